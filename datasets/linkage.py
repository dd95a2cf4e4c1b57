"""Rotations, directions and two-bone limbs, over time."""

import numpy as np

from eal.arrays import Array


def turn(axis: int, angle_rad: Array | float) -> Array:
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


def hinged(before: Array, direction: Array, *, length_m: float, condyle_m: float) -> Array:
    """From the centre of a joint to the far end of the bone beyond it, where round condyles roll on each other.

    Two circles of one radius r, one on each bone, roll without slip: their line of centres halves the angle
    of the bones. The instantaneous centre is where they touch, and wanders over the condyle as the joint bends. The
    marker sits at the centre of the near circle: it is ``length_m`` from the next one in the straight joint only.

    Args:
        before: (T, 3) direction of the bone before the joint, of length 1.
        direction: (T, 3) direction of the bone beyond it; not opposite to ``before``.
        length_m: Length in the straight joint.
        condyle_m: Radius r; 0: an ideal hinge.

    Returns:
        (T, 3) metres.
    """
    return 2 * condyle_m * unit(before + direction) + (length_m - 2 * condyle_m) * direction


def bent(root_m: Array, end_m: Array, pole: Array, *, upper_m: float, lower_m: float, condyle_m: float = 0.0) -> Array:
    """Middle joint of a two-bone limb between two points.

    With c = cos(half the bend) and the lower bone W = lower - 2 r from its condyle on, the span s of U, the bisector's
    2 r and W is s^2 = 4 U W c^2 + 4 r (U + W) c + 4 r^2 + (U - W)^2; for r = 0 that is the cosine rule.

    Args:
        root_m: (T, 3) upper end: shoulder or hip.
        end_m: (T, 3) lower end: wrist or ankle.
        pole: (T, 3) or (3,) direction to which the middle joint bends.
        upper_m: Length of the upper bone, U.
        lower_m: Length of the lower bone in the straight joint.
        condyle_m: Radius r of the condyles that roll on each other, see ``hinged``; 0: an ideal hinge.

    Returns:
        (T, 3) elbow or knee, exactly ``upper_m`` from the root and, for an ideal hinge, ``lower_m`` from the end.

    Raises:
        ValueError: the ends are further apart than the limb is long, or closer than its bones can fold.
    """
    beyond_m = lower_m - 2 * condyle_m
    difference = upper_m - beyond_m
    reach = np.linalg.norm(end_m - root_m, axis=-1)
    if reach.max() >= upper_m + lower_m or reach.min() <= np.hypot(difference, 2 * condyle_m):
        raise ValueError(
            f"a limb of {1e3 * upper_m:.1f} + {1e3 * lower_m:.1f} mm cannot span {1e3 * reach.min():.1f} to "
            f"{1e3 * reach.max():.1f} mm: shorten the stride or lengthen the bones"
        )
    a, half_b = 4 * upper_m * beyond_m, 2 * condyle_m * (upper_m + beyond_m)
    c = (np.sqrt(half_b**2 + a * (reach**2 - difference**2 - 4 * condyle_m**2)) - half_b) / a
    along = (end_m - root_m) / reach[..., None]
    # the upper bone on the line to the end: U (c (bisector) + s (across)), the same of the span, multiplied
    bisector = (upper_m + beyond_m) * c + 2 * condyle_m
    forward = upper_m * (c * bisector + (1 - c**2) * difference) / reach
    aside = pole - np.sum(pole * along, axis=-1, keepdims=True) * along
    height = np.sqrt(upper_m**2 - forward**2)
    return root_m + forward[..., None] * along + height[..., None] * unit(aside)


def ramp(u: Array) -> Array:
    """Smooth step 10 u^3 - 15 u^4 + 6 u^5 from 0 to 1 with zero speed and acceleration at both ends; u clipped."""
    u = np.clip(u, 0, 1)
    return u**3 * (10 + u * (6 * u - 15))
