"""``report.html``: one page of a run that needs no other file and no other host."""

import base64
import re
from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any, cast

import numpy as np

from eal.arrays import Z95, Array
from mocap.kinematics.cycles import Cycle, Footfalls, counted, cycles_table, why_none
from mocap.kinematics.extremes import STATISTICS, statistics_of, without_side
from mocap.kinematics.frequency import frequencies
from mocap.kinematics.records import Kinematics, Quantity, Rests
from mocap.manual import what_to_do
from mocap.plots import figures
from mocap.plots.figures import Picture, drawn
from mocap.plots.kinematics import UNITS, label
from mocap.reading.reading import in_options
from mocap.records import Status
from mocap.report.summary import expected_error, length_text, notes, two_digits
from mocap.sides import side_of, words
from mocap.tracking.result import Result

_MEANT = {"body_speed_m_s": "net body speed"}
"""Columns of the table of cycles whose names leave open what they are."""
_NOT_SHOWN = ("recording", "kind", "of", "number", "start_s", "end_s", "filled", "status", "reason")
"""Columns of which a mean says nothing."""


def write_page(run: Result, found: Kinematics, rows: Sequence[Cycle], steps: Footfalls | None, folder: Path) -> None:
    """Write ``figures/`` and ``report.html`` into a folder."""
    shown = list(figures.pictures(run, found, rows, steps))
    page = report_page(run, found, rows, shown, figures.write_pictures(shown, folder))
    (folder / "report.html").write_text(page, encoding="utf-8")


def report_page(
    run: Result, found: Kinematics, rows: Sequence[Cycle], shown: Sequence[Picture], svg: Mapping[str, str]
) -> str:
    """The page: numbers, findings, tables and figures."""
    from jinja2 import Environment
    from markdown_it import MarkdownIt

    environment = Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    template = environment.from_string(files("mocap.plots").joinpath("report.html").read_text(encoding="utf-8"))
    details = MarkdownIt("commonmark", {"html": False}).enable("table")
    sources = {one.name: base64.b64encode(svg[one.name].encode()).decode() for one in shown}
    frames = found.t_s
    none = why_none(run.skeleton, found, rows) if run.skeleton.joints or run.skeleton.measures.cyclic else []
    wrong, left_open = (cast(Sequence[str], run.report.get(key, ())) for key in ("wrong", "open"))
    asked = *wrong, *left_open
    remedies = {f.text: entry for f in run.findings if f.text in asked and (entry := what_to_do(f.kind)) is not None}
    told = dict.fromkeys(remedies[said] for said in asked if said in remedies)
    anchors = {one: f"do{number}" for number, one in enumerate(told, start=1)}
    # title and text of each section but for the findings, which stand on the page
    parts = re.split(r"^## (.*)$", run.report_text, flags=re.MULTILINE)
    sections = [("Tracking", parts[0].partition("\n")[2]), *zip(parts[1::2], parts[2::2], strict=True)]
    return template.render(
        name=run.name,
        run=run,
        fps=(len(frames) - 1) / (frames[-1] - frames[0]) if len(frames) > 1 else 0.0,
        seconds=float(frames[-1] - frames[0]) if len(frames) else 0.0,
        numbers=_numbers(run, rows),
        **{
            key: [(_linked(said), anchors[remedies[said]] if said in remedies else None) for said in texts]
            for key, texts in (("wrong", wrong), ("open", left_open))
        },
        remedies=[(anchors[one], one[0], details.render(one[1])) for one in anchors],
        notes=[
            (title, [_linked(sentence) for sentence in texts])
            for title, texts in (
                ("What was decided or repaired", notes(run.report)),
                ("Quantities that are missing or unknown in some frames", [*found.notes, *none]),
            )
            if texts
        ],
        cycles=_cycles(rows),
        angles=_angles(run, found),
        peaks=_peaks(run, found, rows),
        animal=next((sources[one.name] for one in shown if one.name == "animal"), None),
        figures=[(one, sources[one.name]) for one in shown if one.name != "animal"],
        sections=[(title, details.render(in_options(text))) for title, text in sections if title != "Findings"],
    )


