"""The most probable trajectory under terms that are not linear, and its covariance.

A trajectory has T states of n numbers. Its cost is -log of its posterior density: squares that tie each state to those
before it, and terms of single frames. About any trajectory it is nearly a quadratic form whose matrix is banded.
Minimising that again and again is Gauss-Newton, which is the same as smoothing again about what was smoothed (Bell
1994, SIAM J. Optim. 4, 626); damped as by Levenberg and Marquardt no step is taken that does not lower the cost (Sarkka
& Svensson 2020, ICASSP). Covariances are read off the factor of the matrix (Takahashi, Fagan & Chen 1973).
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np
from mocap.filters.errors import FilterError
from scipy.linalg import cho_solve_banded, cholesky_banded

from eal.arrays import Array

SETTLED = 0.05
"""Nothing moves by more than so many of its standard deviations in the last step: the length of a step in the metric
of its matrix bounds that of every number, and of every sum of numbers. Chosen; not measured."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Quadratic:
    """A cost near a trajectory, to second order.

    Attributes:
        gradient: (T, n) by the states.
        band: (T - l, n, n) second derivatives by the states of frame t + l (rows) and t, for l = 0, 1, ..., L.
    """

    gradient: Array
    band: tuple[Array, ...]


SLOW = 10
"""Steps after which a search goes on along the sum of the last two. Chosen: most end before."""

X = TypeVar("X")


class Problem(Protocol, Generic[X]):
    """What is minimised."""

    def cost(self, at: X, /) -> float:
        """-log of the posterior density, up to a constant."""
        ...

    def quadratic(self, at: X, /) -> Quadratic:
        """The same to second order; its matrix is positive semidefinite."""
        ...

    def moved(self, at: X, step: Array, /) -> X:
        """A trajectory after a step (T, n) of the states."""
        ...


@dataclass(frozen=True, eq=False)
class BandFactor:
    """The Cholesky factor of a quadratic form.

    Attributes:
        shape: (T, n).
        lags: L.
        band: (n (L + 1), Tn) the factor of the states' matrix, as LAPACK stores bands.
    """

    shape: tuple[int, int]
    lags: int
    band: Array

    def solve(self, right: Array) -> Array:
        """The matrix's inverse times (T, n), or (T, n, k)."""
        flat = right.reshape(self.band.shape[1], -1)
        return cho_solve_banded((self.band, True), flat, check_finite=False).reshape(right.shape)


def factor(form: Quadratic, damping: float = 0.0) -> BandFactor:
    """Factorise a form, its diagonal enlarged by a share of itself.

    Raises:
        np.linalg.LinAlgError: it is not positive definite.
    """
    steps, n = form.gradient.shape
    lower = np.zeros((min(n * len(form.band), n * steps), n * steps))
    row, column = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    for lag, block in enumerate(form.band):
        if lag >= steps:
            break
        use = (row >= column) if lag == 0 else np.ones_like(row, dtype=bool)
        at = n * np.arange(steps - lag)[:, None]
        lower[(lag * n + row - column)[use], at + column[use]] = block[:, use]
    lower[0] *= 1 + damping
    return BandFactor(
        (steps, n), len(form.band) - 1, cholesky_banded(lower, lower=True, overwrite_ab=True, check_finite=False)
    )


def factor_at_all(form: Quadratic) -> BandFactor:
    """The factor of a form that is positive definite but for rounding, as little damped as that needs.

    Raises:
        FilterError: it is not, with a millionth of the diagonal added.
    """
    for damping in (0.0, 1e-12, 1e-9, 1e-6):
        with suppress(np.linalg.LinAlgError):
            return factor(form, damping)
    raise FilterError("the most probable trajectory: what was seen does not say where it is, its covariance has no end")


