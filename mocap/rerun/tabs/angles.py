"""Tab: joint angles and the body's speed with their 95 % intervals beside the scene, and the cycles over the frames."""

from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from eal.arrays import Z95
from mocap.kinematics.cycles import Cycle
from mocap.kinematics.records import Quantity, Rests
from mocap.pipeline.recording import Recording
from mocap.rerun import palette, paths
from mocap.rerun.columns import time_columns
from mocap.rerun.layout import Layout
from mocap.rerun.rows import rows
from mocap.rerun.scene_views import scene_view
from mocap.rerun.series import robust_range, series_view
from mocap.sides import by_side, side_of, words

SECTIONS = {"wing_beat": ("down", "up"), "stride": ("stance", "swing")}
"""What the first and the second part of a cycle are called."""
BODY = ("body_speed_m_s", "body_yaw_deg", "body_pitch_deg", "body_roll_deg")
_COLUMN = 5
"""More plots take two columns."""


def log(rec: rr.RecordingStream, run: Recording, layout: Layout) -> None:
    """A line with its band for each quantity, and a lane for each limb that beats or steps."""
    t_s = run.t_s
    for group, quantities in layout.angles.items():
        for one in quantities:
            _log_quantity(rec, group, one, t_s)
    for (kind, of), lane in _lanes(layout.cycles).items():
        _log_cycles(rec, paths.cycles(kind, of), lane, t_s)


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
    """Flexions (or stated angles) of the joints by side with the strokes, and the body; only what has values.

    Args:
        found: All quantities.
        joints: Names of the joints.
        strokes: Names of the strokes.
    """
    known = {q.name: q for q in found if np.isfinite(q.value).any()}
    out: dict[str, list[Quantity]] = {}
    for side, names in by_side(joints).items():
        wanted = [f"{name}_{what}_deg" for name in names for what in ("flexion", "abduction", "rotation")]
        wanted += [f"{name}_stroke_deg" for name in strokes if side_of(name) == side]
        quantities = [known[name] for name in wanted if name in known]
        if quantities:
            out[side] = quantities
    body = [known[name] for name in BODY if name in known]
    return out | ({"body": body} if body else {})


def _plots(group: str, quantities: Sequence[Quantity]) -> rrb.Container:
    views = [
        series_view(
            paths.quantity(group, q.name),
            f"{title(q)}, 95 % band",
            y_range=robust_range(q.value),
            legend=False,
        )
        for q in quantities
    ]
    return rows(views, columns=1 if len(views) <= _COLUMN else 2, name=group.capitalize())


def title(q: Quantity) -> str:
    """``left elbow flexion (deg)``."""
    unit = q.unit.replace("_", "/").replace("s2", "s²").replace("m2", "m²")
    return f"{words(q.name.removesuffix(f'_{q.unit}'))} ({unit})"


def _log_quantity(rec: rr.RecordingStream, group: str, q: Quantity, t_s: np.ndarray) -> None:
    path = paths.quantity(group, q.name)
    color = palette.SIDE.get(group, palette.WHITE)
    _log_band(rec, f"{path}/measured", q, t_s, q.rests == Rests.MEASURED, color, "measured")
    _log_band(rec, f"{path}/filled", q, t_s, q.rests == Rests.FILLED, palette.YELLOW, "filled")


def _log_band(
    rec: rr.RecordingStream, path: str, q: Quantity, t_s: np.ndarray, where: np.ndarray, color: palette.Rgb, name: str
) -> None:
    """A line with a band of half width 1.96 sd where the values are of one kind; nothing where there are none."""
    there = where & np.isfinite(q.value)
    if not there.any():
        return
    look = rr.Measurements.from_fields(colors=color, widths=1.5, names=name)
    rec.log(path, look, static=True)
    variance = np.where(np.isfinite(q.sd), Z95 * q.sd, 0.0) ** 2
    columns = rr.Measurements.columns(
        values=np.where(there, q.value, np.nan), variances=np.where(there, variance, np.nan)
    )
    rec.send_columns(path, indexes=time_columns(t_s), columns=columns)


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


def _log_cycles(rec: rr.RecordingStream, path: str, rows: Sequence[Cycle], t_s: np.ndarray) -> None:
    parts = sections(rows)
    names = [name for _, name in parts if name]
    labels = [name.split()[0] if name.endswith(("down", "stance")) or " " not in name else " " for name in names]
    colors = [palette.VERMILLION if name.endswith(("up", "swing")) else palette.GREEN for name in names]
    rec.log(path, rr.StateConfiguration(values=names, labels=labels, colors=colors), static=True)
    at = np.clip(np.searchsorted(t_s, [start for start, _ in parts]), 0, len(t_s) - 1)
    last = {int(frame): name for frame, (_, name) in zip(at, parts, strict=True)}
    frames = np.array(list(last), dtype=np.int64)
    rec.send_columns(
        path, indexes=time_columns(t_s, at=frames), columns=rr.StateChange.columns(state=list(last.values()))
    )
