"""A kernel that is one on rotations, for coordinates that are joint angles."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import factorial
from typing import final

import numpy as np

from eal.arrays import Array, positive
from eal.kernels import Kernel

_NEAR = 1.0
"""|v|^2 below which series stand for Stumpff's functions."""


@final
@dataclass(frozen=True)
class RotationKernel(Kernel):
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

    kernel: Kernel
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

    def _joints(self) -> Iterator[tuple[int, slice, slice, float]]:
        """Freedoms, columns among the coordinates and among the features, and scale of each joint."""
        at = into = 0
        for k, scale in zip(self.freedoms, self.scales, strict=True):
            width = (1, 3, 3, 9)[k]
            yield k, slice(at, at + max(k, 1)), slice(into, into + width), scale
            at, into = at + max(k, 1), into + width

    def _features(self, q: Array) -> Array:
        """(n, d) to (n, D): (a part of) the rotation matrix of each joint."""
        out = []
        for k, here, _, scale in self._joints():
            if not k:
                out.append(q[:, here] / scale)
                continue
            matrix = _rotations(_padded(q[:, here] / scale))
            out.append(scale * (matrix[:, :, 2] if k < 3 else matrix.reshape(-1, 9) / np.sqrt(2)))
        return np.concatenate(out, axis=1)

    def _pull_back(self, q: Array, gradients: Array) -> Array:
        """Gradients in the features (n, ..., D) to gradients in the coordinates (n, ..., d)."""
        out = []
        for k, here, there, scale in self._joints():
            g = gradients[..., there]
            if not k:
                out.append(g / scale)
                continue
            v = _padded(q[:, here] / scale).reshape(len(q), *(1,) * (g.ndim - 2), 3)
            out.append(_rodrigues_gradient(v, *_moments(g, k))[..., :k])
        return np.concatenate(out, axis=-1)

    def log_gram(self, q: Array, z: Array) -> Array:
        """See Kernel."""
        return self.kernel.log_gram(self._features(q), self._features(z))

    def log_gradients(self, q: Array, z: Array) -> Array:
        """See Kernel."""
        return self._pull_back(q, self.kernel.log_gradients(self._features(q), self._features(z)))

    def weighted_gradient(self, q: Array, z: Array, w: Array) -> Array:
        """See Kernel."""
        return self._pull_back(q, self.kernel.weighted_gradient(self._features(q), self._features(z), w))

    def weighted_curvature(self, q: Array, z: Array, w: Array) -> Array:
        """D^T H D + sum_k g_k hess f_k for features f with Jacobian D, see Kernel."""
        x, y = self._features(q), self._features(z)
        half = self._pull_back(q, self.kernel.weighted_curvature(x, y, w))
        hessian = self._pull_back(q, half.transpose(0, 2, 1))
        gradient = self.kernel.weighted_gradient(x, y, w)
        for k, here, there, scale in self._joints():
            if k:
                bent = _rodrigues_hessian(_padded(q[:, here] / scale), *_moments(gradient[:, there], k))
                hessian[:, here, here] += bent[:, :k, :k] / scale
        return hessian

    @property
    def curvature(self) -> float:
        """At most that of the features' kernel, see Kernel: no angle moves them faster than itself."""
        lines = [s for k, s in zip(self.freedoms, self.scales, strict=True) if not k]
        return self.kernel.curvature / min([1.0, *lines]) ** 2


def _padded(v: Array) -> Array:
    """(n, k) first components of rotation vectors to (n, 3)."""
    return np.concatenate([v, np.zeros((len(v), 3 - v.shape[1]))], axis=1)


def _stumpff(s: Array) -> list[tuple[Array, Array, Array]]:
    """c_k(s) = sum_i (-s)^i / (k + 2 i)!, k = 1 and 2, each with its first and second derivative by s."""
    near = s < _NEAR
    x, far = np.where(near, s, 0.0), np.where(near, 1.0, s)
    root = np.sqrt(far)
    c0, c1 = np.cos(root), np.sin(root) / root
    c2 = (1 - c0) / far
    first = [-0.5 * c1, (c0 - c1) / (2 * far), (c1 - 2 * c2) / (2 * far)]
    second = [(first[k - 1] - (k + 2) * first[k]) / (2 * far) for k in (1, 2)]
    out = []
    for k, c in ((1, c1), (2, c2)):
        series = [sum(_term(k, i, n) * x ** (i - n) for i in range(n, 11)) for n in range(3)]
        closed = (c, first[k], second[k - 1])
        out.append(tuple(np.where(near, a, b) for a, b in zip(series, closed, strict=True)))
    return out


def _term(k: int, i: int, n: int) -> float:
    """Coefficient of s^(i - n) in the n-th derivative of c_k."""
    return (-1.0) ** i * factorial(i) / factorial(i - n) / factorial(k + 2 * i)


def _rotations(v: Array) -> Array:
    """(n, 3, 3) rotation matrices of rotation vectors: 1 + c_1 [v] + c_2 [v]^2."""
    (c1, _, _), (c2, _, _) = _stumpff(np.sum(v * v, axis=1))
    x, y, z = v.T
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    return np.eye(3) + c1[:, None, None] * cross + c2[:, None, None] * cross @ cross


def _moments(g: Array, freedoms: int) -> tuple[Array, Array]:
    """The vectors a (..., 3) and matrices S (..., 3, 3) of derivatives by the features of a joint."""
    whole = np.zeros((*g.shape[:-1], 3, 3))
    if freedoms == 3:
        whole[...] = g.reshape(*g.shape[:-1], 3, 3) / np.sqrt(2)
    else:
        whole[..., 2] = g
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
    """(n, 3, 3) Hessian of c_1 a.v + c_2 v^T S v."""
    (_, c1_s, c1_ss), (c2, c2_s, c2_ss) = (tuple(x[:, None, None] for x in c) for c in _stumpff(np.sum(v * v, axis=-1)))
    sv = (s @ v[..., None])[..., 0]
    av, vsv = (np.sum(x * v, axis=-1)[:, None, None] for x in (a, sv))
    mixed = (2 * c1_s * a[:, :, None] + 4 * c2_s * sv[:, :, None]) * v[:, None, :]
    round_ = 2 * (c1_s * av + c2_s * vsv) * np.eye(3)
    return (
        mixed
        + np.swapaxes(mixed, 1, 2)
        + round_
        + 4 * (c1_ss * av + c2_ss * vsv) * v[:, :, None] * v[:, None]
        + 2 * c2 * s
    )
