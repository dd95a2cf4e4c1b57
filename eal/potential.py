"""The empirical potential V_z of the EAL paper: zero-like on the samples, 1 far from them.

V = 1 - |B^T k(q)|^2 with B (m, r) and the centres z (m, d) of ``eal.fitting`` and k(q) = (K(q, z_1), ..., K(q, z_m)).
With the weights w_i = (B B^T k)_i k_i and g_i = grad log K_i the gradient of |B^T k|^2 is 2 sum_i w_i g_i, and half of
its Hessian is P^T P + sum_i w_i (hess log K_i + g_i g_i^T) with P = B^T diag(k) g.
"""

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.distance import pdist

from eal import archive, fitting
from eal.arrays import Array, points, positive, read_only, short_repr
from eal.checks import checked_covariances, checked_labels, checked_lambda, checked_samples, checked_weights
from eal.composite import LinearKernel
from eal.kernels import GaussianKernel, Kernel
from eal.spectral import Projection, Scaling, SpectralFilter, Tail, effective_lambda
from eal.threads import one_blas_thread

USUAL_WIDTH = 4.0
"""Beta times the median squared distance, where nothing is known of a potential's use; ``eal.choose`` looks for it."""
USUAL_LAMBDA = 1e-3
"""Spectral filtering parameter there."""
HALF_DIGIT = float(np.finfo(np.float64).eps) / 2
"""1 less this is 1."""
MANY_POINTS = 64
"""Of so many points those far from all samples are looked for, and not computed."""


