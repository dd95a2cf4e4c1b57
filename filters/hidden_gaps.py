"""Gaps hidden in training trials: how models are mixed, and how wide intervals must be, is learned from them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import count

import numpy as np
from mocap.filters.anatomy import Anatomy
from mocap.filters.hide import Hidden, excerpt, hide_neighbours, hide_own, lengths_for
from mocap.filters.interpolate import interpolated
from mocap.filters.models.articulated import ArticulatedSettings
from mocap.filters.models.base import TrajectoryModel, TrialSet, estimate
from mocap.filters.models.constant_velocity import LastingSettings, MarkerSettings
from mocap.filters.models.pose import PoseSettings
from mocap.filters.observations import PositionObservations
from mocap.filters.poses import MarkerTrial
from mocap.filters.score import Residuals, Score, joined, residuals_of, score

from eal.arrays import varying
from eal.efforts import Call, CallAll, Progress, efforts_of, in_turn, shares, with_effort

STEADY_MARKER, EACH_MARKER = MarkerSettings(acceleration=0.01), LastingSettings()
JOINTS, POSE = ArticulatedSettings(), PoseSettings(ranks=(8,))
MODELS: tuple[TrajectoryModel, ...] = (STEADY_MARKER, EACH_MARKER, POSE)
"""What a learned tracker is made of: each marker by itself, at a velocity that hardly changes and with an acceleration
that lasts, and the EAL model. Their settings are the same for all recordings (docs/experiments/steady_velocity.md and
regression_in_the_filter.md)."""
WITH_JOINTS: tuple[TrajectoryModel, ...] = (EACH_MARKER, JOINTS, POSE)
"""With joint angles in place of the steady velocity, for animals whose skeleton states rigid bones: nearer on most;
tracking takes 1.5 to 2.3 times as long (docs/experiments/joint_angles.md)."""


@dataclass(frozen=True, kw_only=True)
class Effort:
    """How much is hidden.

    Attributes:
        validated: Number of trials to hide gaps in at a time.
        most_frames: Of such a trial, the stretch of so many frames of which most is seen.
        gaps: Of each length, at least, as far as trials have room for them.
        times: Gaps are hidden so often, at most.
    """

    validated: int = 2
    most_frames: int = 500
    gaps: int = 10
    times: int = 2


USUAL_EFFORT = Effort()


@dataclass(eq=False, kw_only=True)
class HiddenGaps:
    """Gaps hidden in trials, to see how models fill them.

    Attributes:
        trials: Training trials.
        anatomy: What is known of the animal.
        hidden: Those in which gaps are hidden, by index.
        tell: Called with a line for each of them.
    """

    trials: Sequence[MarkerTrial]
    anatomy: Anatomy
    hidden: Sequence[tuple[int, Hidden[MarkerTrial]]]
    tell: Callable[[str], None] = lambda _line: None

    def fill(
        self, models: Sequence[TrajectoryModel], call_all: CallAll = in_turn, progress: Progress | None = None
    ) -> tuple[Residuals, ...]:
        """Fill all of them by each model, learned without them; ``progress`` is called with the share done."""
        return self.together(call_all(self.calls(models), progress), models)

    def calls(self, models: Sequence[TrajectoryModel]) -> list[Call]:
        """One for each trial that fills it by each model; what is shared by models is kept for it."""
        out: list[Call] = []
        for index, gaps in self.hidden:
            others = [trial for i, trial in enumerate(self.trials) if i != index]
            effort = sum(_seconds(models, others, gaps))
            out.append(with_effort(partial(_filled, models, others, self.anatomy, gaps), effort))
        return out

    def seconds(self, models: Sequence[TrajectoryModel]) -> float:
        """About the time in which models fill all of them, beside that of what else is done."""
        return sum(efforts_of(self.calls(models)))

    def together(self, found: Sequence[list[Residuals]], models: Sequence[TrajectoryModel]) -> tuple[Residuals, ...]:
        """What each model missed all of them by, from what the calls returned."""
        for number, ((_, gaps), parts) in enumerate(zip(self.hidden, found, strict=True)):
            errors = ", ".join(
                f"{1e3 * np.exp(part.log_rmse):.2g} mm by {model.description}"
                for model, part in zip(models, parts, strict=True)
            )
            self.tell(f"gaps hidden in {gaps.trial.name} ({number + 1} of {len(self.hidden)}): {errors}")
        return tuple(joined(list(parts)) for parts in zip(*found, strict=True))

    def alone(self) -> "HiddenGaps":
        """The same, to be filled by models that learn of no other trial."""
        return replace(self, trials=())

    def curves(self) -> dict[str, Score]:
        """How curves through each marker by itself fill them, by the name of the curve."""
        out = {}
        for kind in ("linear", "cubic"):
            errors = []
            for _, gaps in self.hidden:
                axes, path = varying(gaps.trial.xyz_m), interpolated(gaps.shown.xyz_m, gaps.trial.t_s, kind=kind)
                errors.append((path - gaps.trial.xyz_m)[gaps.mask][:, axes])
            every = np.concatenate(errors)
            out[kind] = score(every[np.isfinite(every[:, 0])], None)
        return out


def _filled(
    models: Sequence[TrajectoryModel],
    others: Sequence[MarkerTrial],
    anatomy: Anatomy,
    gaps: Hidden[MarkerTrial],
    *,
    progress: Progress | None = None,
) -> list[Residuals]:
    """What each model, learned from other trials and what is left of this one, misses its hidden samples by."""
    shown, out = gaps.shown, []
    trials = TrialSet([*others, shown], anatomy)
    seen = PositionObservations(xyz_m=shown.xyz_m, sd_m=shown.sd_m)
    shows = trials.rigid.filled[gaps.mask]  # these are not filled by models that are mixed
    for model, tell in zip(models, shares(progress, _seconds(models, others, gaps)), strict=True):
        filled = estimate(model, trials, seen, progress=tell)
        found = residuals_of(gaps, filled.xyz_m, filled.cov_m2)
        out.append(found if shows.all() else found.some(~shows))
    return out


def _seconds(
    models: Sequence[TrajectoryModel], others: Sequence[MarkerTrial], gaps: Hidden[MarkerTrial]
) -> list[float]:
    """About the time in which each model learns from other trials and this one, and fills this one."""
    (frames, markers), more = gaps.trial.xyz_m.shape[:2], sum(len(trial.t_s) for trial in others)
    return [model.fit_s(markers, frames + more) + model.fill_s(markers, frames) for model in models]


def hidden_gaps(
    trials: Sequence[MarkerTrial],
    anatomy: Anatomy,
    rng: np.random.Generator,
    *,
    effort: Effort = USUAL_EFFORT,
    tell: Callable[[str], None] = lambda _line: None,
) -> HiddenGaps:
    """Hide gaps in trials that take turns, as lengths do; those of which most is seen come first.

    Args:
        trials: Training trials of the same markers.
        anatomy: What is known of the animal.
        rng: What to hide.
        effort: How much is hidden.
        tell: Called with a line for each trial that is filled.
    """
    cut = [best_of(trial, effort.most_frames) for trial in trials]
    order = np.argsort([-trial.seen.sum() for trial in cut], kind="stable")
    lengths = {n for trial in cut for n in lengths_for(len(trial.t_s))}
    turns, found = count(), []
    for _ in range(effort.times):
        found += [(int(i), hide_neighbours(cut[i], rng, turn=next(turns))) for i in order[: effort.validated]]
        order = np.roll(order, -effort.validated)
        if all(sum(hidden.count(n) for _, hidden in found) >= effort.gaps for n in lengths):
            break
    hidden = [(i, gaps) for i, gaps in found if gaps.gaps]
    return HiddenGaps(trials=trials, anatomy=anatomy, hidden=hidden, tell=tell)


def best_of(trial: MarkerTrial, most: int) -> MarkerTrial:
    """The stretch of so many frames of which most is seen; all of a shorter one."""
    return _part(trial, excerpt(trial.seen, most))


def within(hidden: Hidden[MarkerTrial], most: int) -> Hidden[MarkerTrial]:
    """The stretch of so many frames of which most is hidden, with the gaps that lie in it."""
    inside = excerpt(hidden.mask, most)
    gaps = [replace(gap, start=gap.start - inside.start) for gap in hidden.gaps]
    kept = [gap for gap in gaps if gap.start >= 0 and gap.frames.stop <= inside.stop - inside.start]
    return Hidden(trial=_part(hidden.trial, inside), gaps=tuple(kept))


def _part(trial: MarkerTrial, inside: slice) -> MarkerTrial:
    return replace(trial, t_s=trial.t_s[inside], xyz_m=trial.xyz_m[inside], sd_m=trial.sd_m[inside])


def gaps_like_own(trials: TrialSet, *, times: int, seed: int = 0) -> HiddenGaps:
    """Gaps like the recording's own, hidden in it (``hide_own``); where it has none, any (``hide_neighbours``).

    Args:
        trials: Trials; the last is the recording.
        times: So many draws, of each the stretch of 300 frames of which most is hidden.
        seed: Where to.
    """
    trial, rng, most, found = trials.trials[-1], np.random.default_rng(seed), 300, []
    for turn in range(times):
        hidden = within(hide_own(trial, rng), most)
        found.append(hidden if hidden.gaps else hide_neighbours(best_of(trial, most), rng, turn=turn))
    return _of_the_last(trials, *found)


def own_gaps(trials: TrialSet) -> HiddenGaps:
    """Gaps hidden in the recording that is to be filled, to see whether a mixture's intervals hold in it.

    They lie in the 500 frames of which most is seen.

    Args:
        trials: Trials; the last is the recording.
    """
    return _of_the_last(trials, hide_neighbours(best_of(trials.trials[-1], 500), np.random.default_rng(0)))


def _of_the_last(trials: TrialSet, *hidden: Hidden[MarkerTrial]) -> HiddenGaps:
    last = len(trials.trials) - 1
    return HiddenGaps(trials=trials.trials, anatomy=trials.anatomy, hidden=[(last, one) for one in hidden if one.gaps])
