"""Rigid bones: distances of markers that keep their length, as a potential that holds the pose."""

from dataclasses import dataclass

import numpy as np
from mocap.filters.gaussian import Markers
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


def bones_term(bones: Bones, markers: Markers, stiffness: float) -> Term:
    """V_b, linearised about the prediction.

    The difference of two markers has the mean d and, across it, the covariance P. Their distance then has the mean
    |d| + tr P / 2|d| and, besides the part that is linear in the state, the variance tr P^2 / 2|d|^2 (second order): of
    a bone whose direction nobody knows the length says little.

    Args:
        bones: The bones.
        markers: In any axes.
        stiffness: Factor on V_b.
    """
    (a, b), view = bones.ends.T, markers.view
    each = markers.spread.reshape(len(view.mean), 3, len(view.mean), 3)
    away = view.mean[a] - view.mean[b]
    spread = each[a, :, a] - each[a, :, b] - each[b, :, a] + each[b, :, b]
    distance = np.maximum(np.sqrt((away**2).sum(axis=1)), 1e-3 * bones.length_m)
    unit = away / distance[:, None]
    seen = (spread @ unit[..., None])[..., 0]
    own = (seen * unit).sum(axis=1)  # variance along the bone
    longer = (np.einsum("bii->b", spread) - own) / (2 * distance)
    bent = ((spread**2).sum(axis=(1, 2)) - 2 * (seen**2).sum(axis=1) + own**2) / (2 * distance**2)
    sd = np.sqrt((bones.sd_m**2 + np.maximum(bent, 0.0)) / stiffness)  # of a bone that is vague along itself, rounding
    along, bone = np.zeros((len(a), len(view.mean), 3)), np.arange(len(a))
    along[bone, a] = unit / sd[:, None]
    along[bone, b] = -along[bone, a]
    along = along.reshape(len(a), -1)
    return Term(view.combined(along), along @ markers.gains, (bones.length_m - distance - longer) / sd)
