"""Cycles of a motion: wing beats, strides, waves of an undulating body; and curves over the phase of a cycle."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from eal.arrays import Z95, Array, short_repr, true_runs
from mocap.filters.velocities import Motion
from mocap.kinematics import angles
from mocap.kinematics.cycle_checks import checked, seen_samples
from mocap.kinematics.records import COUNTED, Cycle, Kinematics
from mocap.kinematics.stroke import analytic
from mocap.measures import AXES, LINES
from mocap.skeleton import Skeleton
from mocap.text import number_of

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False, kw_only=True)
class Footfalls:
    """Which foot stands when.

    Attributes:
        feet: The F feet.
        t_s: (T,) times.
        stance: (T, F) True where a foot stands.
        height_m: (T, F) height above the ground that was found from the footholds.
    """

    feet: tuple[str, ...]
    t_s: Array
    stance: NDArray[np.bool_]
    height_m: Array

    __repr__ = short_repr


def cycles(found: Kinematics, motion: Motion, skeleton: Skeleton) -> list[Cycle]:
    """All cycles of strokes, feet and chains that the skeleton states."""
    out: list[Cycle] = []
    for name in skeleton.measures.strokes:
        if f"{name}_stroke_deg" in found:
            out += wing_beats(found, name, motion, skeleton)
    steps = footfalls(motion, skeleton)
    if steps is not None:
        out += strides(found, steps, motion, skeleton)
    out += undulations(found, motion, skeleton)
    return checked(out, motion, skeleton)


def counted(rows: Sequence[Cycle]) -> list[Cycle]:
    """The cycles that are not doubtful: those of means, figures and comparisons."""
    return [row for row in rows if row.status == COUNTED]


def why_none(skeleton: Skeleton, found: Kinematics, rows: Sequence[Cycle]) -> list[str]:
    """Why a table of cycles has no row, or none that counts: a sentence for each cause, with what mends it."""
    measures = skeleton.measures
    if counted(rows):
        return []
    if rows:
        reasons = Counter(row.reason.split(":")[0].split(" lies in a gap")[0] for row in rows)
        most = reasons.most_common(1)[0][0]
        return [
            f"none of the {number_of(len(rows), 'cycle')} in cycles.csv counts: most often {most} (column `reason`)"
        ]
    if not measures.cyclic:
        lines = 'strokes = { wing_l = ["SHOULDER", "TIP"] }, feet = ["FOOT"] or chain = ["HEAD", ..., "TAIL"]'
        return [f"cycles.csv is empty: the skeleton names no limbs that move in cycles: add under [measures] {lines}"]
    out = []
    without_axes = [name for name in ("forward", "left") if getattr(measures, name) is None]
    if measures.strokes and without_axes:
        state = " and ".join(LINES[name] for name in without_axes)
        out.append(
            f"strokes of {', '.join(measures.strokes)} are angles in axes of the trunk, which the skeleton does not "
            f"state: add under [measures] {state}, with markers of yours"
        )
    else:
        lacking = [name for name in measures.strokes if f"{name}_stroke_deg" not in found]
        short = [name for name in measures.strokes if name not in lacking]
        if lacking:
            out.append(
                f"{', '.join(lacking)} has no stroke angle: trunk, root and tip were not known together in four frames"
            )
        if short:
            out.append(f"of {', '.join(short)} no two upper turning points were tracked: no whole beat was filmed")
    if measures.feet:
        out.append(f"no foot ({', '.join(measures.feet)}) set down twice: no whole stride was filmed, or none stands")
    if measures.chain:
        lost = [name for name in measures.chain if f"{name}_speed_m_s" not in found]
        if len(measures.chain) - len(lost) < 4:
            out.append("a wave needs a chain of four markers that the recording has")
        else:
            out.append("the whole chain was never tracked for one wave")
    return [f"cycles.csv is empty: {sentence}" for sentence in out]


SAME = 13
"""Columns that cycles of every kind have, which come first."""


def cycles_table(rows: Sequence[Cycle]) -> "pd.DataFrame":
    """A row a cycle; columns that no cycle has are left out, those of every kind are always there."""
    import pandas as pd

    names = [f.name for f in fields(Cycle)]
    table = pd.DataFrame([asdict(row) for row in rows], columns=names)
    return table.drop(columns=[c for c in names[SAME:] if not bool(table[c].notna().any())])


def _crossings(y: Array, *, falling: bool) -> NDArray[np.int64]:
    """Frames after which a series crosses zero."""
    a, b = y[:-1], y[1:]
    return np.flatnonzero((a > 0) & (b <= 0) if falling else (a < 0) & (b >= 0))


def _at(t_s: Array, y: Array, frame: int) -> float:
    """Where a line between two frames is zero."""
    share = y[frame] / (y[frame] - y[frame + 1])
    return float(t_s[frame] + share * (t_s[frame + 1] - t_s[frame]))


def _way(found: Kinematics, start_s: float, end_s: float) -> float:
    """Straight distance of the body between two times, m."""
    ends = [[np.interp(t, found.t_s, found[f"body_{axis}_m"].value) for axis in "xyz"] for t in (start_s, end_s)]
    return float(np.linalg.norm(np.array(ends[1]) - np.array(ends[0])))


def _cycle(found: Kinematics, kind: str, of: str, ends_s: tuple[float, float], **more: Any) -> Cycle:
    start_s, end_s = ends_s
    duration = end_s - start_s
    speed = _way(found, start_s, end_s) / duration
    own = {"start_s": start_s, "end_s": end_s, "duration_s": duration, "frequency_hz": 1 / duration}
    return Cycle(recording=found.recording, kind=kind, of=of, body_speed_m_s=speed, **own, **more)


def turning_sd(t_s: Array, rate: Array, sd: Array, frame: int) -> float:
    """Standard deviation of the time at which a rate goes through zero after a frame, s.

    A quarter of the width of the times at which the rate is within two of its own standard deviations of zero, over
    1.02: where rate and deviation hardly change there it is the deviation over the slope, and it grows with the
    deviation where the limb was hidden nearby. Where the recording ends before, or nothing is known of the limb from
    there on, the rate goes on as it goes through zero, with the deviation that it has at the end.
    """
    sign = 1.0 if rate[frame] > rate[frame + 1] else -1.0
    at, slope = _at(t_s, rate, frame), abs(rate[frame + 1] - rate[frame]) / (t_s[frame + 1] - t_s[frame])
    ends = []
    for step, k in ((-1, frame), (1, frame + 1)):
        out = -step * sign * rate - Z95 * sd  # above zero where the rate has left its interval on this side
        while 0 <= k < len(rate) and out[k] <= 0:
            k += step
        if not 0 <= k < len(rate) or not np.isfinite(out[k]):
            far = Z95 * sd[k - step] / slope if slope > 0 else np.inf
            ends.append(at + step * max(far, abs(float(t_s[k - step]) - at)))
            continue
        share = out[k] / (out[k] - out[k - step])
        ends.append(float(t_s[k] + share * (t_s[k - step] - t_s[k])))
    return (ends[1] - ends[0]) / (2 * Z95)


def wing_beats(found: Kinematics, name: str, motion: Motion, skeleton: Skeleton) -> list[Cycle]:
    """Beats of a stroke from one upper turning point to the next: where its rate goes through zero.

    A turning point counts if the stroke moves by a quarter of its range (5th to 95th percentile) until the next; its
    time has the standard deviation of ``turning_sd``.
    """
    stroke, rate, t_s = found[f"{name}_stroke_deg"], found[f"{name}_stroke_rate_deg_s"], found.t_s
    there = np.isfinite(stroke.value) & np.isfinite(rate.value)
    if there.sum() < 8:
        return []
    least = 0.25 * float(np.ptp(np.percentile(stroke.value[there], [5, 95])))
    y = np.where(there, rate.value, 0.0)
    tops = [(f, True) for f in _crossings(y, falling=True)] + [(f, False) for f in _crossings(y, falling=False)]
    points: list[tuple[int, bool]] = []
    for frame, top in sorted(tops):
        if points and points[-1][1] == top:
            better = stroke.value[frame] > stroke.value[points[-1][0]]
            if better == top:
                points[-1] = (frame, top)
        elif not points or abs(stroke.value[frame] - stroke.value[points[-1][0]]) >= least:
            points.append((frame, top))
    out: list[Cycle] = []
    seen = seen_samples("wing_beat", name, motion, skeleton)
    upper = [i for i, (_, top) in enumerate(points) if top]
    for a, b in pairwise(upper):
        frames = [points[i][0] for i in (a, a + 1, b)]
        times = [_at(t_s, y, f) for f in frames]
        sd = [turning_sd(t_s, rate.value, rate.sd, f) for f in frames]
        values = [float(np.interp(t, t_s[there], stroke.value[there])) for t in times]
        duration = times[2] - times[0]
        spread = float(np.hypot(sd[0], sd[2]))
        inside = slice(frames[0], frames[2] + 1)
        out.append(
            _cycle(
                found,
                "wing_beat",
                name,
                (times[0], times[2]),
                number=len(out) + 1,
                start_sd_s=sd[0],
                middle_sd_s=sd[1],
                end_sd_s=sd[2],
                frequency_sd_hz=spread / duration**2,
                filled=float(np.mean(~seen[inside])),
                amplitude_deg=values[0] - values[1],
                amplitude_sd_deg=float(np.hypot(stroke.sd[frames[0]], stroke.sd[frames[1]])),
                downstroke_fraction=(times[1] - times[0]) / duration,
            )
        )
    return out


def footfalls(motion: Motion, skeleton: Skeleton) -> Footfalls | None:
    """When the stated feet stand: slow beside the body, and at the height of the ground.

    A foot is slow below a twentieth of the body's mean speed, or below 1.5 standard deviations of a component of its
    velocity, if that is more. The ground is fitted to the positions of slow feet: a
    plane, or a rod (the distance from the line through them); heights count from each foot's own median. A foot stands
    that is slow and not higher than four median absolute deviations of the slow feet's heights, or half of the
    median height of the others. A foot that swings overtakes the body: while it is never faster than the body's mean
    it has not left the ground, whatever noise or a filled gap says. Gaps and contacts of fewer than three frames
    are closed and dropped. On lizard twins 98 % of all frames are right, tracked with their gaps
    (docs/reference/kinematics.md); contacts last 4 % too long, as a foot starts and ends its swing slowly.

    Returns:
        None: no feet are stated, or they never stand.
    """
    feet = tuple(name for name in skeleton.measures.feet if name in motion.names)
    if not feet or "body" not in motion.names:
        return None
    index = [motion.index(name) for name in feet]
    x, speed = motion.xyz_m[:, index], angles.length(motion.velocity_m_s[:, index])
    pace = float(np.nanmedian(angles.length(motion.velocity_m_s[:, motion.index("body")])))
    variance = np.einsum("tfii->tfi", motion.own[:, index])[..., 3:]
    noise = float(np.sqrt(np.nanmedian(variance))) if np.isfinite(variance).any() else 0.0
    still = np.isfinite(speed) & (speed < max(0.05 * pace, 1.5 * noise))
    if still.sum() < 10:
        return None
    up = np.array(AXES[skeleton.measures.up])
    height = _above_rod(x, still) if skeleton.measures.ground == "rod" else _above_plane(x, still, up)
    own = np.where(still, height, np.nan)
    has = np.isfinite(own).any(axis=0)
    height[:, has] -= np.nanmedian(own[:, has], axis=0)
    swing = np.abs(height[np.isfinite(height) & ~still])
    tolerance = max(4 * float(np.median(np.abs(height[still]))), 0.5 * float(np.median(swing)) if len(swing) else 0.0)
    stance = still & (np.abs(height) <= tolerance)
    for foot in range(len(feet)):
        for start, stop in true_runs(~stance[:, foot]):
            between = start > 0 and stop < len(stance)
            overtakes = bool((speed[start:stop, foot] > pace).any())
            if between and (stop - start < 3 or (not overtakes and np.isfinite(speed[start:stop, foot]).all())):
                stance[start:stop, foot] = True
        for start, stop in true_runs(stance[:, foot]):
            if stop - start < 3:
                stance[start:stop, foot] = False
    return Footfalls(feet=feet, t_s=motion.t_s, stance=stance, height_m=height)


def _above_plane(x: Array, still: NDArray[np.bool_], up: Array) -> Array:
    """(T, F) heights above the plane through the slow feet."""
    points = x[still]
    centre = np.median(points, axis=0)
    normal = np.linalg.svd(points - centre, full_matrices=False)[2][2]
    if np.linalg.svd(points - centre, compute_uv=False)[1] < 1e-9 or abs(normal @ up) < 0.5:
        normal = up
    normal = normal * np.sign(normal @ up)
    height = (x - centre) @ normal
    return height - float(np.median(height[still]))


def _above_rod(x: Array, still: NDArray[np.bool_]) -> Array:
    """(T, F) distances from the line through the slow feet, less their median."""
    points = x[still]
    centre = points.mean(axis=0)
    along = np.linalg.svd(points - centre, full_matrices=False)[2][0]
    away = x - centre
    across = away - (away @ along)[..., None] * along
    middle = across[still].mean(axis=0)
    distance = angles.length(across - middle)
    return distance - float(np.median(distance[still]))


def strides(found: Kinematics, steps: Footfalls, motion: Motion, skeleton: Skeleton) -> list[Cycle]:
    """Strides of each foot from one footfall to the next."""
    out: list[Cycle] = []
    t_s = steps.t_s
    for foot, name in enumerate(steps.feet):
        runs = [run for run in true_runs(steps.stance[:, foot]) if run[0] >= 3]  # it may have begun before them
        seen = seen_samples("stride", name, motion, skeleton)
        for number, ((start, stop), (after, _)) in enumerate(pairwise(runs), start=1):
            begin, end = (float(t_s[f - 1] + t_s[f]) / 2 for f in (start, after))
            contact = float(t_s[stop - 1] + t_s[min(stop, len(t_s) - 1)]) / 2 - begin
            step = float(t_s[start] - t_s[start - 1])
            duration = end - begin
            out.append(
                _cycle(
                    found,
                    "stride",
                    name,
                    (begin, end),
                    number=number,
                    start_sd_s=step / np.sqrt(12),
                    end_sd_s=step / np.sqrt(12),
                    frequency_sd_hz=step / np.sqrt(6) / duration**2,
                    filled=float(np.mean(~seen[start:after])),
                    contact_s=contact,
                    duty_factor=contact / duration,
                    stride_length_m=_way(found, begin, end),
                )
            )
    return out


def undulations(found: Kinematics, motion: Motion, skeleton: Skeleton) -> list[Cycle]:
    """Waves that travel down a chain of markers, head first.

    Seen along the animal's course, each marker's way to the side is a signal with a phase (of its analytic signal). The
    phases at a time fall along the arc length of the chain; the wavelength is 2 pi over that slope (least squares).
    """
    chain = [name for name in skeleton.measures.chain if name in motion.names]
    if len(chain) < 4:
        return []
    x = motion.xyz_m[:, [motion.index(name) for name in chain]]
    there = np.isfinite(x).all(axis=(1, 2))
    frames = np.flatnonzero(there)
    if len(frames) < 16:
        return []
    inside = slice(int(frames[0]), int(frames[-1]) + 1)
    t_s, index = motion.t_s[inside], np.arange(inside.start, inside.stop)
    flat = x.reshape(len(x), -1)
    path = np.stack([np.interp(index, frames, flat[frames, k]) for k in range(flat.shape[1])], axis=1)
    path = path.reshape(len(index), len(chain), 3)
    side = _sideways(path, np.array(AXES[skeleton.measures.up]))
    signal = analytic(side - side.mean(axis=0))
    phase = np.unwrap(np.unwrap(np.angle(signal), axis=1), axis=0)
    lags = phase - phase[:, :1]
    arc = np.concatenate([[0.0], np.cumsum(angles.length(np.diff(path, axis=1)).mean(axis=0))])
    head = np.angle(signal[:, 0])
    starts = np.flatnonzero((head[:-1] < 0) & (head[1:] >= 0) & (np.abs(np.diff(head)) < np.pi))
    out: list[Cycle] = []
    filled = 1 - motion.measured[inside][:, [motion.index(name) for name in chain]].mean(axis=1)
    for a, b in pairwise(starts.tolist()):
        begin, end = _at(t_s, head, a), _at(t_s, head, b)
        lag = lags[a:b].mean(axis=0)
        slope = np.polyfit(arc, lag, 1)[0]
        out.append(
            _cycle(
                found,
                "undulation",
                "body",
                (begin, end),
                number=len(out) + 1,
                filled=float(filled[a:b].mean()),
                wavelength_m=float(2 * np.pi / abs(slope)),
                amplitude_m=float(np.abs(signal[a:b]).mean()),
                phase_lag_deg=float(np.degrees(-lag[-1])),
            )
        )
    return out


def _sideways(path: Array, up: Array) -> Array:
    """(T, K) way of each marker to the left of the chain's own course: the mean line from tail to head, smoothed."""
    axes = angles.level_axes(up)
    flat = (path @ axes.T)[..., :2]
    course = flat[:, 0] - flat[:, -1]
    course = course.mean(axis=0) if len(path) else course
    course = course / np.linalg.norm(course)
    left = np.array([-course[1], course[0]])
    side = flat @ left
    t = np.linspace(-1, 1, len(side))
    middle = np.polyval(np.polyfit(t, side.mean(axis=1), 2), t)
    return side - middle[:, None]


