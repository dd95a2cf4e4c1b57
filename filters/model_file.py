"""Learned models as files: a numpy archive with everything that was learned, to be looked at and tracked with."""

import json
import zipfile
import zlib
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from eal import npz
from filters.delayed import DelaySettings
from filters.fitting import Kind
from filters.learn import PoseSettings
from filters.learn_markers import MarkerSettings
from filters.mixture import Mixture
from filters.model import LearnedModel, kind_name, own_fitting
from filters.motion.pose import PoseMotion
from filters.motion.shape import LinearShape
from filters.poses import MarkerTrial
from filters.several import Several
from mocap.arrays import Array
from mocap.errors import FormatError

FORMAT = "eal-mocap model 7"
_DAMAGE = (
    OSError,
    LookupError,
    ValueError,
    TypeError,
    AttributeError,
    RuntimeError,
    EOFError,
    zipfile.BadZipFile,
    zlib.error,
)
"""What numpy and zipfile raise on files that are cut, changed, or something else."""


def save_model(learned: LearnedModel, path: Path) -> None:
    """Write a model as a numpy archive.

    ``header`` is JSON: names, choices, scores, units, versions. For each trial i ``trial_i_t_s``, ``trial_i_xyz_m`` and
    ``trial_i_sd_m``; ``mixture_*``; and, to be looked at, ``pose_*``: what the last model, or the first of its members,
    is when it is fitted to all trials (mean pose, basis, shapes, stiffness and damping where its mechanics are linear);
    ``bone_*``: markers, by index, that keep their distance, with its mean and deviation in the last trial.
    """
    header = {
        "format": FORMAT,
        "versions": {name: version(name) for name in ("eal-mocap", "numpy", "scipy")},
        "units": "m, s; shapes z in m; stiffness 1/s^2, damping 1/s",
        "names": learned.names,
        "trunk": learned.trunk,
        "bones": learned.bones,
        "trials": [trial.name for trial in learned.trials],
        "kinds": [{"type": type(kind).__name__, **asdict(kind)} for kind in learned.kinds],
        "models": [kind_name(kind) for kind in learned.kinds],
        "power": learned.mixture.power,
        "scores": learned.scores,
    }
    arrays: dict[str, Array] = {}
    for i, trial in enumerate(learned.trials):
        arrays |= {f"trial_{i}_t_s": trial.t_s, f"trial_{i}_xyz_m": trial.xyz_m, f"trial_{i}_sd_m": trial.sd_m}
    for name in ("offset", "slope", "length", "scale", "widen"):
        arrays[f"mixture_{name}"] = getattr(learned.mixture, name)
    everything: dict[str, Any] = {"header": np.array(json.dumps(header)), **arrays, **_pictures(learned)}
    with path.open("wb") as file:
        np.savez_compressed(file, **everything)


def _pictures(learned: LearnedModel) -> dict[str, Array]:
    """What the last model learned from the trials alone."""
    last = learned.kinds[-1]
    kind = last.members[0] if isinstance(last, Several) else last
    if not isinstance(kind, PoseSettings):
        return {}
    fitting = own_fitting(learned)
    _, shapes = fitting.shapes(kind)
    model: PoseMotion = fitting.pose(kind)
    out = {
        "pose_mean_m": shapes.subspace.mean.reshape(-1, 3),
        "pose_basis": shapes.subspace.basis.reshape(-1, 3, model.rank),
        "pose_residual_sd_m": shapes.subspace.residual_sd.reshape(-1, 3),
        "pose_shapes_m": np.concatenate(shapes.z),
        "pose_acceleration_density": model.mechanics.density @ model.mechanics.density.T,
        "bone_ends": fitting.bones.ends,
        "bone_length_m": fitting.bones.length_m,
        "bone_sd_m": fitting.bones.sd_m,
    }
    if isinstance(model.mechanics, LinearShape):
        out |= {"pose_stiffness": model.mechanics.stiffness, "pose_damping": model.mechanics.damping}
    return out


def load_model(path: Path) -> LearnedModel:
    """Read a model that ``save_model`` wrote.

    Raises:
        FormatError: the file is no such model.
    """
    try:
        with npz.opened(path) as file:
            header = json.loads(str(file["header"]))
            if header.get("format") != FORMAT:
                raise FormatError(f"{path}: expected '{FORMAT}', but it says '{header.get('format')}': learn it again")
            trials = tuple(
                MarkerTrial(name=name, **{key: file[f"trial_{i}_{key}"] for key in ("t_s", "xyz_m", "sd_m")})
                for i, name in enumerate(header["trials"])
            )
            parts = {name: file[f"mixture_{name}"] for name in ("offset", "slope", "length", "scale", "widen")}
            kinds = tuple(_kind(kind) for kind in header["kinds"])
            for trial in trials:
                shape = (len(trial.t_s), len(header["names"]))
                if trial.xyz_m.shape != (*shape, 3) or trial.sd_m.shape != shape:
                    raise ValueError(f"trial {trial.name} has positions of shape {trial.xyz_m.shape}")
            if not trials or len(kinds) != len(parts["offset"]):
                raise ValueError(f"{len(trials)} trials, {len(kinds)} motion models, {len(parts['offset'])} weights")
            return LearnedModel(
                names=tuple(header["names"]),
                trunk=tuple(header["trunk"]),
                bones=tuple((a, b) for a, b in header["bones"]),
                trials=trials,
                kinds=kinds,
                mixture=Mixture(power=header["power"], **parts),
                scores=header["scores"],
            )
    except FormatError:
        raise
    except _DAMAGE as error:
        raise FormatError(f"{path}: not a model that mocap learn wrote ({error}): give its --out") from None


def _kind(written: dict[str, Any]) -> Kind:
    """A kind as ``save_model`` wrote it."""
    if written["type"] == Several.__name__:
        return Several(tuple(PoseSettings(**_settings(one)) for one in written["members"]))
    kinds: dict[str, type[Any]] = {kind.__name__: kind for kind in (PoseSettings, DelaySettings, MarkerSettings)}
    return kinds[written["type"]](**_settings(written))


def _settings(written: dict[str, Any]) -> dict[str, Any]:
    """What a kind is made from; JSON has no tuples."""
    return {key: tuple(value) if isinstance(value, list) else value for key, value in written.items() if key != "type"}
