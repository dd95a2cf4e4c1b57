"""How often markers are seen and how long they are not, and how far two recordings are apart in that."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import wasserstein_distance

from datasets.gaps import interior_gaps
from mocap.arrays import Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Visibility:
    """How the markers of a recording are seen, from the first to the last frame that shows any.

    Attributes:
        view: (C, M) share of frames in which a camera sees a marker.
        solid: (M,) share of frames in which a marker is seen in 3D: by two cameras, or in a file of positions.
        gaps: Lengths in frames of interior gaps in one camera.
        gaps_3d: Lengths in frames of interior gaps in 3D.
        marker_seconds: Number of markers times duration.
    """

    view: Array
    solid: Array
    gaps: NDArray[np.intp]
    gaps_3d: NDArray[np.intp]
    marker_seconds: float

    @property
    def rate_hz(self) -> float:
        """Gaps in 3D a marker and second."""
        return len(self.gaps_3d) / self.marker_seconds


def visibility(seen: NDArray[np.bool_], *, fps: float) -> Visibility:
    """Of (C, T, M) views, or of (1, T, M) positions in 3D.

    Raises:
        ValueError: nothing is seen in any frame.
    """
    frames = np.flatnonzero(seen.any(axis=(0, 2)))
    if not len(frames):
        raise ValueError("nothing is seen in any frame: there is no visibility to describe")
    seen = seen[:, frames[0] : frames[-1] + 1]
    solid = seen.sum(axis=0) >= min(2, len(seen))
    return Visibility(
        view=seen.mean(axis=1),
        solid=solid.mean(axis=0),
        gaps=np.concatenate([interior_gaps(one)[:, 2] for one in seen]),
        gaps_3d=interior_gaps(solid)[:, 2],
        marker_seconds=solid.size / fps,
    )


def pooled(parts: Sequence[Visibility]) -> Visibility:
    """Several recordings of the same markers by the same cameras as one."""
    return Visibility(
        view=np.mean([p.view for p in parts], axis=0),
        solid=np.mean([p.solid for p in parts], axis=0),
        gaps=np.concatenate([p.gaps for p in parts]),
        gaps_3d=np.concatenate([p.gaps_3d for p in parts]),
        marker_seconds=sum(p.marker_seconds for p in parts),
    )


def merged(parts: Sequence[Visibility]) -> Visibility:
    """Several recordings of different markers as one."""
    return Visibility(
        view=np.concatenate([p.view.ravel() for p in parts])[None],
        solid=np.concatenate([p.solid for p in parts]),
        gaps=np.concatenate([p.gaps for p in parts]),
        gaps_3d=np.concatenate([p.gaps_3d for p in parts]),
        marker_seconds=sum(p.marker_seconds for p in parts),
    )


def distances(a: Visibility, b: Visibility) -> dict[str, float]:
    """How far apart two are; 0 is equal.

    Returns:
        ``view``: mean difference of the shares over cameras and markers, where both have the same; ``3D``: Wasserstein
        distance of the markers' shares; ``gap`` and ``gap3D``: Wasserstein distances of the lengths of gaps in one
        camera and in 3D, in octaves (1: a factor 2); NaN where there are none; ``rate``: ratio of the rates of gaps in
        3D, in octaves, of ``b`` to ``a``.
    """
    found = {"view": float(np.abs(a.view - b.view).mean())} if a.view.shape == b.view.shape else {}
    found["3D"] = float(wasserstein_distance(a.solid, b.solid))
    found["gap"] = _octaves(a.gaps, b.gaps)
    found["gap3D"] = _octaves(a.gaps_3d, b.gaps_3d)
    found["rate"] = float(np.log2(b.rate_hz / a.rate_hz)) if len(a.gaps_3d) and len(b.gaps_3d) else np.nan
    return found


def _octaves(a: NDArray[np.intp], b: NDArray[np.intp]) -> float:
    return float(wasserstein_distance(np.log2(a), np.log2(b))) if len(a) and len(b) else np.nan
