"""Kernels made of kernels: sums, products, other metrics, scaled and periodic coordinates."""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from eal.arrays import Array, positive
from eal.kernels import Kernel


@final
@dataclass(frozen=True)
class SumKernel(Kernel):
    """K = sum_i a_i K_i with a_i > 0 and sum a_i = 1, so that K(x, x) = 1.

    Attributes:
        parts: The kernels.
        shares: Their weights; scaled to sum to 1. Empty: equal.
    """

    parts: tuple[Kernel, ...]
    shares: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        """Check and normalise the shares."""
        if not self.parts:
            raise ValueError("SumKernel needs at least one part, but has none")
        shares = self.shares or (1.0,) * len(self.parts)
        if len(shares) != len(self.parts):
            raise ValueError(f"SumKernel has {len(self.parts)} parts and {len(shares)} shares: give one share a part")
        total = sum(positive("a share of SumKernel", a) for a in shares)
        object.__setattr__(self, "parts", tuple(self.parts))
        object.__setattr__(self, "shares", tuple(a / total for a in shares))

    def _logs(self, q: Array, z: Array) -> tuple[Array, Array]:
        """Log K (n, m), and the part of each kernel in K (p, n, m), which sums to 1."""
        logs = np.stack([np.log(a) + k.log_gram(q, z) for a, k in zip(self.shares, self.parts, strict=True)])
        top = logs.max(axis=0)
        parts = np.exp(logs - top)
        total = parts.sum(axis=0)
        return top + np.log(total), parts / total

    def log_gram(self, q: Array, z: Array) -> Array:
        """Log sum_i a_i K_i, see Kernel."""
        return np.minimum(self._logs(q, z)[0], 0.0)

    def log_gradients(self, q: Array, z: Array) -> Array:
        """sum_i p_i grad log K_i with p_i the part of K_i in K, see Kernel."""
        _, part = self._logs(q, z)
        return sum((p[:, :, None] * k.log_gradients(q, z) for p, k in zip(part, self.parts, strict=True)), np.zeros(1))

    def weighted_curvature(self, q: Array, z: Array, w: Array) -> Array:
        """sum_i p_i (hess log K_i + (g_i - g)(g_i - g)^T) with g_i = grad log K_i, g = grad log K, see Kernel."""
        _, part = self._logs(q, z)
        slopes = [k.log_gradients(q, z) for k in self.parts]
        mean = sum((p[:, :, None] * g for p, g in zip(part, slopes, strict=True)), np.zeros(1))
        total = np.zeros(1)
        for p, g, kernel in zip(part, slopes, self.parts, strict=True):
            off = g - mean
            total = total + kernel.weighted_curvature(q, z, w * p)
            total = total + ((w * p)[:, :, None] * off).transpose(0, 2, 1) @ off
        return total

    @property
    def curvature(self) -> float:
        """At most the weighted mean of the parts, see Kernel."""
        return sum(a * k.curvature for a, k in zip(self.shares, self.parts, strict=True))


@final
@dataclass(frozen=True)
class ProductKernel(Kernel):
    """K = prod_i K_i.

    Attributes:
        parts: The kernels.
    """

    parts: tuple[Kernel, ...]

    def __post_init__(self) -> None:
        """Check that there is a part."""
        if not self.parts:
            raise ValueError("ProductKernel needs at least one part, but has none")
        object.__setattr__(self, "parts", tuple(self.parts))

    def log_gram(self, q: Array, z: Array) -> Array:
        """sum_i log K_i, see Kernel."""
        return sum((k.log_gram(q, z) for k in self.parts), np.zeros(1))

    def log_gradients(self, q: Array, z: Array) -> Array:
        """sum_i grad log K_i, see Kernel."""
        return sum((k.log_gradients(q, z) for k in self.parts), np.zeros(1))

    def weighted_curvature(self, q: Array, z: Array, w: Array) -> Array:
        """sum_i hess log K_i, see Kernel."""
        return sum((k.weighted_curvature(q, z, w) for k in self.parts), np.zeros(1))

    @property
    def curvature(self) -> float:
        """At most the sum of the parts, see Kernel."""
        return sum(k.curvature for k in self.parts)


@dataclass(frozen=True)
class FeatureKernel(Kernel):
    """K on features f(q) of the coordinates.

    Attributes:
        kernel: Kernel on the features.
    """

    kernel: Kernel

    @abstractmethod
    def _features(self, q: Array) -> Array:
        """(n, d) coordinates to (n, D) features."""

    @abstractmethod
    def _pull_back(self, q: Array, gradients: Array) -> Array:
        """Gradients in the features (n, ..., D) to gradients in the coordinates (n, ..., d)."""

    @abstractmethod
    def _bend(self, q: Array, gradients: Array, hessian: Array) -> None:
        """Add sum_k g_k hess f_k of gradients g (n, D) in the features to Hessians (n, d, d)."""

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
        self._bend(q, self.kernel.weighted_gradient(x, y, w), hessian)
        return hessian


