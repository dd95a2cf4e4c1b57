"""Joint angles that were the state of a filter, and the segments that they turn."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from eal.arrays import Array, frozen
from eal.over_time import OverTime

ENERGIES = ("energy_j", "v_z", "v_z_bound")
"""Columns of a Lagrangian."""
PARTS = {0: (), 1: ("bend",), 2: ("across_1", "across_2"), 3: ("across_1", "across_2", "twist")}
"""What the coordinates of a joint are called, by how many it has."""


@dataclass(frozen=True, eq=False, kw_only=True)
class JointAngles:
    """Joint angles over time; those of a joint are components of the rotation vector that turns its segment from rest.

    Attributes:
        names: (F,) ``<joint>_<end of the segment>_<part>``.
        angle_rad: (T, F); NaN where the animal was not tracked.
        sd_rad: (T, F) standard deviations: large where samples do not determine an angle.
        segments: (J,) ``<joint> to <end>``.
        length_m: (J,) lengths of the segments.
        length_sd_m: (J,) their standard errors; NaN where a segment was hardly seen.
        energies: (T, 3) energy of the animal's Lagrangian in J, its V_z, and what V_z stays below if the animal is
            released there (Theorem 3); (T, 0) where the angles have learned mechanics.
    """

    names: tuple[str, ...]
    angle_rad: OverTime[Array]
    sd_rad: OverTime[Array]
    segments: tuple[str, ...]
    length_m: Array
    length_sd_m: Array
    energies: OverTime[Array]

    def __post_init__(self) -> None:
        """Copy, freeze and check."""
        shape = (len(self.angle_rad), len(self.names))
        sizes = {"angle_rad": shape, "sd_rad": shape}
        sizes |= dict.fromkeys(("length_m", "length_sd_m"), (len(self.segments),))
        sizes["energies"] = (shape[0], 3 if np.shape(self.energies)[1:] == (3,) else 0)
        for name, size in sizes.items():
            object.__setattr__(self, name, frozen(name, getattr(self, name), size))

    def to_frame(self, t_s: Array) -> pd.DataFrame:
        """A row a frame: ``frame`` (from 1), ``t_s``, then ``<name>_deg`` and ``<name>_deg_sd``.

        Of a Lagrangian ``energy_j``, ``v_z`` and ``v_z_bound`` as well.
        """
        table = {"frame": np.arange(1, len(t_s) + 1), "t_s": t_s}
        for name, angle, sd in zip(self.names, np.degrees(self.angle_rad).T, np.degrees(self.sd_rad).T, strict=True):
            table |= {f"{name}_deg": angle, f"{name}_deg_sd": sd}
        table |= dict(zip(ENERGIES, self.energies.T, strict=False))
        return pd.DataFrame(table)


def angle_names(ends: Sequence[tuple[str, str]], freedoms: Sequence[int]) -> tuple[str, ...]:
    """Names of the coordinates of joints, each with the names of its marker and of the end of its segment."""
    return tuple(f"{a}_{b}_{part}" for (a, b), k in zip(ends, freedoms, strict=True) for part in PARTS[k])
