"""Whether what a skeleton calls left lies on the left: evidence on which hand the world has."""

from collections.abc import Sequence

import numpy as np

from eal.arrays import Array
from mocap.findings import Finding, Kind
from mocap.measures import AXES, Measures

FEWEST = 20
"""Frames by which it is judged."""
CLEAR = 0.95
"""Share of them that agree."""
UPRIGHT = 0.5
"""Sine from which left, forward and up span a space: an animal that lies on its side tells nothing."""


def side_findings(
    xyz_m: Array, names: Sequence[str], measures: Measures, *, decided: bool, doubted: bool
) -> list[Finding]:
    """What the stated up, forward and left tell of the world.

    Args:
        xyz_m: (T, M, 3) positions.
        names: The M markers.
        measures: What a skeleton states.
        decided: Whether its hand is known otherwise.
        doubted: Whether cameras leave open that it is mirrored: with this it is.
    """
    lines = (measures.forward, measures.left)
    if decided or None in lines or not {marker for line in lines if line for marker in line} <= {*names}:
        return []
    index = {name: i for i, name in enumerate(names)}
    forward, left = (_unit(xyz_m[:, index[b]] - xyz_m[:, index[a]]) for a, b in lines)  # type: ignore[misc]
    volume = np.cross(forward, left) @ np.array(AXES[measures.up])
    clear = volume[np.abs(volume) > UPRIGHT]  # NaN is not
    if len(clear) < FEWEST:
        return []
    wrong = float(np.mean(clear < 0))
    if wrong < CLEAR:
        return []
    text = (
        f"seen from above (up is {measures.up}), what the skeleton calls left lies on the right of forward in "
        f"{wrong:.0%} of the frames: the world is mirrored, names of the two sides are exchanged, up is another axis, or the animal "
        "is upside down: check `calibration`, `origin` and the `skeleton`"
    )
    mends = ("calibration", "origin", "skeleton")
    return [Finding(kind=Kind.MIRRORED_WORLD, alarm=doubted, text=text, numbers={"share": wrong}, mends=mends)]


def _unit(vectors: Array) -> Array:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0, length, np.nan)
