"""Audit: stored 3D against what follows from the stored 2D."""

from dataclasses import dataclass

import numpy as np

from mocap.arrays import Array
from mocap.records import MarkerTracks


@dataclass(frozen=True, kw_only=True)
class StalePoint:
    """A stored point that does not follow from its pixels.

    Attributes:
        frame: Row of the file, from 1.
        marker: Its name.
        off_m: Distance from the point that follows from the pixels; None where the pixels give none.
    """

    frame: int
    marker: str
    off_m: float | None


def stale_points(xyz_m: Array, stored: MarkerTracks, *, tolerance_m: float = 2e-6) -> list[StalePoint]:
    """Stored points further than ``tolerance_m`` from those that the pixels give, or that the pixels do not give.

    Args:
        xyz_m: (T, M, 3) linear triangulation of the pixels.
        stored: The stored points of the same frames and markers.
        tolerance_m: Print precision of the files leaves 1e-6.

    Raises:
        ValueError: the stored points have another number of frames or markers.
    """
    if stored.xyz_m.shape != xyz_m.shape:
        raise ValueError(
            f"stored points are {stored.xyz_m.shape[:2]} (frames, markers), the pixels give {xyz_m.shape[:2]}: "
            "the files do not belong together"
        )
    off = np.linalg.norm(xyz_m - stored.xyz_m, axis=-1)
    stale = stored.seen & ~(off <= tolerance_m)
    return [
        StalePoint(frame=int(t) + 1, marker=stored.names[m], off_m=float(off[t, m]) if np.isfinite(off[t, m]) else None)
        for t, m in np.argwhere(stale)
    ]
