"""Mechanics of limbs as a table."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from eal.arrays import Array
from mocap.pipeline.limb_mechanics import LimbMechanics

FILE = "mechanics.csv"


def mechanics_table(limbs: Sequence[LimbMechanics], t_s: Array) -> pd.DataFrame:
    """A row a frame: energies in J, V_z and Theorem 3's bound of each limb, named by its outermost marker.

    Args:
        limbs: Limbs of one recording.
        t_s: (T,) its times.
    """
    table: dict[str, np.ndarray] = {"frame": np.arange(1, len(t_s) + 1), "t_s": t_s}
    for limb in limbs:
        part = slice(limb.first, limb.first + len(limb.track.t_s))
        columns = {
            "kinetic_j": limb.kinetic_j,
            "energy_j": limb.track.energy_j,
            "v_z": limb.track.value,
            "bound": limb.bound,
        }
        for name, values in columns.items():
            whole = np.full(len(t_s), np.nan)
            whole[part] = values
            table[f"{limb.markers[-1]}_{name}"] = whole
    return pd.DataFrame(table)


def write_mechanics(limbs: Sequence[LimbMechanics], t_s: Array, path: Path) -> None:
    """Write the table; empty where a limb was not tracked."""
    mechanics_table(limbs, t_s).to_csv(path, index=False, float_format="%.9g", lineterminator="\n")
