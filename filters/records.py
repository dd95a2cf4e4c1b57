"""What a tracker returns."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mocap.filters.moving import Rates
from mocap.filters.observe import Observed
from numpy.typing import NDArray

from mocap.arrays import Array, frozen
from mocap.held import HeldLimb
from mocap.records import MarkerTracks


@dataclass(frozen=True, eq=False, kw_only=True)
class Estimate:
    """Where a motion model has the markers of a trial.

    Attributes:
        xyz_m: (T, M, 3) positions in the world; NaN where the model has no estimate.
        cov_m2: (T, M, 3, 3) their covariance.
        observed: What a filter saw in each frame, and how it was believed; empty where nothing was filtered.
        rates: Velocities and joint covariances of what was asked for; None: nothing was, or the model has none.
        angles: (2, T, F) joint angles that are the model's state, and their standard deviations; None: it has none.
        energies: (T, 3) energy in J of the model's Lagrangian, its V_z and Theorem 3's bound; None: it has none.
        held: What its potentials of limbs said, where velocities were asked for.
    """

    xyz_m: Array
    cov_m2: Array
    observed: Sequence[Observed] = ()
    rates: Rates | None = None
    held: tuple[HeldLimb, ...] = ()
    angles: Array | None = None
    energies: Array | None = None

    @property
    def log_likelihood(self) -> Array:
        """(T,) log density of each frame's observations given those before."""
        return np.array([seen.log_likelihood for seen in self.observed])


@dataclass(frozen=True, eq=False, kw_only=True)
class TrackedMotion:
    """Smoothed motion of all markers, and how well it agrees with what was seen.

    Attributes:
        model: Name of the motion model.
        markers: Smoothed positions with covariance; ``origin`` tells measured from filled from rejected.
        reprojected_px: (C, T, M, 2) ideal pixels of the smoothed positions; C = 0 where only positions were tracked.
        innovation_px: (C, T, M, 2) measured minus predicted ideal pixel, before the update; NaN where nothing was seen.
        used: (C, T, M) True where a pixel took part in the estimate.
        nis: (T,) normalised innovation squared of each frame; NaN without rows.
        n_rows: (T,) scalar observations used in each frame.
        log_likelihood: (T,) log density of each frame's observations given those before.
    """

    model: str
    markers: MarkerTracks
    reprojected_px: Array
    innovation_px: Array
    used: NDArray[np.bool_]
    nis: Array
    n_rows: NDArray[np.int64]
    log_likelihood: Array

    def __post_init__(self) -> None:
        """Copy, freeze and check."""
        n_frames, n_markers = self.markers.status.shape
        n_cameras = len(self.used)
        pixels = (n_cameras, n_frames, n_markers, 2)
        object.__setattr__(self, "reprojected_px", frozen("reprojected_px", self.reprojected_px, pixels))
        object.__setattr__(self, "innovation_px", frozen("innovation_px", self.innovation_px, pixels))
        object.__setattr__(self, "used", frozen("used", self.used, pixels[:3], dtype=np.bool_))
        object.__setattr__(self, "n_rows", frozen("n_rows", self.n_rows, (n_frames,), dtype=np.int64))
        for name in ("nis", "log_likelihood"):
            object.__setattr__(self, name, frozen(name, getattr(self, name), (n_frames,)))
