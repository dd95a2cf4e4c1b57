"""Conditioning a state on what a frame shows: gates, Student's t, and three rows a marker for any number of cameras."""

from dataclasses import dataclass

import numpy as np
from mocap.filters.gaussian import Markers, Moments, Update, diagonal, diagonal_blocks
from mocap.filters.observations import Sights
from numpy.typing import NDArray
from scipy.linalg.lapack import dgesv  # type: ignore[attr-defined]  # made at run time

from eal.arrays import Array

GATE_SD = 6.0
"""Rows further from their prediction than so many of its deviations are not believed alone (``gate_groups``): of normal
errors one in 5e8, so that what is left out there is a mistake, and less far heavy tails do the work. Chosen."""


@dataclass(frozen=True, eq=False)
class Observed:
    """What a tracker made of the observations of a frame.

    Attributes:
        where: (g, 2) camera and marker of each group of rows that was seen (``Sights``).
        innovation: (g, 3) observed minus predicted.
        weight: (g,) share of its information with which each group took part; 0 where it was gated.
        nis: Normalised innovation squared y^T S^-1 y of the used rows, over the mean share of their information that
            is used where errors are Student's; NaN without rows.
        n_rows: Rows that were used.
        log_likelihood: Log density of the used rows.
    """

    where: NDArray[np.int64]
    innovation: Array
    weight: Array
    nis: float
    n_rows: int
    log_likelihood: float


