"""A joint compared between two groups of runs: its angle in the plane of its limb, from the potentials of the runs."""

import json
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd

from eal.archive import ArchiveError
from eal.arrays import Array
from eal.comparison import Comparison, compare
from eal.potential import load_potential
from mocap.errors import FormatError, MocapError
from mocap.io.manifest import current_files
from mocap.pipeline.potentials import PLANAR
from mocap.rerun.log_comparison import write_comparison_recording
from mocap.sides import without_side

By = Literal["trial", "animal"]
MAP = ("q", "time_a", "time_b", "band")
"""Arrays of a comparison that are a table over the angle; the others are its report."""


def compare_joints(runs_a: Path, runs_b: Path, *, joint: str, by: By = "trial") -> Comparison:
    """Whether a joint moves differently in two groups of runs, in degrees.

    The angle is that of the child about the joint's centre in the plane of the limb, 0 where the limb is straight, so
    that neither an animal's size nor its side matter; from frames in which all three markers were measured.

    Args:
        runs_a: Folder of runs of ``track``, ``demo`` or ``batch``, at any depth.
        runs_b: The other group. The same folder: sides of the same trials are exchanged.
        joint: Name of the joint; one without a side (``elbow``) stands for both sides. Two with a comma between: the
            first in a, the second in b.
        by: What is permuted. ``animal``: the runs in one folder are of one animal.

    Returns:
        The comparison, in degrees.

    Raises:
        MocapError: no runs, no such joint, or too few of either to judge.
    """
    joints = [part.strip() for part in joint.split(",")]
    if len(joints) > 2:
        raise MocapError(f"`joint` {joint}: give one joint, or one for each group with a comma between")
    groups = [_runs(folder) for folder in (runs_a, runs_b)]
    radians = [[_angles(run, name) for run in runs] for runs, name in zip(groups, (joints[0], joints[-1]), strict=True)]
    whole = np.exp(1j * np.concatenate([angle for group in radians for angle in group])).mean()
    middle = float(np.angle(whole))  # half a turn away from it no angle jumps but those that are there
    degrees = [[np.degrees(middle + np.angle(np.exp(1j * (one - middle))))[:, None] for one in g] for g in radians]
    paired = runs_a.resolve() == runs_b.resolve()
    owners = [
        [run.parent.name if by == "animal" else str(run.relative_to(top)) for run in runs]
        for runs, top in zip(groups, (runs_a, runs_b), strict=True)
    ]
    try:
        return compare(
            *degrees,
            animals=(owners[0], owners[1]) if paired or by == "animal" else None,
            names=[f"{' and '.join(dict.fromkeys(joints))} angle"],
            units=["°"],
        )
    except ValueError as error:
        raise MocapError(f"{runs_a} and {runs_b}: {error}") from None


def write_comparison(found: Comparison, folder: Path) -> None:
    """``report.json``, ``difference.csv`` (a row an angle), ``comparison.png`` and ``recording.rrd``."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    (folder / "report.json").write_text(json.dumps(report(found), indent=1, ensure_ascii=False), encoding="utf-8")
    table = pd.DataFrame({"angle_deg": found.q[:, 0]} | {name: getattr(found, name) for name in MAP[1:]})
    table["differs"] = found.differs
    table.to_csv(folder / "difference.csv", index=False, float_format="%.6g", lineterminator="\n")
    canvas = Figure(figsize=(6.4, 6.4), dpi=110, layout="constrained")
    FigureCanvasAgg(canvas)
    found.plot(canvas.subplots(2, 1, sharex=True))
    canvas.suptitle(found.lines()[0].split(" (")[0], fontsize=10)
    canvas.savefig(folder / "comparison.png")
    write_comparison_recording(found, folder / "recording.rrd")


def report(found: Comparison) -> dict[str, object]:
    """All of it but the map, as JSON takes it."""
    values = {one.name: getattr(found, one.name) for one in fields(found) if one.name not in MAP}
    return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in values.items()}


def _runs(folder: Path) -> list[Path]:
    if not folder.is_dir():
        raise MocapError(f"{folder}: there is no such folder: give one that holds runs of mocap track or mocap batch")
    there = (path for path in folder.rglob(PLANAR) if path.is_dir())
    # folders of interrupted runs are hidden
    found = sorted({p.parent for p in there if not any(x[0] == "." for x in p.relative_to(folder).parts)})
    if not found:
        raise MocapError(f"{folder}: holds no run with {PLANAR}/: give folders that mocap track wrote with `skeleton`")
    return found


def _angles(run: Path, joint: str) -> Array:
    """(N,) radians of a joint in one run, of both its sides where its name has none."""
    there = {Path(file).stem: path for file, path in current_files(run).items() if file.startswith(f"{PLANAR}/")}
    names = (
        [joint] if joint in there else [name for name in there if without_side(name) == without_side(joint) == joint]
    )
    if not names:
        raise MocapError(f"{run}: has no joint {joint}: `joint` is one of {', '.join(sorted(there))}")
    return np.concatenate([_angle(there[name]) for name in sorted(names)])


def _angle(path: Path) -> Array:
    try:
        potential = load_potential(path)
    except ArchiveError as error:
        raise FormatError(f"{path}: not the potential of a joint ({error}): run mocap track again") from None
    if potential.dimension != 2:
        raise FormatError(f"{path}: has {potential.dimension} coordinates, and not the 2 of the plane of a limb")
    along, across = potential.samples.T
    return np.arctan2(across, along)


def readable(found: Comparison, groups: Sequence[Path]) -> str:
    """The verdict and the effect, in lines."""
    return "\n".join([f"a: {groups[0]}, b: {groups[1]}", *found.lines()])
