"""Rigid bones: distances of markers that keep their length, as a potential that holds the pose."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from filters.ensemble import Gaussian, condition
from mocap.arrays import Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Bones:
    """B distances that are kept: V_b = sum (|a - b| - L)^2 / (2 s^2).

    Attributes:
        ends: (B, 2) indices of the markers a and b.
        length_m: (B,) lengths L.
        sd_m: (B,) deviation s of the distance from that.
    """

    ends: NDArray[np.int64]
    length_m: Array
    sd_m: Array


def hold_bones(state: Gaussian, bones: Bones, pose: Array, deviations: Array, stiffness: float) -> Gaussian:
    """A state held by its bones: an implicit step of the penalised mechanics, as ``enforce`` makes it for V_z.

    The difference of two markers has the mean d and, across it, the covariance P. Their distance then has the mean
    |d| + tr P / 2|d| and, besides the part that is linear in the state, the variance tr P^2 / 2|d|^2 (second order): of
    a bone whose direction nobody knows the length says little.

    Args:
        state: Predicted state.
        bones: The bones.
        pose: (M, 3) mean of the markers, in any frame.
        deviations: (k, M, 3) their ensemble rows in that frame, for the first k columns of the state's factor.
        stiffness: Factor on V_b.
    """
    a, b = bones.ends.T
    difference, rows = pose[a] - pose[b], deviations[:, a] - deviations[:, b]
    distance = np.maximum(np.linalg.norm(difference, axis=1), 1e-3 * bones.length_m)
    unit = difference / distance[:, None]
    along = np.einsum("kbi,bi->kb", rows, unit)
    across = np.swapaxes(rows - along[..., None] * unit, 0, 1)
    cov = np.swapaxes(across, 1, 2) @ across
    longer = np.trace(cov, axis1=1, axis2=2) / (2 * distance)
    bent = np.einsum("bij,bij->b", cov, cov) / (2 * distance**2)
    sd = np.sqrt((bones.sd_m**2 + bent) / stiffness)
    return condition(state, along / sd, (bones.length_m - distance - longer) / sd, len(deviations))[0]
