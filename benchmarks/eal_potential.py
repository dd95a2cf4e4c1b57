"""Learning and evaluating V: pivoted Cholesky beside a plain eigendecomposition and scikit-learn.

``python -m benchmarks.eal_potential [--quick]``. Every row is measured in this run, on one BLAS thread; ratios are
times over ours, "off by" is the largest difference of V from the exact one on 500 configurations (at N = 1e4 from the
randomised one), "bound" our own bound on it. scikit-learn's Nystroem map with the tail filter on top is the same V on
centres drawn at random; KernelPCA (centred) and OneClassSVM are other descriptions of a support, and have no V.
"""

import argparse

import numpy as np
from scipy.linalg import eigh
from sklearn.decomposition import KernelPCA
from sklearn.kernel_approximation import Nystroem
from sklearn.svm import OneClassSVM
from threadpoolctl import threadpool_limits

from benchmarks.timing import timed
from eal import EmpiricalPotential, GaussianKernel, fit_potential
from eal.arrays import Array

BETA, LAM, QUERIES = 3.0, 1e-6, 500


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="N up to 1e4")
    quick = parser.parse_args().quick
    with threadpool_limits(1):
        planar(quick)
        noisy_thirty(quick)
        batches()


def planar(quick: bool) -> None:
    """A circle in the plane, lambda = 1e-6."""
    print(f"planar circle, beta = {BETA:g}, lambda = {LAM:g}; evaluation of {QUERIES} configurations")
    print(
        f"{'N':>7} {'method':<34}{'learn s':>10}{'ratio':>8}{'evaluate ms':>13}{'ratio':>8}{'off by':>10}{'bound':>10}"
    )
    rng = np.random.default_rng(0)
    for n in (1000, 10_000) if quick else (1000, 4000, 10_000, 100_000):
        z, q = circle(rng, n), 1.5 * rng.standard_normal((QUERIES, 2))
        learn, ours = timed(lambda z=z: fit_potential(z, kernel=GaussianKernel(BETA), lam=LAM))
        evaluate, v = timed(lambda ours=ours, q=q: ours.value(q))
        m, rows, exact = len(ours.centres), [], None
        if n <= 4000:
            spent, plain = timed(lambda z=z: plain_fit(z, LAM), repeats=1)
            late, exact = timed(lambda z=z, q=q, plain=plain: plain_value(z, plain, q))
            rows.append(("numpy, full eigendecomposition", spent, late, exact))
        if n == 10_000:
            spent, thin = timed(lambda z=z: randomised(z), repeats=1)
            late, exact = timed(lambda q=q, thin=thin: thin.value(q))
            rows.append(("ours, randomised, 100 modes", spent, late, exact))
        if n == 10_000 and not quick:
            spent, top = timed(lambda z=z: top_fit(z, LAM), repeats=1)
            late, values = timed(lambda z=z, q=q, top=top: plain_value(z, top, q))
            rows.append(("SciPy eigh, top 60 of K", spent, late, values))
        for size in (m, 4 * m):
            peer = Nystroem(gamma=BETA, n_components=size, random_state=0)
            spent, columns = timed(lambda z=z, peer=peer: nystroem_columns(peer.fit(z).transform(z), LAM))
            late, values = timed(lambda q=q, p=peer, c=columns: 1 - ((p.transform(q) @ c) ** 2).sum(axis=1))
            rows.append((f"scikit-learn Nystroem, m = {size}", spent, late, values))
        if n <= 4000:
            peer = KernelPCA(m, kernel="rbf", gamma=BETA, eigen_solver="dense")
            spent, fitted = timed(lambda z=z, peer=peer: peer.fit(z), repeats=1)
            late, _ = timed(lambda q=q, f=fitted: f.transform(q))
            rows.append((f"scikit-learn KernelPCA, {m} modes", spent, late, None))
        if n <= 10_000:
            spent, svm = timed(lambda z=z: OneClassSVM(gamma=BETA, nu=0.01).fit(z), repeats=1)
            late, _ = timed(lambda q=q, svm=svm: svm.decision_function(q))
            rows.append(("scikit-learn OneClassSVM", spent, late, None))
        for name, spent, late, values in [(f"ours, pivoted Cholesky, m = {m}", learn, evaluate, v), *rows]:
            line(n, name, spent, late, values, exact, ours if name.startswith("ours, piv") else None, learn, evaluate)


def randomised(z: Array) -> EmpiricalPotential:
    """Our second method, the reference where the full eigendecomposition takes minutes."""
    return fit_potential(z, kernel=GaussianKernel(BETA), lam=LAM, method="randomised", max_rank=100)