@dataclass(frozen=True, eq=False, kw_only=True)
class EmpiricalPotential:
    """V_z(q) = 1 - (g_lambda(T_z) T_z K_q, K_q), EAL paper, equation 14, as 1 - |B^T k(q)|^2.

    Made by ``fit_potential`` or ``load_potential``.

    Attributes:
        kernel: The kernel K.
        lam: lambda as given; see ``scaling``.
        spectral_filter: The filter g.
        scaling: ``mean``: lambda compares with eigenvalues of T_z = K / N; ``gram``: with those of K.
        samples: (N, d) samples.
        weights: (N,) weights; one sample of weight 2 is the same sample twice.
        centres: (m, d) the samples whose kernels are evaluated.
        root: (m, r) B.
        eigenvalues: (r,) eigenvalues sigma of T_z, decreasing, in [0, 1].
        missing: Trace of T_z that the factor leaves out; 0 for the exact method.
        method: ``exact`` or ``cholesky``.
        names: d coordinate names.
        units: d units.
        findings: Sentences on what in the samples or settings makes no sense; empty where all is well.
    """

    kernel: Kernel
    lam: float
    spectral_filter: SpectralFilter
    scaling: Scaling
    samples: Array
    weights: Array
    centres: Array
    root: Array
    eigenvalues: Array
    missing: float
    method: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    findings: tuple[str, ...] = ()

    __repr__ = short_repr

    def __post_init__(self) -> None:
        """Copy and freeze the arrays."""
        for name in ("samples", "weights", "centres", "root", "eigenvalues"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    @property
    def dimension(self) -> int:
        """Number of coordinates."""
        return self.samples.shape[1]

    @property
    def sigma_lambda(self) -> float:
        """Lambda in units of the eigenvalues sigma."""
        return effective_lambda(self.lam, float(self.weights.sum()), self.scaling)

    @property
    def effective_rank(self) -> float:
        """Trace of g_lambda(T_z) T_z: how many independent functions vanish off the samples."""
        return float(self.spectral_filter.response(self.eigenvalues, self.sigma_lambda).sum())

    @property
    def error_bound(self) -> float:
        """Sup |V - V of all samples|, see ``eal.fitting.truncation_bound``; 1 where no bound is known."""
        if self.method == "exact":
            return min(float(np.finfo(np.float64).eps * np.sqrt(len(self.samples)) / self.sigma_lambda), 1.0)
        return fitting.truncation_bound(self.spectral_filter, self.eigenvalues, self.sigma_lambda, self.missing)

    @property
    def curvature_limit(self) -> float:
        """Largest eigenvalue that the Hessian of V can have on its zero set: 4 beta for the Gaussian kernel."""
        return 2.0 * self.kernel.curvature

    def value(self, q: ArrayLike) -> Array:
        """V_z(q) = 1 - |B^T k(q)|^2, between 0 (on the data) and 1 (far from it).

        EAL paper, equations 14 and 29 with the scaling of equation 12.

        Args:
            q: (..., d) configurations, in the units of the samples.

        Returns:
            (...) values in [0, 1].

        Raises:
            ValueError: the last axis is not d.
        """
        return self._at(self._value, q)

    def _value(self, q: Array) -> Array:
        if len(q) < MANY_POINTS:
            return self._of_kernels(self.kernel.gram(q, self.centres))
        # |B^T k|^2 <= |B|^2 m max k^2: most of a map is so far from all samples that V is 1 to the last digit
        logs, value = self.kernel.log_gram(q, self.centres), np.ones(len(q))
        near = 2 * logs.max(axis=1) > np.log(HALF_DIGIT / (len(self.root) * np.sum(self.root**2)))
        k = logs[near]
        np.exp(k, out=k)
        value[near] = self._of_kernels(k)
        return value

    def _of_kernels(self, k: Array) -> Array:
        a = k @ self.root
        return np.maximum(1.0 - np.einsum("nr,nr->n", a, a), 0.0)  # rounding below 0 is cut

    def gradient(self, q: ArrayLike) -> Array:
        """Gradient of V_z: (..., d) configurations to (..., d), in 1/unit; raises as ``value``."""
        return self._at(self._gradient, q)

    def _gradient(self, q: Array) -> Array:
        k = self.kernel.gram(q, self.centres)
        w = ((k @ self.root) @ self.root.T) * k
        w *= -2.0
        return self.kernel.weighted_gradient(q, self.centres, w)

    def hessian(self, q: ArrayLike) -> Array:
        """Hessian of V_z: (..., d) configurations to (..., d, d), in 1/unit^2; raises as ``value``."""
        return self._at(self._hessian, q, second=True)

    def _hessian(self, q: Array) -> Array:
        k = self.kernel.gram(q, self.centres)
        return -2.0 * self._half_hessian(q, k, k @ self.root, np.zeros_like(q))

    def barrier_value(self, q: ArrayLike) -> Array:
        """-log(1 - V_z(q)): as V_z near the data, and without end away from it; (..., d) to (...).

        For the Gaussian kernel it grows as 2 beta times the squared distance from the samples. The largest
        exponent is factored out, so that nothing underflows at any distance. Raises as ``value``.
        """
        return self._at(self._barrier_value, q)

    def _barrier_value(self, q: Array) -> Array:
        k, top = self._scaled(q)
        a = k @ self.root
        return np.maximum(-2.0 * top - np.log(np.einsum("nr,nr->n", a, a)), 0.0)

    def barrier_gradient(self, q: ArrayLike) -> Array:
        """Gradient of -log(1 - V_z): (..., d) to (..., d), in 1/unit; raises as ``value``."""
        return self._at(self._barrier_gradient, q)

    def _barrier_gradient(self, q: Array) -> Array:
        k, _ = self._scaled(q)  # the common factor exp(2 top) cancels
        w = (k @ self._square) * k
        w *= (-2.0 / w.sum(axis=1))[:, None]
        return self.kernel.weighted_gradient(q, self.centres, w)

    @cached_property
    def _square(self) -> Array:
        """(m, m) B B^T: half the work of B and its transpose where gradients are asked for again and again."""
        return self.root @ self.root.T

    def barrier_hessian(self, q: ArrayLike) -> Array:
        """Hessian of -log(1 - V_z): (..., d) to (..., d, d), in 1/unit^2; raises as ``value``.

        1 - V times exp(-2 c.q), c half the gradient of log(1 - V), has the same Hessian of its logarithm and no
        gradient at q: with g_i - c for g_i nothing large cancels.
        """
        return self._at(self._barrier_hessian, q, second=True)

    def _barrier_hessian(self, q: Array) -> Array:
        k, _ = self._scaled(q)
        a = k @ self.root
        total = np.einsum("nr,nr->n", a, a)
        shift = self.kernel.weighted_gradient(q, self.centres, (a @ self.root.T) * k / total[:, None])
        return (-2.0 / total)[:, None, None] * self._half_hessian(q, k, a, shift)

    def _scaled(self, q: Array) -> tuple[Array, Array]:
        """K / exp(top) (n, m) and top = max_i log K_i (n,)."""
        logs = self.kernel.log_gram(q, self.centres)
        top = logs.max(axis=1)
        logs -= top[:, None]
        return np.exp(logs, out=logs), top

    def _half_hessian(self, q: Array, k: Array, a: Array, shift: Array) -> Array:
        """Half of the Hessian of |B^T k|^2 exp(-2 shift.q) over exp(-2 shift.q); k (n, m), a = B^T k (n, r)."""
        n, d = q.shape
        slopes = self.kernel.log_gradients(q, self.centres) - shift[:, None, :]
        w = (a @ self.root.T) * k
        p = ((slopes * k[:, :, None]).transpose(0, 2, 1).reshape(n * d, -1) @ self.root).reshape(n, d, -1)
        outer = (slopes * w[:, :, None]).transpose(0, 2, 1) @ slopes
        return p @ p.transpose(0, 2, 1) + outer + self.kernel.weighted_curvature(q, self.centres, w)

    def with_lambda(self, lam: float) -> "EmpiricalPotential":
        """The potential of the same samples at another lambda, without learning again: the columns of B scale.

        Fit at the smallest lambda wanted, where the factor has to be most accurate.

        Raises:
            ValueError: lambda as in ``fit_potential``, or a projection, whose cut modes cannot come back.
        """
        if isinstance(self.spectral_filter, Projection):
            raise ValueError("with_lambda cannot bring back modes that a projection has cut: use fit_potential")
        new = checked_lambda(lam, float(self.weights.sum()), self.scaling)
        before, after = (self.spectral_filter.gain(self.eigenvalues, x) for x in (self.sigma_lambda, new))
        return replace(self, lam=float(lam), root=self.root * np.sqrt(after / before)).judged()

    def judged(self) -> "EmpiricalPotential":
        """The same with its ``findings``: what in the samples or settings makes no sense, what it means, what to do."""
        return replace(self, findings=self._findings())

    def _findings(self) -> tuple[str, ...]:
        z, names, sigma, sigma_lambda = self.samples, self.names, self.eigenvalues, self.sigma_lambda
        n = len(z)
        sentences = []
        if n == 1:
            return ("there is one sample: V is one minus the squared kernel about it, and knows no shape",)
        ordered = z[np.lexsort(z.T)]
        distinct = 1 + int(np.count_nonzero((ordered[1:] != ordered[:-1]).any(axis=1)))
        if distinct < n:
            sentences.append(
                f"{n - distinct} of {n} samples repeat others: they add weight, not information (was a gap filled by "
                "hold?)"
            )
        still = [name for name, spread in zip(names, np.ptp(z, axis=0), strict=True) if spread == 0.0]
        if still:
            sentences.append(
                f"coordinate {', '.join(still)} never varies: V confines it to that value as tightly as the kernel is "
                "wide"
            )
        if len(sigma) > 1 and sigma[0] > 1.0 - 1e-6 and distinct > 1:
            sentences.append(
                f"all samples lie within a small part of the kernel's width (first eigenvalue {sigma[0]:.7f}): V sees "
                "one cluster; scale the coordinates up or take a larger beta"
            )
        if sigma[0] < 2.0 / n and n > 2:
            sentences.append(
                f"no two samples are near at the kernel's width (first eigenvalue {sigma[0]:.2g} of {n} samples): V is "
                "a set of separate wells; scale the coordinates down, take a smaller beta or more samples"
            )
        elif float(np.minimum(sigma / sigma_lambda, 1.0).sum()) > 0.9 * distinct and n > 2:
            sentences.append(
                f"nearly every one of the {distinct} distinct samples is a mode of its own above lambda: V follows "
                "each sample, noise included; take a larger lambda, a smaller beta or more samples"
            )
        if sigma[0] < sigma_lambda:
            sentences.append(
                f"lambda = {sigma_lambda:.2g} is above the first eigenvalue {sigma[0]:.2g}: V stays near 1 even on the "
                "samples; take a smaller lambda"
            )
        if sigma_lambda < 1e-11:
            sentences.append(f"lambda = {sigma_lambda:.2g} is near rounding: V on the samples has few correct digits")
        if self.error_bound > 0.01 and self.method != "exact":
            sentences.append(
                f"V may be off by up to {self.error_bound:.2g} away from the samples ({self.method}, "
                f"{len(self.centres)} centres): raise lambda or max_rank, or take method='exact'"
            )
        if not np.isfinite(self.kernel.curvature):
            sentences.append("the kernel has a cusp: forces jump at the samples, and no explicit step is stable there")
        return tuple(sentences)

    def save(self, path: Path | str) -> None:
        """Write to an ``.npz`` file with all settings; written to a temporary name and renamed when whole."""
        archive.write(
            Path(path),
            arrays={name: getattr(self, name) for name in archive.ARRAYS},
            kernel=self.kernel,
            settings={
                "lam": self.lam,
                "spectral_filter": self.spectral_filter.name,
                "scaling": self.scaling,
                "missing": self.missing,
                "method": self.method,
                "names": list(self.names),
                "units": list(self.units),
                "findings": list(self.findings),
            },
        )

    def plot(self, ax: Any = None) -> Any:
        """Map of V_z in two coordinates, or its curve in one, with the samples; on matplotlib axes, which it returns.

        Raises:
            ValueError: it has more than two coordinates.
        """
        from eal.plot import plot_potential

        return plot_potential(self, ax)

    def _at(self, function: Callable[[Array], Array], q: ArrayLike, *, second: bool = False) -> Array:
        """A function of (n, d) configurations at (..., d) of them, a bounded number at a time."""
        q = points("q", q, self.dimension)
        width = len(self.centres) * ((self.dimension + 1) * self.dimension if second else 1)
        flat, size = q.reshape(-1, q.shape[-1]), max(1, (1 << 19) // width)  # 4 MiB of kernel values
        parts = [function(flat[i : i + size]) for i in range(0, max(len(flat), 1), size)]
        result = parts[0] if len(parts) == 1 else np.concatenate(parts)
        return result.reshape(q.shape[:-1] + result.shape[1:])


def fit_potential(
    samples: ArrayLike,
    *,
    kernel: Kernel | None = None,
    lam: float = USUAL_LAMBDA,
    spectral_filter: SpectralFilter | None = None,
    scaling: Scaling = "mean",
    weights: ArrayLike | None = None,
    covariances: ArrayLike | None = None,
    method: fitting.Method = "auto",
    accuracy: float = 1e-5,
    max_rank: int = 2000,
    names: Sequence[str] | None = None,
    units: Sequence[str] | None = None,
) -> EmpiricalPotential:
    """Learn V_z from samples, EAL paper, equations 12, 14 and 30.

    Args:
        samples: (N, d) configurations; several trials are merged by concatenating them.
        kernel: Kernel on the coordinates; scale them first (or with a CoordinateKernel) to like magnitudes. None:
            ``usual_kernel`` of the samples.
        lam: lambda > 0, see ``scaling``.
        spectral_filter: Tail (the default, equation 30), Projection or Tikhonov.
        scaling: ``mean``: lambda compares with eigenvalues of K / N; ``gram``: with those of K.
        weights: (N,) positive weights, 2 being the same as a repeated sample; None: all 1.
        covariances: (N, d, d) or (d, d) known covariance of the samples' noise, with the Gaussian kernel: V of what the
            samples would be without it, so that noise does not widen the valley (``eal.fitting.deconvolved``). It
            takes more samples, or a larger lambda. Not for what a smoother estimates, which varies less than the truth
            (docs/experiments/known_noise.md). None: samples are taken as they are.
        method: ``auto``, ``exact`` or ``cholesky``, see ``eal.fitting.solve``.
        accuracy: Wanted bound on the error in V of the pivoted Cholesky factor; rounding may leave more.
        max_rank: Most centres.
        names: d coordinate names; None: q0, q1, ...
        units: d units; None: 1.

    Returns:
        The potential; read its ``findings``.

    Raises:
        ValueError: samples that are empty, not (N, d) or not finite; weights or covariances that do not fit, noise as
            wide as the kernel; lambda not positive or below rounding.
    """
    z = checked_samples(samples)
    kernel = usual_kernel(z) if kernel is None else kernel
    w = checked_weights(weights, len(z))
    labels, measures = checked_labels(names, units, z.shape[1])
    spectral_filter = Tail() if spectral_filter is None else spectral_filter
    sigma_lambda = checked_lambda(lam, float(w.sum()), scaling)
    limits = {"accuracy": positive("accuracy", accuracy), "max_rank": max_rank}
    with one_blas_thread() if len(z) <= 2000 else nullcontext():  # a fit of few samples stays on one BLAS thread
        if covariances is None:
            found = fitting.solve(kernel, z, w, sigma_lambda, spectral_filter, method=method, **limits)
        else:
            noise = checked_covariances(covariances, z.shape)
            linear = isinstance(kernel, LinearKernel)
            inner, a = (kernel.kernel, np.array(kernel.matrix)) if linear else (kernel, np.eye(z.shape[1]))
            if not isinstance(inner, GaussianKernel):
                raise ValueError(f"covariances need a GaussianKernel, but the kernel is {kernel}")
            noise = a @ noise @ a.T
            found = fitting.deconvolved(inner, z @ a.T, noise, w, sigma_lambda, spectral_filter, **limits)
            found = replace(found, centres=np.linalg.solve(a, found.centres.T).T)
    return EmpiricalPotential(
        kernel=kernel,
        lam=float(lam),
        spectral_filter=spectral_filter,
        scaling=scaling,
        samples=z,
        weights=w,
        centres=found.centres,
        root=found.root,
        eigenvalues=found.eigenvalues,
        missing=found.missing,
        method=found.method,
        names=labels,
        units=measures,
    ).judged()


def usual_kernel(samples: ArrayLike, *, width: float = USUAL_WIDTH, most: int = 500) -> GaussianKernel:
    """The Gaussian kernel exp(-width |x - y|^2 / m), m the median squared distance of the samples.

    Blind to the unit of the coordinates. With width 4 and lambda 1e-3 potentials of joints look as the paper's figures
    7 and 8 do; ``eal.choose`` finds those under which samples left out are likeliest.

    Args:
        samples: (N, d) configurations, in coordinates of like magnitudes.
        width: beta m.
        most: The distances of so many evenly spaced samples are looked at.
    """
    z = checked_samples(samples)
    distance = pdist(z[:: max(1, len(z) // most)], "sqeuclidean")
    median = float(np.median(distance)) if len(distance) else 0.0
    return GaussianKernel(width / (median if median > 0 else 1.0))


def load_potential(path: Path | str) -> EmpiricalPotential:
    """Read what ``EmpiricalPotential.save`` wrote.

    Raises:
        ArchiveError: the file is not one, or of another version.
    """
    return EmpiricalPotential(**archive.read(Path(path)))