def _curve(t_s: Array, y: Array, row: Cycle, phase: Array) -> Array | None:
    """(P,) values at phases of a cycle; None where a frame of it has none, or it has fewer than four."""
    inside, there = (t_s >= row.start_s) & (t_s <= row.end_s), np.isfinite(y)
    if inside.sum() < 4 or not there[inside].all():
        return None
    return np.interp(row.start_s + phase * (row.end_s - row.start_s), t_s[there], y[there])


def mean_angles(found: Kinematics, rows: Sequence[Cycle]) -> "pd.DataFrame":
    """A row a cycle: which it is, and the mean over it of each angle, in degrees; NaN where a frame of it has no value.

    ``_sd`` is the mean of the angle's standard deviations: no mean of values has a larger one, however long their
    errors last. Means of directions, which go from 180 to -180, are of the way that was turned.
    """
    import pandas as pd

    phase = np.linspace(0, 1, 101)
    which = ("recording", "kind", "of", "number", "start_s", "end_s", "filled")
    columns: dict[str, list] = {name: [getattr(row, name) for row in rows] for name in which}
    for angle in (q for q in found.quantities if q.unit == "deg"):
        there = np.isfinite(angle.value)
        turned = angle.value.copy()
        turned[there] = np.unwrap(turned[there], period=360)
        for name, values in ((angle.name, turned), (f"{angle.name}_sd", angle.sd)):
            curves = [_curve(found.t_s, values, row, phase) for row in rows]
            columns[name] = [np.nan if curve is None else np.trapezoid(curve, phase) for curve in curves]
        columns[angle.name] = [180 - (180 - mean) % 360 for mean in columns[angle.name]]
    return pd.DataFrame(columns)


