"""A model learned from trials: what it learned from, what was chosen, how it did on hidden gaps; kept in one file."""

import json
import zipfile
import zlib
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from filters.hidden import Fill
from filters.learn import PoseSettings, learn_constant_velocity, learn_pose
from filters.mixture import Mixture, gap_lengths
from filters.motion.base import MotionModel
from filters.motion.pose import PoseMotion
from filters.motion.shape import LinearShape
from filters.observations import Observations
from filters.poses import MarkerTrial, PoseTrial, Shapes, poses_of, shapes_of
from filters.track import Progress, Smoothed, smooth
from filters.tune import Kind, Tuned, search_on, tuned
from mocap.arrays import Array
from mocap.errors import FormatError, MocapError

FORMAT = "eal-mocap model 1"
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


@dataclass(frozen=True, eq=False, kw_only=True)
class LearnedModel:
    """A tracker that has learned from trials.

    The trials themselves are part of it: tracking another recording fits the subspace, the mechanics and the potential
    to them together with what that recording shows, with the choices that were made on hidden gaps.

    Attributes:
        names: The M markers.
        trunk: Those of the body.
        trials: What it learned from.
        kinds: Its K motion models.
        mixture: How they are mixed.
        scores: For each of them and the mixture, by length of gap: root mean square error in mm and the share of
            coordinates inside 95 % intervals, in gaps that were hidden while learning.
    """

    names: tuple[str, ...]
    trunk: tuple[str, ...]
    trials: tuple[MarkerTrial, ...]
    kinds: tuple[Kind, ...]
    mixture: Mixture
    scores: dict[str, dict[str, list[float]]]

    @property
    def dt_s(self) -> float:
        """Time step."""
        return self.trials[0].dt_s


def learn_model(
    names: Sequence[str],
    trunk: Sequence[str],
    trials: Sequence[MarkerTrial],
    rng: np.random.Generator,
    *,
    tell: Callable[[str], None] = lambda _line: None,
) -> LearnedModel:
    """Choose motion models and their mixture on gaps hidden in the trials.

    Args:
        names: The M markers of all trials.
        trunk: Those of the body; empty: all.
        trials: What to learn from.
        rng: What to hide.
        tell: Called with a line for each candidate.

    Raises:
        MocapError: the trials differ in rate, or show too little to hide gaps in.
    """
    check_rates(trials)
    body = [names.index(name) for name in trunk] or list(range(len(names)))
    search = search_on(trials, body, rng, tell=tell)
    if not search.hidden:
        raise MocapError(
            "no gap could be hidden in these trials: a model needs a trial of at least 40 frames in which markers are "
            "seen for 16 frames on end; give longer or more complete trials"
        )
    found = tuned(search)
    return LearnedModel(
        names=tuple(names),
        trunk=tuple(trunk),
        trials=tuple(trials),
        kinds=found.kinds,
        mixture=found.mixture,
        scores=scores_of(found),
    )


def check_rates(trials: Sequence[MarkerTrial]) -> None:
    """Refuse trials of different frame rates.

    Raises:
        MocapError: they differ by more than 1 %.
    """
    rates = [1 / trial.dt_s for trial in trials]
    if max(rates) > 1.01 * min(rates):
        listed = ", ".join(f"{trial.name} {rate:.6g}" for trial, rate in zip(trials, rates, strict=True))
        raise MocapError(f"trials of one model need one frame rate, but have frames a second: {listed}")


def kind_name(kind: Kind) -> str:
    """A model in a few words."""
    if kind is None:
        return "constant velocity of each marker"
    mechanics = {"free": "constant velocity of the pose", "linear": "linear mechanics", "field": "learned forces"}
    held = {"none": "", "shape": " + V_z of shapes", "motion": " + V_z of shapes and velocities"}
    return mechanics[kind.mechanics] + held.get(kind.potential, f" + {kind.potential} potential")


