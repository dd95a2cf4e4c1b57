"""Angles, areas and frames of points, as functions of their positions (T, k, 3)."""

from collections.abc import Callable

import numpy as np

from eal.arrays import Array, cross
from mocap.measures import SEQUENCE


def _last(*parts: Array) -> Array:
    """Parts on end along a last axis, each of them whole in memory."""
    return np.moveaxis(np.stack(parts), 0, -1)


def length(v: Array) -> Array:
    """(...) lengths of (..., 3) vectors."""
    return np.sqrt(v[..., 0] ** 2 + v[..., 1] ** 2 + v[..., 2] ** 2)


def unit(v: Array) -> Array:
    """(..., 3) vectors of length 1; NaN where there is none."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return v / length(v)[..., None]


def flexion(x: Array) -> Array:
    """Flexion of a joint of three markers, 180 degrees less the angle they include: 0 where it is straight, rad.

    atan2(|a x b|, a . b) of the segments a from parent to centre and b from centre to child; exact at all angles.
    """
    a, b = x[:, 1] - x[:, 0], x[:, 2] - x[:, 1]
    return np.arctan2(length(cross(a, b)), np.einsum("...i,...i->...", a, b))


def flexion_slopes(x: Array) -> tuple[Array, Array]:
    """(T,) tangents of flexion, and (T, 2, 9) slopes of the child's direction as the parent sees it, rad.

    The first is that of flexion itself; the second is sideways, which moves flexion only near 0 and 180 degrees:
    it is the length of (tangent + first, second), a vector in a plane, but for what bends in between.
    """
    a, b = x[:, 1] - x[:, 0], x[:, 2] - x[:, 1]
    u, n = unit(a), unit(b)
    normal = cross(u, n)
    straight = length(normal) < 1e-12  # of rounding: any plane will do
    normal[straight] = cross(u, np.eye(3)[np.argmin(np.abs(np.nan_to_num(u)), axis=1)])[straight]
    normal, cosine = unit(normal), np.einsum("ti,ti->t", u, n)[:, None]
    by_a, by_b = 1 / length(a)[:, None], 1 / length(b)[:, None]
    slopes = []
    for of_a, of_b in ((cross(normal, u) * by_a, cross(normal, n) * by_b), (cosine * normal * by_a, normal * by_b)):
        slopes.append(np.concatenate([of_a, -of_a - of_b, of_b], axis=1))
    return np.abs(np.tan(flexion(x))), np.stack(slopes, axis=1)


def segment_frame(long_axis: Array, left: Array) -> Array:
    """(T, 3, 3) axes of a segment as columns: x along it, z = x cross left made a unit vector, y = z cross x.

    Right-handed; for an animal that stands with its long axis forward z points up and y to its left.
    """
    x = unit(long_axis)
    z = unit(cross(x, left))
    return _last(x, cross(z, x), z)


def frames_of_four(x: Array) -> Array:
    """Frame of a segment: long axis from the first to the second point, left from the third to the fourth."""
    return segment_frame(x[:, 1] - x[:, 0], x[:, 3] - x[:, 2])


def euler(rotation: Array, sequence: str = SEQUENCE) -> tuple[Array, Array, Array]:
    """Angles (rad) about the first axis of a sequence, the turned second, and the twice turned third.

    Of "zyx" R = Rz(a) Ry(b) Rx(c): the joint coordinate system of Grood & Suntay (1983), as the International Society
    of Biomechanics recommends (Wu et al. 2002, 2005) with the axes named otherwise: a about an axis of the parent, c
    about the long axis of the child, b about the axis normal to both. Of "yxy" first and third axis are the same, and
    b is between 0 and pi.
    """
    i, j, k = ("xyz".index(axis) for axis in sequence)
    sign = 1.0 if (j - i) % 3 == 1 else -1.0
    if i == k:
        k = 3 - i - j
        a = np.arctan2(rotation[:, j, i], -sign * rotation[:, k, i])
        b = np.arctan2(np.hypot(rotation[:, i, j], rotation[:, i, k]), rotation[:, i, i])
        return a, b, np.arctan2(rotation[:, i, j], sign * rotation[:, i, k])
    a = np.arctan2(-sign * rotation[:, j, k], rotation[:, k, k])
    b = np.arctan2(sign * rotation[:, i, k], np.hypot(rotation[:, i, i], rotation[:, i, j]))
    return a, b, np.arctan2(-sign * rotation[:, i, j], rotation[:, i, i])


MIRROR = np.array([1.0, -1.0, 1.0])
"""Reflects points. Any plane does: angles between frames of points do not depend on it."""


def joint_angle(which: int, *, mirrored: bool = False, sequence: str = SEQUENCE) -> Callable[[Array], Array]:
    """One of the three angles (``euler``) of a joint of eight points: four of the parent's frame, four of the child's.

    Mirrored ones are those of the same joint of the mirror image (Wu et al. 2005): of a right joint as a left one.
    """

    def angle(x: Array) -> Array:
        x = x * MIRROR if mirrored else x
        parent, child = frames_of_four(x[:, :4]), frames_of_four(x[:, 4:])
        return euler(np.einsum("tji,tjk->tik", parent, child), sequence)[which]

    return angle


def turns(sequence: str) -> tuple[str, str, str]:
    """What the three angles of a sequence are called: z, y, x; y, x, y2 where an axis comes twice."""
    first, second, third = sequence
    return first, second, third if third != first else f"{third}2"


def level_axes(up: Array) -> Array:
    """(3, 3) rows ahead, left and up of the world for an upward direction: x (or what is nearest) is ahead."""
    first = np.array([1.0, 0, 0]) if abs(up[0]) < 0.5 else np.array([0, 1.0, 0])
    ahead = first - (first @ up) * up
    ahead /= np.linalg.norm(ahead)
    return np.stack([ahead, cross(up, ahead), up])


def _ahead(x: Array, axes: Array) -> Array:
    """(T, 3) the line from the first to the second point along axes; of one vector (a velocity) itself."""
    return (x[:, 1] - x[:, 0] if x.shape[1] > 1 else x[:, 0]) @ axes.T


def yaw(up: Array) -> Callable[[Array], Array]:
    """Direction of the line from the first to the second point (or of one vector) seen from above, rad."""
    axes = level_axes(up)

    def angle(x: Array) -> Array:
        ahead = _ahead(x, axes)
        return np.arctan2(ahead[:, 1], ahead[:, 0])

    return angle


def pitch(up: Array) -> Callable[[Array], Array]:
    """How far the line from the first to the second point (or one vector) rises above the horizontal, rad."""
    axes = level_axes(up)

    def angle(x: Array) -> Array:
        ahead = _ahead(x, axes)
        return np.arctan2(ahead[:, 2], np.hypot(ahead[:, 0], ahead[:, 1]))

    return angle


def roll(up: Array) -> Callable[[Array], Array]:
    """How far the trunk is turned about its long axis, rad, of four points (``frames_of_four``); 0: its left is level.

    Positive: the left side is up, the right side down.
    """

    def angle(x: Array) -> Array:
        frame = frames_of_four(x)
        return np.arctan2(frame[..., 1] @ up, frame[..., 2] @ up)

    return angle


def distance(x: Array) -> Array:
    """Between the first and the second point, m."""
    return length(x[:, 1] - x[:, 0])


def area(x: Array) -> Array:
    """Area of an outline of points one after the other, m^2: half the length of the sum of x(i) cross x(i + 1).

    That is the area of the outline seen along the direction from which it is largest (the vector area); an outline that
    is bent out of its plane has more surface.
    """
    about = x - x[:, :1]
    return 0.5 * length(np.sum(cross(about, np.roll(about, -1, axis=1)), axis=1))


def near_the_mean(angle_deg: Array) -> Array:
    """The same angles, whole turns taken off such that each is within half a turn of their circular mean.

    A joint that rotates about 170 degrees is then not cut in two at 180.

    Args:
        angle_deg: (T,) angles in degrees; NaN stays.
    """
    there = np.isfinite(angle_deg)
    if not there.any():
        return angle_deg
    mean = np.rad2deg(np.angle(np.exp(1j * np.deg2rad(angle_deg[there])).mean()))
    return angle_deg - 360 * np.round((angle_deg - mean) / 360)
