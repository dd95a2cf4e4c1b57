"""An animal as a tree of rigid segments: where joint angles put its markers, and which angles fit markers best."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from eal.arrays import Array, cross, skew

_NEAR = 1e-2
"""Squared angle below which series stand for quotients that lose digits: there both are right to 1e-11."""
STEP_RAD = 0.5
"""Steps of an iteration turn a joint by at most so many radians. Chosen, not measured."""
POSES_AT_ONCE = 200
"""Frames that are fitted at once."""


class Posed(NamedTuple):
    """Segments of S poses, in axes of the root.

    Attributes:
        rotation: (S, J + 1, 3, 3) axes of each segment; the root's are 1.
        origin: (S, J + 1, 3) the joint that it hangs on.
    """

    rotation: Array
    origin: Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Tree:
    """Segment 0 is the root, segment j + 1 hangs by joint j on one before it. At rest all have the root's axes.

    A joint turns its segment by the rotation vector sum angle * axis over its coordinates: three axes are a ball, two a
    universal joint, one a hinge, none is fixed. Mirrored axes make mirrored motion the same angles.

    Attributes:
        parent: (J,) segment that each joint is on.
        joint_m: (J, 3) where on it.
        axes: (F, 3) orthonormal axes of each joint's coordinates, in the axes of the segment it is on.
        joint: (F,) joint of each coordinate.
        segment: (M,) segment that carries each marker.
        place_m: (M, 3) where on it; from its joint, of the root from its origin.
    """

    parent: NDArray[np.int64]
    joint_m: Array
    axes: Array
    joint: NDArray[np.int64]
    segment: NDArray[np.int64]
    place_m: Array

    @cached_property
    def above(self) -> NDArray[np.bool_]:
        """(J + 1, J + 1) whether the second segment is the first, or one that the first hangs on."""
        out = np.eye(len(self.parent) + 1, dtype=bool)
        for joint, on in enumerate(self.parent):
            out[joint + 1] |= out[on]
        return out

    @cached_property
    def carries(self) -> NDArray[np.bool_]:
        """(F, M) whether a coordinate moves a marker."""
        return self.above[self.segment][:, self.joint + 1].T

    @cached_property
    def _levels(self) -> list[NDArray[np.int64]]:
        """Joints by how many others they hang on."""
        depth = np.zeros(len(self.parent) + 1, dtype=np.int64)
        for joint, on in enumerate(self.parent):
            depth[joint + 1] = depth[on] + 1
        return [np.flatnonzero(depth[1:] == level) for level in range(1, int(depth.max()) + 1)]

    @cached_property
    def _vectors(self) -> Array:
        """(F, J, 3) the rotation vector that a unit of each coordinate adds to its joint."""
        out = np.zeros((len(self.axes), len(self.parent), 3))
        out[np.arange(len(self.axes)), self.joint] = self.axes
        return out

    def turns(self, angles: Array) -> Array:
        """(S, J, 3) rotation vectors of the joints."""
        return (angles @ self._vectors.reshape(len(self.axes), -1)).reshape(len(angles), -1, 3)

    def without_turns(self, angles: Array, rows: Array) -> tuple[Array, Array]:
        """The same rotations of the joints by less than half a turn: angles (F,), and their deviations (F, n).

        v becomes t v with t = 1 - 2 pi n / |v|, and deviations across v change by t.
        """
        size = np.sqrt(np.bincount(self.joint, angles**2, minlength=len(self.parent)))
        whole = 2 * np.pi * np.round(size / (2 * np.pi))
        if not whole.any():
            return angles, rows
        share = 1 - whole / np.where(whole > 0, size, 1.0)
        out = rows.copy()
        for joint in np.flatnonzero(whole):
            mine = self.joint == joint
            unit = angles[mine] / size[joint]
            out[mine] = share[joint] * rows[mine] + (1 - share[joint]) * np.outer(unit, unit @ rows[mine])
        return angles * share[self.joint], out

    def pose(self, angles: Array) -> Posed:
        """Segments where (S, F) angles have them."""
        count, joints = len(angles), len(self.parent)
        local = Rotation.from_rotvec(self.turns(angles).reshape(-1, 3)).as_matrix().reshape(count, joints, 3, 3)
        rotation, origin = np.zeros((count, joints + 1, 3, 3)), np.zeros((count, joints + 1, 3))
        rotation[:, 0] = np.eye(3)
        for level in self._levels:
            on = rotation[:, self.parent[level]]
            rotation[:, level + 1] = on @ local[:, level]
            origin[:, level + 1] = origin[:, self.parent[level]] + (on @ self.joint_m[level][..., None])[..., 0]
        return Posed(rotation, origin)

    def markers(self, posed: Posed, slip_m: Array | float = 0.0) -> Array:
        """(S, M, 3) markers in axes of the root; ``slip_m`` (S, M, 3) is added to their places."""
        place = np.broadcast_to(self.place_m + slip_m, (len(posed.origin), *self.place_m.shape))
        return posed.origin[:, self.segment] + (posed.rotation[:, self.segment] @ place[..., None])[..., 0]

    def turning(self, angles: Array, posed: Posed) -> Array:
        """(S, F, 3) angular velocity, in axes of the root, that a unit rate of each coordinate gives what it carries.

        R_parent J_l(v) axis, J_l the left Jacobian of the joint's rotation vector v (Chirikjian 2011, section 10.8).
        """
        about = posed.rotation[:, self.parent] @ left_jacobian(self.turns(angles))
        return (about[:, self.joint] @ self.axes[..., None])[..., 0]

    def jacobian(self, angles: Array, posed: Posed, markers: Array) -> Array:
        """(S, M, 3, F) derivative of the markers by the angles: each turns all that its joint carries (``turning``)."""
        axis = self.turning(angles, posed)
        arm = markers[:, :, None] - posed.origin[:, None, self.joint + 1]
        moved = cross(np.broadcast_to(axis[:, None], arm.shape), arm) * self.carries.T[..., None]
        return np.swapaxes(moved, 2, 3)


def left_jacobian(v: Array) -> Array:
    """(..., 3, 3) of rotation vectors: exp(v + d) = exp(J d) exp(v) to first order."""
    first, second, _, _ = (x[..., None] for x in _series(v))
    k = skew(v)
    return np.eye(3) + first * k + second * k @ k


def turning_on(v: Array, rate: Array) -> Array:
    """(..., 3) by how much the angular velocity J_l(v) rate grows, a second, while v grows at a constant rate.

    d/dt (rate + b v x rate + c v x (v x rate)) with b = (1 - cos a) / a^2, c = (a - sin a) / a^3 and a = |v|.
    """
    _, second, first_slope, second_slope = _series(v)
    across = cross(v, rate)
    grows = np.sum(v * rate, axis=-1, keepdims=True)
    return grows * (first_slope * across + second_slope * cross(v, across)) + second * cross(rate, across)


def _series(v: Array) -> tuple[Array, Array, Array, Array]:
    """(..., 1) b and c of ``turning_on``, and db/da and dc/da over a; near 0 to the third order in a^2."""
    square = np.sum(np.square(v), axis=-1, keepdims=True)
    near = square < _NEAR
    s = np.where(near, _NEAR, square)
    a = np.sqrt(s)
    b, c = (1 - np.cos(a)) / s, (a - np.sin(a)) / (s * a)
    b_slope, c_slope = (np.sin(a) / a - 2 * b) / s, (b - 3 * c) / s
    if near.any():
        x = np.where(near, square, 0.0)
        b = np.where(near, 1 / 2 - x / 24 * (1 - x / 30 * (1 - x / 56)), b)
        c = np.where(near, 1 / 6 - x / 120 * (1 - x / 42 * (1 - x / 72)), c)
        b_slope = np.where(near, -1 / 12 + x / 180 * (1 - x / 37.333333333333336), b_slope)
        c_slope = np.where(near, -1 / 60 + x / 1260 * (1 - x / 48), c_slope)
    return b, c, b_slope, c_slope


@dataclass(frozen=True, eq=False)
class FittedPoses:
    """Poses that fit markers best, frame by frame.

    Attributes:
        angles: (T, F) joint angles.
        shift_m: (T, 3) position of the root, in the axes in which the markers were given.
        rotation: (T, 3, 3) its axes.
        certainty: (T, F + 6) 1 less the share of the prior variance that is left, of shift, turn and angles.
    """

    angles: Array
    shift_m: Array
    rotation: Array
    certainty: Array


def fit_poses(tree: Tree, xyz_m: Array, sd_m: Array, *, root: tuple[float, float] = (1.0, 1.0)) -> FittedPoses:
    """Least squares in each frame by itself: Gauss-Newton steps of at most ``STEP_RAD``.

    Angles are drawn to rest by a prior of a deviation of one radian, so that what a frame does not determine stays
    there, and the root to where it is given.

    Args:
        tree: The animal.
        xyz_m: (T, M, 3) markers about a point near the root's origin, in axes near the root's; NaN where not seen.
        sd_m: (T, M) their standard deviations.
        root: Deviations of the root's shift, over the extent of the places of markers, and of its turn, in radians.
    """
    starts = range(0, len(xyz_m), POSES_AT_ONCE)
    parts = [_fit(tree, xyz_m[i : i + POSES_AT_ONCE], sd_m[i : i + POSES_AT_ONCE], root) for i in starts]
    return FittedPoses(*(np.concatenate(each) for each in zip(*parts, strict=True)))


def _fit(tree: Tree, xyz: Array, sd: Array, root: tuple[float, float]) -> tuple[Array, Array, Array, Array]:
    count, freedoms = len(xyz), len(tree.axes)
    angles, shift, rotation = np.zeros((count, freedoms)), np.zeros((count, 3)), np.tile(np.eye(3), (count, 1, 1))
    seen = np.isfinite(xyz[..., 0])
    weight = np.where(seen, 1 / np.where(seen, sd, 1.0), 0.0)[..., None]
    extent = max(float(np.abs(tree.place_m).max()), 1e-9)
    prior = np.concatenate([np.full(3, root[0] * extent), np.full(3, root[1]), np.ones(freedoms)]) ** -2.0
    normal = np.zeros((count, freedoms + 6, freedoms + 6))
    moving = np.arange(count)
    for _ in range(20):
        bent, turn = angles[moving], rotation[moving]
        posed = tree.pose(bent)
        inside = tree.markers(posed)
        turned = inside @ np.swapaxes(turn, 1, 2)
        slope = np.zeros((*turned.shape, freedoms + 6))
        slope[..., :3], slope[..., 3:6] = np.eye(3), -skew(turned)
        slope[..., 6:] = turn[:, None] @ tree.jacobian(bent, posed, inside)
        missed = np.where(seen[moving][..., None], xyz[moving] - turned - shift[moving][:, None], 0.0)
        away = (weight[moving] * missed).reshape(len(moving), -1)
        slope = (weight[moving][..., None] * slope).reshape(len(moving), -1, freedoms + 6)
        normal[moving] = here = np.swapaxes(slope, 1, 2) @ slope + np.diag(prior)
        whole = np.concatenate([shift[moving], Rotation.from_matrix(turn).as_rotvec(), bent], axis=1)
        pull = np.einsum("tri,tr->ti", slope, away) - prior * whole
        step = np.linalg.solve(here, pull[..., None])[..., 0]
        size = np.abs(step[:, 3:]).max(axis=1)
        step *= np.minimum(1.0, STEP_RAD / np.maximum(size, 1e-12))[:, None]
        shift[moving], angles[moving] = shift[moving] + step[:, :3], bent + step[:, 6:]
        rotation[moving] = Rotation.from_rotvec(step[:, 3:6]).as_matrix() @ turn
        moving = moving[size > 1e-3]  # radians
        if not len(moving):
            break
    left = np.einsum("tii->ti", np.linalg.inv(normal)) * prior
    return angles, shift, rotation, 1 - left
