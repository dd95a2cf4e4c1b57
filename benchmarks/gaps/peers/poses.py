"""Poses of several trials as rows of one matrix."""

from collections.abc import Iterator, Sequence

import numpy as np
from mocap.filters.subspace import principal_components
from numpy.typing import NDArray

from benchmarks.gaps.peers.coordinates import Placed
from eal.arrays import Array


def patterns(seen: NDArray[np.bool_]) -> Iterator[tuple[NDArray[np.bool_], NDArray[np.int64]]]:
    """Every way of seeing that occurs among (N, K) rows, with the rows where it does."""
    unique, inverse = np.unique(seen, axis=0, return_inverse=True)
    order = np.argsort(inverse.ravel(), kind="stable")
    ends = np.cumsum(np.bincount(inverse.ravel(), minlength=len(unique)))
    yield from zip(unique, np.split(order, ends[:-1]), strict=True)


def usable(poses: Array, *, share: float = 0.3) -> Array:
    """Rows of (N, D) poses that show more than ``share`` of their entries (all rows if none does)."""
    keep = np.isfinite(poses).mean(axis=1) > share
    return poses[keep] if keep.any() else poses


def completed(trials: Sequence[Placed], *, rank: int = 12) -> list[Array]:
    """Poses (T, D) of each trial without NaN: what is missing is filled by principal components of all trials.

    The misfit of the components (``principal_components``) is interpolated over every gap, so that the
    filled track joins the measured one. Rows that show nothing take the components' own guess.
    """
    rows = [placed.poses for placed in trials]
    if all(np.isfinite(r).all() for r in rows):
        return rows
    stacked = np.concatenate(rows)
    fit = principal_components(stacked, max(1, min(rank, stacked.shape[1] // 2, len(stacked) // 4)), iterations=12)
    out, start = [], 0
    for y in rows:
        model = fit.poses[start : start + len(y)]
        start += len(y)
        index, misfit = np.arange(len(y)), y - model
        filled = y.copy()
        for column in range(y.shape[1]):
            known = np.isfinite(misfit[:, column])
            if known.any() and not known.all():
                shift = np.interp(index[~known], index[known], misfit[known, column])
                filled[~known, column] = model[~known, column] + shift
            elif not known.any():
                filled[:, column] = model[:, column]
        out.append(filled)
    return out
