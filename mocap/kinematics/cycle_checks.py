"""Which cycles can be believed: turning points that were seen, and durations that the other cycles bear out.

A cycle that cannot is kept, with the reasons; means, figures and comparisons are of the others.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Z95, Array, true_runs
from mocap.filters.velocities import Motion
from mocap.kinematics.records import COUNTED, DOUBTFUL, Cycle
from mocap.sides import TRUNK, other_side, side_of, words
from mocap.skeleton import Skeleton

GAP = 0.25
"""Share of a cycle that a gap may last with a turning point in it: in a longer one the model says when it turned."""
TIMING = 0.125
"""Share of a cycle that the half-width of the 95 % interval of a turning point's time may have: with a quarter on both
sides of it, it could as well be half way to the next one."""
TIMES = 1.4
"""Ratio of a cycle's duration to the median one from which on it may be two, or a part of one: half way, in logarithms,
between one cycle and two."""
SPREADS = 5.0
"""And how many robust standard deviations of the logarithms of all durations it must be away: an animal that changes
its rate has cycles like that, of which none is wrong."""
LEAST_AMPLITUDE = 0.4
"""Share of the median amplitude that a beat must have: a flutter within a beat has a quarter, what a turning point of
noise must have to be one (``wing_beats``)."""


def checked(rows: Sequence[Cycle], motion: Motion, skeleton: Skeleton) -> list[Cycle]:
    """The cycles with their ``status`` and the reasons of those that are doubtful.

    Args:
        rows: Cycles of one recording.
        motion: Which samples were measured.
        skeleton: Of which markers each limb's cycles are.
    """
    why: list[list[str]] = [[] for _ in rows]
    for of in dict.fromkeys((row.kind, row.of) for row in rows):
        some = [i for i, row in enumerate(rows) if (row.kind, row.of) == of]
        seen = seen_samples(*of, motion, skeleton)
        for i in some:
            why[i] += [*_unseen(rows[i], motion.t_s, seen), *_badly_timed(rows[i])]
    for i, reason in _unlike_others(rows, [not reasons for reasons in why]):
        why[i].append(reason)
    for i, reason in _without_mates(rows, [not reasons for reasons in why], motion, skeleton):
        why[i].append(reason)
    return [
        replace(row, status=DOUBTFUL if reasons else COUNTED, reason="; ".join(reasons))
        for row, reasons in zip(rows, why, strict=True)
    ]


def limb_markers(kind: str, of: str, skeleton: Skeleton) -> tuple[str, ...]:
    """The markers that say when a limb turns: root and tip of a wing, a foot, the chain of a body."""
    if kind == "wing_beat":
        return skeleton.measures.strokes[of]
    return (of,) if kind == "stride" else skeleton.measures.chain


def seen_samples(kind: str, of: str, motion: Motion, skeleton: Skeleton) -> NDArray[np.bool_]:
    """(T,) frames in which a limb was measured: all the markers of ``limb_markers``, or half of those of a chain."""
    index = [motion.names.index(name) for name in limb_markers(kind, of, skeleton) if name in motion.names]
    return motion.measured[:, index].mean(axis=1) >= (0.5 if kind == "undulation" else 1.0)


def turning_times(row: Cycle) -> list[tuple[str, float]]:
    """What a cycle's times rest on, with words for it."""
    if row.kind == "wing_beat":
        lower = row.start_s + row.downstroke_fraction * row.duration_s
        return [
            ("its upper turning point", row.start_s),
            ("its lower turning point", lower),
            ("the next upper turning point", row.end_s),
        ]
    if row.kind == "stride":
        return [("its footfall", row.start_s), ("the next footfall", row.end_s)]
    return [("its start", row.start_s), ("its end", row.end_s)]


def _unseen(row: Cycle, t_s: Array, seen: NDArray[np.bool_]) -> Iterator[str]:
    """Turning points that lie outside of what was measured, or in a long gap."""
    for what, time in turning_times(row):
        gap = gap_at(time, t_s, seen)
        if gap is None:
            continue
        start, stop = gap
        if start == 0 or stop == len(seen):
            yield f"{what} is extrapolated: the limb was not measured {'before' if start == 0 else 'after'} it"
            return
        length = float(t_s[stop] - t_s[start - 1])
        if length > GAP * row.duration_s:
            yield f"{what} lies in a gap of {1e3 * length:.3g} ms, {length / row.duration_s:.0%} of the cycle"
            return


