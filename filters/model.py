"""A model learned from trials: what it learned from, what was chosen, how it did on hidden gaps."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain, islice

import numpy as np
from mocap.filters.anatomy import Anatomy, anatomy_of
from mocap.filters.errors import FilterError
from mocap.filters.hidden_gaps import (
    EACH_MARKER,
    MODELS,
    USUAL_EFFORT,
    Effort,
    HiddenGaps,
    gaps_like_own,
    hidden_gaps,
    own_gaps,
)
from mocap.filters.hide import gap_lengths, nearest_length
from mocap.filters.mixture import Mixture, crossed, learn_mixture, mixed_residuals
from mocap.filters.models.base import TrajectoryModel, TrialSet, estimate, seconds_of
from mocap.filters.models.pose import PoseSettings
from mocap.filters.observations import Observations
from mocap.filters.poses import MarkerTrial
from mocap.filters.records import Estimate
from mocap.filters.score import Residuals, Score
from mocap.filters.velocities import RatePoints
from numpy.typing import NDArray

from eal.efforts import Call, CallAll, Progress, in_turn, shares, with_effort


@dataclass(frozen=True, eq=False, kw_only=True)
class LearnedModel:
    """A tracker that has learned from trials.

    The trials themselves are part of it: tracking another recording fits the subspace, the mechanics and the potential
    to them together with what that recording shows, with the choices that were made on hidden gaps.

    Attributes:
        names: The M markers.
        trunk: Those of the body.
        bones: Markers of the skeleton's rigid bones.
        bodies: Markers of the skeleton's rigid bodies.
        trials: What it learned from; none where a recording is to teach itself.
        models: The K models that are mixed; the last is a filter, whose record of what was observed is kept.
        mixture: How they are mixed.
        scores: For each of them and the mixture, by length of gap: root mean square error in mm, the share of
            coordinates inside 95 % intervals and ``Score.z``, in gaps that were hidden while learning.
    """

    names: tuple[str, ...]
    trunk: tuple[str, ...]
    bones: tuple[tuple[str, str], ...]
    trials: tuple[MarkerTrial, ...]
    models: tuple[TrajectoryModel, ...]
    mixture: Mixture
    scores: dict[str, dict[str, list[float]]]
    bodies: tuple[tuple[str, ...], ...] = ()

    @property
    def dt_s(self) -> float:
        """Time step."""
        return self.trials[0].dt_s

    def anatomy(self, names: Sequence[str]) -> Anatomy:
        """What is known of an animal with such markers."""
        return anatomy_of(names, self.trunk, self.bones, bodies=self.bodies)


def learn_model(
    names: Sequence[str],
    trunk: Sequence[str],
    trials: Sequence[MarkerTrial],
    rng: np.random.Generator,
    *,
    bones: Sequence[tuple[str, str]] = (),
    bodies: Sequence[Sequence[str]] = (),
    models: Sequence[TrajectoryModel] = MODELS,
    effort: Effort = USUAL_EFFORT,
    tell: Callable[[str], None] = lambda _line: None,
    progress: Progress | None = None,
    call_all: CallAll = in_turn,
) -> LearnedModel:
    """Learn from trials; how motion models are mixed is learned on gaps hidden in these.

    Args:
        names: The M markers of all trials.
        trunk: Those of the body; empty: all.
        trials: What to learn from.
        rng: What to hide.
        bones: Markers of the skeleton's rigid bones.
        bodies: Markers of the skeleton's rigid bodies.
        models: Motion models; the last is a filter.
        effort: How much is hidden.
        tell: Called with a line for each trial that is filled.
        progress: Called with the share done.
        call_all: Makes the calls that do not wait for each other.

    Raises:
        FilterError: the trials differ in rate, or show too little to hide gaps in.
    """
    check_rates(trials)
    every = TrialSet(trials, anatomy_of(names, trunk, bones, bodies=bodies))
    gaps = hidden_gaps(trials, every.anatomy, rng, effort=effort, tell=tell)
    if not gaps.hidden:
        raise FilterError(
            "no gap could be hidden in these trials: that needs a marker that is seen in three frames before and after "
            "ten others; give longer or more complete trials"
        )
    tell("settings are learned from all recordings")
    frames = sum(len(trial.t_s) for trial in trials)
    *first, then = shares(progress, [*(m.tuned_s(len(names), frames) for m in models), gaps.seconds(models)])
    tuned = [_tuned(model, every, told) for model, told in zip(models, first, strict=True)]
    residuals = gaps.fill(tuned, call_all, then)
    mixture = learn_mixture(residuals)
    return LearnedModel(
        names=tuple(names),
        trunk=tuple(trunk),
        bones=tuple(bones),
        bodies=tuple(map(tuple, bodies)),
        trials=tuple(trials),
        models=tuple(tuned),
        mixture=mixture,
        scores=scores_of(tuned, residuals, crossed(residuals) or mixed_residuals(mixture, residuals)),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Members:
    """What each of the models that are to be mixed says of a recording.

    Attributes:
        found: The K estimates; the last is of the pose model.
        recording: Its markers as triangulated, and where its rigid bodies have them.
        placed: (T, M) where these have them.
    """

    found: tuple[Estimate, ...]
    recording: MarkerTrial
    placed: NDArray[np.bool_]

    def mixed(self, mixture: Mixture) -> "MixedTrack":
        """What was not seen by the mixture; all else by the pose model.

        What the pose model refused is its own, and as uncertain as what was not seen: others may have believed it. A
        marker that its rigid body has is its own as well, as certain as it says: all models have the same of it, and
        hidden gaps say how they err where nothing does.
        """
        last, seen = self.found[-1], self.recording.seen
        used = (seen & last.believed | self.placed)[..., None]
        xyz, cov = mixture.combine(
            [*(np.where(seen[..., None] & ~used, np.nan, f.xyz_m) for f in self.found[:-1]), last.xyz_m],
            [f.cov_m2 for f in self.found],
            gap_lengths(used[..., 0]),
        )
        markers = replace(
            last, xyz_m=np.where(used, last.xyz_m, xyz), cov_m2=np.where(used[..., None], last.cov_m2, cov)
        )
        return MixedTrack(markers=markers, eal=last, mixture=mixture)


@dataclass(frozen=True, eq=False, kw_only=True)
class MixedTrack:
    """A recording tracked by several models.

    Attributes:
        markers: Those that were not seen are of the mixture; all else is of the pose model, widened where refused.
        eal: What the pose model alone says.
        mixture: How they were mixed.
        scores: How well gaps that were hidden in the recording were filled, by the name of the method.
    """

    markers: Estimate
    eal: Estimate
    mixture: Mixture
    scores: Mapping[str, Score] = field(default_factory=dict)


def track_alone(
    names: Sequence[str],
    trunk: Sequence[str],
    recording: MarkerTrial,
    observations: Observations,
    settings: PoseSettings,
    *,
    bones: Sequence[tuple[str, str]] = (),
    bodies: Sequence[Sequence[str]] = (),
    rate_points: RatePoints | None = None,
    compared: Mapping[str, TrajectoryModel] | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    call_all: CallAll = in_turn,
) -> MixedTrack | None:
    """Track a recording by models that are learned from it; how they are mixed, on gaps hidden in it.

    The same gaps tell how well gaps are filled: each fifth of them by what the others teach (``crossed``).

    Args:
        names: The M markers.
        trunk: Those of the body.
        recording: Its markers as triangulated.
        observations: What each frame shows.
        settings: Of the EAL model.
        bones: Markers of the skeleton's rigid bones.
        bodies: Markers of the skeleton's rigid bodies.
        rate_points: Points whose velocities and joint covariances the pose model keeps; None: of none.
        compared: Models that fill the hidden gaps, too, by name; None: nothing is scored.
        seed: Where gaps are hidden.
        progress: Called with the share done.
        call_all: Makes the calls that do not wait for each other.

    Returns:
        None: no gap could be hidden.
    """
    trials = TrialSet([recording], anatomy_of(names, trunk, bones, bodies=bodies))
    gaps = gaps_like_own(trials, times=2, seed=seed)
    if not gaps.hidden:
        return None
    own, more = (EACH_MARKER, settings), [*(compared or {}).values()]
    whole_s = sum(sum(seconds_of(model, trials, observations, learned=True)) for model in own)
    tuned_s = settings.tuned_s(len(names), len(recording.t_s))
    first, then = shares(progress, [tuned_s, whole_s + gaps.seconds([*own, *more])])
    models = [EACH_MARKER, _tuned(settings, trials, first)]
    every, (found,) = _estimates(models, trials, observations, [(gaps, [*models, *more])], rate_points, then, call_all)
    residuals = [replace(part, length=nearest_length(part.length)) for part in found]
    track = every.mixed(learn_mixture(residuals[: len(models)]))
    if compared is None:
        return track
    scored = dict(zip(("eal", *compared), residuals[len(models) - 1 :], strict=True))
    left_out = crossed(residuals[: len(models)])
    scored |= {} if left_out is None else {"mixture": left_out}
    return replace(track, scores=gaps.curves() | {name: part.score() for name, part in scored.items()})


def _tuned(model: TrajectoryModel, trials: TrialSet, progress: Progress | None) -> TrajectoryModel:
    """The model with settings that are learned from the trials."""
    found = model.tuned(trials)
    if progress is not None:
        progress(1.0)
    return found


def check_rates(trials: Sequence[MarkerTrial]) -> None:
    """Refuse trials of different frame rates.

    Raises:
        FilterError: they differ by more than 1 %.
    """
    some = [trial for trial in trials if len(trial.t_s) > 1]
    rates = [1 / trial.dt_s for trial in some]
    if rates and max(rates) > 1.01 * min(rates):
        listed = ", ".join(f"{trial.name} {rate:.6g}" for trial, rate in zip(some, rates, strict=True))
        raise FilterError(f"trials of one model must share a frame rate, but have frames a second: {listed}")


def scores_of(
    models: Sequence[TrajectoryModel], residuals: Sequence[Residuals], mixed: Residuals
) -> dict[str, dict[str, list[float]]]:
    """Errors and coverage of each model and of the mixture on what was hidden, by length of gap."""
    named = [(model.description, part) for model, part in zip(models, residuals, strict=True)]
    out = {}
    for name, part in [*named, ("mixture", mixed)]:
        rows: dict[str, list[float]] = {"gap_frames": [], "rmse_mm": [], "coverage95": [], "z": []}
        for n in np.unique(part.length):
            value = part.some(part.length == n).score()
            rows["gap_frames"].append(int(n))
            rows["rmse_mm"].append(value.rmse_mm)
            rows["coverage95"].append(100 * value.coverage95)
            rows["z"].append(value.z)
        out[name] = rows
    return out


def same_recording(a: MarkerTrial, b: MarkerTrial) -> bool:
    """Whether at least half of the samples of the one that has fewer are in the other, to a micrometre."""
    sets = [{tuple(row) for row in np.rint(1e6 * trial.xyz_m[trial.seen]).astype(int).tolist()} for trial in (a, b)]
    return len(sets[0] & sets[1]) > 0.5 * min(map(len, sets))


def renamed(learned: LearnedModel, names: Sequence[str]) -> LearnedModel:
    """The model with other names of its markers, as a skeleton has aliases for those of files.

    A model of files that number their points (``pt1``) then tracks what a skeleton names. A marker keeps its name where
    the model knows another by the new one.

    Args:
        learned: The model.
        names: New names of its M markers.
    """
    old_name = {
        old: new for old, new in zip(learned.names, names, strict=True)
        if new not in learned.names
    }  # fmt: skip
    if len(set(old_name.values())) < len(old_name):  # two numbers that the aliases make one marker: of different files
        old_name = {}

    def name(old: str) -> str:
        return old_name.get(old, old)

    return replace(
        learned,
        names=tuple(map(name, learned.names)),
        trunk=tuple(map(name, learned.trunk)),
        bones=tuple((name(a), name(b)) for a, b in learned.bones),
        bodies=tuple(tuple(map(name, body)) for body in learned.bodies),
    )


def for_recording(learned: LearnedModel, names: Sequence[str], recording: MarkerTrial) -> list[MarkerTrial]:
    """The trials with the markers of a recording, in its order; markers that the model does not know are never seen.

    A trial that is the recording itself is left out: it would show what was hidden to see how well gaps are filled.

    Raises:
        FilterError: fewer than four markers in common.
    """
    common = [name for name in names if name in learned.names]
    if len(common) < 4:
        raise FilterError(
            f"the model knows {len(common)} of the recording's markers ({', '.join(names[:6])}, ...), and needs 4; it "
            f"was learned for {', '.join(learned.names[:6])}, ...: name them alike (aliases in the skeleton)"
        )
    index = np.array([learned.names.index(name) if name in learned.names else -1 for name in names])
    out = []
    for trial in learned.trials:
        xyz, sd = trial.xyz_m[:, index], trial.sd_m[:, index]
        xyz[:, index < 0], sd[:, index < 0] = np.nan, np.nan
        out.append(replace(trial, xyz_m=xyz, sd_m=sd))
    return [trial for trial in out if not same_recording(trial, recording)]


def trials_for(learned: LearnedModel, names: Sequence[str], recording: MarkerTrial) -> TrialSet:
    """The model's trials and a recording that is to be tracked, to fit its models to.

    Args:
        learned: The model.
        names: Markers of the recording.
        recording: What is to be tracked.

    Raises:
        FilterError: another frame rate, or other markers.
    """
    check_rates([*learned.trials, recording])
    return TrialSet([*for_recording(learned, names, recording), recording], learned.anatomy(names))


def own_trials(learned: LearnedModel) -> TrialSet:
    """The model's trials alone, to look at what its models learn from them."""
    return TrialSet(learned.trials, learned.anatomy(learned.names))


