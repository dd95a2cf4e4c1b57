"""Does it pay to use the triangle of L in A A^T?

The factor L is lower triangular and the state holds marker after marker, so that sigma point j moves only markers from
j / 3 on: row j of the whitened ensemble A is zero in the columns of the markers before. With columns in the order of
markers A is a staircase, and of the k^2 m multiplications of one triangle of A A^T a third is left; of the projections
of sigma points half are.

Compared at n = 204 (k = 102 columns of L move positions, rows [G; E]): one dsyrk of all of A, as the engine does;
blocks, each with one dgemm of its rows with all before on the columns that they share; and the floor, the third of the
multiplications at the speed of a large dgemm in the same run.

Settled: it does not pay enough. The best blocks (17 or 34) take 0.64 to 0.86 of dsyrk's time while the machine is quiet
(1.3 to 1.8 times the floor; dsyrk has 1.7 to 2.2), and more than dsyrk, up to twice, while neighbours use its caches; h
on moved markers takes 0.4 to 0.8 of h on all. The rows of A would have to be kept interleaved and its columns sorted by
marker, and a pose in a subspace moves all markers with every column: it has no staircase. The engine stays as it is.

    python -m design.blocked_gram
"""

import numpy as np
from scipy.linalg.blas import dgemm, dsyrk  # type: ignore[attr-defined]  # made at run time

from benchmarks.timing import interleaved

K = 102


def staircase(rng: np.random.Generator, m: int) -> np.ndarray:
    """(2 K, m) ensemble rows [G; E] in Fortran order, columns in the order of 34 markers."""
    marker = np.sort(np.arange(m) * (K // 3) // m)
    rows = rng.normal(size=(K, m)) * (marker >= np.arange(K)[:, None] // 3)
    return np.asfortranarray(np.concatenate([rows, 0.1 * rng.normal(size=(K, m)) * (rows != 0)]))


def blocked(a: np.ndarray, block: int) -> np.ndarray:
    """Lower triangle of A A^T by blocks of ``block`` columns of L, rows interleaved as [G_0; E_0; G_1; E_1; ...].

    The result is in that order of rows: the engine would keep A so.
    """
    m, size = a.shape[1], 2 * block
    out = np.zeros((2 * K, 2 * K), order="F")
    for start in range(0, 2 * K, size):
        first = (start // 2 // 3) * m // (K // 3)  # columns of the markers that this block moves
        shared = a[: start + size, first:]
        out[start : start + size, : start + size] = dgemm(1.0, shared[start:], shared, trans_b=1)
    return out


def interleave(a: np.ndarray, block: int) -> np.ndarray:
    """[G; E] to [G_0; E_0; G_1; E_1; ...]."""
    order = np.arange(2 * K).reshape(2, K // block, block).transpose(1, 0, 2).ravel()
    return np.asfortranarray(a[order])


def main() -> None:
    """Print the table."""
    rng = np.random.default_rng(0)
    print(f"{'m':>6}{'':22}{'us':>9}{'x dsyrk':>9}{'x floor':>9}")
    for m in (120, 600, 2040):
        a = staircase(rng, m)
        whole = a @ a.T
        calls = {"dsyrk of all (engine)": lambda a=a: dsyrk(1.0, a, lower=1)}
        for block in (17, 34, 51):
            b = interleave(a, block)
            order = np.arange(2 * K).reshape(2, K // block, block).transpose(1, 0, 2).ravel()
            np.testing.assert_allclose(np.tril(blocked(b, block)), np.tril(whole[np.ix_(order, order)]), atol=1e-9)
            calls[f"blocks of {block}"] = lambda b=b, block=block: blocked(b, block)
        large = np.asfortranarray(rng.normal(size=(600, 600)))
        calls["dgemm 600^3"] = lambda large=large: dgemm(1.0, large, large)
        steps = rng.normal(size=(K // 3, 2 * K, 3))  # (marker, sigma point, coordinate)
        cameras = rng.normal(size=(3, 3 * m // 2 // (K // 3) + 3))
        calls["h of all points"] = lambda p=steps, c=cameras: p @ c
        calls["h of moved markers"] = lambda p=steps, c=cameras: [
            p[j // 3 :, 2 * j : 2 * j + 34] @ c for j in range(0, K, 17)
        ]
        seconds = {name: timing.median_s for name, timing in interleaved(calls, repeats=31, budget_s=3).items()}
        rate = 2 * 600**3 / seconds.pop("dgemm 600^3")
        floor = (2 * K) ** 2 * m / 3 / rate
        h_all, h_moved = seconds.pop("h of all points"), seconds.pop("h of moved markers")
        base = seconds["dsyrk of all (engine)"]
        for name, value in seconds.items():
            print(f"{m:6}  {name:20}{1e6 * value:9.0f}{value / base:9.2f}{value / floor:9.2f}")
        print(f"{m:6}  {'floor':20}{1e6 * floor:9.0f}{floor / base:9.2f}{1:9.2f}")
        print(f"{m:6}  {'h, moved / all':20}{1e6 * h_moved:9.0f}{h_moved / h_all:9.2f}  (of {1e6 * h_all:.0f} us)")


if __name__ == "__main__":
    main()
