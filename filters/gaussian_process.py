"""Gaussian-process regression over several trials, its covariance learned by marginal likelihood.

A value y at the inputs x, in trial k at time t, is a Gaussian process (Rasmussen & Williams 2006) of covariance

    scale^2 (linear <x, x'> + curved exp(-sharp |x - x'|^2)
             + [same trial] (trial + slow (1 + u) exp(-u) + own exp(-sharp |x - x'|^2)) + [same row] noise),

u = sqrt(3) |t - t'| / memory. The linear part alone is the conditional mean of a Gaussian. The curved part holds what a
Gaussian cannot: sets that bend, several gaits. A trial has its own constant and its own curved part (another animal,
markers placed anew), and what regression misses by lasts for a while (Matern-3/2).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.linalg.lapack import dpotrf, dpotri  # type: ignore[attr-defined]  # made at run time
from scipy.optimize import minimize

from eal.arrays import Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Rows:
    """Inputs of n rows.

    Attributes:
        x: (n, D) regressors, centred; their mean square length is about 1.
        trial: (n,) trial of each row.
        t: (n,) its time, in units of the memory's.
    """

    x: Array
    trial: NDArray[np.int64]
    t: Array


@dataclass(frozen=True, eq=False)
class Apart:
    """What the covariance of n rows with m others depends on, (n, m) each.

    Attributes:
        inner: <x, x'>.
        square: |x - x'|^2.
        lag: sqrt(3) |t - t'|.
        same: 1 where both are of one trial, else 0.
    """

    inner: Array
    square: Array
    lag: Array
    same: Array

    @classmethod
    def of(cls, a: Rows, b: Rows) -> "Apart":
        """Of rows and others."""
        inner = a.x @ b.x.T
        lag = np.sqrt(3) * np.abs(a.t[:, None] - b.t)
        return cls(inner, _square(a, b, inner), lag, (a.trial[:, None] == b.trial).astype(float))


@dataclass(frozen=True, kw_only=True)
class Covariance:
    """Amplitudes of the parts of the covariance, before the scale, and two lengths; all positive.

    Attributes:
        linear: Of the linear part.
        curved: Of the curved part that all trials share.
        sharp: How sharply it is curved.
        trial: Of a trial's constant.
        slow: Of what is missed by.
        memory: How long that lasts.
        own: Of a trial's own curved part.
        noise: Of a row.
    """

    linear: float = 1.0
    curved: float = 0.4
    sharp: float = 0.7
    trial: float = 0.01
    slow: float = 0.15
    memory: float = 1.3
    own: float = 0.025
    noise: float = 0.001

    def __call__(self, a: Rows, b: Rows) -> Array:
        """(n, m) covariances between rows, without noise."""
        out = a.x @ b.x.T
        bent = 2 * self.sharp * out  # in place from here: at these sizes a fresh array costs as much as a product
        bent -= self.sharp * np.sum(a.x**2, axis=1)[:, None]
        bent -= self.sharp * np.sum(b.x**2, axis=1)
        np.exp(np.minimum(bent, 0.0, out=bent), out=bent)
        out *= self.linear
        out += self.curved * bent
        for trial in np.intersect1d(a.trial, b.trial):
            here, there = a.trial == trial, b.trial == trial
            both = (slice(None), slice(None)) if here.all() and there.all() else np.ix_(here, there)
            u = (np.sqrt(3) / self.memory) * (a.t[here][:, None] - b.t[there])
            np.abs(u, out=u)
            more = np.exp(-u)
            u += 1
            more *= u
            more *= self.slow
            more += self.trial
            more += self.own * bent[both]
            out[both] += more
        return out

    def gradient(self, apart: "Apart") -> tuple[Array, Callable[[Array], Array]]:
        """(n, n) covariance of rows with themselves, noise included; and of weights (n, n) what changes with them.

        The second is (8,), the sum of the weights times the slopes of the covariance by each logarithm: no slope is
        formed, as sums of the weights times what the parts are made of say as much.
        """
        bent, u = np.exp(-self.sharp * apart.square), apart.lag / self.memory
        fading = apart.same * np.exp(-u)
        lasting = fading * (1 + u)
        covariance = self.linear * apart.inner + (self.curved + self.own * apart.same) * bent
        covariance += self.trial * apart.same + self.slow * lasting
        covariance[np.diag_indices(len(u))] += self.noise

        def along(weights: Array) -> Array:
            every = weights * bent
            mine = every * apart.same
            bends = self.curved * np.vdot(apart.square, every) + self.own * np.vdot(apart.square, mine)
            return np.array(
                [
                    self.linear * np.vdot(apart.inner, weights),
                    self.curved * every.sum(),
                    -self.sharp * bends,
                    self.trial * np.vdot(apart.same, weights),
                    self.slow * np.vdot(lasting, weights),
                    self.slow * np.vdot(fading * u**2, weights),  # d (1 + u) exp(-u) / du = -u exp(-u)
                    self.own * mine.sum(),
                    self.noise * np.trace(weights),
                ]
            )

        return covariance, along

    def prior(self, rows: Rows) -> Array:
        """(n,) variances of rows, without noise."""
        flat = self.curved + self.trial + self.slow + self.own
        return self.linear * np.sum(rows.x**2, axis=1) + flat

    @property
    def logarithms(self) -> Array:
        """Of all parameters, in their order."""
        return np.log([getattr(self, field.name) for field in fields(self)])

    @classmethod
    def of(cls, logarithms: Array) -> "Covariance":
        """From logarithms of all parameters."""
        names = [field.name for field in fields(cls)]
        return cls(**dict(zip(names, np.exp(logarithms).tolist(), strict=True)))


def _square(a: Rows, b: Rows, inner: Array) -> Array:
    """(n, m) squared distances |x - x'|^2."""
    return np.maximum(np.sum(a.x**2, axis=1)[:, None] + np.sum(b.x**2, axis=1) - 2 * inner, 0.0)