def scores_of(found: Tuned) -> dict[str, dict[str, list[float]]]:
    """Errors and coverage of each model and of the mixture on what was hidden, by length of gap."""
    miss = np.stack([f.miss_m for f in found.fills])
    length = found.fills[0].length
    variance = np.stack([f.variance for f in found.fills]) * found.mixture.scaling(length)[..., None] ** 2
    weight = found.mixture.weights(variance.mean(axis=2), length)
    mean = np.einsum("kn,kni->ni", weight, miss)
    total = np.einsum("kn,kni->ni", weight, variance + (miss - mean) ** 2)
    total = total * found.mixture.widening(length)[:, None] ** 2
    mixed = Fill(miss_m=mean, variance=total, gap=found.fills[0].gap, length=length)
    named = [(kind_name(kind), fill) for kind, fill in zip(found.kinds, found.fills, strict=True)]
    out = {}
    for name, fill in [*named, ("mixture", mixed)]:
        rows: dict[str, list[float]] = {"gap_frames": [], "rmse_mm": [], "coverage95": []}
        for n in np.unique(length):
            at = fill.length == n
            inside = np.abs(fill.miss_m[at]) <= 1.959964 * np.sqrt(fill.variance[at])
            rows["gap_frames"].append(int(n))
            rows["rmse_mm"].append(float(1e3 * np.sqrt(np.mean(np.sum(fill.miss_m[at] ** 2, axis=1)))))
            rows["coverage95"].append(float(100 * inside.mean()))
        out[name] = rows
    return out


def for_recording(learned: LearnedModel, names: Sequence[str]) -> list[MarkerTrial]:
    """The trials with the markers of a recording, in its order; markers that the model does not know are never seen.

    Raises:
        MocapError: fewer than four markers in common.
    """
    common = [name for name in names if name in learned.names]
    if len(common) < 4:
        raise MocapError(
            f"the model knows {len(common)} of the recording's markers ({', '.join(names[:6])}, ...), and needs 4; it "
            f"was learned for {', '.join(learned.names[:6])}, ...: name them alike (aliases in the skeleton)"
        )
    index = np.array([learned.names.index(name) if name in learned.names else -1 for name in names])
    out = []
    for trial in learned.trials:
        xyz, sd = trial.xyz_m[:, index], trial.sd_m[:, index]
        xyz[:, index < 0], sd[:, index < 0] = np.nan, np.nan
        out.append(replace(trial, xyz_m=xyz, sd_m=sd))
    return out


def models_for(
    learned: LearnedModel, names: Sequence[str], recording: MarkerTrial, *, shapes: dict | None = None
) -> list[MotionModel]:
    """The model's K motion models for a recording: fitted to its trials and to what the recording shows.

    Args:
        learned: The model.
        names: Markers of the recording.
        recording: What is to be tracked.
        shapes: Receives the poses and shapes that models share.

    Raises:
        MocapError: another frame rate, or other markers.
    """
    trials = [*for_recording(learned, names), recording]
    check_rates(trials)
    trunk = [names.index(name) for name in learned.trunk if name in names] or list(range(len(names)))
    known: dict = {} if shapes is None else shapes
    models: list[MotionModel] = []
    for kind in learned.kinds:
        if kind is None:
            models.append(learn_constant_velocity(recording.xyz_m, dt_s=recording.dt_s))
            continue
        poses, about = _shared(known, kind, trials, trunk)
        models.append(learn_pose(poses, kind, shapes=about))
    return models


def _shared(
    known: dict, kind: PoseSettings, trials: Sequence[MarkerTrial], trunk: Sequence[int]
) -> tuple[list[PoseTrial], Shapes]:
    body = (kind.body_hz, kind.turns)
    if body not in known:
        known[body] = poses_of(trials, trunk, body_hz=kind.body_hz, turns=kind.turns)
    if (body, kind.ranks) not in known:
        known[body, kind.ranks] = shapes_of(known[body], ranks=kind.ranks)
    return known[body], known[body, kind.ranks]


def track_with(
    learned: LearnedModel,
    names: Sequence[str],
    recording: MarkerTrial,
    observations: Observations,
    *,
    progress: Progress | None = None,
) -> Smoothed:
    """Track a recording by all models of a learned one, and mix what they say.

    Args:
        learned: The model.
        names: Markers of the recording.
        recording: Its markers as triangulated.
        observations: What each frame shows.
        progress: Called with the share done.

    Returns:
        Markers of the mixture; what was seen and believed is that of the last model, the one held by V_z.
    """
    models = models_for(learned, names, recording)
    found = []
    for i, model in enumerate(models):
        tell = None if progress is None else (lambda share, i=i: progress((i + share) / len(models)))
        with threadpool_limits(1):
            found.append(smooth(model, observations, recording.t_s, progress=tell))
    length = gap_lengths(recording.seen)
    xyz, cov = learned.mixture.combine([f.xyz_m for f in found], [f.cov_m2 for f in found], length)
    return replace(found[-1], xyz_m=xyz, cov_m2=cov)


