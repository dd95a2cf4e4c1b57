"""Choosing pose models on hidden gaps of their own training trials, and how to mix them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TypeVar

import numpy as np

from filters.delayed import DelaySettings
from filters.fitting import Fitting, Kind
from filters.hide import Hidden, excerpt, hide_neighbours, lengths_for
from filters.learn import PoseSettings, Potential
from filters.learn_markers import MarkerSettings
from filters.mixture import Mixture, learn_mixture
from filters.observations import PositionObservations
from filters.poses import MarkerTrial
from filters.score import Residuals, joined, residuals_of
from filters.several import Several, averaged_residuals
from filters.track import Smoothed

Settings = TypeVar("Settings", PoseSettings, DelaySettings, MarkerSettings)


@dataclass(eq=False, kw_only=True)
class Search:
    """Candidates tried on hidden gaps.

    Attributes:
        trials: Training trials.
        trunk: Indices of the trunk's markers.
        hidden: Those of them that are validated on, by index, with what is hidden.
        again: More of that, for the mixture alone.
        named: Indices of the markers of the skeleton's rigid bones.
        tried: Every candidate with how it filled all gaps.
        tell: Called with a line for each candidate.
    """

    trials: Sequence[MarkerTrial]
    trunk: Sequence[int]
    hidden: Sequence[tuple[int, Hidden[MarkerTrial]]]
    again: Sequence[tuple[int, Hidden[MarkerTrial]]] = ()
    named: Sequence[tuple[int, int]] = ()
    tell: Callable[[str], None] = lambda _line: None
    tried: list[tuple[Kind, Residuals]] = field(default_factory=list)
    _fitting: dict[Hidden[MarkerTrial], Fitting] = field(default_factory=dict)

    def fill(self, kind: Kind) -> Residuals:
        """Fill all hidden gaps with one candidate, learned without them."""
        if isinstance(kind, Several):
            return averaged_residuals([self.fill(one) for one in kind.members])
        for before, fill in self.tried:
            if before == kind:
                return fill
        fill, density = self._fill(kind, self.hidden)
        self.tried.append((kind, fill))
        likelihood = "" if np.isnan(density) else f", log likelihood {density:.3f} a coordinate"
        self.tell(f"cost {fill.cost:.3f}, {1e3 * np.exp(fill.log_rmse):.2f} mm{likelihood}: {_unusual(kind)}")
        return fill

    def both(self, kind: Kind) -> Residuals:
        """The same with the gaps that were hidden again."""
        if isinstance(kind, Several):
            return averaged_residuals([self.both(one) for one in kind.members])
        first = self.fill(kind)
        return joined([first, self._fill(kind, self.again)[0]]) if self.again else first

    def _fill(self, kind: Kind, hidden: Sequence[tuple[int, Hidden[MarkerTrial]]]) -> tuple[Residuals, float]:
        """Of hidden samples; and the filter's own log likelihood of a coordinate that it was shown, NaN without one."""
        fills, observed = [], []
        for index, gaps in hidden:
            if gaps not in self._fitting:
                others = [trial for i, trial in enumerate(self.trials) if i != index]
                self._fitting[gaps] = Fitting([*others, gaps.shown], self.trunk, self.named)
            fitting = self._fitting[gaps]
            shown = fitting.trials[-1]
            found = fitting.fill(kind, PositionObservations(xyz_m=shown.xyz_m, sd_m=shown.sd_m))
            fills.append(residuals_of(gaps, found.xyz_m, found.cov_m2))
            observed += found.observed if isinstance(found, Smoothed) else []
        rows = sum(seen.n_rows for seen in observed)
        return joined(fills), sum(seen.log_likelihood for seen in observed) / rows if rows else np.nan

    def improve(self, start: Settings, choices: Sequence[dict], *, least: float = 0.01) -> Settings:
        """The start with those changes, tried one after the other, that lower the cost by ``least`` or more."""
        best = start
        for change in choices:
            candidate = replace(best, **change)
            if self.fill(candidate).cost < self.fill(best).cost - least:
                best = candidate
        return best


def _unusual(kind: Kind) -> str:
    """What of a kind's settings is not the default."""
    own = [f"{f.name}={getattr(kind, f.name)!r}" for f in fields(kind) if getattr(kind, f.name) != f.default]
    return f"{type(kind).__name__}({', '.join(own)})"


def search_on(
    trials: Sequence[MarkerTrial],
    trunk: Sequence[int],
    rng: np.random.Generator,
    *,
    named: Sequence[tuple[int, int]] = (),
    validated: int = 2,
    most_frames: int = 500,
    times: int = 3,
    tell: Callable[[str], None] = lambda _line: None,
) -> Search:
    """A search that validates on trials, those of which most is seen first.

    Args:
        trials: Training trials of the same markers.
        trunk: Indices of the trunk's markers.
        rng: What to hide.
        named: Indices of the markers of the skeleton's rigid bones.
        validated: Number of trials to hide gaps in at a time.
        most_frames: Of such a trial, the stretch of so many frames of which most is seen.
        times: Gaps are hidden so often, at most, until each length is there twice; and again, until eight times.
        tell: Called with a line for each candidate.
    """
    cut = [_excerpt(trial, most_frames) for trial in trials]
    order = np.argsort([-trial.seen.sum() for trial in cut], kind="stable")
    lengths = {n for trial in cut for n in lengths_for(len(trial.t_s))}

    def hide(gaps: int) -> list[tuple[int, Hidden[MarkerTrial]]]:
        """Hide in trials that take turns until there are so many gaps of each length."""
        nonlocal order
        found: list[tuple[int, Hidden[MarkerTrial]]] = []
        for _ in range(times):
            found += [(int(i), hide_neighbours(cut[i], rng)) for i in order[:validated]]
            order = np.roll(order, -validated)
            if all(sum(hidden.count(n) for _, hidden in found) >= gaps for n in lengths):
                break
        return [(i, hidden) for i, hidden in found if hidden.gaps]

    return Search(trials=trials, trunk=trunk, hidden=hide(2), again=hide(8), named=named, tell=tell)