def tracked_html(run: Result) -> str:
    """A run as a notebook shows it: the main numbers, the animal, what is wrong, and what to do next."""
    from mocap.plots.animal import draw_animal

    picture = base64.b64encode(drawn(draw_animal(run), "png", dpi=100)).decode()
    rows = "".join(
        f"<tr><td>{escape(what)}</td><td><b>{escape(value)}</b></td></tr>" for value, what in _numbers(run, ())
    )
    wrong = "".join(f"<li>{escape(sentence)}</li>" for sentence in cast(Sequence[str], run.report.get("wrong", ()))[:3])
    angle = next((f"{joint.name}_flexion_deg" for joint in run.skeleton.joints), "body_speed_m_s")
    following = (
        f'res.plot.over_time("{angle}")',
        "res.kinematics",
        "res.markers.position",
        "res.view()",
        'res.save("out")',
    )
    return (
        f"<b>{escape(run.name)}</b><table>{rows}</table><img style='max-width:100%;background:white' alt='the animal' "
        f"src='data:image/png;base64,{picture}'>{f'<ol>{wrong}</ol>' if wrong else ''}"
        f"<p>Next: {', '.join(f'<code>{escape(one)}</code>' for one in following)}</p>"
    )


def _numbers(run: Result, rows: Sequence[Cycle]) -> list[tuple[str, str]]:
    """The main numbers of a run, and what they are; shares are of the tracked frames."""
    report: Mapping[str, Any] = run.report
    status = run.tracks.status
    status = status[(status != Status.MISSING).any(axis=1)]
    kinds = {"measured": (Status.MEASURED,), "filled": (Status.SMOOTHED, Status.INTERPOLATED)}
    kinds["extrapolated beyond a marker's first or last observation"] = (Status.PREDICTED,)
    shares = {word: float(np.isin(status, which).mean()) for word, which in kinds.items()}
    out = [(f"{share:.1%}", f"of the points {word}") for word, share in shares.items() if share or word == "measured"]
    error = expected_error(report)
    if error is not None:
        out.append((f"{two_digits(error.rmse)} {error.unit}", "error to expect in gaps (RMS)"))
        if error.half_width is not None:
            out.append((f"± {two_digits(error.half_width)} {error.unit}", "median 95 % interval in gaps"))
        if error.wrong_by is not None:
            out.append((f"{error.z:.2f}", f"errors in gaps over stated sd: intervals are too {error.wrong_by}"))
    if report.get("length_m"):
        out.append((length_text(report["length_m"]), "length of the animal"))
    return out + [(one.number, one.meaning) for one in frequencies(rows)[:1]]


def _linked(finding: str) -> list[tuple[str, str]]:
    """A sentence in parts: frames are links, what stands between backquotes is code, the rest has no kind."""
    parts = re.split(r"(frames? \d+(?: (?:to|and) \d+)?|`[^`]+`)", in_options(finding))
    kinds = ["" if k % 2 == 0 else "code" if part[0] == "`" else "link" for k, part in enumerate(parts)]
    return [(part.strip("`"), kind) for part, kind in zip(parts, kinds, strict=True) if part]


def _titled(column: str) -> tuple[str, str]:
    """A column as words, and its unit."""
    unit = next(
        (
            text
            for end, text in sorted((UNITS | {"hz": "Hz", "s": "s"}).items(), key=lambda one: -len(one[0]))
            if column.endswith(f"_{end}")
        ),
        "",
    )
    return _MEANT.get(column, label(column).removesuffix(" hz").removesuffix(" s")), unit


