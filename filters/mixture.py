"""Several motion models as one: weights and widths learned on hidden gaps."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from mocap.filters.score import Residuals, joined
from numpy.typing import NDArray
from scipy.optimize import minimize, root_scalar
from scipy.special import ndtri, stdtrit

from eal.arrays import Array, frozen

PRIOR = 12.0
"""What gaps of one length show of scales is drawn to what those of all lengths do as if so many gaps more had, and what
those of one recording show of the width to what was learned. Chosen; the second use is measured in
docs/experiments/widths.md."""
UNCHANGED = 2.0
"""How models compare in one recording changes their scales as if so many gaps more had shown that nothing is to be
changed: of two gaps half of the logarithm is taken, of thirty nearly all. Chosen."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Mixture:
    """How K models are mixed, sample by sample.

    Model k has the weight w_k ~ exp(offset_k + slope_k log(n / 30)) / variance_k in a gap of n frames, where
    variance_k is its predicted variance times ``scale_k`` squared: near the edges of a gap others are right than in its
    middle.

    Attributes:
        offset: (K,) see above.
        slope: (K,) see above.
        length: (L,) lengths of gaps in frames, increasing.
        scale: (L, K) factor on the standard deviation that each model states in gaps of these lengths.
        widen: Factor on the mixture's standard deviation by which errors in hidden gaps are what is stated.
        dof: Of the estimate of ``widen`` squared: independent errors that tell it as well as those gaps do.
    """

    offset: Array
    slope: Array
    length: Array
    scale: Array
    widen: float
    dof: float

    def __post_init__(self) -> None:
        """Copy and freeze."""
        object.__setattr__(self, "offset", frozen("offset", self.offset, (None,)))
        object.__setattr__(self, "slope", frozen("slope", self.slope, (len(self.offset),)))
        object.__setattr__(self, "length", frozen("length", self.length, (None,)))
        object.__setattr__(self, "scale", frozen("scale", self.scale, (len(self.length), len(self.offset))))

    def scaling(self, length: NDArray[np.int64]) -> Array:
        """(K, ...) factors on stated deviations, linear in the logarithms of both; 1 where nothing is missing."""
        place, lengths = np.log(np.maximum(length, 1)), np.log(self.length)
        scale = np.exp(np.stack([np.interp(place, lengths, np.log(column)) for column in self.scale.T]))
        return np.where(np.asarray(length) > 0, scale, 1.0)

    def weights(self, variance: Array, length: NDArray[np.int64]) -> Array:
        """(K, ...) weights of samples with scaled variances (K, ...) in gaps of given lengths (...)."""
        place = np.log(np.maximum(length, 1) / 30.0)
        pad = (slice(None), *[None] * place.ndim)
        logit = self.offset[pad] + self.slope[pad] * place - np.log(variance)
        weight = np.exp(logit - logit.max(axis=0))
        return weight / weight.sum(axis=0)

    def widening(self, length: NDArray[np.int64]) -> Array:
        """Factor on the deviation, for intervals of 1.96 of it to be those of Student's t; 1 where nothing is missing.

        An error over a deviation that is an estimate with so many degrees of freedom follows Student's t.
        """
        return np.where(np.asarray(length) > 0, self.widen * stdtrit(self.dof, 0.975) / ndtri(0.975), 1.0)

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
        gaps, as if ``UNCHANGED`` gaps more had shown that nothing is to be changed; that is for the weights.

        What was learned is the prior of the width, and counts as ``PRIOR`` gaps at most, for recordings differ.

        Args:
            residuals: What each of the K models missed the hidden samples by.
        """
        gap, found = residuals[0].gap, list[float]()
        for part, scaling in zip(residuals, self.scaling(residuals[0].length), strict=True):
            scaled = replace(part, variance=part.variance * scaling[:, None] ** 2)
            found.append(_log_scale(scaled))
        count = len(np.unique(gap))
        scaled = replace(
            self, scale=self.scale * np.exp(count / (count + UNCHANGED) * (np.array(found) - np.mean(found)))
        )
        learned = min(self.dof, PRIOR * residuals[0].error_m.shape[1])
        own = mixed_residuals(replace(scaled, widen=1.0, dof=np.inf), residuals)
        return replace(scaled, **_width(own, prior=self.widen, dof=learned))


def learn_mixture(residuals: Sequence[Residuals]) -> Mixture:
    """The mixture of K models that fills hidden gaps with the least error: the mean over lengths of log rmse.

    A generalisation of stacking (Wolpert 1992). Each model's scale in gaps of a length is the factor that its errors
    show there, drawn to the geometric mean over lengths as if ``PRIOR`` gaps more had shown that (``_width``). The
    width is that of gaps that the mixture was not learned from (each fifth of them by the mixture of the others): in
    its own gaps a mixture errs by less than in those that it will fill.

    Args:
        residuals: What each model missed the same hidden samples by.
    """
    return _Fifths(residuals).mixture()


def crossed(residuals: Sequence[Residuals]) -> Residuals | None:
    """What a mixture misses gaps by that it was not learned from: each fifth of them, by that of the others.

    Args:
        residuals: What each model missed them by.

    Returns:
        None: there is one gap.
    """
    fifths = _Fifths(residuals)
    if len(fifths.every) < 2:
        return None
    parts = []
    for k in fifths.every:
        others = fifths.mixture(k)
        parts.append(mixed_residuals(others, [part.some(fifths.fold == k) for part in residuals]))
    return joined(parts)


class _Fifths:
    """Mixtures of some fifths of the hidden gaps; weights that several of them share are learned once."""

    def __init__(self, residuals: Sequence[Residuals]) -> None:
        self.residuals, self.known = residuals, dict[frozenset[int], Mixture]()
        self.fold = np.unique(residuals[0].gap, return_inverse=True)[1] % 5
        self.every = set(np.unique(self.fold).tolist())

    def mixture(self, *left: int) -> Mixture:
        """Of all fifths but some; its width is that of each fifth by the mixture of the others."""
        chosen, parts = self._chosen({*left}), []
        for k in sorted(self.every.difference(left)):
            others = self._chosen({*left, k}) if len(self.every.difference(left)) > 1 else chosen
            parts.append(mixed_residuals(others, [part.some(self.fold == k) for part in self.residuals]))
        return replace(chosen, **_width(joined(parts), prior=1.0, dof=float(self.residuals[0].error_m.shape[1])))

    def _chosen(self, left: set[int]) -> Mixture:
        key, kept = frozenset(left), ~np.isin(self.fold, [*left])
        if key not in self.known:
            self.known[key] = _mixture([part.some(kept) for part in self.residuals])
        return self.known[key]


def mixed_residuals(mixture: Mixture, residuals: Sequence[Residuals]) -> Residuals:
    """What a mixture misses hidden samples by, from what each model does."""
    length = residuals[0].length
    error = np.stack([part.error_m for part in residuals])
    variance = np.stack([part.variance for part in residuals]) * mixture.scaling(length)[..., None] ** 2
    weight = mixture.weights(variance.mean(axis=2), length)
    mean = np.einsum("kn,kni->ni", weight, error)
    total = np.einsum("kn,kni->ni", weight, variance + (error - mean) ** 2)
    return replace(residuals[0], error_m=mean, variance=total * mixture.widening(length)[:, None] ** 2)


def _width(found: Residuals, *, prior: float, dof: float) -> dict[str, float]:
    """``widen`` and ``dof``: the factor on stated deviations that errors show, drawn to that of a prior.

    The square is the posterior mean of a variance under a scaled inverse chi-square prior (Gelman et al. 2013, Bayesian
    Data Analysis, section 2.6): the mean of both, by degrees of freedom. What errors show is their mean square, less
    that of the noise, over what is stated. A sample counts for what it shows (its Fisher information): the square of
    the estimate's share of the variance. Samples of a gap err alike: the variance of the mean square is the one from
    gap to gap (the sandwich estimate for clusters), in units of the variance that errors show, and a gap is no more
    than one normal error of each coordinate. Degrees of freedom are 2 over the relative variance (Satterthwaite 1946).

    Args:
        found: What a model or a mixture misses hidden samples by, its deviations not widened.
        prior: Factor of the prior.
        dof: Its degrees of freedom; those of one gap where only the models' own scales speak (a unit information
            prior: Kass & Wasserman 1995).
    """
    gap = np.unique(found.gap, return_inverse=True)[1]
    count, n_axes = int(gap.max()) + 1, found.error_m.shape[1]
    squared, noise, shown = prior**2, found.noise[:, None], 0.0
    for _ in range(20):  # Fisher scoring: ten rounds were enough on seven recordings, to 1e-9
        before = squared
        variance = squared * found.variance
        share = (variance / (variance + noise)) ** 2
        excess = share * ((found.error_m**2 - noise) / variance - 1)
        mean = excess.sum() / share.sum()
        shows = (variance + noise) / (max(1 + mean, 1e-3) * variance + noise)
        apart = np.bincount(gap, (shows * (excess - mean * share)).sum(axis=1))
        varies = np.sum(apart**2) / share.sum() ** 2 * count / max(count - 1, 1)
        shown = 2 / max(varies, 2 / (count * n_axes))
        squared = (dof * prior**2 + shown * squared * max(1 + mean, 0.0)) / (dof + shown)
        if abs(squared - before) < 1e-13 * before:
            break
    return {"widen": float(np.sqrt(squared)), "dof": float(dof + shown)}


def _log_scale(part: Residuals) -> float:
    """Logarithm of the factor on a model's deviation by which its errors are as large as stated, gap by gap.

    That is: by which root mean squares, in deviations from measurements, are 1 in the geometric mean over gaps. It
    stays within 2 of 0: where measurements err by more than the model, there is nothing to see.
    """
    groups = [part.gap == one for one in np.unique(part.gap)]

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
    n_axes = residuals[0].error_m.shape[1]
    for i, part in enumerate(residuals):
        each = [part.some(length == n) for n in lengths]
        alone = [_width(one, prior=1.0, dof=float(n_axes))["widen"] for one in each]
        overall = float(np.exp(np.mean(np.log(alone))))
        scale[:, i] = [_width(one, prior=overall, dof=PRIOR * n_axes)["widen"] for one in each]

    def mixture(x: Array) -> Mixture:
        offset, slope = np.concatenate([np.zeros((2, 1)), x.reshape(2, k - 1)], axis=1)
        return Mixture(offset=offset, slope=slope, length=lengths, scale=scale, widen=1.0, dof=np.inf)

    start = mixture(np.zeros(2 * k - 2))
    error = np.stack([part.error_m for part in residuals])
    variance = np.stack([part.variance for part in residuals]).mean(axis=2) * start.scaling(length) ** 2

    def cost(x: Array) -> float:
        weight = mixture(x).weights(variance, length)
        squared = np.sum(np.einsum("kn,kni->ni", weight, error) ** 2, axis=1)
        level = np.mean([0.5 * np.log(squared[length == n].mean()) for n in lengths])
        return float(level + 0.1 * np.sum(x**2))  # offsets and slopes stay small that gain little

    return mixture(minimize(cost, np.zeros(2 * k - 2), method="L-BFGS-B").x) if k > 1 else start
