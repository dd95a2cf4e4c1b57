"""Choosing pose models on hidden gaps of their own training trials, and how to mix them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from filters.delayed import DelaySettings
from filters.fitting import Fitting, Kind
from filters.hidden import Fill, Hidden, fill_of, hide_groups, joined_fills
from filters.learn import PoseSettings, Potential
from filters.mixture import Mixture, learn_mixture
from filters.observations import PositionObservations
from filters.poses import MarkerTrial

Settings = TypeVar("Settings", PoseSettings, DelaySettings)


@dataclass(eq=False, kw_only=True)
class Search:
    """Candidates tried on hidden gaps.

    Attributes:
        trials: Training trials.
        trunk: Indices of the trunk's markers.
        hidden: Those of them that are validated on, by index, with what is hidden.
        again: The same with other samples hidden, for the mixture.
        tried: Every candidate with how it filled all gaps.
        tell: Called with a line for each candidate.
    """

    trials: Sequence[MarkerTrial]
    trunk: Sequence[int]
    hidden: dict[int, Hidden]
    again: dict[int, Hidden] = field(default_factory=dict)
    tell: Callable[[str], None] = lambda _line: None
    tried: list[tuple[Kind, Fill]] = field(default_factory=list)
    _fitting: dict[int, Fitting] = field(default_factory=dict)
    _fitting_again: dict[int, Fitting] = field(default_factory=dict)

    def fill(self, kind: Kind) -> Fill:
        """Fill all hidden gaps with one candidate, learned without them."""
        for before, fill in self.tried:
            if before == kind:
                return fill
        fill = self._fill(kind, self.hidden, self._fitting)
        self.tried.append((kind, fill))
        self.tell(f"cost {fill.cost:.3f}, {1e3 * np.exp(fill.log_rmse):.2f} mm: {kind or 'constant velocity'}")
        return fill

    def both(self, kind: Kind) -> Fill:
        """The same with the gaps that were hidden again."""
        first = self.fill(kind)
        return joined_fills([first, self._fill(kind, self.again, self._fitting_again)]) if self.again else first

    def _fill(self, kind: Kind, hidden: dict[int, Hidden], fitting: dict[int, Fitting]) -> Fill:
        fills = []
        for index, gaps in hidden.items():
            shown = gaps.shown
            if index not in fitting:
                others = [trial for i, trial in enumerate(self.trials) if i != index]
                fitting[index] = Fitting([*others, shown], self.trunk)
            found = fitting[index].fill(kind, PositionObservations(xyz_m=shown.xyz_m, sd_m=shown.sd_m))
            fills.append(fill_of(gaps, found.xyz_m, found.cov_m2))
        return joined_fills(fills)

    def improve(self, start: Settings, choices: Sequence[dict], *, least: float = 0.01) -> Settings:
        """The start with those changes, tried one after the other, that lower the cost by ``least`` or more."""
        best = start
        for change in choices:
            candidate = replace(best, **change)
            if self.fill(candidate).cost < self.fill(best).cost - least:
                best = candidate
        return best


def search_on(
    trials: Sequence[MarkerTrial],
    trunk: Sequence[int],
    rng: np.random.Generator,
    *,
    validated: int = 2,
    most_frames: int = 500,
    tell: Callable[[str], None] = lambda _line: None,
) -> Search:
    """A search that validates on the trials of which most is seen.

    Args:
        trials: Training trials of the same markers.
        trunk: Indices of the trunk's markers.
        rng: What to hide.
        validated: Number of trials to hide gaps in.
        most_frames: Of such a trial, the stretch of so many frames of which most is seen.
        tell: Called with a line for each candidate.
    """
    cut = [_excerpt(trial, most_frames) for trial in trials]
    order = np.argsort([-trial.seen.sum() for trial in cut], kind="stable")[:validated]

    def hide() -> dict[int, Hidden]:
        hidden = {int(i): hide_groups(cut[i], rng) for i in order}
        return {i: h for i, h in hidden.items() if h.mask.any()}

    return Search(trials=trials, trunk=trunk, hidden=hide(), again=hide(), tell=tell)


def _excerpt(trial: MarkerTrial, most: int) -> MarkerTrial:
    if len(trial.t_s) <= most:
        return trial
    total = np.concatenate([[0], np.cumsum(trial.seen.sum(axis=1))])
    start = int(np.argmax(total[most:] - total[:-most]))
    inside = slice(start, start + most)
    return replace(trial, t_s=trial.t_s[inside], xyz_m=trial.xyz_m[inside], sd_m=trial.sd_m[inside])


def calibrated(mixture: Mixture, kinds: Sequence[Kind], fitting: Fitting, *, most_frames: int = 500) -> Mixture:
    """A mixture with intervals that hold in gaps hidden in the recording that is to be filled.

    Args:
        mixture: Of the kinds.
        kinds: The K models.
        fitting: Trials; the last is the recording.
        most_frames: Of it, the stretch of so many frames of which most is seen.
    """
    hidden = hide_groups(_excerpt(fitting.trials[-1], most_frames), np.random.default_rng(0))
    if not hidden.mask.any():
        return mixture
    search = Search(trials=fitting.trials, trunk=fitting.trunk, hidden={len(fitting.trials) - 1: hidden})
    return mixture.calibrated([search.fill(kind) for kind in kinds])


SHARP = PoseSettings(excess=0.3, residual=0.6, residual_rate=0.5)
"""Where a search starts: less noise than a single recording shows, as a mixture's widths are learned afterwards."""


def pose_kinds(search: Search, base: PoseSettings = SHARP) -> tuple[PoseSettings, PoseSettings, PoseSettings]:
    """Pose models of one subspace and body: without forces, with identified mechanics, and these held by V_z.

    Chosen one after the other on the hidden gaps: the rank, whether the body's axes turn, linear mechanics or a field,
    V_z of shapes or of shapes and velocities, its stiffness. The noise keeps its defaults (``design/mixture.py``).
    """
    free = replace(base, mechanics="free", potential="none")
    free = search.improve(free, [{"ranks": (rank,)} for rank in (16, 8, 26)] + [{"turns": not base.turns}])
    bare = search.improve(replace(free, mechanics="linear"), [{"mechanics": "field"}])
    return free, bare, held_pose(search, bare, ("motion", "shape"))


def held_pose(search: Search, bare: PoseSettings, potentials: Sequence[Potential]) -> PoseSettings:
    """The same model held by a potential: by which, and how stiffly."""
    first = search.improve(replace(bare, potential=potentials[0]), [{"potential": p} for p in potentials[1:]])
    return search.improve(first, [{"weight": 0.25 * first.weight}, {"weight": 4 * first.weight}])


def delay_kind(search: Search, free: PoseSettings) -> DelaySettings:
    """The regression on delayed poses of the subspace and body of a pose model."""
    start = DelaySettings(ranks=free.ranks, body_hz=free.body_hz, turns=free.turns)
    return search.improve(start, [{"cutoff": 8.0}])


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
    fills: tuple[Fill, ...]


def tuned(search: Search) -> Tuned:
    """The default tracker, a mixture: constant velocity of markers, delayed poses, mechanics held by V_z."""
    free, _, held = pose_kinds(search)
    kinds: tuple[Kind, ...] = (None, delay_kind(search, free), held)
    return mixed(search, kinds)


def mixed(search: Search, kinds: Sequence[Kind]) -> Tuned:
    """Kinds that were chosen, and how they are mixed."""
    fills = tuple(search.both(kind) for kind in kinds)
    return Tuned(kinds=tuple(kinds), mixture=learn_mixture(fills), fills=fills)
