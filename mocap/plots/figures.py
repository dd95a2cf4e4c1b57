"""Figures of a run, or of one video, for people who open no viewer."""

import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np

from eal.arrays import Z95
from mocap.kinematics.cycles import Cycle, Ensemble, Footfalls, counted, ensemble
from mocap.kinematics.records import Kinematics
from mocap.plots import kinematics as plots
from mocap.plots.animal import draw_animal
from mocap.plots.kinematics import COLOURS, labelled, legend_above, new_axes, shade
from mocap.records import Status
from mocap.sides import TRUNK, side_of, words
from mocap.tracking.result import Result

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, FigureBase

FOLDER = "figures"
DPI = 200  # of printed images


@dataclass(frozen=True, eq=False, kw_only=True)
class Picture:
    """A figure with what it shows.

    Attributes:
        name: Of its files.
        caption: What it shows, in a sentence or two.
        figure: What was drawn.
    """

    name: str
    caption: str
    figure: "FigureBase"


def pictures(run: Result, found: Kinematics, rows: Sequence[Cycle], steps: Footfalls | None) -> Iterator[Picture]:
    """The figures of a run: those for which it has something to show."""
    yield Picture(
        name="animal",
        caption="The animal at the two extremes of its largest motion and half-way, and the path of its body.",
        figure=draw_animal(run),
    )
    turns = [f"{j.name}_rotation_{axis}_deg" for j in run.skeleton.body_joints for axis in "zyx"]
    joints = _most_moving(found, [*(f"{j.name}_flexion_deg" for j in run.skeleton.joints), *turns])
    if joints:
        pairs = plots.stacked(len(joints))
        for (ax, below), sides in zip(pairs, joints, strict=True):
            plots.lines_over_time(ax, below, [found[name] for name in sides], found.t_s)
        pairs[-1][1].set_xlabel("time (s)", fontsize=7)
        yield Picture(
            name="angles",
            caption="Angles of the joints that move most (flexion 0°: straight), on both sides; below each, half the "
            "width of the 95 % interval. Bars at the bottom: one of the joint's markers was filled. Triangles: the "
            "interval leaves the axes there, as it is wider than the curve is high.",
            figure=pairs[0][0].figure,
        )
    for kind, of in (("wing_beat", "wing beat"), ("stride", "stride")):
        some = [row for row in counted(rows) if row.kind == kind]
        if not some:
            continue
        limbs = [limb for limb in dict.fromkeys(row.of for row in some) if len(joints)][:2]
        drawn = [(limb, curves) for limb in limbs if (curves := _curves(found, some, limb, joints))]
        if drawn:
            axes = plots.beside_each_other(len(drawn), rows=1 + max(len(curves) for _, curves in drawn))
            for ax, (limb, curves) in zip(axes, drawn, strict=True):
                turning = float(np.mean([row.downstroke_fraction for row in some if row.of == limb]))
                plots.plot_by_phase(curves, unit="deg", of=f"{of} of the {words(limb)}", turning=turning, ax=ax)
            yield Picture(
                name=f"angles_by_phase_{kind}",
                caption=f"The same angles over the phase of the {of}: mean, its 95 % interval over cycles "
                "(Student's t), and each cycle (thin).",
                figure=axes[0].figure,
            )
        yield Picture(
            name=f"frequency_{kind}",
            caption=f"Frequency of each {of}, with its 95 % interval.",
            figure=plots.plot_cycle_values(some, "frequency_hz", unit="Hz").figure,
        )
    if "body_speed_m_s" in found and np.isfinite(found["body_speed_m_s"].value).any():
        yield Picture(
            name="speed",
            caption=f"Speed of the body (mean of {'trunk' if run.skeleton.trunk else 'all'} markers) with its 95 % "
            "interval.",
            figure=plots.plot_over_time(found, ["body_speed_m_s"]).figure,
        )
    if steps is not None:
        yield Picture(name="gait", caption="Gait diagram: when each foot stands.", figure=plots.plot_gait(steps).figure)
    for name in list(run.skeleton.measures.strokes)[:1]:
        if f"{name}_stroke_deg" in found:
            yield Picture(
                name="stroke_plane",
                caption=f"Path of the {words(name)} in and out of its stroke plane, in axes of the trunk.",
                figure=plots.plot_stroke_path(found, name, [row for row in counted(rows) if row.of == name]).figure,
            )
    markers = run.tracks
    yield Picture(
        name="gaps",
        caption="Where markers were not measured, and what stands in their place.",
        figure=plots.plot_gaps(markers.names, markers.t_s, markers.status).figure,
    )
    if run.cameras:
        away = np.linalg.norm(run.ideal_px - run.reprojected_px, axis=-1)
        yield Picture(
            name="residuals",
            caption="Reprojection error of each camera.",
            figure=plots.plot_residuals(run.camera_names, away, run.used).figure,
        )