@dataclass(frozen=True, eq=False, kw_only=True)
class Ensemble:
    """A quantity over the phase of a cycle, of several cycles.

    Attributes:
        quantity: Its name.
        phase: (P,) phases from 0 to 1.
        mean: (P,) mean over cycles.
        low: (P,) lower end of the 95 % interval of the mean (Student's t over cycles).
        high: (P,) upper end.
        sd: (P,) standard deviation between cycles.
        curves: (N, P) each cycle.
    """

    quantity: str
    phase: Array
    mean: Array
    low: Array
    high: Array
    sd: Array
    curves: Array

    __repr__ = short_repr

    @property
    def n(self) -> int:
        """Number of cycles."""
        return len(self.curves)


def ensemble(found: Kinematics, rows: Sequence[Cycle], quantity: str, *, n_phases: int = 101) -> Ensemble:
    """A quantity over the cycles in which it has values, each stretched to one phase.

    Raises:
        MocapError: there is no such quantity.
    """
    y, phase = found[quantity].value, np.linspace(0, 1, n_phases)
    curves = [curve for row in rows if (curve := _curve(found.t_s, y, row, phase)) is not None]
    table = np.array(curves).reshape(-1, n_phases)
    n = len(table)
    mean = table.mean(axis=0) if n else np.full(n_phases, np.nan)
    sd = table.std(axis=0, ddof=1) if n > 1 else np.full(n_phases, np.nan)
    half = stdtrit(n - 1, 0.975) * sd / np.sqrt(n) if n > 1 else sd
    return Ensemble(quantity=quantity, phase=phase, mean=mean, low=mean - half, high=mean + half, sd=sd, curves=table)
