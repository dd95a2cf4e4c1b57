"""Gaps in which a marker jumps: which of two places it is at is not known."""

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.pipeline.recording import Recording
from mocap.records import Status


def jump_cov(prepared: Recording, xyz_m: Array, origin: NDArray[np.int8]) -> Array:
    """(T, M, 3, 3) covariance of what was filled across a jump, from the last believed sample to the next.

    The marker is at one place or at the other, d apart: half of that either way, a covariance of d d^T / 4.

    Args:
        prepared: The recording; ``audited`` has its jumps.
        xyz_m: (T, M, 3) positions of the track.
        origin: (T, M) origin of each sample.
    """
    out = np.zeros((*origin.shape, 3, 3))
    for jump in (f for f in prepared.audited if f.kind == "jump"):
        for marker in (prepared.names.index(name) for name in jump.markers):
            believed = np.flatnonzero(origin[:, marker] == Status.MEASURED)
            before, after = believed[believed < jump.frames[1] - 1], believed[believed >= jump.frames[1] - 1]
            if len(before) and len(after):
                far = (xyz_m[after[0], marker] - xyz_m[before[-1], marker]) / 2
                out[before[-1] + 1 : after[0], marker] += np.outer(far, far)
    return out
