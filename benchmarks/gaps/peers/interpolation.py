"""Interpolation of single markers in time: what a program does when it is asked to fill gaps, with or without a filter.

Linear, not-a-knot cubic spline and PCHIP (Fritsch & Butland 1984) are SciPy's. The Butterworth low-pass (fourth order,
forwards and backwards, on linearly filled tracks) is the default of biomechanics (Winter 2009, chapter 3); its cutoff
is the one that fills hidden gaps of the training trials best. So is, for all, the choice of world or body coordinates.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.signal import butter, sosfiltfilt

from benchmarks.gaps.method import Estimate, Filler, Method, Trial
from benchmarks.gaps.peers.coordinates import Body, World, learn_body
from benchmarks.gaps.peers.intervals import tune
from eal.arrays import Array

Curve = Callable[[Array, Array], Callable[[Array], Array]]
"""(n,) times and (n, 3) positions to a function of times."""


def through(y: Array, t_s: Array, curve: Curve, *, least: int) -> Array:
    """Draw a curve through the sightings of every marker.

    Before the first and after the last sighting its position there is held.

    Args:
        y: (T, M, 3) positions; NaN where not seen.
        t_s: (T,) times.
        curve: Fits the curve.
        least: Sightings that it needs; markers with fewer are joined by straight lines.

    Returns:
        (T, M, 3) positions; NaN for markers that are never seen.
    """
    out = np.full_like(y, np.nan)
    for marker in range(y.shape[1]):
        frames = np.flatnonzero(np.isfinite(y[:, marker, 0]))
        if len(frames):
            t, x = t_s[frames], y[frames, marker]
            fit = curve if len(frames) >= least else _straight
            out[:, marker] = fit(t, x)(np.clip(t_s, t[0], t[-1]))
    return out


def _straight(t: Array, x: Array) -> Callable[[Array], Array]:
    return lambda s: np.stack([np.interp(s, t, column) for column in x.T], axis=-1)


CURVES: dict[str, tuple[Curve, int]] = {
    "linear": (_straight, 1),
    "cubic": (CubicSpline, 4),
    "pchip": (PchipInterpolator, 2),
}
"""Each curve with the number of sightings that it needs."""


def low_pass(y: Array, share: float) -> Array:
    """Butterworth filter of order 4, both ways, with a cutoff over the Nyquist frequency; columns with NaN pass."""
    known = np.isfinite(y).all(axis=0)
    flat, keep = y.reshape(len(y), -1).copy(), known.ravel()
    sections = butter(2, share, output="sos")  # both ways: order 4
    if len(y) > 12 and keep.any():
        length = min(len(y) - 1, int(6 / share))
        flat[:, keep] = sosfiltfilt(sections, flat[:, keep], axis=0, padlen=length)
    return flat.reshape(y.shape)


@dataclass(frozen=True, eq=False)
class InterpolationFiller:
    """A curve through the sightings, low-passed where ``share`` is given."""

    coordinates: Body | World
    curve: str
    share: float | None

    def __call__(self, trial: Trial) -> Estimate:
        """Fill every marker on its own."""
        placed = self.coordinates.place(trial)
        curve, least = CURVES[self.curve]
        y = through(placed.y, trial.t_s, curve, least=least)
        return placed.leave(y if self.share is None else low_pass(y, self.share))


@dataclass(frozen=True)
class Interpolation:
    """One curve; the cutoffs to choose from are shares of the Nyquist frequency, None: no filter."""

    name: str
    curve: str
    shares: tuple[float | None, ...] = (None,)

    def learn(self, training: Sequence[Trial]) -> Filler:
        """Choose coordinates and cutoff."""

        def fit(candidate: tuple[bool, float | None], trials: Sequence[Trial]) -> Filler:
            body, share = candidate
            return InterpolationFiller(learn_body(trials) if body else World(), self.curve, share)

        return tune([(body, share) for share in self.shares for body in (True, False)], training, fit)


def peers() -> list[Method]:
    """Three curves and a filter."""
    return [
        Interpolation("linear", "linear"),
        Interpolation("cubic", "cubic"),
        Interpolation("pchip", "pchip"),
        Interpolation("butterworth", "linear", (0.02, 0.05, 0.1, 0.2)),
    ]
