"""Several motion models as one: weights and widths learned on hidden gaps."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from mocap.filters.score import Residuals
from numpy.typing import NDArray
from scipy.optimize import minimize, minimize_scalar, root_scalar

from eal.arrays import Z95, Array, frozen

PRIOR = 12.0
"""What gaps of one length show of widths and scales is drawn to that of all lengths as if so many gaps more had."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Mixture:
    """How K models are mixed, sample by sample.

    Model k has the weight w_k ~ exp(offset_k + slope_k log(n / 30)) / variance_k^power in a gap of n frames, where
    variance_k is its predicted variance times ``scale_k`` squared: near the edges of a gap others are right than in its
    middle.

    Attributes:
        offset: (K,) see above.
        slope: (K,) see above.
        power: See above.
        length: (L,) lengths of gaps in frames, increasing.
        scale: (L, K) factor on the standard deviation that each model states in gaps of these lengths.
        widen: (L,) factor on the mixture's standard deviation.
    """

    offset: Array
    slope: Array
    power: float
    length: Array
    scale: Array
    widen: Array

    def __post_init__(self) -> None:
        """Copy and freeze."""
        object.__setattr__(self, "offset", frozen("offset", self.offset, (None,)))
        object.__setattr__(self, "slope", frozen("slope", self.slope, (len(self.offset),)))
        object.__setattr__(self, "length", frozen("length", self.length, (None,)))
        object.__setattr__(self, "scale", frozen("scale", self.scale, (len(self.length), len(self.offset))))
        object.__setattr__(self, "widen", frozen("widen", self.widen, (len(self.length),)))

    def scaling(self, length: NDArray[np.int64]) -> Array:
        """(K, ...) factors on stated deviations, linear in the logarithms of both; 1 where nothing is missing."""
        place, known = np.log(np.maximum(length, 1)), np.log(self.length)
        scale = np.exp(np.stack([np.interp(place, known, np.log(column)) for column in self.scale.T]))
        return np.where(np.asarray(length) > 0, scale, 1.0)

    def weights(self, variance: Array, length: NDArray[np.int64]) -> Array:
        """(K, ...) weights of samples with scaled variances (K, ...) in gaps of given lengths (...)."""
        place = np.log(np.maximum(length, 1) / 30.0)
        pad = (slice(None), *[None] * place.ndim)
        logit = self.offset[pad] + self.slope[pad] * place - self.power * np.log(variance)
        weight = np.exp(logit - logit.max(axis=0))
        return weight / weight.sum(axis=0)

    def widening(self, length: NDArray[np.int64]) -> Array:
        """Factor on the deviation, linear in the logarithms of both; 1 where nothing is missing (length 0)."""
        place = np.log(np.maximum(length, 1))
        widen = np.exp(np.interp(place, np.log(self.length), np.log(self.widen)))
        return np.where(np.asarray(length) > 0, widen, 1.0)

    def combine(
        self, xyz_m: Sequence[Array], cov_m2: Sequence[Array], length: NDArray[np.int64]
    ) -> tuple[Array, Array]:
        """Mean and covariance of the mixture of K normal densities.

        Args:
            xyz_m: K arrays (T, M, 3); NaN where a model has no estimate; one must have one.
            cov_m2: K arrays (T, M, 3, 3).
            length: (T, M) length of the gap that a sample lies in; 0 where it was measured.
        """
        means, covs = np.array(xyz_m), np.array(cov_m2) * (self.scaling(length) ** 2)[..., None, None]
        silent = np.isnan(means[..., 0])
        means[silent], covs[silent] = 0.0, 0.0
        weight = self.weights(np.where(silent, np.inf, np.trace(covs, axis1=-2, axis2=-1) / 3), length)
        mean = np.einsum("ktm,ktmi->tmi", weight, means)
        cov = np.einsum("ktm,ktmij->tmij", weight, covs)
        cov += np.einsum("ktm,ktmi,ktmj->tmij", weight, means - mean, means - mean)
        return mean, cov * (self.widening(length) ** 2)[..., None, None]

    def calibrated(self, residuals: Sequence[Residuals]) -> "Mixture":
        """The mixture with scales and intervals that hold in gaps hidden in a recording itself.

        Another animal, another day: some models err more here than in what the mixture was learned from. The scale of
        each is multiplied by what makes its root mean square error in stated deviations 1 in the geometric mean over
        gaps, as if two gaps more had shown that nothing is to be changed; that is for the weights. All widths are
        multiplied by the ratio that 95 % of the mixture's errors stay under (``learn_mixture``), with three such
        gaps, whatever the scales have become; by 1 where it is less, for a few gaps that were filled well do not tell
        how other ones will be (docs/experiments/interval_widths.md).

        Args:
            residuals: What each of the K models missed the hidden samples by.
        """
        gap, found = residuals[0].gap, []
        for part, scaling in zip(residuals, self.scaling(residuals[0].length), strict=True):
            scaled = replace(part, variance=part.variance * scaling[:, None] ** 2)
            found.append(_log_scale(scaled, [gap == one for one in np.unique(gap)]))
        scaled = replace(self, scale=self.scale * np.exp(_share(gap, 2.0) * np.array(found)))
        before, after = (_conformal(_widths(mixture, residuals), gap) for mixture in (self, scaled))
        factor = after / before * max(1.0, before) ** _share(gap, 3.0)
        return replace(scaled, widen=np.clip(scaled.widen * factor, 0.1, 10.0))


