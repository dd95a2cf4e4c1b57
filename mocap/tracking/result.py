"""A recording that was tracked, and what is computed of it: thin properties over the functions that do it."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Self

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.filters.limb_potential import HeldPotential
from mocap.filters.velocities import Motion, RatePoints
from mocap.kinematics.compute import kinematics
from mocap.kinematics.points import rate_points_for
from mocap.kinematics.records import Kinematics
from mocap.recording import Recording
from mocap.tracking.potentials import JointPotential, Potentials
from mocap.tracking.report_part import Report
from mocap.variables import VARIABLES

MOTION = {
    "point_position": "xyz_m",
    "velocity": "velocity_m_s",
    "point_covariance": "own",
    "pairs": "pairs",
    "pair_covariance": "cross",
    "velocity_change": "kept",
    "measured": "measured",
    "acceleration": "acceleration_m_s2",
    "acceleration_covariance": "acceleration_cov",
}
"""Variables of the fields of ``Motion``; the last two where a model has accelerations."""


def motion_in(recording: Recording) -> Motion:
    """Markers, the body and the centre of mass of a recording that was tracked."""
    parts = {of: recording.data[name].values for name, of in MOTION.items() if name in recording.data}
    return Motion(names=tuple(recording.data["point"].values.tolist()), t_s=recording.t_s, **parts)


def rate_points(recording: Recording) -> RatePoints:
    """The points and pairs of points whose velocities and covariances the kinematics of a recording need."""
    return rate_points_for(recording.names, recording.skeleton, n_frames=len(recording.t_s))


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Result(Recording):
    """A recording that was tracked."""

    @classmethod
    def of(cls, recording: Recording) -> Self:
        """The same recording, which was tracked."""
        return cls(**{one.name: getattr(recording, one.name) for one in fields(recording)})

    @property
    def report(self) -> Mapping[str, object]:
        """What ``report.json`` holds; empty: none was made."""
        found = self.get(Report)
        return {} if found is None else found.numbers

    @property
    def report_text(self) -> str:
        """The same as markdown."""
        found = self.get(Report)
        return "" if found is None else found.text

    @property
    def potentials(self) -> Mapping[str, JointPotential]:
        """One empirical potential a joint, by joint name, in the planes of its limb."""
        found = self.get(Potentials)
        return {} if found is None else found.planar

    @property
    def spatial_potentials(self) -> Mapping[str, JointPotential]:
        """The same in three coordinates in the body."""
        found = self.get(Potentials)
        return {} if found is None else found.spatial

    @property
    def reprojected_px(self) -> Array:
        """(C, T, M, 2) ideal pixels of the smoothed positions; C = 0 where only positions were tracked."""
        return self._of_rays("reprojected", 2)

    @property
    def innovation_px(self) -> Array:
        """(C, T, M, 2) measured minus predicted ideal pixel, before the update; NaN where nothing was seen."""
        return self._of_rays("innovation", 2)

    @property
    def used(self) -> NDArray[np.bool_]:
        """(C, T, M) True where a pixel took part in the estimate."""
        return self._of_rays("used").astype(bool)

    @property
    def nis(self) -> Array:
        """(T,) normalised innovation squared of each frame; NaN without rows."""
        return self.values("nis")

    @property
    def n_rows(self) -> NDArray[np.int64]:
        """(T,) scalar observations used in each frame."""
        return self.values("n_rows")

    @property
    def log_likelihood(self) -> Array:
        """(T,) log density of each frame's observations given those before."""
        return self.values("log_likelihood")

    @cached_property
    def motion(self) -> Motion:
        """Markers, the body and the centre of mass, with velocities and joint covariances."""
        return motion_in(self)

    def with_motion(self, motion: Motion) -> Self:
        """The same with these points, their velocities and covariances, in place of others."""
        values = {name: getattr(motion, of) for name, of in MOTION.items()}
        return self.having({"point": motion.names}, **{name: of for name, of in values.items() if of is not None})

    @property
    def angles(self) -> xr.Dataset | None:
        """Joint angles that were the filter's state, lengths of segments, energies; None: they were not."""
        own = [name for name, one in VARIABLES.items() if {"angle", "segment", "energy"} & set(one.dims)]
        return self.data[[name for name in own if name in self.data]] if "angle_rad" in self.data else None

    def joints_m(self, frame: str) -> dict[str, Array]:
        """(T, d) coordinates of each joint in a frame of reference (``mocap.joints``); empty where none are known."""
        if f"joint_{frame}" not in self.data:
            return {}
        coordinates = np.moveaxis(self.data[f"joint_{frame}"].values, 1, 0)
        return dict(zip(self.data["joint"].values.tolist(), coordinates, strict=True))

    @cached_property
    def limbs(self) -> dict[str, HeldPotential]:
        """What potentials said of limbs that they held: the variables ``limb_...`` of each, of its own samples.

        ``marker`` is (J,) its markers along the limb, ``pull`` (T, J, 3) on these.
        """
        out = {}
        for i, name in enumerate(self.data["limb"].values.tolist() if "limb" in self.data.coords else ()):
            own = [of for of, one in VARIABLES.items() if "limb" in one.dims]
            limb = {of.removeprefix("limb_"): self.data[of].isel(limb=i).values for of in own}
            index = np.argsort(limb["marker"], kind="stable")[int((limb["marker"] < 0).sum()) :]
            samples = limb["samples"][np.isfinite(limb["samples"][:, 0])]
            out[name] = {**limb, "samples": samples, "marker": index, "pull": limb["pull"][:, index]}
        return out

    @cached_property
    def kinematics(self) -> Kinematics:
        """Angles, velocities, accelerations, lengths, areas, strokes, each with its standard deviation.

        Raises:
            MocapError: the recording is one video, in the plane of its image.
        """
        self.in_space("kinematics")
        return kinematics(self.motion, self.skeleton, recording=self.name)
