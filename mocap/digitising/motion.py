"""Motion of markers on their own: constant acceleration with white jerk, all markers of a frame at once.

The time unit is the frame. A state is [position, velocity, acceleration] in metres, m / frame and m / frame^2: three
chains of three states each for the filter's step in time. Updates are not the filter's: dots are named anew in each
frame, backward in time too, and what comes back is a position's posterior, of rays that other markers have a say in.
"""

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.filters.gaussian import Moments, Move

TRANSITION = np.array([[1.0, 1.0, 0.5], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
"""(3, 3) transition of each coordinate from one frame to the next."""
_JERK = np.array([[1 / 20, 1 / 8, 1 / 6], [1 / 8, 1 / 3, 1 / 2], [1 / 6, 1 / 2, 1.0]])
JERK = np.kron(_JERK, np.eye(3))
"""(9, 9) covariance that white jerk of unit density adds in a frame."""
REVERSED = np.repeat([1.0, -1.0, 1.0], 3)
"""(9,) signs of a state that runs backward."""


@dataclass(frozen=True, eq=False)
class State(Moments):
    """Markers at an instant: (M, 9) means of their states, and (M, 9, 9) covariances."""

    @property
    def xyz_m(self) -> Array:
        """(M, 3) positions."""
        return self.mean[:, :3]

    @property
    def cov_m2(self) -> Array:
        """(M, 3, 3) their covariances."""
        return self.cov[:, :3, :3]

    def turned(self) -> "State":
        """The same, for time that runs backward."""
        return State(self.mean * REVERSED, self.cov * REVERSED[:, None] * REVERSED)

    def looser(self, factor: float) -> "State":
        """With covariances multiplied."""
        return State(self.mean, self.cov * factor)


def predicted(state: State, density: Array) -> State:
    """A frame later; ``density`` (M,) of the jerk in m^2 / frame^5."""
    ahead = Move(np.zeros((0, 0)), TRANSITION, density[:, None, None] * JERK).ahead(state)
    return State(ahead.mean, ahead.cov)


def positioned(state: State, xyz_m: Array, cov_m2: Array, which: NDArray[np.bool_]) -> State:
    """The state when positions are known as they are after an update: (M, 3), (M, 3, 3), for markers (M,) of bool.

    With the gain B = C_xp C_pp^-1 of the state on its position, x = x + B (p' - p), C = C + B (C_pp' - C_pp) B^T.
    """
    x, cov = state.mean.copy(), state.cov.copy()
    before = cov[which][:, :3, :3]
    gain = np.swapaxes(np.linalg.solve(before, cov[which][:, :3, :]), 1, 2)
    x[which] += np.einsum("mij,mj->mi", gain, xyz_m[which] - x[which, :3])
    cov[which] += gain @ (cov_m2[which] - before) @ np.swapaxes(gain, 1, 2)
    return State(x, 0.5 * (cov + np.swapaxes(cov, 1, 2)))


def fused(a: State, b: State) -> State:
    """Two independent opinions on the same states as one (the two-filter smoother; Fraser & Potter 1969)."""
    total = a.cov + b.cov
    gain = np.swapaxes(np.linalg.solve(total, a.cov), 1, 2)
    x = a.mean + np.einsum("mij,mj->mi", gain, b.mean - a.mean)
    cov = a.cov - gain @ a.cov
    return State(x, 0.5 * (cov + np.swapaxes(cov, 1, 2)))


def jerk_density(xyz_m: Array, variance_m2: Array, *, reach: int = 8) -> Array:
    """(T, M) density of white jerk by which positions move, from their third differences near each frame.

    Three integrations of white jerk of density q give third differences of variance 11/20 q a coordinate (the square of
    the quadratic B-spline); errors of positions of variance s^2 add 20 s^2. The median of the squares is used: a place
    that is another marker's counts little.

    Args:
        xyz_m: (T, M, 3) positions; NaN where not known.
        variance_m2: (T, M) variances of the positions, summed over coordinates.
        reach: Frames on each side whose differences count.

    Returns:
        Densities in m^2 / frame^5; of frames without differences near them the greatest of the marker; NaN: none.
    """
    out = np.full(xyz_m.shape[:2], np.nan)
    if len(xyz_m) < 4:
        return out
    square = np.sum(np.diff(xyz_m, n=3, axis=0) ** 2, axis=2)
    pad, none = (np.full((n, xyz_m.shape[1]), np.nan) for n in (reach, 2))
    # the third difference at i is about frame i + 1.5
    rows = np.concatenate([pad, none[:1], square, none, pad])
    near = np.lib.stride_tricks.sliding_window_view(rows, 2 * reach + 1, axis=0)
    noise = np.concatenate([pad, variance_m2, pad])
    noise = np.lib.stride_tricks.sliding_window_view(noise, 2 * reach + 1, axis=0)
    enough = np.isfinite(near).sum(axis=2) >= reach // 2
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of windows without differences
        # the median of chi-square of three degrees of freedom is 2.366
        usual = np.nanmedian(near, axis=2) * 3 / 2.366
        added = 20 * np.nanmedian(noise, axis=2)
        found = np.where(enough, np.maximum(usual - added, 0.1 * usual) / (3 * 11 / 20), np.nan)
        return np.where(enough, found, np.nanmax(found, axis=0))
