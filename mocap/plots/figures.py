"""Figures of a run for people who open no viewer, and a report of one file that holds them."""

import base64
import html
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mocap.kinematics.cycles import Cycle, Footfalls, cycles_table, ensemble
from mocap.kinematics.records import Kinematics, Rests
from mocap.pipeline.run import Run
from mocap.plots import kinematics as plots
from mocap.records import Status

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

FOLDER = "figures"


@dataclass(frozen=True, eq=False, kw_only=True)
class Picture:
    """A figure with what it shows.

    Attributes:
        name: Of its files.
        caption: What it shows, in a sentence or two.
        axes: What was drawn.
    """

    name: str
    caption: str
    axes: "Axes"


def pictures(run: Run, found: Kinematics, rows: Sequence[Cycle], steps: Footfalls | None) -> Iterator[Picture]:
    """The figures of a run: those for which it has something to show."""
    angles = _most_moving(found, [f"{j.name}_flexion_deg" for j in run.skeleton.joints])
    if angles:
        what = ", ".join(plots.label(name) for name in angles)
        yield Picture(
            name="angles",
            caption=f"Joint angles over time: {what}; the joints that move most. Bands are 95 % intervals; "
            "where a frame is grey one of the markers was filled.",
            axes=plots.plot_over_time(found, angles),
        )
    for kind, of in (("wing_beat", "wing beat"), ("stride", "stride")):
        some = [row for row in rows if row.kind == kind]
        if not some:
            continue
        limb = some[0].of
        cycle = [row for row in some if row.of == limb]
        curves = [one for one in (ensemble(found, cycle, name) for name in angles) if one.n > 1]
        if curves:
            yield Picture(
                name=f"angles_by_phase_{kind}",
                caption=f"The same angles over the phase of the {of} of {limb.replace('_', ' ')}: mean, its 95 % "
                "interval over cycles (Student's t), and each cycle (thin).",
                axes=plots.plot_by_phase(curves, unit="deg", of=of),
            )
        yield Picture(
            name=f"frequency_{kind}",
            caption=f"Frequency of each {of}.",
            axes=plots.plot_cycle_values(some, "frequency_hz", unit="Hz"),
        )
    if "body_speed_m_s" in found and np.isfinite(found["body_speed_m_s"].value).any():
        yield Picture(
            name="speed",
            caption="Speed of the body (mean of the trunk's markers) with its 95 % interval.",
            axes=plots.plot_over_time(found, ["body_speed_m_s"]),
        )
    if steps is not None:
        yield Picture(name="gait", caption="Gait diagram: when each foot stands.", axes=plots.plot_gait(steps))
    for name in list(run.skeleton.measures.strokes)[:1]:
        if f"{name}_stroke_deg" in found:
            stroke, aside = found[f"{name}_stroke_deg"], found[f"{name}_deviation_deg"]
            yield Picture(
                name="stroke_plane",
                caption=f"Path of {name.replace('_', ' ')} in and out of its stroke plane, in axes of the trunk.",
                axes=plots.plot_stroke_path(stroke, aside),
            )
    markers = run.tracked.markers
    yield Picture(
        name="gaps",
        caption="Where markers were not measured, and what stands in their place.",
        axes=plots.plot_gaps(markers.names, markers.t_s, markers.status),
    )
    if run.ideal_px is not None and run.tracked.reprojected_px.size:
        away = np.linalg.norm(run.ideal_px.uv_px - run.tracked.reprojected_px, axis=-1)
        yield Picture(
            name="residuals",
            caption="How far each camera's pixels lie from the tracked markers.",
            axes=plots.plot_residuals(run.ideal_px.cameras, away, run.tracked.used),
        )


def _most_moving(found: Kinematics, names: Sequence[str], most: int = 3) -> list[str]:
    """The angles that move most, all of one side, of those that are known in half as many frames as the best known."""
    count = {n: int(np.isfinite(found[n].value).sum()) for n in names if n in found}
    some = [found[n] for n, known in count.items() if known >= max(8, 0.5 * max(count.values()))]
    order = sorted(some, key=lambda q: -float(np.nanstd(q.value)))
    other = {"l": "_r_", "r": "_l_"}
    side = next((part for q in order[:1] for part in q.name.split("_") if part in other), None)
    return [q.name for q in order if side is None or other[side] not in q.name][:most]


def write_pictures(shown: Sequence[Picture], folder: Path) -> dict[str, str]:
    """Write each as PNG (200 dpi) and SVG, and return the SVG text by name."""
    (folder / FOLDER).mkdir()
    out: dict[str, str] = {}
    for one in shown:
        figure = one.axes.figure
        (folder / FOLDER / f"{one.name}.png").write_bytes(_drawn(figure, "png"))
        svg = _drawn(figure, "svg")
        (folder / FOLDER / f"{one.name}.svg").write_bytes(svg)
        out[one.name] = svg.decode("utf-8")
    return out


