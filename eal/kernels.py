"""Positive kernels with K(x, x) = 1: Gaussian, Laplace, Matern 3/2 and 5/2.

Every kernel answers through log K, so that a caller can factor the largest exponent out and stay exact where K itself
underflows: grad K / K = grad log K, and hess K / K = hess log K + grad log K (grad log K)^T.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import final

import numpy as np
from scipy.spatial.distance import cdist

from eal.arrays import Array, positive


class Kernel(ABC):
    """A symmetric, positive definite K(x, y) with 0 < K <= K(x, x) = 1."""

    @abstractmethod
    def log_gram(self, q: Array, z: Array) -> Array:
        """Log K(q_n, z_i): (n, d) and (m, d) to (n, m), at most 0."""

    @abstractmethod
    def log_gradients(self, q: Array, z: Array) -> Array:
        """Gradients of log K(q_n, z_i) in q_n: (n, m, d)."""

    @abstractmethod
    def weighted_curvature(self, q: Array, z: Array, w: Array) -> Array:
        """sum_i w_ni hess log K(q_n, z_i), derivatives in q_n: weights (n, m) to (n, d, d)."""

    @property
    @abstractmethod
    def curvature(self) -> float:
        """Largest eigenvalue of the Hessian in x of |K_x - K_y|^2 / 2 at x = y: 2 beta for the Gaussian kernel.

        The penalty V has Hessian at most twice this on its zero set; infinite for a kernel with a cusp.
        """

    def gram(self, x: Array, y: Array) -> Array:
        """K(x_n, y_i): (n, d) and (m, d) to (n, m)."""
        logs = self.log_gram(x, y)
        np.exp(logs, out=logs)
        return logs

    def weighted_gradient(self, q: Array, z: Array, w: Array) -> Array:
        """sum_i w_ni grad log K(q_n, z_i), derivatives in q_n: weights (n, m) to (n, d)."""
        return np.einsum("nm,nmd->nd", w, self.log_gradients(q, z))


@dataclass(frozen=True)
class Radial(Kernel):
    """K = exp(l(s)) with s = |x - y|^2, in terms of l and its first two derivatives in s.

    Attributes:
        beta: Positive inverse scale; its unit is given by the subclass.
    """

    beta: float

    def __post_init__(self) -> None:
        """Check beta."""
        object.__setattr__(self, "beta", positive(f"beta of {type(self).__name__}", self.beta))

    @abstractmethod
    def _log(self, s: Array) -> Array:
        """l(s), maybe in the memory of s."""

    @abstractmethod
    def _slopes(self, s: Array) -> tuple[Array, Array]:
        """l'(s) and l''(s), both 0 at s = 0 where they are singular there."""

    def squared_distance(self, q: Array, z: Array) -> Array:
        """|q_n - z_i|^2 from differences, exact at coincidence: (n, m)."""
        return np.asarray(cdist(q, z, "sqeuclidean"), dtype=np.float64)

    def log_gram(self, q: Array, z: Array) -> Array:
        """Log K, see Kernel."""
        return self._log(self.squared_distance(q, z))

    def log_gradients(self, q: Array, z: Array) -> Array:
        """2 l'(s) (q - z), see Kernel."""
        first, _ = self._slopes(self.squared_distance(q, z))
        return 2.0 * first[:, :, None] * (q[:, None, :] - z)

    def weighted_gradient(self, q: Array, z: Array, w: Array) -> Array:
        """2 sum_i w_i l'(s_i) (q - z_i), see Kernel; two matrix products."""
        first, _ = self._slopes(self.squared_distance(q, z))
        return _first_moment(q, z, 2.0 * w * first)

    def weighted_curvature(self, q: Array, z: Array, w: Array) -> Array:
        """sum_i w_i [2 l' I + 4 l'' (q - z_i)(q - z_i)^T], see Kernel."""
        first, second = self._slopes(self.squared_distance(q, z))
        curvature = _second_moment(q, z, 4.0 * w * second)
        diagonal = np.arange(q.shape[1])
        curvature[:, diagonal, diagonal] += 2.0 * (w * first).sum(axis=1)[:, None]
        return curvature

    @property
    def curvature(self) -> float:
        """-2 l'(0), see Kernel."""
        return float(-2.0 * self._slopes(np.zeros(1))[0][0])


