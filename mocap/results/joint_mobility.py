"""Mobility of a joint over tracked runs: the share of all rotations that it visits, beside its ranges of angles."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from eal.arrays import Array, short_repr
from eal.comparison import RANGE
from eal.rotation_share import Mobility
from eal.rotation_share import mobility as share_of_rotations
from mocap.errors import MocapError
from mocap.kinematics.angles import SEQUENCE, turns
from mocap.kinematics.records import Kinematics, Rests
from mocap.measures import JointAxes
from mocap.results.stored import RECORDING
from mocap.results.tracked import Tracked, load
from mocap.sides import words
from mocap.tracking.result import Result


@dataclass(frozen=True, eq=False, kw_only=True)
class JointMobility:
    """What a joint visits over several runs.

    Attributes:
        joint: Its name.
        found: The share with its interval (``eal.Mobility``); ``plot`` shows it on the sphere.
        ranges: A row for each angle: its name, and the ends of 95 % of the time of all runs, in degrees.
        note: What restricts it; empty: nothing does.
    """

    joint: str
    found: Mobility
    ranges: pd.DataFrame
    note: str

    __repr__ = short_repr

    def lines(self) -> list[str]:
        """What a person reads."""
        angles = "; ".join(
            f"{row['angle']} {row['low_deg']:.3g} to {row['high_deg']:.3g}°" for row in self.ranges.to_dict("records")
        )
        return [f"{words(self.joint)}: {self.found.line()}", f"95 % of the time: {angles}", *filter(None, [self.note])]

    def report(self) -> dict[str, object]:
        """All of it but the poses, as JSON takes it."""
        one = self.found
        low, high = (float(x) for x in one.interval)
        return {
            "joint": self.joint,
            "share": one.share,
            "share_low": low,
            "share_high": high,
            "level": one.level,
            "cover": one.cover,
            "trials": one.trials,
            "within_mm": one.within,
            "hidden": one.hidden,
            "share_measured": one.share_measured if np.isfinite(one.share_measured) else None,
            "ranges": self.ranges.to_dict("records"),
            "note": self.note,
        }

    def write(self, folder: Path) -> None:
        """``mobility.json``, ``mobility.png`` and ``recording.rrd``."""
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        from mocap.rerun.log_mobility import write_mobility_recording

        text = json.dumps(self.report(), indent=1, ensure_ascii=False)
        (folder / "mobility.json").write_text(text, encoding="utf-8")
        canvas = Figure(figsize=(7.2, 4.2), dpi=110, layout="constrained")
        FigureCanvasAgg(canvas)
        self.found.plot(canvas.subplots(1, 2))
        canvas.suptitle(f"{words(self.joint)}: {100 * self.found.share:.3g} % of all rotations", fontsize=10)
        canvas.savefig(folder / "mobility.png")
        write_mobility_recording(self.found, self.lines(), folder / "recording.rrd")


def mobility(
    runs: str | PathLike[str] | Sequence[str | PathLike[str] | Result],
    *,
    joint: str,
    within_mm: float | None = None,
    cover: float = 0.95,
) -> JointMobility:
    """The share of all rotations that a joint visits, with an interval over runs; axes and side do not change it.

    Frames that the tracker filled count as it has them; what measured frames alone visit is told beside it.

    Args:
        runs: A folder of runs of ``track`` or ``batch``, at any depth, or the runs; each is a trial.
        joint: A joint of three angles: between two bodies, or of three markers with axes of both segments.
        within_mm: With translations (of a joint between bodies): the radius of the ball that they are a share of.
        cover: Share of the time of a trial that the visited poses hold.

    Returns:
        The mobility.

    Raises:
        MocapError: no runs, fewer than four, or no three angles of such a joint.
    """
    folder = Path(runs) if isinstance(runs, (str, PathLike)) else None
    loaded = _found(folder) if folder is not None else [_loaded(one) for one in runs]  # type: ignore[union-attr]
    rotations, shifts, measured, angles, names = [], [], [], [], ("", "", "")
    for run in loaded:
        names, degrees, seen = _angles(run, joint)
        axes = run.skeleton.measures.axes.get(joint, JointAxes())
        known = np.isfinite(degrees).all(axis=1)
        turned = np.full((len(degrees), 3, 3), np.nan)
        turned[known] = Rotation.from_euler(axes.sequence.upper(), degrees[known], degrees=True).as_matrix()
        rotations.append(turned)
        angles.append(degrees[known])
        measured.append(seen)
        if within_mm is not None:
            shifts.append(_translations(run.kinematics, joint))
    try:
        found = share_of_rotations(
            rotations,
            translations=shifts if within_mm is not None else None,
            within=within_mm,
            measured=measured,
            cover=cover,
        )
    except ValueError as error:
        raise MocapError(f"mobility of {joint!r}: {error}") from None
    low, high = np.quantile(np.concatenate(angles), RANGE, axis=0)
    bodies = joint in {one.name for one in loaded[0].skeleton.body_joints}
    stated = loaded[0].skeleton.measures.axes.get(joint, JointAxes()).parent is not None
    return JointMobility(
        joint=joint,
        found=found,
        ranges=pd.DataFrame({"angle": names, "low_deg": low, "high_deg": high}),
        note=""
        if stated or not bodies
        else "axes of the bodies coincide in the mean pose of each run: what differs between runs is not counted; "
        "state [measures.axes]",
    )


def _found(folder: Path) -> list[Tracked]:
    paths = sorted({path.parent for path in folder.rglob(RECORDING)}) if folder.is_dir() else []
    paths = [path for path in paths if not any(part[0] == "." for part in path.relative_to(folder).parts)]
    if not paths:
        raise MocapError(f"{folder}: holds no run: give a folder that mocap track or mocap batch wrote")
    return [load(path) for path in paths]


def _loaded(one: str | PathLike[str] | Result) -> Tracked:
    return one if isinstance(one, Tracked) else Tracked.of(one) if isinstance(one, Result) else load(one)


def _angles(run: Tracked, joint: str) -> tuple[tuple[str, str, str], Array, Array]:
    """Names of the three angles, (N, 3) of them in degrees, and (N,) whether all markers were measured."""
    there = {one.name: one for one in run.kinematics.quantities}
    sequence = run.skeleton.measures.axes.get(joint, JointAxes()).sequence
    by_axis = tuple(f"rotation_{one}" for one in turns(sequence))
    for names in (by_axis, ("flexion", "abduction", "rotation")) if sequence == SEQUENCE else (by_axis,):
        three = [there.get(f"{joint}_{name}_deg") for name in names]
        if None not in three:
            values = np.stack([one.value for one in three if one is not None], axis=1)
            seen = np.all([one.rests == Rests.MEASURED for one in three if one is not None], axis=0)
            return names, values, seen  # type: ignore[return-value]
    joints = [one.name for one in (*run.skeleton.joints, *run.skeleton.body_joints)]
    raise MocapError(
        f"{run.name}: joint {joint!r} has no three angles: name a joint between two bodies, or state [measures.axes] "
        f"of its segments; there are {', '.join(joints) or 'none'}"
    )


def _translations(found: Kinematics, joint: str) -> Array:
    """(N, 3) in mm."""
    names = [f"{joint}_translation_{one}_m" for one in "xyz"]
    if not set(names) <= {one.name for one in found.quantities}:
        raise MocapError(f"joint {joint!r} has no translations: only a joint between two bodies has")
    return np.stack([1e3 * found[name].value for name in names], axis=1)
