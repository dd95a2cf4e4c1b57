"""Where the potential of a joint comes from: a run's folder, a potential's file, or a learned model with its trials."""

import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial import KDTree

from eal import npz
from eal.archive import ArchiveError
from eal.arrays import Array
from eal.potential import EmpiricalPotential, load_potential
from mocap.errors import FormatError, MocapError
from mocap.filters.body_axes import BodyFrames
from mocap.filters.model import LearnedModel
from mocap.io.csv_table import read_table
from mocap.io.manifest import current_files
from mocap.joints import joint_variables
from mocap.records import marker_tracks
from mocap.schema import Entry, Schema, checked
from mocap.skeleton import Joint, Skeleton
from mocap.skeleton_files import read_skeleton
from mocap.tracking.model_file import load_model
from mocap.tracking.potentials import joint_potentials

FRAMES = ("limb", "plane", "body", "world")
FRAME = "limb"


@dataclass(frozen=True, eq=False, kw_only=True)
class JointSource:
    """A joint's potential and where the joint went.

    Attributes:
        name: Joint name.
        frame: Frame of reference of the coordinates, as far as known.
        potential: V_z on coordinates divided by ``unit_m``.
        unit_m: Metres a unit of these.
        t_s: (T,) times of the path; frame numbers where the times are not known.
        path_m: (T, d) recorded path of the joint's child about its centre; no NaN.
    """

    name: str
    frame: str
    potential: EmpiricalPotential
    unit_m: float
    t_s: Array
    path_m: Array


def read_source(source: Path, joint: str | None, skeleton: Path | None) -> JointSource:
    """Read the potential of a joint.

    Args:
        source: Folder that ``track`` or ``demo`` wrote; a file of its ``potentials/``; or a model that ``learn`` wrote.
        joint: Joint name; with a model and no skeleton three markers: ``parent,centre,child``. None: of a potential's
            file, its name.
        skeleton: Of a model: the file that names the joint.

    Raises:
        MocapError: nothing of that kind, or no such joint; the message names those that there are.
    """
    if source.is_dir():
        files = current_files(source)
        potentials = {Path(file).stem: path for file, path in files.items() if file.startswith("potentials/")}
        there = sorted(potentials)
        if not there:
            raise MocapError(f"{source}: has no potentials/: give a folder that mocap track wrote with `skeleton`")
        if joint not in there:
            raise MocapError(f"{source}: give `joint`, one of {', '.join(there)}" + (f", not {joint}" if joint else ""))
        return _from_file(potentials[joint], joint, files.get("joints.csv", source / "joints.csv"))
    if not source.is_file():
        raise MocapError(f"{source}: there is no such file: give the folder of a run, a potential, or a model (.npz)")
    try:
        with npz.opened(source) as stored:
            is_model = "header" in stored
    except (OSError, ValueError, RuntimeError, EOFError, zipfile.BadZipFile):
        raise FormatError(f"{source}: not a potential or model (.npz) that mocap wrote") from None
    if is_model:
        return _from_model(load_model(source), joint, skeleton, source)
    return _from_file(source, joint or source.stem, None)


