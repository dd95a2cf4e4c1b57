"""Joints compared between two groups of runs: their angles in the planes of their limbs, of all frames."""

import csv
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from eal.archive import ArchiveError
from eal.arrays import Array
from eal.comparison import Comparison, compare_all
from eal.potential import load_potential
from mocap.errors import FormatError, MocapError
from mocap.io.manifest import current_files
from mocap.records import Status
from mocap.rerun.log_comparison import write_comparison_recording
from mocap.results.files import RECORDING
from mocap.results.stored import read_recording
from mocap.sides import without_side
from mocap.tracking.potentials import FRAME, PLANAR
from mocap.tracking.result import Result

By = Literal["trial", "animal"]
MAP = ("q", "time_a", "time_b", "band")
"""Arrays of a comparison that are a table over the angle; the others are its report."""
EVERY = "all"
"""In place of a joint: each that all runs have."""


def compare_joints(runs_a: Path, runs_b: Path, *, joint: str, by: By | None = None) -> Comparison:
    """Whether a joint moves differently in two groups of runs, in degrees; ``compare_several`` of one.

    Args:
        runs_a: Folder of runs of ``track``, ``demo`` or ``batch``, at any depth.
        runs_b: The other group. The same folder: sides of the same trials are exchanged.
        joint: Name of the joint; one without a side (``elbow``) stands for both sides. Two with a comma between: the
            first in a, the second in b.
        by: What is permuted. None: animals, where a ``summary.csv`` of a batch or folders (ANIMAL/TRIAL) tell them,
            else trials.

    Returns:
        The comparison, in degrees.

    Raises:
        MocapError: no runs, no such joint, or too few of either to judge.
    """
    return compare_several(runs_a, runs_b, joints=[joint], by=by)[joint]


def compare_several(
    runs_a: Path, runs_b: Path, *, joints: Sequence[str], by: By | None = None
) -> dict[str, Comparison]:
    """Whether joints move differently in two groups of runs, in degrees, with p of the largest difference of any.

    The angle is that of the child about the joint's centre in the plane of the limb, 0 where the limb is straight, so
    that neither an animal's size nor its side matter. It is of all frames: measured, and as the smoother has those that
    were not, with their covariance.

    Args:
        runs_a: See ``compare_joints``.
        runs_b: See there.
        joints: Names as there; ``all``: each that all runs have.
        by: See there.

    Returns:
        The comparison of each.

    Raises:
        MocapError: see there.
    """
    groups = [_runs(folder) for folder in (runs_a, runs_b)]
    loaded = [[_Run.of(path) for path in group] for group in groups]
    wanted = list(dict.fromkeys(joints))
    if EVERY in wanted:
        wanted = sorted(set.intersection(*(set(run.joints) for group in loaded for run in group)))
    paired = runs_a.resolve() == runs_b.resolve()
    animals = [_animals(group, top) for group, top in zip(groups, (runs_a, runs_b), strict=True)]
    told = all(one is not None for one in animals)
    whole = by == "animal" or (by is None and told)
    owners = [
        (names or [run.parent.name for run in runs]) if whole else [str(run.relative_to(top)) for run in runs]
        for runs, top, names in zip(groups, (runs_a, runs_b), animals, strict=True)
    ]
    trials, options = {}, {}
    for joint in wanted:
        parts = [part.strip() for part in joint.split(",")]
        if len(parts) > 2:
            raise MocapError(f"`joint` {joint}: give one joint, or one for each group with a comma between")
        angles = [[run.angle(name) for run in runs] for runs, name in zip(loaded, (parts[0], parts[-1]), strict=True)]
        every = np.concatenate([one.radians for group in angles for one in group])
        middle = float(np.angle(np.nanmean(np.exp(1j * every))))  # half a turn away from it no angle jumps but there
        degrees = [
            [np.degrees(middle + np.angle(np.exp(1j * (one.radians - middle))))[:, None] for one in group]
            for group in angles
        ]
        trials[joint] = (degrees[0], degrees[1])
        options[joint] = {
            "covariances": tuple([np.degrees(np.degrees(one.variance))[:, None, None] for one in g] for g in angles),
            "measured": tuple([one.measured for one in g] for g in angles),
            "names": [f"{' and '.join(dict.fromkeys(parts))} angle"],
            "units": ["°"],
        }
    try:
        return compare_all(trials, animals=(owners[0], owners[1]) if paired or whole else None, options=options)
    except ValueError as error:
        hint = "; by trial the result holds within these animals" if whole and by is None else ""
        raise MocapError(f"{runs_a} and {runs_b}: {error}{hint}") from None


def _animals(runs: Sequence[Path], top: Path) -> list[str] | None:
    """Whose each run is: as the summary of a batch says, or the folder that it is in; None: neither tells."""
    summary = top / "summary.csv"
    if summary.is_file():
        with summary.open(encoding="utf-8", newline="") as stream:
            whose = {row.get("trial", ""): row.get("animal", "") for row in csv.DictReader(stream)}
        named = [whose.get(run.relative_to(top).as_posix(), "") for run in runs]
        if all(named):
            return named
    if all(len(run.relative_to(top).parts) > 1 for run in runs):
        return [run.parent.name for run in runs]
    return None


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


