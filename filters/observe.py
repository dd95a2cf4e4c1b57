"""Conditioning a state on what a frame shows: gates, Student's t, and three rows a marker for any number of cameras."""

from dataclasses import dataclass

import numpy as np
from mocap.filters.ensemble import Gaussian, cholesky, condition, each_marker, marker_covariances
from mocap.filters.observations import WHOLE, Sights
from numpy.typing import NDArray
from scipy.linalg.blas import dtrsm  # type: ignore[attr-defined]  # made at run time

from eal.arrays import Array


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
        where: Camera and marker of each.
        apart: Rays that do not meet another of their marker.
    """
    if not (far.any() or apart.any()):
        return ~far
    marker = where[:, 1]
    agreed = np.bincount(marker[far & ~apart], minlength=marker.max() + 1) >= 2
    believed = ~(far & ~agreed[marker] & (where[:, 0] != WHOLE))
    nearest = np.full(marker.max() + 1, np.inf)
    np.minimum.at(nearest, marker[apart], squared[apart])
    return believed & ~(apart & (squared > nearest[marker]))


def observe(
    state: Gaussian, sights: Sights, deviations: Array, *, reads: int, gate_sd: float = 6.0, rounds: int = 3
) -> tuple[Gaussian, Observed]:
    """Condition a state on the sights of a frame.

    The whitened rows W_g of all groups of a marker act through J = sum W^T W = V diag(l) V^T alone: three rows
    diag(l)^1/2 V^T with the innovation diag(l)^-1/2 V^T sum W^T y give the same posterior, and what is left of y^T y is
    the misfit of the rays among themselves. The state is conditioned on these.

    Errors that follow Student's t with nu degrees of freedom are normal ones whose precision is scaled by a weight;
    its expectation given a residual r (d rows, scaled) is (nu + d) / (nu + E[r^2]) (Lange et al. 1989; with the
    posterior's spread in E, as in Roth et al. 2013). It is found by ``rounds`` of reweighting from 1. The state is then
    conditioned with (nu + d) / (nu + d + 2) of it, the Fisher information of Student's t over what its weights add up
    to: the spread of the posterior would else leave out that the weights are estimates.

    Args:
        state: Predicted state.
        sights: What is seen.
        deviations: (k, M, 3) ensemble rows of the markers: their covariance is the sum of squares over k; the first
            ``reads`` belong to the first columns of the factor.
        reads: Number of columns of the factor that move the markers.
        gate_sd: Groups with a row further off than this many standard deviations are not believed (``gate_groups``);
            a measured position always is.
        rounds: Reweightings of Student-t groups.
    """
    n_groups, marker = len(sights.size), sights.where[:, 1]
    if not n_groups:
        return state, unused(sights)
    white, y = sights.slope / sights.sd[..., None], sights.innovation / sights.sd
    cov = marker_covariances(deviations)
    predicted = 1 + np.einsum("gri,gij,grj->gr", white, cov[marker], white)
    far = (np.abs(y) > gate_sd * np.sqrt(predicted)).any(axis=1)
    used = gate_groups(np.sum(y**2 / predicted, axis=1), far, sights.where, sights.apart)
    if not used.any():
        return state, unused(sights)
    weight = used.astype(float)
    heavy = used & np.isfinite(sights.dof) & (rounds > 0)
    freedom = sights.dof[heavy] + sights.size[heavy]
    rounds = rounds if heavy.any() else 0
    flat = deviations.reshape(len(deviations), -1)
    together = flat.T @ flat if rounds else np.zeros((0, 0))
    for _ in range(rounds):
        shift, left = _posterior_markers(*_information(white, y, weight, marker, len(cov)), together)
        miss = y - np.einsum("gri,gi->gr", white, shift[marker])
        spread = np.einsum("gri,gij,grj->gr", white, left[marker], white)
        squared = np.sum(miss**2 + spread, axis=1)
        weight[heavy] = freedom / (sights.dof[heavy] + squared[heavy])
    information = np.ones(n_groups)
    information[heavy] = freedom / (freedom + 2)
    weight *= information
    a, target = _compress(white, y, weight, marker, deviations)
    posterior, w, log_det = condition(state, a, target, reads)
    n_rows = int(sights.size[used].sum())
    nis = float(np.sum(weight[:, None] * y**2) - w @ w)
    log_sd = np.log(sights.sd[used]).sum() - 0.5 * (sights.size[used] * np.log(weight[used])).sum()
    log_likelihood = -0.5 * (n_rows * np.log(2 * np.pi) + 2 * log_sd + log_det + nis)
    nis *= n_rows / float(sights.size[used] @ information[used])  # about n_rows, of rows that follow their law
    return posterior, Observed(sights.where, sights.innovation, weight, nis, n_rows, float(log_likelihood))


def unused(sights: Sights) -> Observed:
    """Of sights of which nothing was believed."""
    return Observed(sights.where, sights.innovation, np.zeros(len(sights.size)), np.nan, 0, 0.0)


def _compress(
    white: Array, y: Array, weight: Array, marker: NDArray[np.int64], deviations: Array
) -> tuple[Array, Array]:
    """Ensemble rows (k, m), innovations (m,) of at most three rows for each marker that is seen."""
    information, pull = _information(white, y, weight, marker, deviations.shape[1])
    seen = np.unique(marker[weight > 0])
    values, vectors = np.linalg.eigh(information[seen])
    known = values > 1e-12 * values[:, -1:]
    root = np.sqrt(np.where(known, values, 1.0))
    rows = each_marker(deviations[:, seen], vectors * root[:, None])
    target = np.einsum("mi,mij->mj", pull[seen], vectors) / root
    return np.ascontiguousarray(rows[:, known]), target[known]


def _information(
    white: Array, y: Array, weight: Array, marker: NDArray[np.int64], n_markers: int
) -> tuple[Array, Array]:
    """J = sum W^T W (M, 3, 3) and sum W^T y (M, 3) of the groups of each marker."""
    scaled = weight[:, None, None] * white
    information, pull = np.zeros((n_markers, 3, 3)), np.zeros((n_markers, 3))
    np.add.at(information, marker, np.swapaxes(scaled, 1, 2) @ white)
    np.add.at(pull, marker, np.einsum("gri,gr->gi", scaled, y))
    return information, pull


def _posterior_markers(information: Array, pull: Array, together: Array) -> tuple[Array, Array]:
    """Shift (M, 3) and covariance (M, 3, 3) of the markers given J (M, 3, 3) and j = W^T y (M, 3) of each.

    With J = R R^T and the covariance C of all markers together, (C^-1 + J)^-1 = C - C R (1 + R^T C R)^-1 R^T C.

    Args:
        information: J.
        pull: j.
        together: C, (3M, 3M).
    """
    count = len(information)
    least = 1e-12 * np.trace(information, axis1=1, axis2=2) + 1e-300  # one ray leaves a direction free
    root = np.linalg.cholesky(information + least[:, None, None] * np.eye(3))
    half = (np.swapaxes(root, 1, 2) @ together.reshape(count, 3, -1)).reshape(3 * count, -1)  # R^T C
    c = (half.reshape(-1, count, 3).swapaxes(0, 1) @ root).swapaxes(0, 1).reshape(3 * count, -1)
    c[np.diag_indices(3 * count)] += 1
    solved = dtrsm(1.0, cholesky(np.asfortranarray(np.tril(c))), half, lower=1)
    j = pull.ravel()
    shift = together @ j - solved.T @ (solved @ j)
    each = np.arange(count)
    own = together.reshape(count, 3, count, 3)[each, :, each]
    rows = solved.reshape(-1, count, 3).swapaxes(0, 1)
    return shift.reshape(count, 3), own - np.swapaxes(rows, 1, 2) @ rows
