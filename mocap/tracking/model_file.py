"""Learned models as files: a numpy archive with everything that was learned, to be looked at and tracked with."""

import json
import zipfile
import zlib
from dataclasses import fields, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

import numpy as np

from eal import npz
from eal.arrays import Array
from mocap.documents import from_json, one_line
from mocap.errors import FormatError, MocapError, beside
from mocap.filters.mixture import Mixture
from mocap.filters.model import LearnedModel, check_rates, own_trials
from mocap.filters.models.base import TrajectoryModel
from mocap.filters.models.registry import MODELS
from mocap.filters.poses import MarkerTrial
from mocap.schema import LARGEST, POSITIVE, Entry, Schema, checked, names

FORMAT = "eal-mocap model 12"
_HEADER: Schema = {
    "names": names("markers", filled=True),
    "trunk": names(among="names"),
    "bones": Entry(kind="s", shape=(None, 2), among="names"),
    "trials": Entry(kind="s", shape=(None,), filled=True),
    "widen": Entry(least=POSITIVE),
    "dof": Entry(least=POSITIVE),
}
_BODY: Schema = {"names": names("markers"), "body": names(among="names", filled=True)}
_TRIAL: Schema = {
    "t_s": Entry(shape=("frames",), rising=True, filled=True),
    "xyz_m": Entry(shape=("frames", "markers", 3), missing=1, filled=True),
    "sd_m": Entry(shape=("frames", "markers"), least=POSITIVE, missing=0, there="xyz_m"),
}
_MIXTURE: Schema = {
    "offset": Entry(shape=("models",), filled=True),
    "slope": Entry(shape=("models",)),
    "length": Entry(shape=("lengths",), least=POSITIVE, rising=True, filled=True),
    "scale": Entry(shape=("lengths", "models"), least=POSITIVE),
}
_SHOWN: Schema = {
    "pose_mean_m": Entry(shape=("markers", 3), needed=False),
    "pose_basis": Entry(shape=("markers", 3, "rank"), needed=False),
    "pose_residual_sd_m": Entry(shape=("markers", 3), least=0.0, needed=False),
    "pose_shapes_m": Entry(shape=(None, "rank"), needed=False),
    "pose_acceleration_density": Entry(shape=("rank", "rank"), covariance=True, needed=False),
    "pose_stiffness": Entry(shape=("rank", "rank"), needed=False),
    "pose_damping": Entry(shape=("rank", "rank"), needed=False),
    "bone_ends": Entry(kind="i", shape=("bones", 2), least=0, most="markers", needed=False),
    "bone_length_m": Entry(shape=("bones",), least=POSITIVE, needed=False),
    "bone_sd_m": Entry(shape=("bones",), least=0.0, needed=False),
}
"""What is not tracked with, but looked at."""
_DAMAGE = (
    OSError,
    KeyError,
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
        "bodies": learned.bodies,
        "trials": [trial.name for trial in learned.trials],
        "models": [written(model) for model in learned.models],
        "descriptions": [model.description for model in learned.models],
        **{name: getattr(learned.mixture, name) for name in ("widen", "dof")},
        "scores": learned.scores,
    }
    arrays: dict[str, Array] = {}
    for i, trial in enumerate(learned.trials):
        arrays |= {f"trial_{i}_t_s": trial.t_s, f"trial_{i}_xyz_m": trial.xyz_m, f"trial_{i}_sd_m": trial.sd_m}
    for name in ("offset", "slope", "length", "scale"):
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
    again = "give the file that mocap learn wrote, or learn it again"
    if not path.exists():
        raise FormatError(f"{path}: there is no such file{beside(path)}: {again}")
    try:
        with npz.opened(path) as file:
            header = from_json(str(file["header"]), "header")
            if header.get("format") != FORMAT:
                raise FormatError(f"expected '{FORMAT}', but it says '{header.get('format')}': learn it again")
            entries = checked("header", header, _HEADER, again=again)
            sizes = {"markers": len(entries["names"])}
            bodies = header.get("bodies", [])
            for body in [bodies] if not isinstance(bodies, list) else bodies:
                checked("bodies", {"names": entries["names"], "body": body}, _BODY, again=again)
            trials = []
            for i, name in enumerate(entries["trials"]):
                parts = {key: file[f"trial_{i}_{key}"] for key in _TRIAL}
                found = checked(f"trial_{i} ({name})", parts, _TRIAL, sizes=dict(sizes), again=again)
                trials.append(MarkerTrial(name=name, **found))
            models = tuple(read(model, again=again) for model in header["models"])
            parts = {name: file[f"mixture_{name}"] for name in _MIXTURE}
            mixture = checked("mixture", parts, _MIXTURE, sizes={"models": len(models)}, again=again)
            shown = {name: file[name] for name in _SHOWN if name in file}
            checked("file", shown, _SHOWN, sizes=sizes, again=again)
            for name, by in header["scores"].items():
                checked(f"scores of {name}", by, {key: Entry(shape=("gaps",), least=0.0) for key in by}, again=again)
        check_rates(trials)
    except (MocapError, *_DAMAGE) as error:
        reason = str(error) if isinstance(error, MocapError) else f"{one_line(error)}: {again}"
        raise FormatError(f"{path}: not a model that mocap learn wrote: {reason}") from None
    return LearnedModel(
        names=tuple(entries["names"]),
        trunk=tuple(entries["trunk"]),
        bones=tuple((a, b) for a, b in entries["bones"]),
        bodies=tuple(map(tuple, bodies)),
        trials=tuple(trials),
        models=models,
        mixture=Mixture(widen=float(entries["widen"]), dof=float(entries["dof"]), **mixture),
        scores=header["scores"],
    )


