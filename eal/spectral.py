"""Spectral filters g_lambda: which eigenvalues of the sampled operator T_z count, and how much.

sigma are eigenvalues of T_z = K / N (EAL paper, equation 12), between 0 and 1 for a kernel with K(x, x) = 1. A filter
is used through its response r = sigma g(sigma), which is defined for sigma <= 0 too: rounding leaves some there.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Literal, final, get_args

import numpy as np

from eal.arrays import Array

Scaling = Literal["mean", "gram"]


class SpectralFilter(ABC):
    """g_lambda(sigma) >= 0 with sigma g_lambda(sigma) between 0 and 1."""

    name: str

    @abstractmethod
    def gain(self, sigma: Array, lam: float) -> Array:
        """g_lambda(sigma), for any real sigma."""

    def response(self, sigma: Array, lam: float) -> Array:
        """Sigma g_lambda(sigma) in [0, 1]; 0 for sigma <= 0."""
        positive = np.maximum(sigma, 0.0)
        return np.minimum(positive * self.gain(positive, lam), 1.0)


@final
@dataclass(frozen=True)
class Tail(SpectralFilter):
    """g = 1/sigma from lambda up, 1/lambda below: equation 30, with 1/lambda for sigma <= 0 too."""

    name: str = "tail"

    def gain(self, sigma: Array, lam: float) -> Array:
        """1 / max(sigma, lambda)."""
        return 1.0 / np.maximum(sigma, lam)


@final
@dataclass(frozen=True)
class Projection(SpectralFilter):
    """g = 1/sigma above lambda, 0 elsewhere: section 6 of the EAL paper, where the printed g = 1 is a slip."""

    name: str = "projection"

    def gain(self, sigma: Array, lam: float) -> Array:
        """1 / sigma where sigma > lambda."""
        return np.where(sigma > lam, 1.0 / np.maximum(sigma, lam), 0.0)


@final
@dataclass(frozen=True)
class Tikhonov(SpectralFilter):
    """g = 1 / (sigma + lambda), with 1/lambda for sigma <= 0."""

    name: str = "tikhonov"

    def gain(self, sigma: Array, lam: float) -> Array:
        """1 / (max(sigma, 0) + lambda)."""
        return 1.0 / (np.maximum(sigma, 0.0) + lam)


FILTERS: dict[str, SpectralFilter] = {f.name: f for f in (Tail(), Projection(), Tikhonov())}


def effective_lambda(lam: float, total: float, scaling: Scaling) -> float:
    """Lambda in units of sigma = s / N.

    ``mean`` compares lambda with sigma (equation 12); ``gram`` with the eigenvalues s of K itself, the literal reading
    of equation 31, which is lambda / N here.

    Args:
        lam: As given.
        total: N, or the sum of the weights.
        scaling: ``mean`` or ``gram``.

    Raises:
        ValueError: another scaling.
    """
    if scaling not in get_args(Scaling):
        raise ValueError(f"scaling must be one of {', '.join(get_args(Scaling))}, but is {scaling!r}")
    return lam / total if scaling == "gram" else lam
