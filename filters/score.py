"""How estimates compare with what was hidden: the one score of learning, validation and benchmarks."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from mocap.filters.hide import GAP_FRAMES, Hidden, length_bins
from mocap.filters.poses import MarkerTrial
from numpy.typing import NDArray

from eal.arrays import Z95, Array, varying


@dataclass(frozen=True, kw_only=True)
class Score:
    """How estimates of samples did.

    Attributes:
        samples: Number of samples that were compared.
        rmse_mm: Root mean square of the distance to the measured sample; NaN without samples.
        coverage95: Share of coordinates inside 1.96 standard deviations; NaN without intervals.
        z: Root mean square of errors of coordinates over stated standard deviations, 1 where they are right; NaN
            without intervals.
        nll: Mean negative log likelihood of a coordinate (of all together, over their number; lengths in mm); NaN
            without covariances, or where one is not positive definite.
        by_length_mm: The same as ``rmse_mm`` in gaps of up to as many frames as each of ``GAP_FRAMES``, and of more
            than the length before it; NaN without samples. Empty where gaps are not told apart.
    """

    samples: int
    rmse_mm: float
    coverage95: float
    z: float
    nll: float
    by_length_mm: tuple[float, ...] = ()

    def as_json(self) -> dict[str, float | None]:
        """``rmse_mm``, ``coverage95`` (per cent), ``z`` for reports; None where not defined."""
        return {
            "rmse_mm": self.rmse_mm if np.isfinite(self.rmse_mm) else None,
            "coverage95": 100 * self.coverage95 if np.isfinite(self.coverage95) else None,
            "z": self.z if np.isfinite(self.z) else None,
        }


def score(error_m: Array, cov_m2: Array | None) -> Score:
    """The score of errors (n, d), with the covariances (n, d, d) that were stated for them; None: none were."""
    if not len(error_m):
        return Score(samples=0, rmse_mm=np.nan, coverage95=np.nan, z=np.nan, nll=np.nan)
    rmse = float(1e3 * np.sqrt(np.mean(np.sum(error_m**2, axis=1))))
    if cov_m2 is None:
        return Score(samples=len(error_m), rmse_mm=rmse, coverage95=np.nan, z=np.nan, nll=np.nan)
    variance, d = np.diagonal(cov_m2, axis1=1, axis2=2), error_m.shape[1]
    nll = np.nan
    if np.isfinite(cov_m2).all() and (variance > 0).all():
        sign, log_det = np.linalg.slogdet(cov_m2 * 1e6)
        if (sign > 0).all():
            mahalanobis = np.einsum("ki,ki->k", error_m, np.linalg.solve(cov_m2, error_m[..., None])[..., 0])
            nll = float(np.mean(mahalanobis + log_det + d * np.log(2 * np.pi)) / (2 * d))
    return Score(
        samples=len(error_m),
        rmse_mm=rmse,
        coverage95=float(np.mean(np.abs(error_m) <= Z95 * np.sqrt(np.maximum(variance, 0.0)))),
        z=float(np.sqrt(np.mean(error_m**2 / variance))) if (variance > 0).all() else np.nan,
        nll=nll,
    )


def compared(xyz_m: Array, cov_m2: Array | None, truth_m: Array, where: NDArray[np.bool_]) -> Score:
    """The score of estimates (T, M, 3) against the truth.

    Args:
        xyz_m: (T, M, 3) estimates.
        cov_m2: (T, M, 3, 3) their covariance; None: the method has none.
        truth_m: (T, M, 3) truth.
        where: (T, M) samples to compare; those without estimate or truth do not count.
    """
    ok = where & np.isfinite(xyz_m[..., 0]) & np.isfinite(truth_m[..., 0])
    axes = varying(truth_m)
    return score((xyz_m - truth_m)[ok][:, axes], None if cov_m2 is None else cov_m2[ok][:, axes][:, :, axes])


@dataclass(frozen=True, eq=False, kw_only=True)
class Residuals:
    """What one model missed n hidden samples by, and what it stated.

    Attributes:
        error_m: (n, d) estimates minus measurements; d = 3, or 2 in a plane.
        variance: (n, d) stated variance of the estimates.
        noise: (n,) variance of the measurements.
        gap: (n,) number of the gap.
        length: (n,) its length in frames.
    """

    error_m: Array
    variance: Array
    noise: Array
    gap: NDArray[np.int64]
    length: NDArray[np.int64]

    @property
    def expected(self) -> Array:
        """(n, d) stated variance of the errors: of estimates and measurements."""
        return self.variance + self.noise[:, None]

    @property
    def log_rmse(self) -> float:
        """Mean over lengths of the logarithm of the root mean square distance in metres."""
        squared = np.sum(self.error_m**2, axis=1)
        return float(np.mean([0.5 * np.log(squared[self.length == n].mean()) for n in np.unique(self.length)]))

    def some(self, which: NDArray[np.bool_]) -> "Residuals":
        """Of some of the samples."""
        return Residuals(**{name: value[which] for name, value in vars(self).items()})

    def score(self) -> Score:
        """The score, errors being those from measurements."""
        whole = score(self.error_m, self.expected[..., None] * np.eye(self.error_m.shape[1]))
        bins = length_bins(self.length)
        each = [score(self.error_m[bins == i], None).rmse_mm for i in range(len(GAP_FRAMES))]
        return replace(whole, by_length_mm=tuple(each))


def residuals_of(hidden: Hidden[MarkerTrial], xyz_m: Array, cov_m2: Array) -> Residuals:
    """Compare estimates (T, M, 3) with covariance (T, M, 3, 3) with what was hidden."""
    where, axes = hidden.mask, varying(hidden.trial.xyz_m)
    return Residuals(
        error_m=(xyz_m - hidden.trial.xyz_m)[where][:, axes],
        variance=np.diagonal(cov_m2[where], axis1=-2, axis2=-1)[:, axes],
        noise=hidden.trial.sd_m[where] ** 2,
        gap=hidden.gap[where],
        length=hidden.length[where],
    )


def joined(parts: Sequence[Residuals]) -> Residuals:
    """The hidden samples of several trials together; gaps are numbered anew."""
    start = np.cumsum([0, *(int(part.gap.max(initial=-1)) + 1 for part in parts)])
    return Residuals(
        error_m=np.concatenate([part.error_m for part in parts]),
        variance=np.concatenate([part.variance for part in parts]),
        noise=np.concatenate([part.noise for part in parts]),
        gap=np.concatenate([part.gap + s for part, s in zip(parts, start, strict=False)]),
        length=np.concatenate([part.length for part in parts]),
    )
