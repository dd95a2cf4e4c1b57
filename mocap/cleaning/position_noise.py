"""The noise of measured positions without cameras."""

import numpy as np

from eal.arrays import Array, varying
from mocap.records import MarkerTracks


def position_sd(tracks: MarkerTracks) -> Array:
    """(T, M) standard deviation of a coordinate from fourth differences, which smooth motion hardly feels.

    White noise of variance s^2 gives fourth differences of variance 70 s^2. Digitising errors have heavy tails: the
    result is the root mean square of a marker's differences within five robust standard deviations (their median is
    0.6745 of one). Markers with too few samples take the median of the others, and all at least 1e-6 m.
    Points in a plane have two coordinates.
    """
    size = np.abs(np.asarray(np.diff(tracks.xyz_m[..., varying(tracks.xyz_m)], n=4, axis=0))) / np.sqrt(70)
    sd: Array = np.full(tracks.xyz_m.shape[1], np.nan)
    for marker in range(len(sd)):
        known = size[:, marker][np.isfinite(size[:, marker])]
        if len(known) >= 15:
            near = known[known <= 5 * np.median(known) / 0.6745]
            sd[marker] = np.sqrt(np.mean(near**2))
    fallback = np.nanmedian(sd) if np.isfinite(sd).any() else 1e-3
    return np.broadcast_to(np.maximum(np.where(np.isfinite(sd), sd, fallback), 1e-6), tracks.xyz_m.shape[:2])
