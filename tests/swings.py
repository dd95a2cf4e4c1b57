"""Simulated trials of a joint that swings, for the tests that compare groups of trials."""

import numpy as np

from eal.arrays import Array


def draw(
    rng: np.random.Generator, count: int, *, posture: tuple[float, float], reach: tuple[float, float], frames: int = 150
) -> list[Array]:
    """Trials of three swings, with 1 degree of noise a frame.

    Args:
        rng: For all of it.
        count: Number of trials.
        posture: Middle of the range in degrees, and its standard deviation between trials.
        reach: Of the swing to either side, and its standard deviation between trials.
        frames: N.

    Returns:
        (N, 1) samples of each trial, in degrees.
    """
    found = []
    for _ in range(count):
        middle, half = rng.normal(*posture), rng.normal(*reach)
        phase = rng.uniform(0.0, 2.0 * np.pi) + np.linspace(0.0, 6.0 * np.pi, frames)
        found.append((middle + half * np.sin(phase) + rng.standard_normal(frames))[:, None])
    return found
