"""How far a track lies from what was measured: a sample that was moved far was not measured there."""

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.pipeline.recording import Recording
from mocap.records import MarkerTracks, Status

FAR = 3.0
"""A sample is not called measured if it lies more than so many standard deviations from where it was measured."""
MOVED = {"moved": f"the track lies more than {FAR:g} standard deviations from where the sample was measured"}
"""Why a sample was rejected here, by the key that reports use."""


def moved(recording: Recording, xyz_m: Array, cov_m2: Array) -> tuple[Array, NDArray[np.bool_]]:
    """How (T, M, 3) positions with their (T, M, 3, 3) covariance lie from the measured ones, NaN without one.

    (T, M, 3) metres from the points of the believed clicks, or the positions of the file; and whether their length is
    more than ``FAR`` standard deviations.

    The distance of a measurement from its estimate has at most the covariance of both together; its deviation here is
    the root mean square over the three coordinates.
    """
    off = xyz_m - recording.xyz_m
    total = np.trace(cov_m2 + recording.cov_m2, axis1=-2, axis2=-1) / 3
    with np.errstate(invalid="ignore"):
        return off, np.linalg.norm(off, axis=-1) > FAR * np.sqrt(total)


def moved_report(recording: Recording, markers: MarkerTracks) -> dict[str, object]:
    """Median, 90 % and largest distance in mm of all that was measured and believed, and where the largest is."""
    off_m, far = moved(recording, markers.xyz_m, markers.cov_m2)
    distance_m = np.linalg.norm(off_m, axis=-1)
    rejected = np.any(list(recording.rejected.values()), axis=0)
    far &= (markers.status == Status.REJECTED) & ~rejected
    known = ((markers.status == Status.MEASURED) | far) & np.isfinite(distance_m)
    if not known.any():
        return {"median_mm": None, "90%_mm": None, "largest": None, "beyond_3_sd": 0, "samples": []}
    distance = np.where(known, 1e3 * distance_m, -1.0)
    frame, marker = (int(i) for i in np.unravel_index(np.argmax(distance), distance.shape))
    return {
        "median_mm": float(np.median(distance[known])),
        "90%_mm": float(np.quantile(distance[known], 0.9)),
        "largest": {"frame": frame + 1, "marker": markers.names[marker], "mm": float(distance[frame, marker])},
        "beyond_3_sd": int(far.sum()),
        "samples": [
            {"frame": int(t) + 1, "marker": markers.names[m], "mm": float(distance[t, m])} for t, m in np.argwhere(far)
        ],
    }
