"""Points and exchanged names, judged by what two people clicked."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.arena.flights import PAIRS, Flight
from benchmarks.arena.methods import Outcome
from eal.arrays import Z95, Array
from mocap.cameras.triangulate import project

RIGHT_M = 0.01
"""A pair counts as put right if both points are within that of their own landmarks."""


SAME_PX = 5.0
"""Clicks of two markers that lie closer than that are not judged: an exchange changes nothing."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Errors:
    """How far points are from what people say.

    Attributes:
        distance_m: (n,) distances.
        inside: (n, 3) whether coordinates are inside 95 % intervals; empty without covariance.
    """

    distance_m: Array
    inside: NDArray[np.bool_]


def errors(outcome: Outcome, truth_m: Array, *, more_m2: Array | None = None) -> Errors:
    """Distances of all points that have a truth.

    Args:
        outcome: Of a method.
        truth_m: (T, M, 3) what people say.
        more_m2: (T, M, 3, 3) covariance of the truth, added to that of the method.
    """
    off = outcome.xyz_m - truth_m
    known = np.isfinite(off[..., 0])
    inside = np.zeros((0, 3), dtype=bool)
    if outcome.cov_m2 is not None:
        cov = outcome.cov_m2 if more_m2 is None else outcome.cov_m2 + np.nan_to_num(more_m2)
        sd = np.sqrt(np.diagonal(cov, axis1=-2, axis2=-1))
        inside = np.abs(off[known]) <= Z95 * sd[known]
    return Errors(distance_m=np.linalg.norm(off[known], axis=-1), inside=inside)


@dataclass(frozen=True, kw_only=True)
class Names:
    """Exchanged names in frames that people digitised; counts of pairs of left and right in a frame.

    Attributes:
        pairs: Pairs that can be judged.
        exchanged: Pairs whose points are nearer to each other's landmark.
        crossed: Pairs whose clicks are exchanged in at least one camera.
        put_right: Of these, pairs both of whose points are within ``RIGHT_M`` of their own landmarks.
        right: Clicks of two markers that the method exchanged, rightly.
        wrong: The same, wrongly.
    """

    pairs: int = 0
    exchanged: int = 0
    crossed: int = 0
    put_right: int = 0
    right: int = 0
    wrong: int = 0

    def __add__(self, other: "Names") -> "Names":
        """Of both."""
        return Names(**{name: value + getattr(other, name) for name, value in vars(self).items()})


def names(flight: Flight, outcome: Outcome) -> Names:
    """How a method dealt with exchanged names."""
    truth, at = flight.truth_m, project(flight.recording.matrices, flight.truth_m)
    total = Names()
    for left, right in PAIRS:
        known = np.isfinite(truth[:, [left, right], 0]).all(axis=1)
        points = outcome.xyz_m[:, [left, right]]
        judged = known & np.isfinite(points[..., 0]).all(axis=1)
        crossed = known & np.any(
            [_crossed(uv[:, [left, right]], there[:, [left, right]]) > 0 for uv, there in _views(flight, at)], axis=0
        )
        own = np.linalg.norm(points - truth[:, [left, right]], axis=-1)
        total += Names(
            pairs=int(judged.sum()),
            exchanged=int((_crossed(points, truth[:, [left, right]]) > 0)[judged].sum()),
            crossed=int(crossed.sum()),
            put_right=int((crossed & (own < RIGHT_M).all(axis=1)).sum()),
        )
    for swap in outcome.swaps:
        pair = [swap.a, swap.b]
        for camera, (uv, there) in enumerate(_views(flight, at)):
            if swap.camera is not None and camera != swap.camera:
                continue
            gain = _crossed(uv[swap.frames][:, pair], there[swap.frames][:, pair])
            total += Names(right=int((gain > SAME_PX).sum()), wrong=int((gain < -SAME_PX).sum()))
    return total


def _views(flight: Flight, at: Array) -> list[tuple[Array, Array]]:
    return list(zip(flight.recording.ideal_px, at, strict=True))


def _crossed(both: Array, truth: Array) -> Array:
    """(K,) by how much exchanging (K, 2, d) places of two markers brings them nearer to the truth.

    0 where unknown; where one of the two is not seen the other decides.
    """
    own = np.linalg.norm(both - truth, axis=-1)
    other = np.linalg.norm(both - truth[:, ::-1], axis=-1)
    gain = own - other
    return np.where(np.isfinite(gain).any(axis=1), np.nansum(gain, axis=1), 0.0)