def _from_file(path: Path, joint: str, tracks: Path | None) -> JointSource:
    try:
        potential = load_potential(path)
        unit_m = float(potential.units[0].removesuffix(" m"))
    except (ArchiveError, ValueError) as error:
        raise FormatError(f"{path}: not the potential of a joint in metres ({error}): run mocap track again") from None
    samples_m = potential.samples * unit_m
    if tracks is None:
        return JointSource(
            name=joint,
            frame=FRAME if potential.dimension == 2 else "body",
            potential=potential,
            unit_m=unit_m,
            t_s=np.arange(len(samples_m), dtype=np.float64),
            path_m=samples_m,
        )
    # ``joints.csv`` of a run
    titles, values = read_table(tracks)
    found = dict(zip(titles, values.T, strict=True))
    checked(tracks.name, found, _TIMES, again="run mocap track again")
    table = pd.DataFrame(found)
    near: dict[str, float] = {}
    for frame in FRAMES:
        columns = [f"{joint}_{frame}_{axis}" for axis in "xyz"[: potential.dimension]]
        if set(columns) <= set(table.columns) and f"{joint}_{frame}_z" not in set(table.columns) - set(columns):
            path_m = table[columns].to_numpy(dtype=np.float64)
            finite = path_m[np.isfinite(path_m).all(axis=1)]
            if len(finite):
                near[frame] = float(np.median(KDTree(finite).query(samples_m)[0]))
    if not near:
        raise FormatError(
            f"{tracks}: has no coordinates of {joint!r} in {potential.dimension} dimensions: run mocap track again"
        )
    frame = min(near, key=lambda key: near[key])
    path_m = table[[f"{joint}_{frame}_{axis}" for axis in "xyz"[: potential.dimension]]].to_numpy(dtype=np.float64)
    finite = np.isfinite(path_m).all(axis=1)
    return JointSource(
        name=joint,
        frame=frame,
        potential=potential,
        unit_m=unit_m,
        t_s=table["t_s"].to_numpy(dtype=np.float64)[finite],
        path_m=path_m[finite],
    )


_TIMES: Schema = {"t_s": Entry(shape=("frames",), rising=True)}


def _from_model(model: LearnedModel, joint: str | None, skeleton: Path | None, path: Path) -> JointSource:
    wanted = _joint(model.names, joint, skeleton, path)
    bones = Skeleton(name="joint", markers=model.names, joints=(wanted,))
    q, origin, t = [], [], []
    owner = np.repeat(np.arange(len(model.trials)), [len(trial.t_s) for trial in model.trials])
    for trial in model.trials:
        markers = marker_tracks(model.names, trial.t_s, trial.xyz_m)
        still = BodyFrames(
            rotation=np.tile(np.eye(3), (len(trial.t_s), 1, 1)), position_m=np.zeros((len(trial.t_s), 3))
        )
        q.append(joint_variables(markers, bones, still)[f"joint_{FRAME}"])
        origin.append(trial.xyz_m)
        t.append(trial.t_s - trial.t_s[0] + (t[-1][-1] + model.dt_s if t else 0.0))
    t_s, q_m = np.concatenate(t), np.concatenate(q)
    markers = marker_tracks(model.names, t_s, np.concatenate(origin))
    found = joint_potentials({wanted.name: q_m[:, 0]}, FRAME, markers, bones, trials=owner.tolist())
    if wanted.name not in found:
        raise MocapError(f"{path}: {wanted.name} has too few frames in which its three markers were measured")
    one = found[wanted.name]
    finite = np.isfinite(q_m[:, 0]).all(axis=1)
    return JointSource(
        name=wanted.name,
        frame=FRAME,
        potential=one.potential,
        unit_m=one.scale_m,
        t_s=t_s[finite],
        path_m=q_m[finite, 0],
    )


def _joint(names: tuple[str, ...], joint: str | None, skeleton: Path | None, path: Path) -> Joint:
    if skeleton is not None:
        joints = {j.name: j for j in read_skeleton(skeleton).for_markers(names, source=str(path)).joints}
        if joint not in joints:
            raise MocapError(f"{skeleton}: give `joint`, one of {', '.join(joints) or 'there is none'}")
        return joints[joint]
    parts = tuple(part.strip() for part in (joint or "").split(","))
    if len(parts) != 3 or not set(parts) <= set(names):
        raise MocapError(
            f"{path}: a model contains markers, not joints: give `skeleton` with `joint`, or `joint` as "
            f"parent,centre,child of its markers {', '.join(names)}"
        )
    return Joint(name=f"{parts[1]}_{parts[2]}", parent=parts[0], centre=parts[1], child=parts[2])
