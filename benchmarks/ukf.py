"""One step of our unscented Kalman filter and smoother beside filterpy's, on the same sigma points.

``python -m benchmarks.ukf [--quick]``. The state is [positions, velocities] of n / 6 markers under constant velocity;
m rows are seen, of affine cameras (planar) or of pinholes (pixels). "floor" is the time that BLAS takes for A A^T alone
as a full product, A the ensemble rows of the update, and "share" that time over all of ours. The last two columns are
the largest difference of the two programs: means in standard deviations, covariances in units of correlation.
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
from mocap.datasets.rig import tunnel_cameras
from mocap.filters.ensemble import Gaussian, Update, default_points, predict, smooth_step, update
from mocap.filters.motion.constant_velocity import white_acceleration
from mocap.filters.unscented import UnscentedKalmanFilter as OurFilter
from scipy.linalg.blas import dgemm  # type: ignore[attr-defined]  # made at run time
from threadpoolctl import threadpool_limits

from benchmarks.timing import interleaved
from eal.arrays import Array
from mocap.cameras.camera import project, stacked

DT_S = 1 / 240
SD_PX = 1.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Problem:
    """A state before a step, and what is seen after it.

    Attributes:
        name: What observes.
        noise: (n, n) lower factor of the noise of a step.
        start: State of size n = 6 M.
        h: (S, 3 M) positions to (S, m) rows.
        y: (m,) observations of standard deviation ``SD_PX``.
    """

    name: str
    noise: Array
    start: Gaussian
    h: Callable[[Array], Array]
    y: Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Row:
    """One line of the table; times in milliseconds."""

    n: int
    m: int
    what: str
    ours_ms: float
    peer_ms: float
    floor_ms: float
    off_mean: float
    off_cov: float


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="without m = 2040, fewer repeats")
    quick = parser.parse_args().quick
    sizes = [(12, 8), (60, 120), (204, 600)] + ([] if quick else [(204, 2040)])
    columns = ("ours ms", "filterpy ms", "ratio", "floor ms", "share", "|dx|/sd", "|dP| corr")
    print(f"{'n':>4} {'m':>5}  {'predict + update':<18}" + "".join(f"{c:>12}" for c in columns))
    for n, m in sizes:
        for affine in (True, False):
            for row in compare(problem(n, m, affine=affine), repeats=3 if quick else 11, budget_s=1 if quick else 8):
                floor = f"{row.floor_ms:>12.3f}{row.floor_ms / row.ours_ms:>12.0%}" if row.floor_ms else f"{'':>24}"
                print(
                    f"{row.n:>4} {row.m:>5}  {row.what:<18}{row.ours_ms:>12.3f}{row.peer_ms:>12.2f}"
                    f"{row.peer_ms / row.ours_ms:>12.0f}{floor}{row.off_mean:>12.0e}{row.off_cov:>12.0e}"
                )
    own_models(repeats=3 if quick else 11, budget_s=1 if quick else 8)


def own_models(*, repeats: int, budget_s: float) -> None:
    """Print what ``mocap.filters.UnscentedKalmanFilter`` takes for a model that is not ours, beside filterpy's."""
    columns = "".join(f"{c:>14}" for c in ("ours ms", "filterpy ms", "ratio"))
    print(f"\n{'n':>4} {'m':>5}  {'a model of your own':<20}{columns}")
    for n, m in ((4, 2), (12, 8), (60, 120), (204, 600)):
        rng = np.random.default_rng(0)
        moves, sees = np.eye(n) + 0.01 * rng.normal(size=(n, n)), rng.normal(size=(m, n)) / n
        z = rng.normal(size=m)
        for kind, vectorised in (("one by one", False), ("all at once", True)):
            model = {
                "dim_x": n,
                "dim_z": m,
                "dt": DT_S,
                "fx": lambda x, _dt, moves=moves: x @ moves.T + 0.01 * np.sin(x),
                "hx": lambda x, sees=sees: np.tanh(x @ sees.T),
                "points": MerweScaledSigmaPoints(n, alpha=0.5, beta=2.0, kappa=1.0),
            }
            filters = (OurFilter(**model, vectorised=vectorised), UnscentedKalmanFilter(**model))
            for one in filters:
                one.Q, one.R = 0.01 * np.eye(n), 0.1 * np.eye(m)
            steps = {
                name: (lambda one=one, z=z: (one.predict(), one.update(z)))
                for name, one in zip(("ours", "peer"), filters, strict=True)
            }
            times = interleaved(steps, repeats=repeats, budget_s=budget_s)
            ours, peer = (1e3 * times[name].median_s for name in ("ours", "peer"))
            print(f"{n:>4} {m:>5}  {kind:<20}{ours:>14.2f}{peer:>14.2f}{peer / ours:>14.1f}")


