"""Tab: joint angles and the body's speed with their 95 % intervals beside the scene, and the cycles over the frames."""

from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from eal.arrays import Z95
from mocap.kinematics.cycles import Cycle
from mocap.kinematics.records import Quantity, Rests
from mocap.rerun import palette, paths
from mocap.rerun.blueprint import robust_range, rows, series_view
from mocap.rerun.columns import log_over_time
from mocap.rerun.layout import Layout
from mocap.rerun.scene_views import scene_view
from mocap.sides import by_side, side_of, words
from mocap.tracking.result import Result

SECTIONS = {"wing_beat": ("down", "up"), "stride": ("stance", "swing")}
"""What the first and the second part of a cycle are called."""
BODY = ("body_speed_m_s", "body_yaw_deg", "body_pitch_deg", "body_roll_deg")


def log(rec: rr.RecordingStream, run: Result, layout: Layout) -> None:
    """A line with its band for each quantity, and a lane for each limb that beats or steps."""
    t_s = run.t_s
    for group, quantities in layout.angles.items():
        for one in quantities:
            _log_quantity(rec, group, one, t_s)
    for (kind, of), lane in _lanes(layout.cycles).items():
        parts = sections(lane)
        names = [name for _, name in parts if name]
        labels = [name.split()[0] if name.endswith(("down", "stance")) or " " not in name else " " for name in names]
        colors = [palette.VERMILLION if name.endswith(("up", "swing")) else palette.GREEN for name in names]
        look = rr.StateConfiguration(values=names, labels=labels, colors=colors)
        at = np.clip(np.searchsorted(t_s, [start for start, _ in parts]), 0, len(t_s) - 1)
        last = {int(frame): name for frame, (_, name) in zip(at, parts, strict=True)}
        changes = rr.StateChange.columns(state=list(last.values()))
        log_over_time(rec, paths.cycles(kind, of), t_s, changes, look, at=np.array(list(last), dtype=np.int64))


def tab(layout: Layout) -> rrb.Container | None:
    """The scene, beside it the angles of the left, the right and the trunk, and under them the cycles."""
    if not layout.angles:
        return None
    groups = [_plots(group, quantities) for group, quantities in layout.angles.items()]
    right: rrb.Container = rrb.Tabs(*groups, active_tab=0)
    if layout.cycles:
        lanes = rrb.StateTimelineView(
            origin=paths.CYCLES,
            name="Cycles, numbered: green down-stroke or stance, red-brown up-stroke or swing",
            time_view=rrb.TimeAxis(link=rrb.components.LinkAxis.LinkToGlobal),
        )
        right = rrb.Vertical(right, lanes, row_shares=[5, 1 + 0.25 * min(len(_lanes(layout.cycles)), 6)])
    return rrb.Horizontal(scene_view(layout), right, column_shares=[2, 3], name="Angles and cycles")


def chosen(found: Sequence[Quantity], joints: Sequence[str], strokes: Sequence[str]) -> dict[str, list[Quantity]]:
    """Flexions (or stated angles) of the joints by side with the strokes, and the body; only what has values."""
    finite = {q.name: q for q in found if np.isfinite(q.value).any()}
    out: dict[str, list[Quantity]] = {}
    for side, names in by_side(joints).items():
        wanted = [f"{name}_{what}_deg" for name in names for what in ("flexion", "abduction", "rotation")]
        wanted += [f"{name}_stroke_deg" for name in strokes if side_of(name) == side]
        quantities = [finite[name] for name in wanted if name in finite]
        if quantities:
            out[side] = quantities
    body = [finite[name] for name in BODY if name in finite]
    return out | ({"body": body} if body else {})


def _plots(group: str, quantities: Sequence[Quantity]) -> rrb.Container:
    views = [
        series_view(
            paths.quantity(group, q.name), f"{title(q)}, 95 % band", y_range=robust_range(q.value), legend=False
        )
        for q in quantities
    ]
    return rows(views, columns=1 if len(views) <= 5 else 2, name=group.capitalize())


def title(q: Quantity) -> str:
    """``left elbow flexion (deg)``."""
    unit = q.unit.replace("_", "/").replace("s2", "s²").replace("m2", "m²")
    return f"{words(q.name.removesuffix(f'_{q.unit}'))} ({unit})"


def _log_quantity(rec: rr.RecordingStream, group: str, q: Quantity, t_s: np.ndarray) -> None:
    """A line with a band of half width 1.96 sd for values of one kind; nothing where there are none."""
    path = paths.quantity(group, q.name)
    color = palette.SIDE.get(group, palette.WHITE)
    variance = np.where(np.isfinite(q.sd), Z95 * q.sd, 0.0) ** 2
    for name, kind, own in (("measured", Rests.MEASURED, color), ("filled", Rests.FILLED, palette.YELLOW)):
        there = (q.rests == kind) & np.isfinite(q.value)
        if there.any():
            value, spread = (np.where(there, numbers, np.nan) for numbers in (q.value, variance))
            look = rr.Measurements.from_fields(colors=own, widths=1.5, names=name)
            log_over_time(rec, f"{path}/{name}", t_s, rr.Measurements.columns(values=value, variances=spread), look)


def _lanes(cycles: Sequence[Cycle]) -> dict[tuple[str, str], list[Cycle]]:
    out: dict[tuple[str, str], list[Cycle]] = {}
    for row in cycles:
        out.setdefault((row.kind, row.of), []).append(row)
    return out


def sections(rows: Sequence[Cycle]) -> list[tuple[float, str]]:
    """Times (s) at which the parts of cycles begin, with their names; an empty name where no cycle follows."""
    out: list[tuple[float, str]] = []
    for i, row in enumerate(rows):
        first = row.downstroke_fraction if row.kind == "wing_beat" else row.duty_factor
        names = SECTIONS.get(row.kind)
        if names is None or not np.isfinite(first):
            out.append((row.start_s, f"{row.number}"))
        else:
            out.append((row.start_s, f"{row.number} {names[0]}"))
            out.append((row.start_s + first * row.duration_s, f"{row.number} {names[1]}"))
        if i + 1 == len(rows) or rows[i + 1].start_s > row.end_s + 1e-9:
            out.append((row.end_s, ""))
    return out
