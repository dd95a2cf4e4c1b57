"""Learned models as files: a numpy archive with everything that was learned, to be looked at and tracked with."""

import json
import zipfile
import zlib
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from eal import npz
from eal.arrays import Array
from mocap.errors import FormatError
from mocap.filters.mixture import Mixture
from mocap.filters.model import LearnedModel, own_trials
from mocap.filters.models.registry import read, written
from mocap.filters.poses import MarkerTrial

FORMAT = "eal-mocap model 10"
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
    ``trial_i_sd_m``; ``mixture_*``; and, to be looked at, what the last model, or the first of those that it averages,
    learns from all trials: ``pose_*`` (mean pose, basis, shapes, stiffness and damping where its mechanics are linear);
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
        "models": [written(model) for model in learned.models],
        "descriptions": [model.description for model in learned.models],
        "power": learned.mixture.power,
        "scores": learned.scores,
    }
    arrays: dict[str, Array] = {}
    for i, trial in enumerate(learned.trials):
        arrays |= {f"trial_{i}_t_s": trial.t_s, f"trial_{i}_xyz_m": trial.xyz_m, f"trial_{i}_sd_m": trial.sd_m}
    for name in ("offset", "slope", "length", "scale", "widen"):
        arrays[f"mixture_{name}"] = getattr(learned.mixture, name)
    everything: dict[str, Any] = {"header": np.array(json.dumps(header)), **arrays}
    everything |= learned.models[-1].learned_arrays(own_trials(learned))
    with path.open("wb") as file:
        np.savez_compressed(file, **everything)


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
            models = tuple(read(model) for model in header["models"])
            for trial in trials:
                shape = (len(trial.t_s), len(header["names"]))
                if trial.xyz_m.shape != (*shape, 3) or trial.sd_m.shape != shape:
                    raise ValueError(f"trial {trial.name} has positions of shape {trial.xyz_m.shape}")
            if not trials or len(models) != len(parts["offset"]):
                raise ValueError(f"{len(trials)} trials, {len(models)} motion models, {len(parts['offset'])} weights")
            return LearnedModel(
                names=tuple(header["names"]),
                trunk=tuple(header["trunk"]),
                bones=tuple((a, b) for a, b in header["bones"]),
                trials=trials,
                models=models,
                mixture=Mixture(power=header["power"], **parts),
                scores=header["scores"],
            )
    except FormatError:
        raise
    except _DAMAGE as error:
        raise FormatError(
            f"{path}: not a model that mocap learn wrote ({error}): give the file that it wrote"
        ) from None