def covariance(found: BandFactor) -> list[Array]:
    """(T - l, n, n) covariances of the states of frames t + l and t, for l = 0, 1, ..., L."""
    (steps, n), lags = found.shape, min(found.lags, found.shape[0] - 1)
    row, column = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    at = n * np.arange(steps)[:, None, None] + column
    inverse = np.linalg.inv(np.where(row >= column, found.band[np.maximum(row - column, 0), at], 0))
    below = np.zeros((steps, lags * n, n))
    for lag in range(1, lags + 1):
        below[: steps - lag, (lag - 1) * n : lag * n] = found.band[lag * n + row - column, at[: steps - lag]]
    below, own = below @ inverse, np.swapaxes(inverse, 1, 2) @ inverse
    out: list[Array] = [np.zeros((steps - lag, n, n)) for lag in range(lags + 1)]
    ahead = np.zeros(((lags + 1) * n,) * 2)  # covariance of the frames that follow, and of one more
    for t in range(steps - 1, -1, -1):
        across = -ahead[:-n, :-n] @ below[t]
        here = own[t] - below[t].T @ across
        out[0][t] = here = 0.5 * (here + here.T)
        for lag in range(1, min(lags, steps - 1 - t) + 1):
            out[lag][t] = across[(lag - 1) * n : lag * n]
        ahead[n:, n:] = ahead[:-n, :-n].copy()
        ahead[:n, :n], ahead[n:, :n], ahead[:n, n:] = here, across, across.T
    return out


def most_probable(
    problem: Problem[X],
    start: X,
    *,
    within: float = SETTLED,
    tell: Callable[[float], None] = lambda _cost: None,
) -> X:
    """The trajectory of the least cost near a start.

    Args:
        problem: What is minimised.
        start: Where to begin.
        within: Nothing moves by more than so many of its standard deviations in the last step.
        tell: Called with the cost after each step that lowered it.

    Raises:
        FilterError: the cost at the start is not finite, or no end was found.
    """
    at, least, damping = start, problem.cost(start), 1e-3
    before = np.zeros(1)
    if not np.isfinite(least):
        raise FilterError("the most probable trajectory: the start is impossible")
    form = problem.quadratic(at)
    for count in range(100):
        try:
            step = factor(form, damping).solve(-form.gradient)
        except np.linalg.LinAlgError:
            damping = max(10 * damping, 1e-6)
            continue
        gain = -float(np.sum(form.gradient * step))
        there = problem.moved(at, step)
        cost = problem.cost(there)
        bend = cost - least + gain  # the cost along the step is about value - gain s + bend s^2
        if np.isfinite(bend) and 2 * bend > gain:
            short = problem.moved(at, gain / (2 * bend) * step)
            less = problem.cost(short)
            if less < cost:
                there, cost, step = short, less, gain / (2 * bend) * step
        if cost <= least:
            at, least = there, cost
            if count >= SLOW:
                at, least, more = further(problem, at, least, step)
                at, least, most = further(problem, at, least, step + more + before)
                step = step + more + most
            before = step
            tell(least)
            if gain <= within**2 and damping <= 0.1:
                return at
            form = problem.quadratic(at)
            damping = max(0.1 * damping, 1e-9)
        elif gain <= within**2 and damping <= 0.1:  # rounding of a cost that is as low as it gets
            return at
        else:
            damping = max(10 * damping, 1e-6)
    raise FilterError("the most probable trajectory was not found in 100 steps: the last still moved it")


def further(problem: Problem[X], at: X, cost: float, along: Array) -> tuple[X, float, Array]:
    """A trajectory, its cost and the step that led there, twice as far along a direction as long as that costs less.

    Steps that creep down a valley, as along a depth of which pixels tell little, add up to its direction (parallel
    tangents: Shah, Buehler & Kempthorne 1964).
    """
    length, moved = 1.0, np.zeros_like(along)
    for _ in range(20):
        there = problem.moved(at, length * along)
        new = problem.cost(there)
        if not new < cost:
            break
        at, cost, moved, length = there, new, moved + length * along, 2 * length
    return at, cost, moved