def write_several(found: Mapping[str, Comparison], folder: Path) -> None:
    """Of each joint a folder as of ``write_comparison``, and ``joints.csv``: a row a joint."""
    for name, one in found.items():
        place = folder / name.replace(",", "_")
        place.mkdir()
        write_comparison(one, place)
    table(found).to_csv(folder / "joints.csv", index=False, float_format="%.6g", lineterminator="\n")


def table(found: Mapping[str, Comparison]) -> pd.DataFrame:
    """A row a joint: p alone and of all, the effect with its intervals."""
    return pd.DataFrame(
        {
            "joint": name,
            "p": one.p_value,
            "p_of_all": one.p_of_all,
            "shift_deg": one.shift[0],
            "shift_low_deg": one.shift_interval[0, 0],
            "shift_high_deg": one.shift_interval[0, 1],
            "variance_ratio": one.variance_ratio[0],
            "variance_ratio_low": one.variance_ratio_interval[0, 0],
            "variance_ratio_high": one.variance_ratio_interval[0, 1],
            "variance_p": one.variance_p[0],
            "variance_p_of_all": one.variance_p_of_all[0],
            "n_a": one.counts[0],
            "n_b": one.counts[1],
            "unit": one.unit,
        }
        for name, one in found.items()
    )


def report(found: Comparison) -> dict[str, object]:
    """All of it but the map, as JSON takes it."""
    values = {one.name: getattr(found, one.name) for one in fields(found) if one.name not in MAP}
    values["methods"] = found.methods()
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


@dataclass(frozen=True, eq=False, kw_only=True)
class _Angle:
    """(N,) radians of a joint over a run, NaN where nothing is known, their variances, and which were measured."""

    radians: Array
    variance: Array
    measured: NDArray[np.bool_]


@dataclass(frozen=True, eq=False, kw_only=True)
class _Run:
    """A run: its potentials by joint, and its recording, where it was saved (runs of before have none)."""

    path: Path
    potentials: Mapping[str, Path]
    recording: Result | None

    @classmethod
    def of(cls, path: Path) -> "_Run":
        files = current_files(path)
        there = {Path(file).stem: where for file, where in files.items() if file.startswith(f"{PLANAR}/")}
        return cls(path=path, potentials=there, recording=read_recording(path) if RECORDING in files else None)

    @property
    def joints(self) -> list[str]:
        return sorted(self.potentials)

    def angle(self, joint: str) -> _Angle:
        """Of both sides, one after the other, where the name has none."""
        names = (
            [joint]
            if joint in self.potentials
            else [name for name in self.joints if without_side(name) == without_side(joint) == joint]
        )
        if not names:
            raise MocapError(f"{self.path}: has no joint {joint}: `joint` is one of {', '.join(self.joints)}")
        parts = [self._smoothed(name) or _of_potential(self.potentials[name]) for name in sorted(names)]
        return _Angle(
            **{one.name: np.concatenate([getattr(part, one.name) for part in parts]) for one in fields(_Angle)}
        )

    def _smoothed(self, joint: str) -> _Angle | None:
        """All frames from the first in which the joint is known to the last; None: no recording holds it."""
        found = self.recording
        one = None if found is None else next((x for x in found.skeleton.joints if x.name == joint), None)
        q = {} if found is None else found.joints_m(FRAME)
        if found is None or one is None or joint not in q:
            return None
        tracks = found.tracks
        at = [tracks.names.index(name) for name in (one.parent, one.centre, one.child)]
        status, xyz, cov = tracks.status[:, at], tracks.xyz_m[:, at], tracks.cov_m2[:, at]
        known = np.isfinite(q[joint]).all(axis=1)
        measured = (status == Status.MEASURED).all(axis=1) & known
        # of each marker a third of the trace is its variance across the limb, over the length of its own segment
        across = np.trace(cov, axis1=2, axis2=3) / 3.0
        near, far = (np.sum((xyz[:, i] - xyz[:, 1]) ** 2, axis=1) for i in (0, 2))
        variance = (across[:, 0] + across[:, 1]) / near + (across[:, 2] + across[:, 1]) / far
        angle = np.where(known, np.arctan2(q[joint][:, 1], q[joint][:, 0]), np.nan)
        if not measured.any():
            return None
        rows = np.flatnonzero(measured)
        inside = slice(rows[0], rows[-1] + 1)
        # measured frames are samples as they are: their noise is that of the trial, and alike on both sides
        return _Angle(
            radians=angle[inside],
            variance=np.where(measured, 0.0, np.nan_to_num(variance))[inside],
            measured=measured[inside],
        )


def _of_potential(path: Path) -> _Angle:
    try:
        potential = load_potential(path)
    except ArchiveError as error:
        raise FormatError(f"{path}: not the potential of a joint ({error}): run mocap track again") from None
    if potential.dimension != 2:
        raise FormatError(f"{path}: has {potential.dimension} coordinates, and not the 2 of the plane of a limb")
    along, across = potential.samples.T
    radians = np.arctan2(across, along)
    return _Angle(radians=radians, variance=np.zeros(len(radians)), measured=np.ones(len(radians), dtype=bool))


def readable(found: Mapping[str, Comparison], groups: Sequence[Path]) -> str:
    """The verdict and the effect of each joint, in lines, and the sentence for the methods."""
    lines = [f"a: {groups[0]}, b: {groups[1]}"]
    for one in found.values():
        lines += one.lines()
    return "\n".join([*lines, f"for the methods section: {next(iter(found.values())).methods()}"])