def with_own_widths(mixture: Mixture, residuals: Sequence[Residuals]) -> Mixture:
    """The mixture with widths under which root mean square errors are what is stated, for the recording of the gaps.

    What is learned for other recordings is wider (``learn_mixture``): their movement differs by more than gaps of one
    do. The widths of a length are drawn to that of all as if ``PRIOR`` gaps more had shown it.

    Args:
        mixture: The mixture.
        residuals: What each model missed hidden samples of the recording by.
    """
    found = mixed_residuals(replace(mixture, widen=np.ones(len(mixture.length))), residuals)
    overall = _width(found)
    scaled = replace(found, variance=found.variance * overall**2)
    widen = [overall * _width(scaled.some(found.length == n), prior=PRIOR) for n in mixture.length]
    return replace(mixture, widen=np.clip(widen, 0.3, 5.0))


def learn_mixture(residuals: Sequence[Residuals]) -> Mixture:
    """The mixture of K models that fills hidden gaps with the least error: the mean over lengths of log rmse.

    A generalisation of stacking (Wolpert 1992). Each model's scale is the root mean square of its errors in units of
    what it states in gaps of a length. The widening is a quantile of the mixture's errors in units of 1.96 deviations,
    in gaps that it was not learned from (each fifth of them by the mixture of the others); its level is
    that of conformal prediction, 95 % (1 + 1 / n) for n errors (Lei et al. 2018), of which a gap is taken to show ten
    that are independent. Both are drawn to those of all lengths
    as if ``PRIOR`` gaps more had shown them.

    Args:
        residuals: What each model missed the same hidden samples by.
    """
    chosen = _mixture(residuals)
    gap, length = residuals[0].gap, residuals[0].length
    fold = np.unique(gap, return_inverse=True)[1] % 5
    ratio = np.empty(residuals[0].error_m.shape)
    for k in range(5):
        here = fold == k
        known = chosen if here.all() or not here.any() else _mixture([part.some(~here) for part in residuals])
        ratio[here] = _widths(known, [part.some(here) for part in residuals])
    overall = _conformal(ratio, gap)
    widen = []
    for n in chosen.length:
        here = length == n
        share = _share(gap[here], PRIOR)
        widen.append(_conformal(ratio[here], gap[here]) ** share * overall ** (1 - share))
    return replace(chosen, widen=np.clip(widen, 0.3, 5.0))


def mixed_residuals(mixture: Mixture, residuals: Sequence[Residuals]) -> Residuals:
    """What a mixture misses hidden samples by, from what each model does."""
    length = residuals[0].length
    error = np.stack([part.error_m for part in residuals])
    variance = np.stack([part.variance for part in residuals]) * mixture.scaling(length)[..., None] ** 2
    weight = mixture.weights(variance.mean(axis=2), length)
    mean = np.einsum("kn,kni->ni", weight, error)
    total = np.einsum("kn,kni->ni", weight, variance + (error - mean) ** 2)
    return replace(residuals[0], error_m=mean, variance=total * mixture.widening(length)[:, None] ** 2)


