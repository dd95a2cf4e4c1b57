"""A model of what one camera sees: the most probable trajectory of poses under what other trials tell of them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from mocap.filters.models.base import TrajectoryModel, TrialSet
from mocap.filters.one_camera import left_out, track_views
from mocap.filters.one_view import Views
from mocap.filters.pose_prior import PosePrior, learn_prior
from mocap.filters.poses import MarkerTrial
from mocap.filters.records import Estimate
from mocap.filters.velocities import RatePoints

from eal.efforts import Progress


@dataclass(frozen=True, eq=False, kw_only=True)
class FittedViews:
    """What was learned from trials, to track a recording of which a camera sees most.

    Attributes:
        prior: What the trials tell.
        trials: They themselves, each of which is left out to see how it fares.
        trunk: Indices of the trunk's markers.
    """

    prior: PosePrior
    trials: Sequence[MarkerTrial]
    trunk: Sequence[int]

    def fill(
        self, observations: Views, *, rate_points: RatePoints | None = None, progress: Progress | None = None
    ) -> Estimate:
        """The most probable poses, NaN in frames whose poses are unlike those of the trials.

        ``Estimate.own`` has of these ``unlike`` (T,), what deviations were multiplied by, ``wider`` (T,), the
        probability of the ``mirror_image``, ``residual_px`` (T, M), whether bones had to be ``loose``, what trials that
        were left out erred by in such a view and spread by, ``left_out_m`` (2,), and what was missed beyond what trials
        tell, ``misfit`` (4,): in m, in px, how long it lasts in s, and in m the part that is errors of clicks.

        Args:
            observations: What was seen; deviations are those of the pixels alone.
            rate_points: Points whose velocities and joint covariances are kept; None: of none.
            progress: Called with the share done.

        Raises:
            FilterError: no frame shows enough markers.
        """
        found = track_views(
            self.prior,
            observations,
            doubt=partial(left_out, trials=self.trials, trunk=self.trunk),
            rate_points=rate_points,
            progress=progress,
        )
        beyond = found.misfit
        return replace(
            found.estimate,
            xyz_m=np.where(found.unlike[:, None, None], np.nan, found.estimate.xyz_m),
            own={
                "unlike": found.unlike,
                "wider": found.wider,
                "mirror_image": np.array(found.other),
                "residual_px": found.residual_px,
                "loose": np.array(found.loose),
                "misfit": np.array([beyond.sd_m, beyond.sd_px, beyond.half_life_s, beyond.clicks_m]),
                "left_out_m": np.array([found.left_out.error_m, found.left_out.spread_m]),
            },
        )


@dataclass(frozen=True)
class OneCameraSettings(TrajectoryModel):
    """The most probable poses of a whole recording, of which the last trial shows nothing in 3D."""

    @property
    def description(self) -> str:
        """Its name."""
        return "one camera"

    def fit(self, trials: TrialSet) -> FittedViews:
        """Learn from all trials but the last, which is the one to fill."""
        others, trunk = trials.trials[:-1], trials.anatomy.trunk
        return FittedViews(prior=learn_prior(others, trunk), trials=others, trunk=trunk)