def gap_at(time: float, t_s: Array, seen: NDArray[np.bool_]) -> tuple[int, int] | None:
    """The run of frames without a measurement that a time lies in; None: both frames around it were measured."""
    after = int(np.clip(np.searchsorted(t_s, time), 1, len(t_s) - 1))
    for start, stop in true_runs(~seen):
        if start <= after and after - 1 < stop:
            return start, stop
    return None


def _badly_timed(row: Cycle) -> Iterator[str]:
    """Times that the interval of the rate leaves open."""
    known = [sd for sd in (row.start_sd_s, row.middle_sd_s, row.end_sd_s) if sd == sd]
    half = Z95 * max(known, default=0.0) / row.duration_s
    if half > TIMING:
        yield f"its times are known to ± {half:.0%} of the cycle only" if np.isfinite(half) else "its times are unknown"
    if row.kind == "wing_beat" and row.amplitude_deg < 3 * row.amplitude_sd_deg:
        yield f"its amplitude is {row.amplitude_deg:.3g} ± {row.amplitude_sd_deg:.2g} degrees (SD)"


def _unlike_others(rows: Sequence[Cycle], sound: Sequence[bool]) -> Iterator[tuple[int, str]]:
    """Durations and amplitudes that no other cycle of the kind has."""
    for kind in dict.fromkeys(row.kind for row in rows):
        index = [i for i, row in enumerate(rows) if row.kind == kind]
        trusted = [i for i in index if sound[i]]
        if len(trusted) < 3:  # of two that differ nobody knows which is wrong
            continue
        durations = np.array([rows[i].duration_s for i in trusted])
        middle = float(np.median(durations))
        spread = 1.4826 * float(np.median(np.abs(np.log(durations / middle))))
        amplitude = float(np.median([rows[i].amplitude_deg for i in trusted]))
        for i in index:
            ratio = rows[i].duration_s / middle
            if abs(np.log(ratio)) > max(np.log(TIMES), SPREADS * spread):
                yield i, f"it lasts {ratio:.2g} times as long as the median one: a turning point is missing or too many"
            if rows[i].amplitude_deg < LEAST_AMPLITUDE * amplitude:
                share = rows[i].amplitude_deg / amplitude
                yield i, f"its amplitude is {share:.0%} of the median one"


def _without_mates(
    rows: Sequence[Cycle], sound: Sequence[bool], motion: Motion, skeleton: Skeleton
) -> Iterator[tuple[int, str]]:
    """Wing beats that the wing of the other side does not make, though it was seen all the time.

    Wings beat together (in a turn, too; they may be shifted by less than a quarter of a beat). Where both sides are
    sound alone and differ, the one whose duration is nearer to the median of all is right.
    """
    beats = [i for i, row in enumerate(rows) if row.kind == "wing_beat"]
    durations = [rows[i].duration_s for i in beats if sound[i]]
    if not durations:
        return
    middle = float(np.median(durations))
    for i in beats:
        row = rows[i]
        mate = other_side(row.of)
        if not sound[i] or side_of(row.of) == TRUNK or mate not in skeleton.measures.strokes:
            continue
        across = [k for k in beats if rows[k].of == mate]
        others = [rows[k] for k in across]
        seen = seen_samples(row.kind, mate, motion, skeleton)
        window = (motion.t_s >= row.start_s - GAP * row.duration_s) & (motion.t_s <= row.end_s + GAP * row.duration_s)
        if not others or not _without_long_gaps(seen[window], motion.t_s[window], row.duration_s):
            continue
        starts = _nearest(row.start_s, (o.start_s for o in others), (o.end_s for o in others))
        ends = _nearest(row.end_s, (o.start_s for o in others), (o.end_s for o in others))
        away = max(starts, ends) / row.duration_s
        if away <= GAP:
            continue
        overlapping = [k for k in across if rows[k].start_s < row.end_s and rows[k].end_s > row.start_s]
        if not all(sound[k] for k in overlapping):
            continue  # it is the other one's fault
        error = abs(np.log(row.duration_s / middle))
        if not overlapping or error > min(abs(np.log(rows[k].duration_s / middle)) for k in overlapping):
            yield i, f"the {words(mate)} turns {away:.0%} of a beat before or after it"


def _without_long_gaps(seen: NDArray[np.bool_], t_s: Array, duration_s: float) -> bool:
    """Whether a limb was measured throughout, but for gaps shorter than a quarter of a cycle."""
    if len(t_s) < 2 or not seen.any():
        return False
    step = float(np.median(np.diff(t_s)))
    return all((stop - start + 1) * step <= GAP * duration_s for start, stop in true_runs(~seen))


def _nearest(time: float, *others: Iterable[float]) -> float:
    return min(abs(time - other) for some in others for other in some)