@final
@dataclass(frozen=True)
class LinearKernel(FeatureKernel):
    """K on coordinates A q: another metric.

    Attributes:
        kernel: Kernel on A q.
        matrix: (d, d) rows of A.
    """

    matrix: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        """Check that A has an inverse."""
        rows = tuple(tuple(float(x) for x in row) for row in self.matrix)
        if any(len(row) != len(rows) for row in rows) or not np.linalg.matrix_rank(np.array(rows)) == len(rows) > 0:
            raise ValueError(f"matrix must be square and have an inverse, but is {self.matrix!r}")
        object.__setattr__(self, "matrix", rows)

    def _features(self, q: Array) -> Array:
        return q @ np.array(self.matrix).T

    def _pull_back(self, q: Array, gradients: Array) -> Array:  # noqa: ARG002
        return gradients @ np.array(self.matrix)

    def _bend(self, q: Array, gradients: Array, hessian: Array) -> None:
        """None: lines."""

    @property
    def curvature(self) -> float:
        """Along the direction that A stretches most, see Kernel."""
        return self.kernel.curvature * float(np.linalg.norm(np.array(self.matrix), 2)) ** 2


@final
@dataclass(frozen=True)
class CoordinateKernel(FeatureKernel):
    """K on coordinates divided by their scales, angles on their circle.

    A coordinate x becomes x / s; one with period P becomes the point (P / 2 pi s) (cos, sin)(2 pi x / P), whose chord
    distance is |x - y| / s for near angles. A scale of ``inf`` takes a coordinate out, as a product of kernels on
    different coordinates needs.

    Attributes:
        kernel: Kernel on the scaled coordinates.
        scales: d scales in the units of the coordinates.
        periods: d periods in the units of the coordinates, 0 where not periodic. Empty: none is.
    """

    scales: tuple[float, ...]
    periods: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        """Check scales and periods."""
        scales = tuple(float(s) for s in self.scales)
        periods = tuple(float(p) for p in self.periods) or (0.0,) * len(scales)
        if len(periods) != len(scales):
            raise ValueError(
                f"{len(scales)} scales and {len(periods)} periods: give one period a coordinate, 0 for none"
            )
        for j, s in enumerate(scales):
            if not s > 0.0:
                raise ValueError(f"scale {j} must be above 0, but is {s!r}: inf takes a coordinate out of the kernel")
        for j, p in enumerate(periods):
            if not (np.isfinite(p) and p >= 0.0):
                raise ValueError(f"period {j} must be 0 (none) or a positive length, but is {p!r}")
        object.__setattr__(self, "scales", scales)
        object.__setattr__(self, "periods", periods)

    def _features(self, q: Array) -> Array:
        """(n, d) coordinates to (n, d + p) features: lines and cosines, then sines."""
        return _curve(q, self.scales, self.periods, 0)

    def _pull_back(self, q: Array, gradients: Array) -> Array:
        """Gradients in the features (n, ..., d + p) to gradients in the coordinates (n, ..., d)."""
        d, turning = q.shape[1], np.flatnonzero(self.periods)
        slopes = _curve(q, self.scales, self.periods, 1)
        slopes = slopes.reshape(len(q), *(1,) * (gradients.ndim - 2), -1)
        scaled = slopes * gradients
        pulled = scaled[..., :d].copy()
        pulled[..., turning] += scaled[..., d:]
        return pulled

    def _bend(self, q: Array, gradients: Array, hessian: Array) -> None:
        """See FeatureKernel: features of one coordinate each."""
        d, turning = q.shape[1], np.flatnonzero(self.periods)
        bent = _curve(q, self.scales, self.periods, 2) * gradients
        bend = bent[:, :d].copy()
        bend[:, turning] += bent[:, d:]
        diagonal = np.arange(d)
        hessian[:, diagonal, diagonal] += bend

    @property
    def curvature(self) -> float:
        """Divided by the square of the smallest scale, see Kernel."""
        return self.kernel.curvature / min(self.scales) ** 2


def _curve(q: Array, scales: Sequence[float], periods: Sequence[float], order: int) -> Array:
    """Derivative of that order of the features of each coordinate: (n, d + p)."""
    inverse = 1.0 / np.array(scales)
    period = np.array(periods)
    turning = np.flatnonzero(period)
    line = (q * inverse, np.broadcast_to(inverse, q.shape), np.zeros_like(q))[order]
    features = np.concatenate([line, np.empty((len(q), len(turning)))], axis=1)
    rate = 2.0 * np.pi / period[turning]
    angle = q[:, turning] * rate + 0.5 * np.pi * order
    size = inverse[turning] * rate ** (order - 1)
    features[:, turning] = size * np.cos(angle)
    features[:, q.shape[1] :] = size * np.sin(angle)
    return features
