"""Filling gaps as people do today: curves through each marker by itself."""

import numpy as np
from scipy.interpolate import CubicSpline

from eal.arrays import Array


def interpolated(xyz_m: Array, t_s: Array, *, kind: str) -> Array:
    """Every marker interpolated through its gaps, ``linear`` or ``cubic`` (a spline); NaN outside its sightings."""
    out = np.full_like(xyz_m, np.nan)
    for marker in range(xyz_m.shape[1]):
        frames = np.flatnonzero(np.isfinite(xyz_m[:, marker, 0]))
        if len(frames) < 2:
            continue
        inside = slice(frames[0], frames[-1] + 1)
        t, x = t_s[frames], xyz_m[frames, marker]
        if kind == "cubic" and len(frames) >= 4:
            out[inside, marker] = CubicSpline(t, x)(t_s[inside])
        else:
            out[inside, marker] = np.stack([np.interp(t_s[inside], t, x[:, k]) for k in range(3)], axis=-1)
    return out
