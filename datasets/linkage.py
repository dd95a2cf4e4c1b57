"""Rotations, directions and two-bone limbs, over time."""

import numpy as np

from mocap.arrays import Array


def turn(axis: int, angle_rad: Array) -> Array:
    """Right-handed rotations about a coordinate axis.

    Args:
        axis: 0, 1 or 2.
        angle_rad: (...) angles.

    Returns:
        (..., 3, 3) rotation matrices.
    """
    angle_rad = np.asarray(angle_rad, dtype=np.float64)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rotation = np.zeros((*angle_rad.shape, 3, 3))
    rotation[..., axis, axis] = 1
    rotation[..., i, i] = rotation[..., j, j] = np.cos(angle_rad)
    rotation[..., j, i] = np.sin(angle_rad)
    rotation[..., i, j] = -rotation[..., j, i]
    return rotation


def rotated(rotation: Array, vector: Array) -> Array:
    """``rotation @ vector`` for (..., 3, 3) rotations and (..., 3) vectors, broadcast."""
    return (rotation @ np.asarray(vector)[..., None])[..., 0]


def unit(vector: Array) -> Array:
    """(..., 3) vectors of length 1 along ``vector``."""
    return vector / np.linalg.norm(vector, axis=-1, keepdims=True)


def bent(root_m: Array, end_m: Array, pole: Array, *, upper_m: float, lower_m: float) -> Array:
    """Middle joint of a two-bone limb between two points, by the cosine rule.

    Args:
        root_m: (T, 3) upper end: shoulder or hip.
        end_m: (T, 3) lower end: wrist or ankle.
        pole: (T, 3) or (3,) direction to which the middle joint bends.
        upper_m: Length of the upper bone.
        lower_m: Length of the lower bone.

    Returns:
        (T, 3) elbow or knee, exactly ``upper_m`` and ``lower_m`` from the ends.

    Raises:
        ValueError: the ends are further apart than the limb is long, or closer than its bones can fold.
    """
    reach = np.linalg.norm(end_m - root_m, axis=-1)
    if reach.max() >= upper_m + lower_m or reach.min() <= abs(upper_m - lower_m):
        raise ValueError(
            f"a limb of {1e3 * upper_m:.1f} + {1e3 * lower_m:.1f} mm cannot span {1e3 * reach.min():.1f} to "
            f"{1e3 * reach.max():.1f} mm: shorten the stride or lengthen the bones"
        )
    along = (end_m - root_m) / reach[..., None]
    forward = (reach**2 + upper_m**2 - lower_m**2) / (2 * reach)
    aside = pole - np.sum(pole * along, axis=-1, keepdims=True) * along
    height = np.sqrt(upper_m**2 - forward**2)
    return root_m + forward[..., None] * along + height[..., None] * unit(aside)


def ramp(u: Array) -> Array:
    """Smooth step 10 u^3 - 15 u^4 + 6 u^5 from 0 to 1 with zero speed and acceleration at both ends; u clipped."""
    u = np.clip(u, 0, 1)
    return u**3 * (10 + u * (6 * u - 15))