def _widths(mixture: Mixture, residuals: Sequence[Residuals]) -> Array:
    """(n, 3) factors, a tenth at least, on a mixture's deviation by which 95 % intervals just hold measurements."""
    found = mixed_residuals(mixture, residuals)
    beyond = (found.error_m / Z95) ** 2 - found.noise[:, None]
    return np.sqrt(np.maximum(beyond / found.variance, 0.01))


def _width(found: Residuals, *, prior: float = 0.0) -> float:
    """The factor on stated deviations under which normal errors are likeliest, gaps counting alike.

    Without noise the mean square of errors is then what is stated. Its logarithm is drawn to 0 as if ``prior`` gaps
    more had shown that nothing is to be changed. A gap counts for what it shows (its Fisher information): the square
    of the estimate's share of the variance, for where measurements err by more than the estimate nothing is seen of it.
    """
    count = np.unique(found.gap, return_inverse=True, return_counts=True)
    weight = (1 / count[2][count[1]])[:, None] / found.error_m.shape[1]  # 1 for each gap

    def cost(log_factor: float) -> float:
        variance = np.exp(2 * log_factor) * found.variance + found.noise[:, None]
        return float(np.sum(weight * (found.error_m**2 / variance + np.log(variance))))

    best: Any = minimize_scalar(cost, bounds=(-np.log(10), np.log(10)), method="bounded", options={"xatol": 1e-4})
    shown = float(np.sum(weight * (found.variance / found.expected) ** 2))
    return float(np.exp(best.x * shown / (shown + prior)))


def _log_scale(part: Residuals, groups: Sequence[NDArray[np.bool_]]) -> float:
    """Logarithm of the factor on a model's deviation by which its errors are as large as stated.

    That is: by which root mean squares, in deviations from measurements, are 1 in the geometric mean over groups of
    samples. It stays within 2 of 0: where measurements err by more than the model, there is nothing to see.
    """

    def excess(log_scale: float) -> float:
        squared = part.error_m**2 / (np.exp(2 * log_scale) * part.variance + part.noise[:, None])
        return float(np.mean([np.log(squared[group].mean()) for group in groups]))

    if excess(2.0) >= 0:
        return 2.0
    return -2.0 if excess(-2.0) <= 0 else float(root_scalar(excess, bracket=(-2.0, 2.0), xtol=1e-6).root)


def _mixture(residuals: Sequence[Residuals]) -> Mixture:
    """Scales and weights; see ``learn_mixture``."""
    k, length = len(residuals), residuals[0].length
    lengths = np.unique(length).astype(float)
    scale = np.ones((len(lengths), k))
    for i, part in enumerate(residuals):
        overall = _log_scale(part, [np.ones(len(length), dtype=bool)])
        for j, n in enumerate(lengths):
            share = _share(part.gap[length == n], PRIOR)
            scale[j, i] = np.exp(share * _log_scale(part, [length == n]) + (1 - share) * overall)

    def mixture(x: Array) -> Mixture:
        offset, slope = np.concatenate([np.zeros((2, 1)), x.reshape(2, k - 1)], axis=1)
        ones = np.ones(len(lengths))
        return Mixture(offset=offset, slope=slope, power=1.0, length=lengths, scale=scale, widen=ones)

    start = mixture(np.zeros(2 * k - 2))
    error = np.stack([part.error_m for part in residuals])
    stated = np.stack([part.variance for part in residuals]).mean(axis=2) * start.scaling(length) ** 2

    def cost(x: Array) -> float:
        weight = mixture(x).weights(stated, length)
        squared = np.sum(np.einsum("kn,kni->ni", weight, error) ** 2, axis=1)
        level = np.mean([0.5 * np.log(squared[length == n].mean()) for n in lengths])
        return float(level + 0.1 * np.sum(x**2))  # offsets and slopes stay small that gain little

    return mixture(minimize(cost, np.zeros(2 * k - 2), method="L-BFGS-B").x) if k > 1 else start


def _conformal(ratio: Array, gap: NDArray[np.int64]) -> float:
    """The 95 % quantile of ratios, a little more where few gaps show it."""
    return float(np.quantile(ratio, min(1.0, 0.95 * (1 + 0.1 / len(np.unique(gap))))))


def _share(gap: NDArray[np.int64], prior: float) -> float:
    """How far what so many gaps show is believed."""
    count = len(np.unique(gap))
    return count / (count + prior)
