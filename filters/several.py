"""Models that differ in one setting, as one: the mean of what all of them say.

A choice between settings that do nearly as well is the noise of a few hidden gaps; the mean of both errs less than
either (``design/several.py``).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from filters.learn import PoseSettings
from filters.score import Residuals
from mocap.arrays import Array


@dataclass(frozen=True)
class Several:
    """Pose models that are averaged; what a tracker says besides positions is the first one's.

    Attributes:
        members: Their settings, best first.
    """

    members: tuple[PoseSettings, ...]


def averaged(means: Array, covs: Array) -> tuple[Array, Array]:
    """Mean and covariance of K normal densities, (K, ..., 3) and (K, ..., 3, 3), mixed by their squared precisions."""
    weight = np.trace(covs, axis1=-2, axis2=-1) ** -2.0
    weight /= weight.sum(axis=0)
    mean = np.einsum("k...,k...i->...i", weight, means)
    apart = means - mean
    return mean, np.einsum("k...,k...ij->...ij", weight, covs + apart[..., :, None] * apart[..., None, :])


def averaged_residuals(fills: Sequence[Residuals]) -> Residuals:
    """What the mean of models says of hidden samples, from what each says."""
    covs = np.array([f.variance[..., None] * np.eye(3) for f in fills])
    miss, cov = averaged(np.array([f.error_m for f in fills]), covs)
    return replace(fills[0], error_m=miss, variance=np.diagonal(cov, axis1=-2, axis2=-1))