def _cycles(rows: Sequence[Cycle]) -> dict[str, Any] | None:
    """Mean and standard deviation over the cycles of each limb that are not doubtful; None: there are none."""
    rows = counted(rows)
    if not rows:
        return None
    table = cycles_table(rows)
    columns = [c for c in table.columns if c not in _NOT_SHOWN and "_sd_" not in c]
    lines = []
    for kind, of in dict.fromkeys(zip(table["kind"], table["of"], strict=True)):
        some = table[(table["kind"] == kind) & (table["of"] == of)]
        values = [np.asarray(some[c], dtype=float) for c in columns]
        cells = [f"{np.nanmean(v):.3g} ± {np.nanstd(v):.2g}" if np.isfinite(v).any() else "–" for v in values]
        lines.append([f"{words(str(of))}, {str(kind).replace('_', ' ')}s", str(len(some)), *cells])
    return {"columns": [("limb", ""), ("n", ""), *map(_titled, columns)], "lines": lines}


def _shown_angles(run: Result, found: Kinematics) -> list[tuple[str, Quantity]]:
    """Titles and values of the angles that the report tells: flexion of joints, rotations of joints of bodies."""
    shown = [(words(joint.name), f"{joint.name}_flexion_deg") for joint in run.skeleton.joints]
    for joint in run.skeleton.body_joints:
        shown += [(f"{words(joint.name)}, {axis}", f"{joint.name}_rotation_{axis}_deg") for axis in "zyx"]
    return [(title, found[name]) for title, name in shown if name in found and np.isfinite(found[name].value).any()]


def _peaks(run: Result, found: Kinematics, rows: Sequence[Cycle]) -> dict[str, Any] | None:
    """Peak, trough, range and mean of these angles in the cycles that are not doubtful, largest range first.

    Mean and standard deviation over cycles, and the median 95 % interval of one cycle's peak. None: there is none.
    """
    lines = []
    shown = _shown_angles(run, found)
    every = statistics_of([q for _, q in shown], found, counted(rows))
    for title, q in shown:
        table = every.loc[(every["quantity"] == without_side(q.name)) & (every["side"] == side_of(q.name))]
        for of in table["of"].unique():
            some = table[table["of"] == of]
            values = {name: np.asarray(some["value"][some["statistic"] == name]) for name in STATISTICS}
            cells = [_mean_sd(values[name]) for name in ("peak", "trough", "range", "mean")]
            own = f"± {Z95 * np.median(some['sd'][some['statistic'] == 'peak']):.2g}"
            at = _mean_sd(100 * values["peak_phase"])
            line = [title, words(of), str(len(values["peak"])), cells[0], own, *cells[1:], at]
            lines.append((values["range"].mean(), line))
    columns = [("joint", ""), ("cycles of", ""), ("n", ""), ("peak", "°"), ("95 % interval of one (median)", "°")]
    columns += [("trough", "°"), ("range", "°"), ("mean", "°"), ("time of peak", "% of the cycle")]
    ordered = [line for _, line in sorted(lines, key=lambda one: -one[0])]
    return {"columns": columns, "lines": ordered} if ordered else None


def _mean_sd(values: Array) -> str:
    spread = f" ± {values.std(ddof=1):.2g}" if len(values) > 1 else ""
    return f"{values.mean():.1f}{spread}"


def _angles(run: Result, found: Kinematics) -> dict[str, Any] | None:
    """Flexion of each joint, rotations of joints of bodies, that which moves most first; None: there is none."""
    lines = []
    for title, q in _shown_angles(run, found):
        low, high = np.nanpercentile(q.value, [2.5, 97.5])
        filled = float(np.mean(q.rests == Rests.FILLED))
        cells = [f"{low:.0f} to {high:.0f}", f"{np.nanmean(q.value):.1f}", f"± {np.nanmedian(q.high - q.low) / 2:.2g}"]
        lines.append((high - low, [title, *cells, f"{filled:.0%}"]))
    columns = [("joint", ""), ("95 % of frames", "°"), ("mean", "°"), ("95 % interval (median)", "°"), ("filled", "")]
    ordered = [cells for _, cells in sorted(lines, key=lambda one: -one[0])]
    return {"columns": columns, "lines": ordered} if ordered else None