def problem(n: int, m: int, *, affine: bool, seed: int = 0) -> Problem:
    """Markers in the middle of the bat's tunnel, with positions and velocities correlated at random.

    Args:
        n: Size of the state, a multiple of 6.
        m: Number of rows; the markers' pixels in as many cameras as needed, without the last ones.
        affine: Whether the cameras are affine ones that touch the pinholes at the origin.
        seed: Of the random numbers.
    """
    rng = np.random.default_rng(seed)
    k = n // 2
    matrices = stacked(tunnel_cameras(max(2, -(-3 * m // (2 * k)))))
    if affine:
        centre = matrices[:, 2:, 3:]
        tangent = matrices[:, :2, :3] - matrices[:, :2, 3:] / centre * matrices[:, 2:, :3]
        matrices = np.concatenate([np.concatenate([tangent, matrices[:, :2, 3:]], axis=2), matrices[:, 2:]], axis=1)
        matrices[:, 2, :3] = 0

    def h(positions: Array) -> Array:
        pixels = project(matrices, positions.reshape(len(positions), -1, 3))  # (C, S, M, 2)
        return np.moveaxis(pixels, 1, 0).reshape(len(positions), -1)[:, :m]

    place = rng.uniform(-0.15, 0.15, k)
    l11, l21, l22 = white_acceleration(np.full(k, 30.0), DT_S)
    noise = np.block([[np.diag(l11), np.zeros((k, k))], [np.diag(l21), np.diag(l22)]])
    loadings = rng.standard_normal((n, n))
    correlation = 0.5 * np.eye(n) + 0.5 * np.corrcoef(loadings)
    sd = np.repeat([3e-3, 0.3], k)
    start = Gaussian(np.concatenate([place, rng.standard_normal(k)]), sd[:, None] * np.linalg.cholesky(correlation))
    true = advance((start.mean + start.factor @ rng.standard_normal(n))[None], DT_S)
    y = h(true[:, :k])[0] + SD_PX * rng.standard_normal(m)
    return Problem(name="planar" if affine else "pixels", noise=noise, start=start, h=h, y=y)


def advance(states: Array, dt_s: float) -> Array:
    """(S, n) states of constant velocity a step later."""
    k = states.shape[1] // 2
    return np.concatenate([states[:, :k] + dt_s * states[:, k:], states[:, k:]], axis=1)


def compare(case: Problem, *, repeats: int, budget_s: float) -> list[Row]:
    """Time a step and a smoothing step of both programs, and compare their states."""
    n, m = len(case.start.mean), len(case.y)
    k, noise, sd, points = n // 2, case.noise, np.full(m, SD_PX), default_points(n)

    def step(states: Array) -> Array:
        return advance(states, DT_S)

    def ours() -> tuple[Gaussian, Update]:
        prediction = predict(case.start, step, noise, points)
        return prediction.state, update(prediction.state, lambda x: case.h(x[:, :k]), case.y, sd, points)

    peer = UnscentedKalmanFilter(
        dim_x=n,
        dim_z=m,
        dt=DT_S,
        fx=lambda x, dt: advance(x[None], dt)[0],
        hx=lambda x: case.h(x[None, :k])[0],
        points=default_points(n),
    )
    peer.Q, peer.R = noise @ noise.T, SD_PX**2 * np.eye(m)
    start_cov = case.start.cov

    def theirs() -> None:
        peer.x, peer.P = case.start.mean.copy(), start_cov.copy()
        peer.predict()
        peer.update(case.y)

    with threadpool_limits(1):
        _, after = ours()
        theirs()
        states = np.stack([case.start.mean, peer.x]), np.stack([start_cov, peer.P])
        prediction = predict(case.start, step, noise, points)
        smoothed = smooth_step(case.start, prediction, after.state)
        peer_mean, peer_cov, _ = peer.rts_smoother(*states)
    a = np.ones((2 * n, m), order="F")
    times = interleaved(
        {
            "ours": ours,
            "peer": theirs,
            "floor": lambda: dgemm(1.0, a, a, trans_b=1),
            "ours back": lambda: smooth_step(case.start, prediction, after.state),
            "peer back": lambda: peer.rts_smoother(*states),
        },
        repeats=repeats,
        budget_s=budget_s,
    )
    ms = {name: 1e3 * timing.median_s for name, timing in times.items()}
    forward = Row(
        n=n,
        m=m,
        what=case.name,
        ours_ms=ms["ours"],
        peer_ms=ms["peer"],
        floor_ms=ms["floor"],
        **difference(after.state, states[0][1], states[1][1]),
    )
    if case.name == "pixels":
        return [forward]
    backward = Row(
        n=n,
        m=m,
        what="  smoother",
        ours_ms=ms["ours back"],
        peer_ms=ms["peer back"],
        floor_ms=0.0,
        **difference(smoothed, peer_mean[0], peer_cov[0]),
    )
    return [forward, backward]


def difference(ours: Gaussian, mean: Array, cov: Array) -> dict[str, float]:
    """Largest difference of means in standard deviations, and of covariances in units of correlation."""
    sd = np.sqrt(np.diag(ours.cov))
    return {
        "off_mean": float(np.abs((ours.mean - mean) / sd).max()),
        "off_cov": float(np.abs((ours.cov - cov) / np.outer(sd, sd)).max()),
    }


if __name__ == "__main__":
    main()
