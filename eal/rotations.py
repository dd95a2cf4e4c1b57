"""A kernel that is one on rotations, for coordinates that are joint angles."""

from dataclasses import dataclass
from functools import cached_property
from math import factorial
from typing import NamedTuple, final

import numpy as np
from numpy.polynomial.polynomial import polyder, polyval
from numpy.typing import NDArray

from eal.arrays import Array, positive
from eal.composite import FeatureKernel


class _Columns(NamedTuple):
    """Coordinates that are angles, their joint among those that turn, axis and scale; balls and others among these.

    ``size`` is the scale of each joint that turns; ``line`` and ``line_scale`` are the columns of what is no angle.
    """

    column: NDArray[np.int64]
    joint: NDArray[np.int64]
    axis: NDArray[np.int64]
    scale: Array
    ball: NDArray[np.int64]
    other: NDArray[np.int64]
    size: Array
    line: NDArray[np.int64]
    line_scale: Array


@final
@dataclass(frozen=True)
class RotationKernel(FeatureKernel):
    """K on joint angles that is one on rotations: a whole turn changes nothing.

    The one, two or three coordinates of a joint, over its scale, are the first components of a rotation vector v about
    orthonormal axes, the third of them along the segment. A ball becomes the matrix s R(v) / sqrt 2 and is compared by
    the chord |R - R'|, so that K is one on SO(3); a universal joint or a hinge becomes s R(v) e_3, the direction of its
    segment, and K is one on the sphere or the circle. Near angles are as far apart as they are as coordinates. With
    G the derivative of a function by R the function's part G . R(v) is

        tr G + c_1 a.v + c_2 v^T S v,   a = axial(G),   S = (G + G^T) / 2 - tr G,

    c_k(|v|^2) Stumpff's functions (Rodrigues' formula); all derivatives below are those of this.

    Attributes:
        kernel: Kernel on the features.
        freedoms: Coordinates of each joint, 1 to 3; 0: one more coordinate, which is no angle.
        scales: Of each joint: its coordinates are angles times this. Of what is no angle: 1.
    """

    freedoms: tuple[int, ...]
    scales: tuple[float, ...]

    def __post_init__(self) -> None:
        """Check freedoms and scales."""
        freedoms, scales = tuple(int(k) for k in self.freedoms), tuple(float(s) for s in self.scales)
        if not freedoms or len(freedoms) != len(scales):
            raise ValueError(f"{len(freedoms)} joints and {len(scales)} scales: give one scale a joint")
        if not set(freedoms) <= {0, 1, 2, 3}:
            raise ValueError(f"a joint has 1 to 3 coordinates (0: no angle), but freedoms are {freedoms}")
        for j, s in enumerate(scales):
            positive(f"scale {j} of RotationKernel", s)
        object.__setattr__(self, "freedoms", freedoms)
        object.__setattr__(self, "scales", scales)

    @cached_property
    def _angles(self) -> "_Columns":
        """Which coordinates are angles, and of what."""
        widths = [max(k, 1) for k in self.freedoms]
        starts = np.cumsum([0, *widths])
        turning = [j for j, k in enumerate(self.freedoms) if k]
        parts = [
            (starts[j] + i, number, i, self.scales[j]) for number, j in enumerate(turning) for i in range(widths[j])
        ]
        column, joint, axis, scale = (
            (np.array(part) for part in zip(*parts, strict=True)) if parts else np.zeros((4, 0))
        )
        free = np.array([self.freedoms[j] for j in turning], dtype=np.int64)
        lines = [j for j, k in enumerate(self.freedoms) if not k]
        return _Columns(
            column=column.astype(np.int64),
            joint=joint.astype(np.int64),
            axis=axis.astype(np.int64),
            scale=scale,
            ball=np.flatnonzero(free == 3),
            other=np.flatnonzero(free < 3),
            size=np.array([self.scales[j] for j in turning]),
            line=starts[np.array(lines, dtype=np.int64)],
            line_scale=np.array([self.scales[j] for j in lines]),
        )

    def _vectors(self, q: Array) -> Array:
        """(n, d) to (n, J, 3) rotation vectors."""
        at = self._angles
        out = np.zeros((len(q), len(at.size), 3))
        out[:, at.joint, at.axis] = q[:, at.column] / at.scale
        return out

    def _features(self, q: Array) -> Array:
        """(n, d) to (n, D): directions of segments, rotation matrices of balls, then what is no angle."""
        at = self._angles
        turned = at.size[:, None, None] * _rotations(self._vectors(q))
        balls = turned[:, at.ball].reshape(len(q), -1) / np.sqrt(2)
        return np.concatenate(
            [turned[..., 2][:, at.other].reshape(len(q), -1), balls, q[:, at.line] / at.line_scale], 1
        )

    def _by_rotation(self, gradients: Array) -> Array:
        """Gradients in the features (n, ..., D) to those in the rotations over their scales, (n, ..., J, 3, 3)."""
        at = self._angles
        first, second = 3 * len(at.other), 3 * len(at.other) + 9 * len(at.ball)
        lead = gradients.shape[:-1]
        out = np.zeros((*lead, len(at.size), 3, 3))
        out[..., 2][..., at.other, :] = gradients[..., :first].reshape(*lead, -1, 3)
        out[..., at.ball, :, :] = gradients[..., first:second].reshape(*lead, -1, 3, 3) / np.sqrt(2)
        return out

    def _pull_back(self, q: Array, gradients: Array) -> Array:
        """Gradients in the features (n, ..., D) to gradients in the coordinates (n, ..., d)."""
        at, lead = self._angles, gradients.shape[:-1]
        v = self._vectors(q)
        v = v.reshape(len(q), *(1,) * (len(lead) - 1), *v.shape[1:])
        turning = _rodrigues_gradient(v, *_moments(self._by_rotation(gradients)))
        out = np.empty((*lead, q.shape[1]))
        out[..., at.column] = turning[..., at.joint, at.axis]
        out[..., at.line] = gradients[..., gradients.shape[-1] - len(at.line) :] / at.line_scale
        return out

    def _bend(self, q: Array, gradients: Array, hessian: Array) -> None:
        """See FeatureKernel."""
        at = self._angles
        bent = _rodrigues_hessian(self._vectors(q), *_moments(self._by_rotation(gradients)))
        for joint, size in enumerate(at.size):
            mine = at.joint == joint
            columns, axes = at.column[mine], at.axis[mine]
            hessian[np.ix_(np.arange(len(q)), columns, columns)] += bent[:, joint][:, axes[:, None], axes] / size

    @property
    def curvature(self) -> float:
        """At most that of the features' kernel, see Kernel: no angle moves them faster than itself."""
        lines = [s for k, s in zip(self.freedoms, self.scales, strict=True) if not k]
        return self.kernel.curvature / min([1.0, *lines]) ** 2


