"""Metric, kernel width, lambda and weight of a potential: those under which samples that it has not seen are likeliest.

1 - V_z over its integral is a probability density. With a Gaussian kernel the integral is closed, and each trial
left out costs one eigenproblem, for all lambda.
"""

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.distance import cdist

from eal.arrays import Array
from eal.checks import checked_covariances, checked_samples
from eal.composite import LinearKernel
from eal.kernels import GaussianKernel
from eal.potential import USUAL_WIDTH, usual_kernel
from eal.spectral import Tail

ONE = "one scale"
LAMBDAS = (3e-3, 1e-3, 3e-4)
"""V at the samples is some times lambda: 0.1 with 1e-2 and narrow kernels. Above the first eigenvalue V is one minus a
kernel density, which is likelier still, and has no valley."""
FARTHEST_FACTOR = 12
"""Beta is at most so many factors of two from the usual one. Chosen; not measured."""
WEIGHTS = tuple(2.0**k for k in range(-2, 9))
LEFT_OUT_BLOCKS = 5
"""A single recording is left out in so many blocks of consecutive samples, which hold a cycle or more each.
Chosen; not measured."""


@dataclass(frozen=True, kw_only=True)
class Choice:
    """What was chosen.

    Attributes:
        kernel: The kernel, on the coordinates as they are.
        lam: lambda, for ``eal.fit_potential``.
        metric: ``one scale``: all coordinates count alike; ``whitened``: each direction in units of its standard
            deviation; ``noise``: in units of that of the noise.
        width: beta times the median squared distance of the samples in that metric.
        weight: w under which (1 - V)^w is likeliest: 1/eps^2 of V_z as an energy in units of the agitation.
        log_likelihood: Mean log density of the samples left out, with w = 1.
    """

    kernel: GaussianKernel | LinearKernel
    lam: float
    metric: str
    width: float
    weight: float
    log_likelihood: float


