"""What a filter or a regression returns."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mocap.filters.moving import Rates
from mocap.filters.observations import WHOLE
from mocap.filters.observe import Observed
from numpy.typing import NDArray

from eal.arrays import Array, frozen, short_repr
from eal.over_time import OverTime


@dataclass(frozen=True, eq=False, kw_only=True)
class HeldLimb:
    """The potential that held a limb while it was tracked, and where the limb was on it.

    Coordinates are the two leading principal components of what V_z was learned from, the relative joint coordinates
    q of the limb (mostly with their velocities), in units of their deviation.

    Attributes:
        name: Of the limb: its root and its first joint.
        markers: The J markers that it moves.
        x: (G,) first coordinate of a grid.
        y: (G,) second coordinate.
        value: (G, G) V_z at (y, x), of the pose that samples near there have in all other coordinates.
        samples: (N, 2) what V_z was learned from.
        state: (T, 2) the limb; NaN where it was not tracked.
        cov: (T, 2, 2) its covariance.
        at_state: (T,) V_z of all coordinates at the limb.
        pull: (T, J, 3) minus the gradient of the filter's potential by the position of each marker, in the world, in
            1/(m s); for V_z of joint angles, how each marker moves when the arc length of every angle changes by
            minus the gradient with respect to it.
    """

    name: str
    markers: tuple[str, ...]
    x: Array
    y: Array
    value: Array
    samples: Array
    state: OverTime[Array]
    cov: OverTime[Array]
    at_state: OverTime[Array]
    pull: OverTime[Array]

    __repr__ = short_repr

    def __post_init__(self) -> None:
        """Copy, freeze and check."""
        n_frames = len(self.state)
        shapes = {
            "x": (None,),
            "y": (None,),
            "value": (len(self.y), len(self.x)),
            "samples": (None, 2),
            "state": (n_frames, 2),
            "cov": (n_frames, 2, 2),
            "at_state": (n_frames,),
            "pull": (n_frames, len(self.markers), 3),
        }
        for name, shape in shapes.items():
            object.__setattr__(self, name, frozen(name, getattr(self, name), shape))


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