def _drawn(figure: object, kind: str) -> bytes:
    import matplotlib as mpl

    made = io.BytesIO()
    options = {"metadata": {"Date": None}} if kind == "svg" else {}
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "mocap"}):
        figure.savefig(made, format=kind, dpi=200, **options)  # type: ignore[attr-defined]
    return made.getvalue()


_STYLE = """body{font:15px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#222}
table{border-collapse:collapse;margin:1rem 0;font-size:13px}td,th{padding:.25rem .6rem;border-bottom:1px solid #ddd;
text-align:right}td:first-child,th:first-child{text-align:left}figure{margin:1.5rem 0}img{max-width:100%}
figcaption{color:#555;font-size:13px}pre{white-space:pre-wrap;background:#f6f6f6;padding:1rem;font-size:12px}"""


def report_page(
    run: Run, found: Kinematics, rows: Sequence[Cycle], shown: Sequence[Picture], svg: dict[str, str]
) -> str:
    """One page of HTML with figures, tables and findings; it needs no other file and no other host."""
    parts = [f"<h1>{html.escape(run.name)}</h1>", _summary(run, found)]
    for one in shown:
        data = base64.b64encode(svg[one.name].encode()).decode()
        caption = html.escape(one.caption)
        parts.append(
            f'<figure><img alt="{caption}" src="data:image/svg+xml;base64,{data}">'
            f"<figcaption>{caption}</figcaption></figure>"
        )
    if rows:
        table = cycles_table(rows).drop(columns=["recording", "number", "start_s", "end_s"])
        parts += ["<h2>Cycles, means</h2>", _means(table)]
    parts += ["<h2>Joint angles</h2>", _ranges(run, found)]
    if found.notes:
        parts.append("<h2>Notes</h2><ul>" + "".join(f"<li>{html.escape(n)}</li>" for n in found.notes) + "</ul>")
    parts += ["<h2>Report of the tracking</h2>", f"<pre>{html.escape(run.report_text)}</pre>"]
    head = f'<meta charset="utf-8"><title>{html.escape(run.name)}</title><style>{_STYLE}</style>'
    return f'<!doctype html><html lang="en"><head>{head}</head><body>{"".join(parts)}</body></html>\n'


def _means(table: "pd.DataFrame") -> str:
    """Means over the cycles of each limb, as a table."""
    columns = [c for c in table.columns if c not in ("kind", "of")]
    head = "".join(f"<th>{c.replace('_', ' ')}</th>" for c in ("kind", "of", "cycles", *columns))
    lines = []
    for kind, of in dict.fromkeys(zip(table["kind"], table["of"], strict=True)):
        some = table[(table["kind"] == kind) & (table["of"] == of)]
        cells = [kind.replace("_", " "), html.escape(of.replace("_", " ")), str(len(some))]
        for c in columns:
            values = np.asarray(some[c], dtype=float)
            cells.append(f"{np.nanmean(values):.4g}" if np.isfinite(values).any() else "")
        lines.append("<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>")
    return f"<table><tr>{head}</tr>{''.join(lines)}</table>"


def _summary(run: Run, found: Kinematics) -> str:
    status = run.tracked.markers.status
    kinds = ((Status.MEASURED,), (Status.PREDICTED, Status.SMOOTHED, Status.REJECTED))
    measured, filled = (100 * float(np.mean(np.isin(status, some))) for some in kinds)
    seconds = float(found.t_s[-1] - found.t_s[0]) if len(found.t_s) else 0.0
    return (
        f"<p>{len(found.t_s)} frames over {seconds:.2f} s, {status.shape[1]} markers: {measured:.1f} % of the samples "
        f"were measured, {filled:.1f} % filled. All values are in <code>kinematics.csv</code>, each with its standard "
        "deviation and whether it rests on measured or on filled markers.</p>"
    )


def _ranges(run: Run, found: Kinematics) -> str:
    rows = []
    for joint in run.skeleton.joints:
        q = found.get(f"{joint.name}_angle_deg") if f"{joint.name}_angle_deg" in found else None
        if q is None or not np.isfinite(q.value).any():
            continue
        low, high = np.nanpercentile(q.value, [2.5, 97.5])
        filled = 100 * float(np.mean(q.rests == Rests.FILLED))
        rows.append(
            f"<tr><td>{html.escape(joint.name)}</td><td>{low:.1f} to {high:.1f}</td><td>{np.nanmean(q.value):.1f}</td>"
            f"<td>{np.nanmedian(q.sd):.2f}</td><td>{filled:.0f}</td></tr>"
        )
    if not rows:
        return "<p>The skeleton has no joints.</p>"
    head = (
        "<th>joint</th><th>angle, 95 % of frames (°)</th><th>mean (°)</th><th>sd of a value (°)</th><th>filled %</th>"
    )
    return f"<table><tr>{head}</tr>{''.join(rows)}</table>"