@final
@dataclass(frozen=True)
class GaussianKernel(Radial):
    """K = exp(-beta |x - y|^2), the kernel of the EAL paper, section 8.1; beta in 1/unit^2."""

    def squared_distance(self, q: Array, z: Array) -> Array:
        """|q|^2 + |z|^2 - 2 q.z about the mean of z: one matrix product."""
        centre = z.mean(axis=0)
        q, z = q - centre, z - centre
        s = q @ (-2.0 * z.T)
        s += np.einsum("nd,nd->n", q, q)[:, None]
        s += np.einsum("md,md->m", z, z)
        return np.maximum(s, 0.0, out=s)

    def _log(self, s: Array) -> Array:
        return np.multiply(s, -self.beta, out=s)

    def _slopes(self, s: Array) -> tuple[Array, Array]:
        return np.full_like(s, -self.beta), np.zeros_like(s)

    def weighted_gradient(self, q: Array, z: Array, w: Array) -> Array:
        """-2 beta sum_i w_i (q - z_i), without the distances."""
        return _first_moment(q, z, -2.0 * self.beta * w)

    def weighted_curvature(self, q: Array, z: Array, w: Array) -> Array:  # noqa: ARG002
        """-2 beta sum_i w_i I, without the distances."""
        return (-2.0 * self.beta * w.sum(axis=1))[:, None, None] * np.eye(q.shape[1])


@final
@dataclass(frozen=True)
class LaplaceKernel(Radial):
    """K = exp(-beta |x - y|), which separates: V_rho vanishes on the support of rho only; beta in 1/unit.

    Its gradient jumps at x = y; there it is taken as 0, the centre of the jump.
    """

    def _log(self, s: Array) -> Array:
        return -self.beta * np.sqrt(s)

    def _slopes(self, s: Array) -> tuple[Array, Array]:
        inverse = _inverse(np.sqrt(s))
        return -0.5 * self.beta * inverse, 0.25 * self.beta * inverse**3

    @property
    def curvature(self) -> float:
        """Infinite: the kernel has a cusp."""
        return float("inf")


@final
@dataclass(frozen=True)
class Matern32Kernel(Radial):
    """K = (1 + beta r) exp(-beta r), r = |x - y|, beta = sqrt(3) / length; beta in 1/unit."""

    def _log(self, s: Array) -> Array:
        u = self.beta * np.sqrt(s)
        return np.log1p(u) - u

    def _slopes(self, s: Array) -> tuple[Array, Array]:
        r = np.sqrt(s)
        p = 1.0 + self.beta * r
        return -0.5 * self.beta**2 / p, 0.25 * self.beta**3 * _inverse(r) / p**2


@final
@dataclass(frozen=True)
class Matern52Kernel(Radial):
    """K = (1 + u + u^2/3) exp(-u), u = beta |x - y|, beta = sqrt(5) / length; beta in 1/unit."""

    def _log(self, s: Array) -> Array:
        u = self.beta * np.sqrt(s)
        return np.log1p(u + u * u / 3.0) - u

    def _slopes(self, s: Array) -> tuple[Array, Array]:
        u = self.beta * np.sqrt(s)
        p = 1.0 + u + u * u / 3.0
        return -(self.beta**2) / 6.0 * (1.0 + u) / p, self.beta**4 / 36.0 * (2.0 + u) / p**2


def _first_moment(q: Array, z: Array, w: Array) -> Array:
    """sum_i w_ni (q_n - z_i): (n, d), about the mean of z against cancellation."""
    centre = z.mean(axis=0)
    return w.sum(axis=1)[:, None] * (q - centre) - w @ (z - centre)


def _second_moment(q: Array, z: Array, w: Array) -> Array:
    """sum_i w_ni (q_n - z_i)(q_n - z_i)^T: (n, d, d)."""
    n, d = q.shape
    centre = z.mean(axis=0)
    q, z = q - centre, z - centre
    mixed = q[:, :, None] * (w @ z)[:, None, :]
    own = w.sum(axis=1)[:, None, None] * (q[:, :, None] * q[:, None, :])
    outer = (z[:, :, None] * z[:, None, :]).reshape(-1, d * d)
    return own - mixed - mixed.transpose(0, 2, 1) + (w @ outer).reshape(n, d, d)


def _inverse(r: Array) -> Array:
    return np.divide(1.0, r, out=np.zeros_like(r), where=r > 0.0)
