"""Sparse robust least squares by Levenberg and Marquardt, for unknowns that live on any manifold."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu

from eal.arrays import Array

State = TypeVar("State")


@dataclass(frozen=True, eq=False)
class Minimum(Generic[State]):
    """Where a search ended.

    Attributes:
        state: The unknowns.
        cost: Half the sum of the robust losses.
        weight: (g,) weight of each group of residuals, 1 where it is believed wholly.
        normal: Weighted normal matrix J^T W J.
        steps: Steps taken.
        converged: False where the steps ran out.
    """

    state: State
    cost: float
    weight: Array
    normal: sparse.csc_array
    steps: int
    converged: bool


def minimise(
    state: State,
    *,
    residuals: Callable[[State], Array],
    jacobian: Callable[[State], sparse.csr_array],
    retract: Callable[[State, Array], State],
    groups: NDArray[np.int64],
    robust: float | None = 3.0,
    most_steps: int = 100,
    tolerance: float = 1e-8,
) -> Minimum[State]:
    """Minimise the sum over groups of rho(|r_g|^2), rho(s) = c^2 log(1 + s / c^2) (Cauchy's loss).

    Each step solves the weighted normal equations (iterated reweighting) with Marquardt's damping, in the given order
    of the unknowns: put those that meet few others first, and the factorisation fills in only where the last ones meet.

    Args:
        state: Where to start.
        residuals: State to (n,) residuals in standard deviations.
        jacobian: State to their (n, p) derivatives by a step.
        retract: State and (p,) step to the next state.
        groups: (n,) number of the group of each residual, from 0; a group (u and v of a pixel) is believed as a whole.
        robust: c; None: plain least squares.
        most_steps: At most so many steps.
        tolerance: Relative decrease of the cost at which to stop.
    """
    n_groups = int(groups.max()) + 1
    error = residuals(state)
    cost, weight = _loss(error, groups, n_groups, robust)
    damping, steps = 1e-4, 0
    while steps < most_steps:
        rows = jacobian(state)
        heavy = rows.multiply(weight[groups, None]).tocsr()
        normal = (rows.T @ heavy).tocsc()
        gradient = heavy.T @ error
        size = normal.diagonal()
        size = np.maximum(size, 1e-12 * size.max())
        better = False
        while not better and damping < 1e12:
            factor = factorised(normal + sparse.diags_array(damping * size).tocsc())
            trial = retract(state, -factor.solve(gradient))
            new_error = residuals(trial)
            new_cost, new_weight = _loss(new_error, groups, n_groups, robust)
            better = bool(new_cost < cost)
            damping = max(damping / 10, 1e-12) if better else damping * 10
        if not better:
            return Minimum(state, cost, weight, normal, steps, True)
        steps += 1
        settled = cost - new_cost <= tolerance * (cost + 1e-300)
        state, error, cost, weight = trial, new_error, new_cost, new_weight
        if settled:
            return Minimum(state, cost, weight, normal, steps, True)
    return Minimum(state, cost, weight, normal, steps, False)


def factorised(normal: sparse.csc_array) -> SuperLU:
    """LU factors of a symmetric positive definite matrix, in its own order."""
    return splu(normal, permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


def _loss(error: Array, groups: NDArray[np.int64], n_groups: int, robust: float | None) -> tuple[float, Array]:
    squares = np.bincount(groups, weights=error**2, minlength=n_groups)
    if not np.isfinite(squares).all():
        return np.inf, np.ones(n_groups)
    if robust is None:
        return float(squares.sum() / 2), np.ones(n_groups)
    return float(robust**2 * np.log1p(squares / robust**2).sum() / 2), 1 / (1 + squares / robust**2)
