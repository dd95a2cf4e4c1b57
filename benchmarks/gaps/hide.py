"""Hiding what was measured: where the gaps of the benchmark lie."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.gaps.method import Trial

Mask = NDArray[np.bool_]

SCENARIOS = ("single", "pair", "limb", "all")
"""One marker of a limb, two of the same limb, a whole limb, all limbs at once."""
GAPS = (10, 25, 50, 100)
"""Lengths in frames."""
MARGIN = 5
"""Frames on either side of a gap in which its markers were measured and stay shown."""
SPACING = 20
"""Frames between two gaps of a trial in which nothing is hidden."""

Cell = tuple[str, int]
"""A scenario and a length."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Gap:
    """One gap.

    Attributes:
        scenario: Of it.
        length: In frames.
        start: Its first frame.
        hidden: (M,) markers that are hidden.
        scored: (M,) of them, those measured through the whole gap and ``MARGIN`` frames on either side.
    """

    scenario: str
    length: int
    start: int
    hidden: Mask
    scored: Mask

    @property
    def frames(self) -> slice:
        """Its frames."""
        return slice(self.start, self.start + self.length)


@dataclass(frozen=True, eq=False, kw_only=True)
class Shown:
    """A trial with gaps.

    Attributes:
        truth: The trial as measured.
        gaps: What is hidden of it.
    """

    truth: Trial
    gaps: tuple[Gap, ...]

    @property
    def trial(self) -> Trial:
        """The trial as a method sees it."""
        xyz = np.array(self.truth.xyz_m)
        for gap in self.gaps:
            xyz[gap.frames, gap.hidden] = np.nan
        return replace(self.truth, xyz_m=xyz)


def cells(*, scenarios: Sequence[str] = SCENARIOS, lengths: Sequence[int] = GAPS) -> list[Cell]:
    """All pairs of a scenario and a length; short ones (10, 25) three times and twice, for they hold few samples."""
    times = {10: 3, 25: 2}
    return [(scenario, length) for scenario in scenarios for length in lengths for _ in range(times.get(length, 1))]


def hide(trial: Trial, wanted: Sequence[Cell], rng: np.random.Generator) -> list[Shown]:
    """A gap of every wanted kind that the trial has room for, in as few copies of the trial as random placing allows.

    Gaps of one copy are ``SPACING`` frames apart. When each kind has its gap, each is placed once more where a copy
    still has room. Kinds that the trial cannot hold (too short, too little measured) are left out.

    Args:
        trial: As measured.
        wanted: Kinds of gaps; a list may name one several times.
        rng: Where and which.
    """
    seen = np.isfinite(trial.xyz_m[..., 0])
    copies: list[list[Gap]] = []
    order = [wanted[i] for i in rng.permutation(len(wanted))]
    for scenario, length in sorted(order, key=lambda cell: -cell[1]):  # the long ones first: they need most room
        for gaps in [*copies, None]:
            gap = _place(trial, seen, gaps or [], scenario, length, rng)
            if gap is not None:
                if gaps is None:
                    copies.append([gap])
                else:
                    gaps.append(gap)
                break
    for scenario, length in order:
        for gaps in copies:
            gap = _place(trial, seen, gaps, scenario, length, rng)
            if gap is not None:
                gaps.append(gap)
                break
    return [Shown(truth=trial, gaps=tuple(sorted(gaps, key=lambda gap: gap.start))) for gaps in copies]


def _place(
    trial: Trial, seen: Mask, others: Sequence[Gap], scenario: str, length: int, rng: np.random.Generator
) -> Gap | None:
    """A gap apart from the others; None where there is no room."""
    window = length + 2 * MARGIN
    if len(seen) < window:
        return None
    count = np.cumsum(np.vstack([np.zeros((1, seen.shape[1]), dtype=int), seen]), axis=0)
    whole = count[window:] - count[:-window] == window  # (starts, M): measured from MARGIN before to MARGIN after
    for other in others:
        near = slice(max(0, other.start - window + MARGIN - SPACING + 1), other.start + other.length + SPACING - MARGIN)
        whole[near] = False
    units = list(_units(trial, whole, scenario))
    if not units:
        return None
    start, hidden = units[int(rng.integers(len(units)))]
    if scenario in ("single", "pair"):
        hidden = np.isin(np.arange(seen.shape[1]), rng.choice(np.flatnonzero(hidden), 1 + (scenario == "pair"), False))
    return Gap(scenario=scenario, length=length, start=start + MARGIN, hidden=hidden, scored=hidden & whole[start])


def _units(trial: Trial, whole: Mask, scenario: str) -> Iterator[tuple[int, Mask]]:
    """Starts and the markers to hide there (for ``single`` and ``pair``: to choose from)."""
    limbs = [np.array([name in limb for name in trial.names]) for limb in trial.limbs]
    if scenario == "all":
        limbs = [np.logical_or.reduce(limbs)] if len(limbs) > 1 else []
    for limb in limbs:
        measured = (whole & limb).sum(axis=1)
        least = {"single": 1, "pair": 2}.get(scenario, max(2, -(-int(limb.sum()) // 2)))
        for start in np.flatnonzero(measured >= least):
            chosen = whole[start] & limb if scenario in ("single", "pair") else limb
            yield int(start), chosen


def excerpt(trial: Trial, frames: int, rng: np.random.Generator) -> Trial:
    """At most so many frames of a trial: the best seen of four random places."""
    if len(trial.t_s) <= frames:
        return trial
    seen = np.isfinite(trial.xyz_m[..., 0])
    starts = rng.integers(0, len(seen) - frames + 1, size=4)
    start = max(starts, key=lambda s: seen[s : s + frames].sum())
    cut = slice(start, start + frames)
    return replace(trial, name=f"{trial.name}@{start}", t_s=trial.t_s[cut], xyz_m=trial.xyz_m[cut])