def written(model: TrajectoryModel) -> dict[str, Any]:
    """A model as JSON: its name and its settings.

    Raises:
        KeyError: it is not in ``MODELS``.
    """
    names = {kind: name for name, kind in MODELS.items()}
    settings = {f.name: getattr(model, f.name) for f in fields(model)}
    return {"model": names[type(model)], **{key: _as_json(value) for key, value in settings.items()}}


def _as_json(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_as_json(one) for one in value]
    return written(value) if isinstance(value, TrajectoryModel) else value


def read(settings: Any, *, again: str = "learn it again") -> TrajectoryModel:
    """A model as ``written`` wrote it.

    Args:
        settings: As JSON has them.
        again: What to do where they are not such, for messages.

    Raises:
        FormatError: it has another name, or other settings than its class declares.
    """
    settings = _separate(settings)
    name = settings.get("model") if isinstance(settings, dict) else settings
    if not isinstance(name, str) or name not in MODELS:
        raise FormatError(f"models: {name!r} is none of {', '.join(MODELS)}: {again}")
    declared = get_type_hints(MODELS[name])
    kinds = {f.name: declared[f.name] for f in fields(MODELS[name])}
    if settings.keys() != {"model", *kinds}:
        odd = min(settings.keys() ^ {"model", *kinds})
        raise FormatError(f"models: {name} has other settings than this version ({odd}): {again}")
    values: dict[str, Any] = {}
    for key, kind in kinds.items():
        if isinstance(kind, type) and issubclass(kind, TrajectoryModel):
            values[key] = read(settings[key], again=again)
            if not isinstance(values[key], kind):
                raise FormatError(f"models: {name}.{key} is another model: {again}")
        else:
            found = checked(f"models: {name}", settings, {key: _setting(kind)}, again=again)[key].tolist()
            values[key] = tuple(found) if isinstance(found, list) else found
    return MODELS[name](**values)


def _separate(settings: Any) -> Any:
    """Settings that were written before the Lagrangian had some of its own; for one release."""
    if not isinstance(settings, dict) or settings.get("model") != "articulated" or "mechanics" not in settings:
        return settings
    out = {key: value for key, value in settings.items() if key != "mechanics"}
    if settings["mechanics"] == "lagrangian":
        return out | {"model": "lagrangian"}
    out.pop("trunk", None)
    return out


def _setting(kind: Any) -> Entry:
    """What a setting must be by its annotation: choices; a number, which is at least 0; or several, of any sign."""
    if get_origin(kind) is tuple:
        one = _setting(get_args(kind)[0])
        return replace(one, shape=(None,), least=1 if one.kind == "i" else -LARGEST)
    if get_origin(kind) is Literal:
        return Entry(kind="s", words=get_args(kind))
    return Entry(kind={bool: "b", int: "i", float: "f"}[kind], least=0)