def track_with(
    learned: LearnedModel,
    names: Sequence[str],
    recording: MarkerTrial,
    observations: Observations,
    *,
    rate_points: RatePoints | None = None,
    compared: Mapping[str, TrajectoryModel] | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    call_all: CallAll = in_turn,
) -> MixedTrack:
    """Track a recording by all models of a learned one, and mix what they say.

    The mixture's intervals are those that gaps hidden in trials and in the recording itself show. The last
    model stands in for one that this recording cannot be modelled by, as where it has no marker of a limb.

    Args:
        learned: The model.
        names: Markers of the recording.
        recording: Its markers as triangulated.
        observations: What each frame shows.
        rate_points: Points whose velocities and joint covariances the pose model keeps; None: of none.
        compared: Models that are learned from the recording alone, to fill gaps that are hidden to compare them with
            this one, by name; None: nothing is scored.
        seed: Where those gaps are hidden.
        progress: Called with the share done.
        call_all: Makes the calls that do not wait for each other.
    """
    trials = trials_for(learned, names, recording)
    models, gaps = models_of(learned, trials), own_gaps(trials)
    hidden: list[tuple[HiddenGaps, Sequence[TrajectoryModel]]] = [(gaps, models)]
    if compared is not None:
        like = gaps_like_own(trials, times=1, seed=seed)
        hidden += [(like, models), (like.alone(), [*compared.values()])]
    every, (own, *found) = _estimates(models, trials, observations, hidden, rate_points, progress, call_all)
    track = every.mixed(learned.mixture.calibrated(own) if gaps.hidden else learned.mixture)
    if compared is None or not found[0]:
        return track
    scored = dict(zip(compared, found[1], strict=True)) | {"learned": mixed_residuals(track.mixture, found[0])}
    return replace(track, scores=like.curves() | {name: part.score() for name, part in scored.items()})