def _most_moving(found: Kinematics, names: Sequence[str], most: int = 3) -> list[list[str]]:
    """The angles that move most, both sides of a joint together, of those known in half as many frames as the best."""
    count = {n: int(np.isfinite(found[n].value).sum()) for n in names if n in found}
    some = [name for name, number in count.items() if number >= max(8, 0.5 * max(count.values()))]
    pairs: dict[str, list[str]] = {}
    for name in some:
        pairs.setdefault(words(name).removeprefix("left ").removeprefix("right "), []).append(name)
    return sorted(pairs.values(), key=lambda pair: -max(float(np.nanstd(found[n].value)) for n in pair))[:most]


def _curves(found: Kinematics, rows: Sequence[Cycle], limb: str, joints: Sequence[Sequence[str]]) -> list[Ensemble]:
    """The joints' angles on the side of a limb (on both where it has none) over the phase of its cycles."""
    side = side_of(limb)
    names = [name for pair in joints for name in pair if TRUNK in (side, side_of(name)) or side_of(name) == side]
    cycle = [row for row in rows if row.of == limb]
    return [one for one in (ensemble(found, cycle, name) for name in names) if one.n > 1]


def write_pictures(shown: Sequence[Picture], folder: Path) -> dict[str, str]:
    """Write each as PNG (``DPI``) and SVG, and return the SVG text by name."""
    (folder / FOLDER).mkdir()
    out: dict[str, str] = {}
    for one in shown:
        figure = cast("Figure", one.figure)
        if (engine := figure.get_layout_engine()) is not None:  # once for both files
            figure.set_dpi(DPI)
            engine.execute(figure)
            figure.set_layout_engine(None)
        (folder / FOLDER / f"{one.name}.png").write_bytes(drawn(one.figure, "png"))
        svg = drawn(one.figure, "svg")
        (folder / FOLDER / f"{one.name}.svg").write_bytes(svg)
        out[one.name] = svg.decode("utf-8")
    return out


def drawn(figure: "FigureBase", kind: str, *, dpi: int = DPI) -> bytes:
    """A figure as PNG or SVG, the same bytes each time."""
    import matplotlib as mpl

    made = io.BytesIO()
    # level 3 of zlib's 9: files 4 % larger than at 6, in 0.6 of the time
    options = {"metadata": {"Date": None}} if kind == "svg" else {"pil_kwargs": {"compress_level": 3}}
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "mocap"}):
        figure.savefig(made, format=kind, dpi=dpi, **options)  # type: ignore[attr-defined]
    return made.getvalue()


def write_plane_figures(run: Result, folder: Path) -> None:
    """Write ``figures/paths`` and a figure of each coordinate, PNG and SVG."""
    write_pictures(list(plane_pictures(run)), folder)


def plane_pictures(run: Result) -> Iterator[Picture]:
    """Paths of all markers; x and y over time of the six that are seen most."""
    assert run.plane is not None
    markers, (xy, cov) = run.tracks, run.plane.in_units(run.tracks)
    unit, filled = run.plane.unit, np.isin(markers.status, (Status.SMOOTHED, Status.PREDICTED))
    yield Picture(
        name="paths",
        caption="Paths in the image, rows downwards; thin grey where filled.",
        figure=_paths(xy, filled, markers.names, unit).figure,
    )
    most = np.argsort(-(markers.status == Status.MEASURED).sum(axis=0), kind="stable")[: len(COLOURS)]
    for axis, title in enumerate("xy"):
        ax = new_axes(width_mm=180, rows=1 + (len(most) - 1) // 6)
        shade(ax, markers.t_s, np.asarray(filled[:, most].sum(axis=1) > 0))
        for m, colour in zip(most, COLOURS, strict=False):
            value, half = xy[:, m, axis], Z95 * np.sqrt(cov[:, m, axis, axis])
            ax.fill_between(markers.t_s, value - half, value + half, color=colour, alpha=0.25, linewidth=0)
            ax.plot(markers.t_s, value, color=colour, linewidth=0.9, label=markers.names[m])
        labelled(ax, "time (s)        band: 95 % interval; grey: one of these markers was filled", f"{title} ({unit})")
        legend_above(ax, size=7, ncols=6)
        yield Picture(name=f"{title}_over_time", caption=f"{title} of markers with 95 % intervals.", figure=ax.figure)


def _paths(xy: np.ndarray, filled: np.ndarray, names: tuple[str, ...], unit: str) -> "Axes":
    ax = new_axes(width_mm=120, height_mm=100)
    for m in range(len(names)):
        colour = COLOURS[m % len(COLOURS)]
        ax.plot(*xy[:, m].T, color="#BBBBBB", linewidth=0.5)
        ax.plot(*np.where(filled[:, m, None], np.nan, xy[:, m]).T, color=colour, linewidth=0.9)
        finite = np.flatnonzero(np.isfinite(xy[:, m, 0]))
        if len(finite):
            ax.annotate(names[m], xy[finite[0], m], fontsize=5, color=colour)
    ax.set_aspect("equal", adjustable="datalim")
    ax.invert_yaxis()
    labelled(ax, f"x ({unit})", f"y ({unit})")
    return ax
