"""The engine for a million frames of random dropouts: no NaN, no negative eigenvalue, and the time that a frame takes.

A body on springs, and observations that bend. Rows come and go: frames with nearly all, few or no rows, dark stretches
of up to a thousand frames, rows as precise as 1e-6 of the prior, and now and then a state that is made as vague as at
the start. After every frame the factor must be finite with a positive diagonal; every thousand frames the least
eigenvalue of the covariance (in units of its deviations) and the distance from the truth are looked at.

    python -m benchmarks.dropouts [--quick]
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from threadpoolctl import threadpool_limits

from filters.ensemble import Gaussian, default_points, predict, update
from mocap.arrays import Array

START_SD = 10.0


@dataclass(frozen=True)
class Outcome:
    """What became of a run.

    Attributes:
        frames: Frames that were filtered.
        dark: Frames without rows.
        seconds: Time of the engine.
        least_pivot: Smallest diagonal entry of a factor over the largest one of its row, over all frames.
        least_eigenvalue: Smallest eigenvalue of the covariance in units of its deviations, over frames looked at.
        inside: Share of components within 1.96 deviations of the truth, over frames looked at.
    """

    frames: int
    dark: int
    seconds: float
    least_pivot: float
    least_eigenvalue: float
    inside: float


def bent(rows: Array) -> Callable[[Array], Array]:
    """(S, n) states to (S, m) observations: a plane wave on a slope in each row's direction."""
    return lambda x: x[:, : rows.shape[1]] @ rows.T + 0.1 * np.sin(x[:, : rows.shape[1]] @ rows.T)


def run(n: int, n_frames: int, *, seed: int = 0, every: int = 1000) -> Outcome:
    """Filter.

    Args:
        n: Size of the state, even: positions, then velocities.
        n_frames: Number of frames.
        seed: Of truth, rows and noise.
        every: Eigenvalues are computed every so many frames.

    Raises:
        FloatingPointError: a factor was not finite, or had a diagonal entry that was not positive.
    """
    rng, half, points = np.random.default_rng(seed), n // 2, default_points(n)
    dt = 0.01
    transition = np.eye(n) + dt * np.diag(np.ones(half), half)
    transition[half:, :half] = -dt * np.eye(half)  # a spring keeps the truth near
    transition[half:, half:] *= 0.999
    noise = np.diag(np.repeat([1e-3, 3e-2], half))
    directions = rng.normal(size=(2 * half, half)) / np.sqrt(half)
    truth = rng.normal(size=n)
    vague = Gaussian(np.zeros(n), START_SD * np.eye(n))
    state, dark_left = vague, 0
    seconds, dark, pivot, eigenvalue, inside = 0.0, 0, np.inf, np.inf, []
    for frame in range(n_frames):
        truth = transition @ truth + noise @ rng.normal(size=n)
        if dark_left == 0 and rng.random() < 3e-4:
            dark_left = int(rng.integers(1, 1000))
        keep = np.flatnonzero(rng.random(2 * half) < rng.choice([0.0, 0.05, 0.3, 0.95]))
        if dark_left:
            dark_left, keep = dark_left - 1, keep[:0]
        rows = directions[keep]
        sd = START_SD * 10.0 ** rng.uniform(-6, -1, len(keep))
        h = bent(rows)
        y = h(truth[None])[0] + sd * rng.normal(size=len(keep))
        start = perf_counter()
        state = predict(state, lambda x: x @ transition.T, noise, points, linear=True).state
        if len(keep):
            state = update(state, h, y, sd, points, reads=half).state
        seconds += perf_counter() - start
        dark += not len(keep)
        diagonal = np.diag(state.factor)
        if not (np.isfinite(state.mean).all() and np.isfinite(state.factor).all() and diagonal.min() > 0):
            raise FloatingPointError(
                f"frame {frame + 1} of seed {seed}, n = {n}: the factor is not that of a covariance"
            )
        pivot = min(pivot, float(np.min(diagonal / np.linalg.norm(state.factor, axis=1))))
        if frame % every == every - 1:
            cov = state.cov
            deviation = np.sqrt(np.diag(cov))
            eigenvalue = min(eigenvalue, float(np.linalg.eigvalsh(cov / np.outer(deviation, deviation)).min()))
            inside.append(np.mean(np.abs(state.mean - truth) <= 1.959964 * deviation))
        if rng.random() < 1e-4:
            state = vague
    return Outcome(n_frames, dark, seconds, pivot, eigenvalue, float(np.mean(inside)) if inside else np.nan)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a hundredth of the frames")
    shorter = 100 if parser.parse_args().quick else 1
    print(f"{'n':>4}{'frames':>9}{'dark':>8}{'us a frame':>12}{'least pivot':>13}{'eigenvalue':>12}{'inside 95 %':>13}")
    with threadpool_limits(1):
        for n, n_frames in ((12, 1_000_000), (60, 50_000)):
            out = run(n, n_frames // shorter)
            print(
                f"{n:4}{out.frames:9}{out.dark:8}{1e6 * out.seconds / out.frames:12.0f}{out.least_pivot:13.1e}"
                f"{out.least_eigenvalue:12.1e}{100 * out.inside:11.1f} %",
                flush=True,
            )


if __name__ == "__main__":
    main()