def noisy_thirty(quick: bool) -> None:
    """A noisy closed curve in 30 dimensions, lambda = 1e-3."""
    print("\nclosed curve in d = 30 with noise of 1 %, beta = 1, lambda = 1e-3")
    print(
        f"{'N':>7} {'method':<34}{'learn s':>10}{'ratio':>8}{'evaluate ms':>13}{'ratio':>8}{'off by':>10}{'bound':>10}"
    )
    rng = np.random.default_rng(1)
    frame = np.linalg.qr(rng.standard_normal((30, 6)))[0]
    for n in (1000,) if quick else (1000, 2000):
        angle = rng.uniform(0, 2 * np.pi, n)
        waves = np.stack([f(k * angle) / k for k in (1, 2, 3) for f in (np.cos, np.sin)], axis=1)
        z = waves @ frame.T + 0.01 * rng.standard_normal((n, 30))
        q = z[:QUERIES] + 0.1 * rng.standard_normal((min(n, QUERIES), 30))
        kernel = GaussianKernel(1.0)
        learn, ours = timed(lambda z=z, k=kernel: fit_potential(z, kernel=k, lam=1e-3, accuracy=0.05), repeats=1)
        evaluate, v = timed(lambda ours=ours, q=q: ours.value(q))
        plain_learn, exact_fit = timed(
            lambda z=z, k=kernel: fit_potential(z, kernel=k, lam=1e-3, method="exact"), repeats=1
        )
        plain_evaluate, exact = timed(lambda f=exact_fit, q=q: f.value(q))
        name = f"ours, {ours.method}, m = {len(ours.centres)}"
        line(n, name, learn, evaluate, v, exact, ours, learn, evaluate)
        line(n, "full eigendecomposition", plain_learn, plain_evaluate, exact, exact, None, learn, evaluate)


def head() -> None:
    """The head of a table; ratios are times over ours."""
    names = f"{'learn s':>10}{'ratio':>8}{'evaluate ms':>13}{'ratio':>8}{'off by':>10}{'bound':>10}"
    print(f"{'N':>7} {'method':<34}{names}")


def batches() -> None:
    """64 queries: value, gradient and Hessian."""
    print("\n64 configurations at once: microseconds")
    rng = np.random.default_rng(2)
    for label, z in (
        ("d = 2, N = 400", circle(rng, 400)),
        ("d = 30, N = 400, all centres", 0.3 * rng.standard_normal((400, 30))),
    ):
        beta = BETA if z.shape[1] == 2 else 0.3
        potential = fit_potential(z, kernel=GaussianKernel(beta), lam=1e-3)
        q = z[:64] + 0.1
        times = [
            timed(lambda f=f, q=q: f(q), repeats=20)[0] * 1e6
            for f in (potential.value, potential.gradient, potential.hessian)
        ]
        print(f"  {label:<30} value {times[0]:7.0f}  gradient {times[1]:7.0f}  Hessian {times[2]:7.0f}")


def circle(rng: np.random.Generator, n: int) -> Array:
    """Samples on the unit circle."""
    angle = rng.uniform(0, 2 * np.pi, n)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def plain_fit(z: Array, lam: float) -> tuple[Array, Array]:
    """What one writes first: all of K, all of its eigenvectors."""
    squared = ((z[:, None] - z) ** 2).sum(axis=2) if len(z) <= 1000 else _squared(z, z)
    s, u = np.linalg.eigh(np.exp(-BETA * squared))
    return u, 1 / np.maximum(s / len(z), lam) / len(z)


def top_fit(z: Array, lam: float) -> tuple[Array, Array]:
    """The leading 60 eigenpairs of all of K."""
    n = len(z)
    s, u = eigh(np.exp(-BETA * _squared(z, z)), subset_by_index=[n - 60, n - 1])
    return u, 1 / np.maximum(s / n, lam) / n


def plain_value(z: Array, fit: tuple[Array, Array], q: Array) -> Array:
    """V from all samples."""
    u, gain = fit
    return 1 - (np.exp(-BETA * _squared(q, z)) @ u) ** 2 @ gain


def nystroem_columns(features: Array, lam: float) -> Array:
    """The tail filter on the Nystroem features: the same V as ours on randomly drawn centres."""
    s, w = np.linalg.eigh(features.T @ features / len(features))
    return w * np.sqrt(np.clip(s / np.maximum(s, lam), 0.0, 1.0))


def _squared(x: Array, y: Array) -> Array:
    return np.maximum((x**2).sum(axis=1)[:, None] + (y**2).sum(axis=1) - 2 * x @ y.T, 0.0)


def line(
    n: int,
    name: str,
    learn: float,
    evaluate: float,
    v: Array | None,
    exact: Array | None,
    ours: EmpiricalPotential | None,
    our_learn: float,
    our_evaluate: float,
) -> None:
    """One row; ratios are times over ours."""
    off = "" if v is None or exact is None or v is exact else f"{np.abs(v - exact).max():.1e}"
    limit = "" if ours is None else f"{ours.error_bound:.1e}"
    print(
        f"{n:>7} {name:<34}{learn:>10.4f}{learn / our_learn:>8.1f}{1e3 * evaluate:>13.3f}"
        f"{evaluate / our_evaluate:>8.1f}{off:>10}{limit:>10}"
    )


if __name__ == "__main__":
    main()
