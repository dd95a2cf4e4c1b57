"""Poses of several trials as rows of one matrix."""

from collections.abc import Sequence

import numpy as np
from mocap.filters.interpolate import blended
from mocap.filters.subspace import principal_components

from benchmarks.gaps.peers.coordinates import Placed
from eal.arrays import Array


def usable(poses: Array, *, share: float = 0.3) -> Array:
    """Rows of (N, D) poses that show more than ``share`` of their entries (all rows if none does)."""
    keep = np.isfinite(poses).mean(axis=1) > share
    return poses[keep] if keep.any() else poses


def completed(trials: Sequence[Placed], *, rank: int = 12) -> list[Array]:
    """Poses (T, D) of each trial without NaN: what is missing is filled by principal components of all trials."""
    rows = [placed.poses for placed in trials]
    if all(np.isfinite(r).all() for r in rows):
        return rows
    stacked = np.concatenate(rows)
    fit = principal_components(stacked, max(1, min(rank, stacked.shape[1] // 2, len(stacked) // 4)), iterations=12)
    models = np.split(fit.poses, np.cumsum([len(y) for y in rows])[:-1])
    return [blended(y, model) for y, model in zip(rows, models, strict=True)]
