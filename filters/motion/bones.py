"""Rigid bones: distances of markers that keep their length, as a potential that holds the pose."""

from dataclasses import dataclass

import numpy as np
from mocap.filters.motion.enforce import Term
from numpy.typing import NDArray

from eal.arrays import Array


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


@dataclass(frozen=True, eq=False)
class Differences:
    """Differences of the ends of bones, as some state has them.

    Attributes:
        mean: (B, 3).
        cov: (B, 3, 3).
    """

    mean: Array
    cov: Array


def differences(bones: Bones, pose: Array, deviations: Array) -> Differences:
    """Of a pose (M, 3) with ensemble rows (k, M, 3)."""
    a, b = bones.ends.T
    rows = np.swapaxes(deviations[:, a] - deviations[:, b], 0, 1)
    return Differences(pose[a] - pose[b], np.swapaxes(rows, 1, 2) @ rows)


def bones_term(
    bones: Bones, pose: Array, deviations: Array, stiffness: float, *, about: Differences | None = None
) -> Term:
    """V_b, linearised.

    The difference of two markers has the mean d and, across it, the covariance P. Their distance then has the mean
    |d| + tr P / 2|d| and, besides the part that is linear in the state, the variance tr P^2 / 2|d|^2 (second order): of
    a bone whose direction nobody knows the length says little.

    Args:
        bones: The bones.
        pose: (M, 3) mean of the markers, in any frame.
        deviations: (k, M, 3) their ensemble rows in that frame, for the first k columns of the state's factor.
        stiffness: Factor on V_b.
        about: Where distances are linearised; None: the prediction.
    """
    a, b = bones.ends.T
    about = differences(bones, pose, deviations) if about is None else about
    distance = np.maximum(np.linalg.norm(about.mean, axis=1), 1e-3 * bones.length_m)
    unit = about.mean / distance[:, None]
    beside = np.eye(3) - unit[:, :, None] * unit[:, None]
    cov = beside @ about.cov @ beside
    longer = np.trace(cov, axis1=1, axis2=2) / (2 * distance)
    bent = np.einsum("bij,bij->b", cov, cov) / (2 * distance**2)
    sd = np.sqrt((bones.sd_m**2 + bent) / stiffness)
    along = np.einsum("kbi,bi->kb", deviations[:, a] - deviations[:, b], unit)
    expected = distance + longer + np.einsum("bi,bi->b", pose[a] - pose[b] - about.mean, unit)
    return Term(along / sd, (bones.length_m - expected) / sd, np.zeros(len(deviations)))
