"""Gaps hidden in training trials: how models are mixed, and how wide intervals must be, is learned from them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import count

import numpy as np

from filters.anatomy import Anatomy
from filters.hide import Hidden, excerpt, hide_neighbours, lengths_for
from filters.mixture import Mixture, learn_mixture
from filters.models.base import TrajectoryModel, TrialSet, estimate
from filters.models.constant_velocity import MarkerSettings
from filters.models.pose import PoseSettings
from filters.observations import PositionObservations
from filters.poses import MarkerTrial
from filters.score import Residuals, joined, residuals_of

SHARP_MARKER = MarkerSettings(acceleration=0.3)
"""Constant velocity in a mixture: nearer with less noise than recordings show; its width is learned afterwards."""
MODELS: tuple[TrajectoryModel, ...] = (SHARP_MARKER, PoseSettings(ranks=(8,)))
"""What a learned tracker is made of: constant velocity of each marker, and the EAL model, whose settings are the same
for all recordings (docs/explanation/decisions.md, "Fixed settings")."""


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
    times: int = 4


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

    def fill(self, models: Sequence[TrajectoryModel]) -> tuple[Residuals, ...]:
        """Fill all of them by each model, learned without them; what is shared by models is kept for one trial."""
        parts: list[list[Residuals]] = [[] for _ in models]
        for number, (index, gaps) in enumerate(self.hidden):
            others = [trial for i, trial in enumerate(self.trials) if i != index]
            shown = gaps.shown
            trials = TrialSet([*others, shown], self.anatomy)
            for model, found in zip(models, parts, strict=True):
                filled = estimate(model, trials, PositionObservations(xyz_m=shown.xyz_m, sd_m=shown.sd_m))
                found.append(residuals_of(gaps, filled.xyz_m, filled.cov_m2))
                error = 1e3 * np.exp(found[-1].log_rmse)
                self.tell(
                    f"{model.description}: gaps hidden in {gaps.trial.name} ({number + 1} of {len(self.hidden)}) are "
                    f"filled to {error:.2f} mm"
                )
        return tuple(joined(found) for found in parts)


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
    cut = [_excerpt(trial, effort.most_frames) for trial in trials]
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


def _excerpt(trial: MarkerTrial, most: int) -> MarkerTrial:
    inside = excerpt(trial.seen, most)
    return replace(trial, t_s=trial.t_s[inside], xyz_m=trial.xyz_m[inside], sd_m=trial.sd_m[inside])


def calibrated(mixture: Mixture, models: Sequence[TrajectoryModel], trials: TrialSet, *, most: int = 500) -> Mixture:
    """A mixture of models with intervals that hold in gaps hidden in the recording that is to be filled.

    Args:
        mixture: The mixture.
        models: Its models.
        trials: Trials; the last is the recording.
        most: Gaps are hidden in the stretch of so many of its frames of which most is seen.
    """
    own = hide_neighbours(_excerpt(trials.trials[-1], most), np.random.default_rng(0))
    if not own.gaps:
        return mixture
    last = len(trials.trials) - 1
    gaps = HiddenGaps(trials=trials.trials, anatomy=trials.anatomy, hidden=[(last, own)])
    return mixture.calibrated(gaps.fill(models))


@dataclass(frozen=True, eq=False, kw_only=True)
class Mixed:
    """Models and how they are mixed.

    Attributes:
        models: The K models.
        mixture: Their weights.
        residuals: What each missed the hidden samples by.
    """

    models: tuple[TrajectoryModel, ...]
    mixture: Mixture
    residuals: tuple[Residuals, ...]


def mixed(gaps: HiddenGaps, models: Sequence[TrajectoryModel]) -> Mixed:
    """How models are mixed, by how they fill hidden gaps."""
    residuals = gaps.fill(models)
    return Mixed(models=tuple(models), mixture=learn_mixture(residuals), residuals=residuals)