def predict(covariance: Covariance, rows: Rows, y: Array) -> tuple[Array, Array]:
    """Posterior at rows that are asked for.

    The scale of each column of y is the one of highest likelihood, sqrt(y' K^-1 y / n).

    Args:
        covariance: Of the process.
        rows: n known rows, then m that are asked for.
        y: (n, c) values of the known ones, centred.

    Returns:
        (m, c) means and (m, c) variances, without noise.
    """
    n = len(y)
    every = covariance(rows, Rows(x=rows.x[:n], trial=rows.trial[:n], t=rows.t[:n]))
    every[np.diag_indices(n)] += covariance.noise
    cross, factor = every[n:], cho_factor(every[:n].T, lower=True, overwrite_a=True, check_finite=False)
    solved = cho_solve(factor, y)
    explained = np.sum(solve_triangular(factor[0], cross.T, lower=True, check_finite=False) ** 2, axis=0)
    prior = covariance.prior(rows)[n:]
    left = np.maximum(prior - explained, 1e-6 * prior)
    return cross @ solved, left[:, None] * np.mean(y * solved, axis=0)


def fitted(tasks: Sequence[tuple[Rows, Array]], *, steps: int = 12) -> Covariance:
    """The covariance under which some data sets are likeliest, each column of each with a scale of its own.

    The search begins at the usual covariance, and a prior of deviation 22 / sqrt(rows) draws logarithms to it.

    Args:
        tasks: Rows and their values (n, c), centred.
        steps: Of the search.
    """
    first = Covariance().logarithms
    blocks = [(Apart.of(rows, rows), y) for rows, y in tasks]

    def cost(logarithms: Array) -> tuple[float, Array]:
        covariance = Covariance.of(logarithms)
        total, slope = 0.001 * np.sum((logarithms - first) ** 2), 0.002 * (logarithms - first)
        for apart, y in blocks:
            square, along = covariance.gradient(apart)
            factor, failed = dpotrf(square.T, lower=1, overwrite_a=1)
            if failed:
                return 1e6, np.zeros(len(first))
            level = np.mean(np.log(np.diag(factor)))
            half, _ = dpotri(factor, lower=1, overwrite_c=1)  # zero above the diagonal, as the factor is
            inverse = half + half.T
            inverse[np.diag_indices(len(y))] /= 2
            solved = inverse @ y
            scale2 = np.mean(y * solved, axis=0) + 1e-300
            total += (0.5 * np.mean(np.log(scale2)) + level) / len(blocks)
            pull = inverse - (solved / scale2) @ solved.T / y.shape[1]
            slope = slope + 0.5 * along(pull) / (len(y) * len(blocks))
        return float(total), slope

    if not blocks:
        return Covariance.of(first)
    bounds, options = [(-12.0, 4.0)] * len(first), {"maxiter": steps}
    return Covariance.of(minimize(cost, first, jac=True, method="L-BFGS-B", bounds=bounds, options=options).x)