def save_model(learned: LearnedModel, path: Path) -> None:
    """Write a model as a numpy archive, whole or not at all.

    ``header`` is JSON: names, choices, scores, units, versions. For each trial i ``trial_i_t_s``, ``trial_i_xyz_m`` and
    ``trial_i_sd_m``; ``mixture_*``; and, to be looked at, ``pose_*``: what the last model is when it is fitted to all
    trials (mean pose, basis, shapes, stiffness and damping where its mechanics are linear).
    """
    header = {
        "format": FORMAT,
        "versions": {name: version(name) for name in ("eal-mocap", "numpy", "scipy")},
        "units": "m, s; shapes z in m; stiffness 1/s^2, damping 1/s",
        "names": learned.names,
        "trunk": learned.trunk,
        "trials": [trial.name for trial in learned.trials],
        "kinds": [None if kind is None else asdict(kind) for kind in learned.kinds],
        "models": [kind_name(kind) for kind in learned.kinds],
        "power": learned.mixture.power,
        "scores": learned.scores,
    }
    arrays: dict[str, Array] = {}
    for i, trial in enumerate(learned.trials):
        arrays |= {f"trial_{i}_t_s": trial.t_s, f"trial_{i}_xyz_m": trial.xyz_m, f"trial_{i}_sd_m": trial.sd_m}
    for name in ("offset", "slope", "length", "scale", "widen"):
        arrays[f"mixture_{name}"] = getattr(learned.mixture, name)
    temporary = path.with_name(f".{path.name}.part")
    try:
        with temporary.open("wb") as file:
            everything: dict[str, Any] = {"header": np.array(json.dumps(header)), **arrays, **_pictures(learned)}
            np.savez_compressed(file, **everything)
        temporary.replace(path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise MocapError(f"{path}: cannot be written: {error.strerror}; give another --out") from None


def _pictures(learned: LearnedModel) -> dict[str, Array]:
    """What the last model learned from the trials alone."""
    kind = learned.kinds[-1]
    if kind is None:
        return {}
    trunk = [learned.names.index(name) for name in learned.trunk] or list(range(len(learned.names)))
    poses, shapes = _shared({}, kind, learned.trials, trunk)
    model: PoseMotion = learn_pose(poses, kind, shapes=shapes)
    out = {
        "pose_mean_m": shapes.subspace.mean.reshape(-1, 3),
        "pose_basis": shapes.subspace.basis.reshape(-1, 3, model.rank),
        "pose_residual_sd_m": shapes.subspace.residual_sd.reshape(-1, 3),
        "pose_shapes_m": np.concatenate(shapes.z),
        "pose_acceleration_density": model.mechanics.density @ model.mechanics.density.T,
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
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            header = json.loads(str(file["header"]))
            if header.get("format") != FORMAT:
                raise FormatError(f"{path}: expected '{FORMAT}', but it says '{header.get('format')}': learn it again")
            trials = tuple(
                MarkerTrial(name=name, **{key: file[f"trial_{i}_{key}"] for key in ("t_s", "xyz_m", "sd_m")})
                for i, name in enumerate(header["trials"])
            )
            parts = {name: file[f"mixture_{name}"] for name in ("offset", "slope", "length", "scale", "widen")}
            kinds = tuple(
                None if kind is None else PoseSettings(**{**kind, "ranks": tuple(kind["ranks"])})
                for kind in header["kinds"]
            )
            for trial in trials:
                shape = (len(trial.t_s), len(header["names"]))
                if trial.xyz_m.shape != (*shape, 3) or trial.sd_m.shape != shape:
                    raise ValueError(f"trial {trial.name} has positions of shape {trial.xyz_m.shape}")
            if not trials or len(kinds) != len(parts["offset"]):
                raise ValueError(f"{len(trials)} trials, {len(kinds)} motion models, {len(parts['offset'])} weights")
            return LearnedModel(
                names=tuple(header["names"]),
                trunk=tuple(header["trunk"]),
                trials=trials,
                kinds=kinds,
                mixture=Mixture(power=header["power"], **parts),
                scores=header["scores"],
            )
    except FormatError:
        raise
    except _DAMAGE as error:
        raise FormatError(f"{path}: not a model that mocap learn wrote ({error}): give its --out") from None
