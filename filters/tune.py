"""Choosing pose models on hidden gaps of their own training trials, and how to mix them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from typing import TypeVar

import numpy as np

from filters.hide import Hidden, excerpt, hide_neighbours, lengths_for
from filters.mixture import Mixture, learn_mixture
from filters.models.average import Average, averaged_residuals
from filters.models.base import TrajectoryModel, TrialSet, estimate
from filters.models.constant_velocity import MarkerSettings
from filters.models.delayed_poses import DelaySettings
from filters.models.pose import PoseSettings, Potential
from filters.observations import PositionObservations
from filters.poses import MarkerTrial
from filters.score import Residuals, joined, residuals_of

Settings = TypeVar("Settings", bound=TrajectoryModel)


@dataclass(eq=False, kw_only=True)
class Search:
    """Candidates tried on hidden gaps.

    Attributes:
        trials: Training trials.
        trunk: Indices of the trunk's markers.
        hidden: Those of them that are validated on, by index, with what is hidden.
        again: More of that, for the mixture alone.
        named: Indices of the markers of the skeleton's rigid bones.
        tell: Called with a line for each candidate.
        at_most: Candidates that will be tried, at most, for those lines; 0: nobody knows.
        tried: Every candidate with how it filled all gaps.
    """

    trials: Sequence[MarkerTrial]
    trunk: Sequence[int]
    hidden: Sequence[tuple[int, Hidden[MarkerTrial]]]
    again: Sequence[tuple[int, Hidden[MarkerTrial]]] = ()
    named: Sequence[tuple[int, int]] = ()
    tell: Callable[[str], None] = lambda _line: None
    at_most: int = 0
    tried: list[tuple[TrajectoryModel, Residuals]] = field(default_factory=list)
    _trial_sets: dict[Hidden[MarkerTrial], TrialSet] = field(default_factory=dict)

    def fill(self, model: TrajectoryModel) -> Residuals:
        """Fill all hidden gaps with one candidate, learned without them."""
        if model.components:
            return averaged_residuals([self.fill(one) for one in model.components])
        for before, residuals in self.tried:
            if before == model:
                return residuals
        residuals = self._fill(model, self.hidden)
        self.tried.append((model, residuals))
        of = f" of at most {self.at_most}" if self.at_most else ""
        error = f"error {1e3 * np.exp(residuals.log_rmse):.2f} mm in hidden gaps, cost {residuals.cost:.3f}"
        self.tell(f"candidate {len(self.tried)}{of}: {model.details}: {error}")
        return residuals

    def both(self, model: TrajectoryModel) -> Residuals:
        """The same with the gaps that were hidden again."""
        if model.components:
            return averaged_residuals([self.both(one) for one in model.components])
        first = self.fill(model)
        if not self.again:
            return first
        self.tell(f"more hidden gaps, to weight models and set intervals: {model.details}")
        return joined([first, self._fill(model, self.again)])

    def _fill(self, model: TrajectoryModel, hidden: Sequence[tuple[int, Hidden[MarkerTrial]]]) -> Residuals:
        """Of hidden samples."""
        parts = []
        for index, gaps in hidden:
            if gaps not in self._trial_sets:
                others = [trial for i, trial in enumerate(self.trials) if i != index]
                self._trial_sets[gaps] = TrialSet([*others, gaps.shown], self.trunk, self.named)
            trials, shown = self._trial_sets[gaps], gaps.shown
            found = estimate(model, trials, PositionObservations(xyz_m=shown.xyz_m, sd_m=shown.sd_m))
            parts.append(residuals_of(gaps, found.xyz_m, found.cov_m2))
        return joined(parts)

    def improve(self, start: Settings, choices: Sequence[dict], *, least: float = 0.01) -> Settings:
        """The start with those changes, tried one after the other, that lower the cost by ``least`` or more."""
        best = start
        for change in choices:
            candidate = replace(best, **change)
            if self.fill(candidate).cost < self.fill(best).cost - least:
                best = candidate
        return best


@dataclass(frozen=True, kw_only=True)
class Effort:
    """How much is hidden in a search.

    Attributes:
        validated: Number of trials to hide gaps in at a time.
        most_frames: Of such a trial, the stretch of so many frames of which most is seen.
        times: Gaps are hidden so often, at most, until each length is there twice; and again, until eight times.
    """

    validated: int = 2
    most_frames: int = 500
    times: int = 3


USUAL_EFFORT = Effort()


def search_on(
    trials: Sequence[MarkerTrial],
    trunk: Sequence[int],
    rng: np.random.Generator,
    *,
    named: Sequence[tuple[int, int]] = (),
    effort: Effort = USUAL_EFFORT,
    tell: Callable[[str], None] = lambda _line: None,
) -> Search:
    """A search that validates on trials, those of which most is seen first.

    Args:
        trials: Training trials of the same markers.
        trunk: Indices of the trunk's markers.
        rng: What to hide.
        named: Indices of the markers of the skeleton's rigid bones.
        effort: How much is hidden.
        tell: Called with a line for each candidate.
    """
    cut = [_excerpt(trial, effort.most_frames) for trial in trials]
    order = np.argsort([-trial.seen.sum() for trial in cut], kind="stable")
    lengths = {n for trial in cut for n in lengths_for(len(trial.t_s))}

    turns = count()

    def hide(gaps: int) -> list[tuple[int, Hidden[MarkerTrial]]]:
        """Hide in trials that take turns, as lengths do, until there are so many gaps of each length."""
        nonlocal order
        found: list[tuple[int, Hidden[MarkerTrial]]] = []
        for _ in range(effort.times):
            found += [(int(i), hide_neighbours(cut[i], rng, turn=next(turns))) for i in order[: effort.validated]]
            order = np.roll(order, -effort.validated)
            if all(sum(hidden.count(n) for _, hidden in found) >= gaps for n in lengths):
                break
        return [(i, hidden) for i, hidden in found if hidden.gaps]

    return Search(trials=trials, trunk=trunk, hidden=hide(2), again=hide(8), named=named, tell=tell)


def _excerpt(trial: MarkerTrial, most: int) -> MarkerTrial:
    inside = excerpt(trial.seen, most)
    return replace(trial, t_s=trial.t_s[inside], xyz_m=trial.xyz_m[inside], sd_m=trial.sd_m[inside])


def own_search(trials: TrialSet, *, most_frames: int = 500) -> Search | None:
    """A search on gaps hidden in the recording that is to be filled, to see how wide intervals are there.

    Args:
        trials: Trials; the last is the recording.
        most_frames: Of it, the stretch of so many frames of which most is seen.

    Returns:
        None where nothing can be hidden.
    """
    hidden = hide_neighbours(_excerpt(trials.trials[-1], most_frames), np.random.default_rng(0))
    if not hidden.gaps:
        return None
    last = len(trials.trials) - 1
    return Search(trials=trials.trials, trunk=trials.trunk, named=trials.named, hidden=[(last, hidden)])


def calibrated(mixture: Mixture, models: Sequence[TrajectoryModel], trials: TrialSet) -> Mixture:
    """A mixture of models with intervals that hold in gaps hidden in the recording that is to be filled."""
    own = own_search(trials)
    return mixture if own is None else mixture.calibrated([own.fill(model) for model in models])


SHARP = PoseSettings(process_noise=0.3, residual=0.6, body=0.1, weight=16.0, bones=0.0)
"""Where a search starts: less noise than a single recording shows, as a mixture's widths are learned afterwards, and a
stiffer potential. Bones come last (``of_bones``): they make poses alike between which the search is to choose."""


def free_pose(search: Search, base: PoseSettings = SHARP) -> PoseSettings:
    """The pose model without forces, its subspace and body chosen on the hidden gaps.

    That is the rank, whether the axes turn, and how freely the body moves.
    """
    free = replace(base, mechanics="free", potential="none")
    ranks, bodies = [{"ranks": (rank,)} for rank in (16, 8, 26)], [{"body": factor} for factor in (0.01, 1.0)]
    return search.improve(free, [*ranks, {"rotating": not base.rotating}, *bodies])


def other_rank(pose: PoseSettings) -> PoseSettings:
    """The same of rank 16, or 8 if it has 16."""
    return replace(pose, ranks=(8,) if pose.ranks == (16,) else (16,))


def of_two_ranks(search: Search, pose: PoseSettings) -> PoseSettings | Average:
    """The mean of a pose model and the same of another rank; itself where that errs more."""
    both = Average((pose, other_rank(pose)))
    return both if search.fill(both).log_rmse < search.fill(pose).log_rmse else pose


def bare_pose(search: Search, free: PoseSettings) -> PoseSettings:
    """The same with the mechanics that fill best without a potential: linear, a field of forces, or none."""
    best = search.improve(replace(free, mechanics="linear"), [{"mechanics": other} for other in ("field", "free")])
    return of_bones(search, best)


def of_bones(search: Search, pose: PoseSettings) -> PoseSettings:
    """The same with its bones held as stiffly as fills best, or not at all."""
    return search.improve(pose, [{"bones": 1.0}, {"bones": 0.25}])


def held_pose(
    search: Search, free: PoseSettings, potentials: Sequence[Potential] = ("motion", "shape")
) -> PoseSettings:
    """The same held by a potential: with which mechanics, by which of some potentials, how stiffly.

    The noise keeps its defaults (docs/decisions.md, "The mixture").
    """
    start = replace(free, mechanics="linear", potential=potentials[0])
    other = [{"mechanics": name} for name in ("field", "free")] + [{"potential": name} for name in potentials[1:]]
    best = search.improve(start, other)
    best = search.improve(best, [{"weight": 0.25 * best.weight}, {"weight": 4 * best.weight}])
    return of_bones(search, best)


def delay_models(search: Search, free: PoseSettings) -> tuple[DelaySettings, DelaySettings]:
    """The regression on delayed poses of the body of a pose model, with its axes and with the other ones."""
    start = DelaySettings(ranks=free.ranks, body_hz=free.body_hz, rotating=free.rotating)
    best = search.improve(start, [{"cutoff": 8.0}])
    return best, replace(best, rotating=not best.rotating)


USUAL_MARKER = MarkerSettings(acceleration=0.3)
"""Best or near it on four sets of the gap benchmark (bat, bat_wing, gait, snake_gap), of 0.003 to 30."""


def marker_model(search: Search) -> MarkerSettings:
    """Constant velocity of each marker, by how many frames its velocity is known at the edges of a gap."""
    return search.improve(USUAL_MARKER, [{"acceleration": factor} for factor in (0.1, 0.03, 0.01, 1.0)])


@dataclass(frozen=True, eq=False, kw_only=True)
class Tuned:
    """Models and how they are mixed.

    Attributes:
        models: The K models.
        mixture: Their weights.
        residuals: What each missed the hidden samples by.
    """

    models: tuple[TrajectoryModel, ...]
    mixture: Mixture
    residuals: tuple[Residuals, ...]


MOST_CANDIDATES = 24
"""That ``tuned`` tries: 7 for the pose without forces, 9 held by V_z, 5 of constant velocity, 3 regressions."""


def tuned(search: Search) -> Tuned:
    """The default tracker, a mixture: constant velocity of markers, delayed poses, mechanics held by V_z."""
    search.at_most = MOST_CANDIDATES
    search.tell(
        "models are tried on gaps hidden in the recordings; those of the lowest cost (error, and how well the stated "
        "uncertainty tells large errors from small ones) are kept"
    )
    free = free_pose(search)
    held = of_two_ranks(search, held_pose(search, free))
    return mixed(search, (marker_model(search), *delay_models(search, free), held))


def mixed(search: Search, models: Sequence[TrajectoryModel]) -> Tuned:
    """Models that were chosen, and how they are mixed."""
    residuals = tuple(search.both(model) for model in models)
    return Tuned(models=tuple(models), mixture=learn_mixture(residuals), residuals=residuals)
