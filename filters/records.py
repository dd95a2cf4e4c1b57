"""What a filter or a regression returns."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from mocap.filters.moving import Rates
from mocap.filters.observations import WHOLE
from mocap.filters.observe import Observed
from numpy.typing import NDArray

from eal.arrays import Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Estimate:
    """Where a motion model has the markers of a trial.

    Attributes:
        xyz_m: (T, M, 3) positions in the world; NaN where the model has no estimate.
        cov_m2: (T, M, 3, 3) their covariance.
        observed: What a filter saw in each frame, and how it was believed; empty where nothing was filtered.
        rates: Velocities and joint covariances of what was asked for; None: nothing was, or the model has none.
        own: What the model says of its own state, by names of its own (``filters.motion.base.MotionModel.own``).
    """

    xyz_m: Array
    cov_m2: Array
    observed: Sequence[Observed] = ()
    rates: Rates | None = None
    own: Mapping[str, NDArray[Any]] = field(default_factory=dict)

    @property
    def believed(self) -> NDArray[np.bool_]:
        """(T, M) where a filter used a position of the marker itself, or rays of two cameras to it."""
        n_markers = self.xyz_m.shape[1]
        count = np.zeros(self.xyz_m.shape[:2], dtype=np.int64)
        for frame, seen in enumerate(self.observed):
            camera, marker = seen.where[seen.weight > 0].T
            count[frame] = np.bincount(marker[camera >= 0], minlength=n_markers)
            count[frame, marker[camera == WHOLE]] = 2
        return count >= 2

    @property
    def log_likelihood(self) -> Array:
        """(T,) log density of each frame's observations given those before."""
        return np.array([seen.log_likelihood for seen in self.observed])
