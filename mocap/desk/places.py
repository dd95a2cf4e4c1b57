"""Where a correction would settle most, in the order in which a person works."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array, true_runs
from mocap.records import MarkerTracks, Status
from mocap.text import number_of

MOST = 300
"""A person works from the top, and the list is made anew after each correction."""


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where a correction would settle something.

    Attributes:
        frame: Row, from 0.
        marker: Its number.
        first: First row of the run that a correction settles.
        last: Its last.
        worth_m2: Squared error that is expected in the run, summed over its frames.
        why: In a person's words.
        camera: In whose image; None: in any.
    """

    frame: int
    marker: int
    first: int
    last: int
    worth_m2: float
    why: str
    camera: int | None = None


def unsettled(tracks: MarkerTracks, measured_m: Array) -> Array:
    """(T, M) squared error that is expected of each sample, in square metres; NaN where there is no position.

    The trace of its covariance; where a measurement was not believed also the variance of two hypotheses that are a
    distance d apart and equally likely, d^2 / 4.

    Args:
        tracks: What was tracked.
        measured_m: (T, M, 3) what was measured, believed or not; NaN where it was not seen.
    """
    apart = np.sum((tracks.xyz_m - measured_m) ** 2, axis=-1)
    doubted = (tracks.status == Status.REJECTED) & np.isfinite(apart)
    return np.trace(tracks.cov_m2, axis1=-2, axis2=-1) + np.where(doubted, np.nan_to_num(apart) / 4, 0.0)


def places(tracks: MarkerTracks, measured_m: Array, done: NDArray[np.bool_]) -> list[Place]:
    """Where corrections would settle most, the most first.

    A correction settles the run of frames of its marker that were not measured, or, in a run that was, its frame: of
    each run the frame with the largest expected error is asked for.

    Args:
        tracks: What was tracked.
        measured_m: As of ``unsettled``.
        done: (T, M) True where a person has been.
    """
    worth = unsettled(tracks, measured_m)
    left = np.isfinite(worth) & ~done
    measured = tracks.status == Status.MEASURED
    found = []
    for m in range(len(tracks.names)):
        for whole in (False, True):
            for first, stop in true_runs((measured[:, m] == whole) & left[:, m]):
                part = worth[first:stop, m]
                at = int(first + np.argmax(part))
                n = stop - first
                total = float(part.max() if whole else part.sum())
                status = Status(int(tracks.status[at, m]))
                why = {
                    Status.MEASURED: "digitised, but uncertain",
                    Status.REJECTED: "digitised, and not believed: two places are possible",
                    Status.PREDICTED: f"not seen at an end, {number_of(n, 'frame')}",
                }.get(status, f"not seen for {number_of(n, 'frame')}")
                bounds = (at, at) if whole else (int(first), int(stop) - 1)
                found.append(Place(frame=at, marker=m, first=bounds[0], last=bounds[1], worth_m2=total, why=why))
    return sorted(found, key=lambda place: -place.worth_m2)[:MOST]
