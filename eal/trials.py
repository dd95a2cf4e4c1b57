"""Merging trials: one potential from several recordings of unequal length."""

from collections.abc import Sequence
from typing import Literal, get_args

import numpy as np

from eal.arrays import Array

Share = Literal["samples", "trials"]


def merge_trials(trials: Sequence[Array], *, share: Share = "samples") -> tuple[Array, Array]:
    """Samples and weights for ``fit_potential`` from several trials.

    Args:
        trials: (N_i, d) samples of each trial; rows with NaN, where a coordinate was not seen, are dropped.
        share: ``samples``: every sample counts the same; ``trials``: every trial does, so that a long one does not
            drown the others. Weights sum to the number of samples either way.

    Returns:
        (N, d) samples and (N,) weights.

    Raises:
        ValueError: no trial, trials of different dimensions, or one without a whole row; the message names it.
    """
    if share not in get_args(Share):
        raise ValueError(f"share must be one of {', '.join(get_args(Share))}, but is {share!r}")
    if not trials:
        raise ValueError("there is no trial to merge: give at least one")
    whole = []
    for i, trial in enumerate(trials):
        z = np.asarray(trial, dtype=np.float64)
        if z.ndim != 2 or z.shape[1] != np.shape(trials[0])[1]:
            raise ValueError(f"trial {i} must be (N, {np.shape(trials[0])[1]}) like the first, but has shape {z.shape}")
        z = z[np.isfinite(z).all(axis=1)]
        if not len(z):
            raise ValueError(f"trial {i} has no row in which every coordinate was seen: leave it out")
        whole.append(z)
    counts = np.array([len(z) for z in whole])
    weight = np.ones(len(counts)) if share == "samples" else counts.mean() / counts
    return np.concatenate(whole), np.repeat(weight, counts)