def _closed(s: Array) -> tuple[NDArray[np.bool_], Array, Array, tuple[Array, Array, Array]]:
    """Where s is near 0, s for the series there and elsewhere for closed forms, and c_0, c_1 and c_2 in these."""
    near = s < 1.0  # series for Stumpff's functions
    x, far = np.where(near, s, 0.0), np.where(near, 1.0, s)
    root = np.sqrt(far)
    c0 = np.cos(root)
    return near, x, far, (c0, np.sin(root) / root, (1 - c0) / far)


def _stumpff(s: Array) -> list[tuple[Array, ...]]:
    """c_k(s) = sum_i (-s)^i / (k + 2 i)!, k = 1 and 2, each with its first and second derivative by s."""
    near, x, far, (c0, c1, c2) = _closed(s)
    first = [-0.5 * c1, (c0 - c1) / (2 * far), (c1 - 2 * c2) / (2 * far)]
    second = [(first[k - 1] - (k + 2) * first[k]) / (2 * far) for k in (1, 2)]
    return [
        tuple(np.where(near, polyval(x, a), b) for a, b in zip(_SERIES[k], (c, first[k], second[k - 1]), strict=True))
        for k, c in ((1, c1), (2, c2))
    ]


_SERIES = {k: [polyder([(-1.0) ** i / factorial(k + 2 * i) for i in range(11)], n) for n in range(3)] for k in (1, 2)}
"""Coefficients of c_k and its derivatives."""


def _rotations(v: Array) -> Array:
    """(..., 3, 3) rotation matrices of rotation vectors (..., 3): 1 + c_1 [v] + c_2 [v]^2."""
    square = np.sum(v * v, axis=-1)
    near, small, _, (_, *closed) = _closed(square)
    c1, c2 = (np.where(near, polyval(small, _SERIES[k][0]), closed[k - 1])[..., None, None] for k in (1, 2))
    x, y, z = np.moveaxis(v, -1, 0)
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*v.shape, 3)
    return (1 - c2 * square[..., None, None]) * np.eye(3) + c1 * cross + c2 * v[..., :, None] * v[..., None, :]


def _moments(whole: Array) -> tuple[Array, Array]:
    """The vectors a (..., 3) and matrices S (..., 3, 3) of derivatives G (..., 3, 3) by rotation matrices."""
    a = np.stack(
        [
            whole[..., 2, 1] - whole[..., 1, 2],
            whole[..., 0, 2] - whole[..., 2, 0],
            whole[..., 1, 0] - whole[..., 0, 1],
        ],
        axis=-1,
    )
    symmetric = 0.5 * (whole + np.swapaxes(whole, -1, -2))
    return a, symmetric - np.trace(whole, axis1=-2, axis2=-1)[..., None, None] * np.eye(3)


def _rodrigues_gradient(v: Array, a: Array, s: Array) -> Array:
    """(..., 3) gradient of c_1 a.v + c_2 v^T S v."""
    (c1, c1_s, _), (c2, c2_s, _) = (tuple(x[..., None] for x in c) for c in _stumpff(np.sum(v * v, axis=-1)))
    sv = (s @ v[..., None])[..., 0]
    along = 2 * (c1_s * np.sum(a * v, axis=-1, keepdims=True) + c2_s * np.sum(sv * v, axis=-1, keepdims=True))
    return c1 * a + 2 * c2 * sv + along * v


def _rodrigues_hessian(v: Array, a: Array, s: Array) -> Array:
    """(..., 3, 3) Hessian of c_1 a.v + c_2 v^T S v."""
    (_, c1_s, c1_ss), (c2, c2_s, c2_ss) = (
        tuple(x[..., None, None] for x in c) for c in _stumpff(np.sum(v * v, axis=-1))
    )
    sv = (s @ v[..., None])[..., 0]
    av, vsv = (np.sum(x * v, axis=-1)[..., None, None] for x in (a, sv))
    mixed = (2 * c1_s * a[..., :, None] + 4 * c2_s * sv[..., :, None]) * v[..., None, :]
    first, second = c1_s * av + c2_s * vsv, c1_ss * av + c2_ss * vsv
    alone = 2 * first * np.eye(3) + 4 * second * v[..., :, None] * v[..., None, :] + 2 * c2 * s
    return mixed + np.swapaxes(mixed, -1, -2) + alone