def gate_groups(
    squared: Array, far: NDArray[np.bool_], where: NDArray[np.int64], apart: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """(g,) groups to believe, of which some are ``far`` (g,) from their prediction.

    A ray that is far from its prediction is not believed, unless another ray of its marker is far as well: if
    triangulation found them to meet, the prediction was wrong, and rays that are near it merely look along the way that
    the marker went. Of rays that do not meet (``apart``) the one that is nearest to its prediction is believed, unless
    it is far as well.

    Args:
        squared: (g,) squared distances from the prediction, in its deviations.
        far: Groups that are far from it.
        where: Camera and marker of each; of no camera: a position, which is always believed.
        apart: Rays that do not meet another of their marker.
    """
    if not (far.any() or apart.any()):
        return ~far
    marker = where[:, 1]
    agreed = np.bincount(marker[far & ~apart], minlength=marker.max() + 1) >= 2
    believed = ~(far & ~agreed[marker] & (where[:, 0] >= 0))
    nearest = np.full(marker.max() + 1, np.inf)
    np.minimum.at(nearest, marker[apart], squared[apart])
    return believed & ~(apart & (squared > nearest[marker]))


def observe(
    markers: Markers, sights: Sights, *, gate_sd: float = GATE_SD, rounds: int = 3
) -> tuple[Moments, Update | None, Observed]:
    """Condition a state on the sights of a frame.

    The whitened rows W_g of all groups of a marker act through J = sum W^T W and j = sum W^T y alone: with J = R R^T
    the three rows R^T with the innovation R^-1 j give the same posterior, and what is left of y^T y is the misfit of
    the rays among themselves. The state is conditioned on these.

    Errors that follow Student's t with nu degrees of freedom are normal ones whose precision is scaled by a weight;
    its expectation given a residual r (d rows, scaled) is (nu + d) / (nu + E[r^2]) (Lange et al. 1989; with the
    posterior's spread in E, as in Roth et al. 2013). It is found by ``rounds`` of reweighting from 1. The state is then
    conditioned with (nu + d) / (nu + d + 2) of it, the Fisher information of Student's t over what its weights add up
    to: the spread of the posterior would else leave out that the weights are estimates.

    Args:
        markers: Those of the predicted state.
        sights: What is seen.
        gate_sd: Groups with a row further off than this many standard deviations are not believed (``gate_groups``);
            a measured position always is, and what a person states.
        rounds: Reweightings of Student-t groups.

    Returns:
        The posterior, how it came from the state (None: nothing was believed), and what was seen.
    """
    n_groups, marker = len(sights.size), sights.where[:, 1]
    if not n_groups:
        return markers.state, None, unused(sights)
    turn, own = markers.view.turn, markers.own
    slope = sights.slope if turn is None else (sights.slope.reshape(-1, 3) @ turn).reshape(-1, 3, 3)
    both = np.concatenate([slope, sights.innovation[..., None]], axis=2) / sights.sd[..., None]
    white = both[..., :3]
    squared = both[..., 3] ** 2 / (1 + ((white @ own[marker]) * white).sum(axis=2))
    far = (squared > gate_sd**2).any(axis=1) & np.logical_not(sights.by_hand)
    used = gate_groups(squared.sum(axis=1), far, sights.where, sights.apart)
    if not used.any():
        return markers.state, None, unused(sights)
    squares = (both.swapaxes(1, 2) @ both).reshape(-1, 16)  # [W y]^T [W y] of each group
    sums = (marker == np.arange(len(own))[:, None]).astype(float)  # of the groups of each marker
    weight = used.astype(float)
    heavy = used & np.isfinite(sights.dof)
    heavy_rounds = rounds if heavy.any() else 0
    dof, of, heavy_squares = sights.dof[heavy], marker[heavy], squares[heavy]
    freedom = dof + sights.size[heavy]
    residual = np.ones((len(own), 4, 1))
    for _ in range(heavy_rounds):
        residual[:, :3, 0], left = _posterior_markers(_sum(sums, weight, squares), markers.spread)
        residual[:, :3] *= -1
        moments = residual * residual.swapaxes(1, 2)
        moments[:, :3, :3] += left
        weight[heavy] = freedom / (dof + (heavy_squares * moments.reshape(-1, 16)[of]).sum(axis=1))
    information = np.ones(n_groups)
    if heavy_rounds:
        information[heavy] = freedom / (freedom + 2)
        weight *= information
    summed = _sum(sums, weight, squares)
    values, vectors = np.linalg.eigh(summed[:, :3, :3])
    certain = values > 1e-12 * np.maximum(values[:, -1:], 1e-300)  # one ray leaves a direction free
    root = np.sqrt(np.where(certain, values, 0.0))
    target = np.einsum("mi,mij->mj", summed[:, :3, 3], vectors) / np.where(certain, root, np.inf)
    posterior, update = markers.condition(np.swapaxes(vectors * root[:, None], 1, 2), target, certain)
    n_rows = int(sights.size[used].sum())
    nis = float(summed[:, 3, 3].sum() - target.ravel() @ target.ravel()) + update.explained
    log_sd = np.log(sights.sd[used]).sum() - 0.5 * (sights.size[used] * np.log(weight[used])).sum()
    log_likelihood = -0.5 * (n_rows * np.log(2 * np.pi) + 2 * log_sd + update.log_det + nis)
    nis *= n_rows / float(sights.size[used] @ information[used])  # about n_rows, of rows that follow their law
    seen = Observed(sights.where, sights.innovation, weight, nis, n_rows, float(log_likelihood))
    return posterior, update, seen


def unused(sights: Sights) -> Observed:
    """Of sights of which nothing was believed."""
    return Observed(sights.where, sights.innovation, np.zeros(len(sights.size)), np.nan, 0, 0.0)


def _sum(sums: Array, weight: Array, squares: Array) -> Array:
    """(M, 4, 4) weighted sums over the groups of each marker."""
    return ((sums * weight) @ squares).reshape(-1, 4, 4)


def _posterior_markers(summed: Array, together: Array) -> tuple[Array, Array]:
    """Shift (M, 3) and covariance (M, 3, 3) of the markers given J and j of each: (1 + C J)^-1 of C j and of C.

    Args:
        summed: (M, 4, 4) J with j beside and below it.
        together: C, (..., 3m, 3m) covariance of all of a part; markers of different parts are independent.
    """
    information, j = summed[:, :3, :3], summed[:, :3, 3]
    if together.ndim > 2:
        left = np.linalg.solve(np.eye(3) + together @ information, together)
        return np.einsum("mij,mj->mi", left, j), left
    size = len(together)
    system = (information @ together.reshape(-1, 3, size)).reshape(size, size)  # its transpose, as LAPACK has it
    diagonal(system)[...] += 1
    _, _, found, _ = dgesv(system.T, together.T, overwrite_a=1)
    return (found @ j.ravel()).reshape(-1, 3), diagonal_blocks(found)