def choose(
    samples: ArrayLike, *, trials: Sequence[Hashable] | None = None, covariances: ArrayLike | None = None
) -> Choice:
    """Kernel and lambda under which each trial is likeliest by the potential of the others.

    Beta goes up or down by factors of two from the usual one as long as the likelihood rises.

    Args:
        samples: (N, d) configurations in coordinates that one scale makes sense for; single recordings in the order of
            time.
        trials: (N,) which trial each is of. None: five blocks of consecutive samples are left out in turn.
        covariances: (N, d, d) or (d, d) of the samples' noise: no kernel is taken that is not wider than the noise of
            half of them, and a metric in units of it is tried where it differs between directions. None: not known.

    Returns:
        The choice.

    Raises:
        ValueError: samples that are empty or not finite, names of trials that are not N, or of one trial only.
    """
    z = checked_samples(samples)
    if trials is not None and len(trials) != len(z):
        raise ValueError(f"trials must name that of each of the {len(z)} samples, but has {len(trials)} names")
    noise = None if covariances is None else checked_covariances(covariances, z.shape)
    fold = np.arange(len(z)) * LEFT_OUT_BLOCKS // len(z)
    if trials is not None:
        order = {name: i for i, name in enumerate(dict.fromkeys(trials))}
        groups = min(len(order), 2 * LEFT_OUT_BLOCKS)  # of whole trials: as good as hundreds one by one
        fold = np.array([order[name] * groups // len(order) for name in trials])
    # over 27 joints they find 95 % of what all of 50 to 500 find in log likelihood
    some = np.linspace(0, len(z) - 1, min(len(z), 100)).astype(int)
    z, fold = z[some], fold[some]
    if len(np.unique(fold)) < 2:
        raise ValueError("one trial cannot be left out: give samples of two at least, or no trials")
    start, tried = 0, []
    for metric, matrix in _metrics(z, noise):
        y, shift = z @ matrix.T, float(np.linalg.slogdet(matrix)[1])
        usual, most = usual_kernel(y), FARTHEST_FACTOR
        if noise is not None:
            sd2 = max(float(np.median(np.linalg.eigvalsh(matrix @ noise @ matrix.T)[:, -1])), 1e-300)
            # at 1 a sample's noise hides what it says of V (``deconvolved``)
            most = int(np.clip(np.floor(np.log2(0.5 / (4.0 * usual.beta * sd2))), -most, most))

        def score(power: int, y: Array = y, usual: GaussianKernel = usual) -> Array:
            return _held_out(y, fold, usual.beta * 2.0**power, LAMBDAS)

        at = min(start, most)
        found = {at: score(at)}
        for step in (1, -1):
            while -FARTHEST_FACTOR <= at + step <= most:
                found[at + step] = score(at + step)
                if found[at + step].max() <= found[at].max():
                    break
                at += step
            if len(found) > 2:
                break
        start = max(found, key=lambda power: found[power].max())  # another metric begins there
        kernel = GaussianKernel(usual.beta * 2.0**start)
        lam = LAMBDAS[int(np.argmax(found[start]))]
        tried.append((float(found[start].max()) + shift, metric, matrix, kernel, lam, 2.0**start))
    likelihood, metric, matrix, kernel, lam, factor = max(tried, key=lambda one: one[0])
    return Choice(
        kernel=kernel if metric == ONE else LinearKernel(kernel, tuple(map(tuple, matrix.tolist()))),
        lam=lam,
        metric=metric,
        width=USUAL_WIDTH * factor,
        weight=_weight(z @ matrix.T, fold, kernel.beta, lam),
        log_likelihood=likelihood,
    )


def _metrics(z: Array, noise: Array | None) -> Iterator[tuple[str, Array]]:
    """Names and (d, d) matrices of coordinates that are divided by 1, by their spread, and by their noise."""
    d = z.shape[1]
    yield ONE, np.eye(d)
    if d > 1:
        yield from _in_units("whitened", np.cov(z.T))
        if noise is not None:
            yield from _in_units("noise", noise.mean(axis=0))


def _in_units(name: str, cov: Array) -> Iterator[tuple[str, Array]]:
    """The matrix that makes a covariance the identity; nothing where it is one already, or singular."""
    size, axes = np.linalg.eigh(cov)
    if size[0] > 1e-9 * size[-1] and size[-1] > 1.01 * size[0]:
        yield name, axes.T / np.sqrt(size / size[-1])[:, None]


def _others(
    z: Array, fold: NDArray[np.intp], beta: float, lams: Sequence[float], at: Array
) -> Iterator[tuple[Array, Array, Array]]:
    """For each fold, of the potential of the others: 1 - V at its samples, at points, and its integral.

    Args:
        z: (N, d) samples.
        fold: (N,) which fold each is in.
        beta: Of the Gaussian kernel.
        lams: L values of lambda.
        at: (n, d) points.

    Yields:
        (k, L) 1 - V at the samples of the fold; (n, L) at the points; (L,) integral of 1 - V.
    """
    kernel = GaussianKernel(beta)
    gram, features = kernel.gram(z, z), kernel.gram(at, z)
    overlap = (0.5 * np.pi / beta) ** (0.5 * z.shape[1]) * np.sqrt(gram)  # integrals of K_i K_j
    for one in np.unique(fold):
        out = fold == one
        sigma, axes = np.linalg.eigh(gram[~out][:, ~out] / (~out).sum())
        # (1 - V)(x) = sum_j gain_j (u_j'k(x))^2 / n: T_z has the spectrum of the Gram matrix over n
        gain = np.stack([Tail().gain(sigma, lam) for lam in lams], axis=1) / (~out).sum()
        integral = np.einsum("ij,ij->j", axes, overlap[~out][:, ~out] @ axes) @ gain
        yield (gram[out][:, ~out] @ axes) ** 2 @ gain, (features[:, ~out] @ axes) ** 2 @ gain, integral


def _held_out(z: Array, fold: NDArray[np.intp], beta: float, lams: Sequence[float]) -> Array:
    """(L,) mean log density of samples left out, (1 - V) / integral of it."""
    total = np.zeros(len(lams))
    for near, _, integral in _others(z, fold, beta, lams, z[:0]):
        total += (np.log(np.maximum(near, 1e-300)) - np.log(integral)).sum(axis=0)
    return total / len(z)


def _weight(z: Array, fold: NDArray[np.intp], beta: float, lam: float) -> float:
    """The w under which samples left out are likeliest by (1 - V)^w over its integral, by importance sampling."""
    rng, d = np.random.default_rng(0), z.shape[1]
    sd = 1.0 / np.sqrt(2.0 * beta)  # twice as wide as the square of a kernel
    # the integral of (1 - V)^w to 5 %: factors of two in w change the likelihood by more
    at = z[rng.integers(0, len(z), 500)] + sd * rng.standard_normal((500, d))
    drawn = np.exp(-beta * cdist(at, z, "sqeuclidean")).mean(axis=1) * (beta / np.pi) ** (0.5 * d)
    weights, total = np.array(WEIGHTS), np.zeros(len(WEIGHTS))
    for near, there, _ in _others(z, fold, beta, (lam,), at):
        integral = (np.maximum(there, 1e-300) ** weights / drawn[:, None]).mean(axis=0)
        total += weights * np.log(np.maximum(near, 1e-300)).sum() - len(near) * np.log(integral)
    return float(weights[int(np.argmax(total))])
