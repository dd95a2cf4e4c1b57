"""Models that differ in one setting, as one: the mean of what all of them estimate.

A choice between settings that do nearly as well is the noise of a few hidden gaps; the mean of both errs less than
either (docs/decisions.md, "Averaging models").
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from filters.models.base import Fitted, Progress, TrajectoryModel, TrialSet, shares
from filters.observations import Observations
from filters.records import Estimate
from filters.score import Residuals
from mocap.arrays import Array


@dataclass(frozen=True)
class Average(TrajectoryModel):
    """Models that are averaged; what was observed is the first one's.

    Attributes:
        members: The models, best first.
    """

    members: tuple[TrajectoryModel, ...]

    @property
    def description(self) -> str:
        """That of the first, and how many there are."""
        return f"{self.members[0].description}, mean of {len(self.members)} ranks of the pose"

    @property
    def details(self) -> str:
        """Those of all."""
        return " and ".join(member.details for member in self.members)

    @property
    def components(self) -> tuple[TrajectoryModel, ...]:
        """Those that are averaged."""
        return self.members

    def fit(self, trials: TrialSet) -> "FittedAverage":
        """Fit each."""
        return FittedAverage(tuple(member.fit(trials) for member in self.members))

    def learned_arrays(self, trials: TrialSet) -> dict[str, NDArray[Any]]:
        """Of the first."""
        return self.members[0].learned_arrays(trials)


@dataclass(frozen=True, eq=False)
class FittedAverage(Fitted):
    """Models that are averaged, fitted."""

    members: tuple[Fitted, ...]

    def fill(self, observations: Observations, *, progress: Progress | None = None) -> Estimate:
        """By each, then their mean."""
        tells = shares(progress, len(self.members))
        found = [one.fill(observations, progress=tell) for one, tell in zip(self.members, tells, strict=True)]
        xyz, cov = averaged(np.array([f.xyz_m for f in found]), np.array([f.cov_m2 for f in found]))
        return replace(found[0], xyz_m=xyz, cov_m2=cov)


def averaged(means: Array, covs: Array) -> tuple[Array, Array]:
    """Mean and covariance of K normal densities, (K, ..., 3) and (K, ..., 3, 3), mixed by their squared precisions."""
    weight = np.trace(covs, axis1=-2, axis2=-1) ** -2.0
    weight /= weight.sum(axis=0)
    mean = np.einsum("k...,k...i->...i", weight, means)
    apart = means - mean
    return mean, np.einsum("k...,k...ij->...ij", weight, covs + apart[..., :, None] * apart[..., None, :])


def averaged_residuals(parts: Sequence[Residuals]) -> Residuals:
    """What the mean of models misses hidden samples by, from what each does."""
    covs = np.array([part.variance[..., None] * np.eye(3) for part in parts])
    error, cov = averaged(np.array([part.error_m for part in parts]), covs)
    return replace(parts[0], error_m=error, variance=np.diagonal(cov, axis1=-2, axis2=-1))