def _excerpt(trial: MarkerTrial, most: int) -> MarkerTrial:
    inside = excerpt(trial.seen, most)
    return replace(trial, t_s=trial.t_s[inside], xyz_m=trial.xyz_m[inside], sd_m=trial.sd_m[inside])


def own_search(fitting: Fitting, *, most_frames: int = 500) -> Search | None:
    """A search on gaps hidden in the recording that is to be filled, to see how wide intervals are there.

    Args:
        fitting: Trials; the last is the recording.
        most_frames: Of it, the stretch of so many frames of which most is seen.

    Returns:
        None where nothing can be hidden.
    """
    hidden = hide_neighbours(_excerpt(fitting.trials[-1], most_frames), np.random.default_rng(0))
    if not hidden.gaps:
        return None
    return Search(
        trials=fitting.trials, trunk=fitting.trunk, named=fitting.named, hidden=[(len(fitting.trials) - 1, hidden)]
    )


def calibrated(mixture: Mixture, kinds: Sequence[Kind], fitting: Fitting) -> Mixture:
    """A mixture of kinds with intervals that hold in gaps hidden in the recording that is to be filled."""
    own = own_search(fitting)
    return mixture if own is None else mixture.calibrated([own.fill(kind) for kind in kinds])


SHARP = PoseSettings(excess=0.3, residual=0.6, body=0.1, weight=16.0, bones=0.0)
"""Where a search starts: less noise than a single recording shows, as a mixture's widths are learned afterwards, and a
stiffer potential. Bones come last (``of_bones``): they make poses alike between which the search is to choose."""


def free_pose(search: Search, base: PoseSettings = SHARP) -> PoseSettings:
    """The pose model without forces, its subspace and body chosen on the hidden gaps.

    That is the rank, whether the axes turn, and how freely the body moves.
    """
    free = replace(base, mechanics="free", potential="none")
    ranks, bodies = [{"ranks": (rank,)} for rank in (16, 8, 26)], [{"body": factor} for factor in (0.01, 1.0)]
    return search.improve(free, [*ranks, {"turns": not base.turns}, *bodies])


def other_rank(pose: PoseSettings) -> PoseSettings:
    """The same of rank 16, or 8 if it has 16."""
    return replace(pose, ranks=(8,) if pose.ranks == (16,) else (16,))


def of_two_ranks(search: Search, pose: PoseSettings) -> PoseSettings | Several:
    """The mean of a pose model and the same of another rank; itself where that errs more."""
    both = Several((pose, other_rank(pose)))
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

    The noise keeps its defaults (``design/mixture.py``).
    """
    start = replace(free, mechanics="linear", potential=potentials[0])
    other = [{"mechanics": name} for name in ("field", "free")] + [{"potential": name} for name in potentials[1:]]
    best = search.improve(start, other)
    best = search.improve(best, [{"weight": 0.25 * best.weight}, {"weight": 4 * best.weight}])
    return of_bones(search, best)


def delay_kinds(search: Search, free: PoseSettings) -> tuple[DelaySettings, DelaySettings]:
    """The regression on delayed poses of the body of a pose model, with its axes and with the other ones."""
    start = DelaySettings(ranks=free.ranks, body_hz=free.body_hz, turns=free.turns)
    best = search.improve(start, [{"cutoff": 8.0}])
    return best, replace(best, turns=not best.turns)


USUAL_MARKER = MarkerSettings(acceleration=0.3)
"""Best or near it on four sets of the gap benchmark (bat, bat_wing, gait, snake_gap), of 0.003 to 30."""


def marker_kind(search: Search) -> MarkerSettings:
    """Constant velocity of each marker, by how many frames its velocity is known at the edges of a gap."""
    return search.improve(USUAL_MARKER, [{"acceleration": factor} for factor in (0.1, 0.03, 0.01, 1.0)])


@dataclass(frozen=True, eq=False, kw_only=True)
class Tuned:
    """Models and how they are mixed.

    Attributes:
        kinds: The K models.
        mixture: Their weights.
        fills: What each said of the hidden samples.
    """

    kinds: tuple[Kind, ...]
    mixture: Mixture
    fills: tuple[Residuals, ...]


def tuned(search: Search) -> Tuned:
    """The default tracker, a mixture: constant velocity of markers, delayed poses, mechanics held by V_z."""
    free = free_pose(search)
    held = of_two_ranks(search, held_pose(search, free))
    return mixed(search, (marker_kind(search), *delay_kinds(search, free), held))


def mixed(search: Search, kinds: Sequence[Kind]) -> Tuned:
    """Kinds that were chosen, and how they are mixed."""
    fills = tuple(search.both(kind) for kind in kinds)
    return Tuned(kinds=tuple(kinds), mixture=learn_mixture(fills), fills=fills)