def filled_alone(
    trials: TrialSet,
    models: Mapping[str, TrajectoryModel],
    *,
    seed: int = 0,
    progress: Progress | None = None,
    call_all: CallAll = in_turn,
) -> dict[str, Score]:
    """How well models that learn from a recording alone fill gaps that are hidden in it, beside curves; by name.

    Args:
        trials: The recording.
        models: The models, by name.
        seed: Where gaps are hidden.
        progress: Called with the share done.
        call_all: Makes the calls that do not wait for each other.
    """
    gaps = gaps_like_own(trials, times=1, seed=seed)
    if not gaps.hidden:
        return {}
    found = gaps.together(call_all(gaps.calls([*models.values()]), progress), [*models.values()])
    return gaps.curves() | {name: part.score() for name, part in zip(models, found, strict=True)}


def models_of(learned: LearnedModel, trials: TrialSet) -> list[TrajectoryModel]:
    """What ``track_with`` mixes in a recording, the last of the trials."""
    return [m if m.applies(trials.anatomy) else learned.models[-1] for m in learned.models]


def _estimates(
    models: Sequence[TrajectoryModel],
    trials: TrialSet,
    observations: Observations,
    hidden: Sequence[tuple[HiddenGaps, Sequence[TrajectoryModel]]],
    rate_points: RatePoints | None,
    progress: Progress | None,
    call_all: CallAll,
) -> tuple[Members, list[tuple[Residuals, ...]]]:
    """What all models say of the last trial, and what models miss hidden samples by."""
    wanted = [None] * (len(models) - 1) + [rate_points]
    whole: list[Call] = [
        with_effort(
            partial(estimate, model, trials, observations, rate_points=points),
            sum(seconds_of(model, trials, observations, learned=bool(trials.learned))),
        )
        for model, points in zip(models, wanted, strict=True)
    ]
    parts = [gaps.calls(fill) for gaps, fill in hidden]
    found = iter(call_all([*whole[::-1], *chain(*parts)], progress))
    every = Members(
        found=tuple(islice(found, len(whole)))[::-1], recording=trials.trials[-1], placed=trials.rigid.filled
    )
    missed = [
        gaps.together(list(islice(found, len(part))), fill) for (gaps, fill), part in zip(hidden, parts, strict=True)
    ]
    return every, missed
