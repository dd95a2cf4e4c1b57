"""The workshop drawing: plan with dimensions, and the table of members; PNG and SVG."""

from collections.abc import Sequence
from typing import cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure as Canvas
from matplotlib.patches import Circle, Polygon
from mpl_toolkits.mplot3d import Axes3D
from numpy.typing import NDArray

from eal.arrays import Array
from eal.joint_design import LEVELS, Truss, equilibria, member_forces
from eal.plot import COLORS
from mocap.joint_design.design import JointDesign
from mocap.joint_design.flexure import MM, Flexure
from mocap.joint_design.solid import FOOT_MM, PLATE_MM, Kit, meander_line

_FRAMES = 6  # of the strip


def figure_7_and_9(design: JointDesign) -> Canvas:
    """V_z left, U right: surfaces above, maps with their level sets below, all on one scale; animal size."""
    canvas = Canvas(figsize=(13.0, 8.2), layout="constrained")
    x, y = (axis * design.source.unit_m / MM for axis in design.target.axes)
    v = design.target.v.reshape(design.target.shape).T
    u = np.clip(design.fit.u.reshape(design.target.shape).T, 0.0, 1.0)
    names = (
        f"empirical potential $V_z$ of {design.source.name} (as Fig. 7)",
        "strain energy U of the truss (as Fig. 9)",
    )
    for i, (value, name) in enumerate(zip((v, u), names, strict=True)):
        surface = canvas.add_subplot(2, 2, 1 + i, projection="3d")
        _surface(cast(Axes3D, surface), x, y, value, name)
    samples = design.source.potential.samples * design.source.unit_m / MM
    maps = [canvas.add_subplot(2, 2, 3), canvas.add_subplot(2, 2, 4)]
    for axes, value in zip(maps, (v, u), strict=True):
        axes.contourf(x, y, value, levels=np.linspace(0.0, 1.0, 21), cmap=COLORS)
        axes.plot(*samples.T, ".", color="black", markersize=1.5, alpha=0.5)
        axes.contour(x, y, value, levels=LEVELS, colors="white", linewidths=1.0)
        axes.set_aspect("equal")
        axes.set_xlabel("$q_1$ (mm)")
        axes.set_ylabel("$q_2$ (mm)")
    maps[1].contour(x, y, v, levels=LEVELS, colors="black", linewidths=1.0, linestyles="--")
    maps[0].set_title("white: levels 0.25, 0.5, 0.75; dots: samples", fontsize=9)
    maps[1].set_title("white: levels of U, cut at 1; black dashed: the same levels of $V_z$", fontsize=9)
    scale = ScalarMappable(Normalize(0.0, 1.0), COLORS)
    canvas.colorbar(scale, ax=maps, label="normalised: $V_z$, and (U - U stored) / U(V = 1)", shrink=0.8)
    return canvas


def _surface(axes: Axes3D, x: Array, y: Array, value: Array, name: str) -> None:
    axes.plot_surface(*np.meshgrid(x, y), value, cmap=COLORS, vmin=0, vmax=1, rstride=1, cstride=1, antialiased=False)
    axes.set_box_aspect((np.ptp(x), np.ptp(y), 0.2 * max(np.ptp(x), np.ptp(y))), zoom=1.3)  # pyright: ignore[reportArgumentType]
    axes.set_zlim(0.0, 1.0)
    axes.zaxis.set_ticks([0.0, 1.0])
    axes.view_init(elev=60, azim=-80)
    axes.set_xlabel("$q_1$ (mm)")
    axes.set_ylabel("$q_2$ (mm)")
    axes.set_title(name, fontsize=11)


def motion(design: JointDesign) -> Canvas:
    """The truss at moments of the recorded motion, members coloured by stretch, and U beside V_z along it."""
    canvas = Canvas(figsize=(16.0, 7.2), layout="constrained")
    strip, below = cast(NDArray, canvas.subfigures(2, 1, height_ratios=[1.35, 1.0]))
    states = design.way.states
    unit = design.source.unit_m / MM
    # (6,) frames, one nearest to each of six evenly spaced places along the principal direction of the way
    centred = states.q_m - states.q_m.mean(axis=0)
    along = centred @ np.linalg.svd(centred, full_matrices=False)[2][0]
    wanted = np.linspace(along.min(), along.max(), _FRAMES)
    chosen = np.array([int(np.argmin(np.abs(along - place))) for place in wanted])
    nodes = np.concatenate([design.design.truss.fixed_m, design.target.q[design.target.inside]]) * unit
    for axes, k in zip(strip.subplots(1, _FRAMES, sharex=True, sharey=True), chosen, strict=True):
        _truss_at(axes, design, int(k), unit)
        margin = 0.06 * float(np.ptp(nodes, axis=0).max())
        axes.set_xlim(nodes[:, 0].min() - margin, nodes[:, 0].max() + margin)
        axes.set_ylim(nodes[:, 1].min() - margin, nodes[:, 1].max() + margin)
    strip.suptitle(
        f"{design.source.name}: the truss over the recorded motion (mm at the animal's size); "
        "orange springs, blue cables, green struts, pale without force",
        fontsize=10,
    )
    axes = below.subplots()
    v = design.source.potential.value(states.q_m)
    axes.plot(design.source.t_s, v, color=INK, linewidth=1.2, label="$V_z(q(t))$")
    axes.plot(design.source.t_s, states.energy_j - design.design.stored, color=SPRING, linewidth=1.0, label="U(q(t))")
    for k in chosen:
        axes.axvline(design.source.t_s[k], color="0.85", linewidth=0.8, zorder=0)
    axes.set_xlabel("t (s)")
    axes.set_ylabel("normalised energy")
    axes.legend(frameon=False, loc="upper right")
    return canvas


def _truss_at(axes: Axes, design: JointDesign, k: int, unit: float) -> None:
    truss, states = design.design.truss, design.way.states
    grid = [axis * unit for axis in design.target.axes]
    v = design.target.v.reshape(design.target.shape).T
    axes.contourf(*grid, v, levels=[-1.0, design.target.level], colors=["#eef2f8"])
    nodes = np.concatenate([truss.fixed_m, states.q_m[k : k + 1], states.x_m[k]]) * unit
    force = np.abs(member_forces(truss, states.stretch[k]))
    for (a, b), law, pull in zip(truss.ends, truss.laws, force / max(force.max(), 1e-12), strict=True):
        colour = COLOURS.get(law, SPRING)
        axes.plot(*nodes[[a, b]].T, color=colour, linewidth=1.2 + 1.6 * pull, alpha=0.25 + 0.75 * float(pull))
    axes.plot(*nodes[: len(truss.fixed_m)].T, "o", color="white", markeredgecolor=INK, markersize=5)
    axes.plot(*nodes[truss.moving], "o", color=INK, markersize=6)
    axes.plot(0, 0, "+", color=INK, markersize=9)
    axes.set_title(f"t = {design.source.t_s[k]:.3f} s", fontsize=8)
    axes.set_aspect("equal")
    axes.tick_params(labelsize=7)


INK, FAINT, REGION = "#1b1f27", "#9aa3b2", "#dfe7f3"
COLOURS = {"cable": "#0072b2", "strut": "#009e73"}
SPRING = "#d55e00"
"""Colour of members of other laws."""


def drawing(design: JointDesign) -> Canvas:
    """Plan on the left, members on the right; sizes in millimetres as printed."""
    canvas = Canvas(figsize=(16.5, 9.6), layout="constrained")
    rows = len(design.truss.rest_m)
    places = canvas.subplot_mosaic(
        [["plan", "table"], ["plan", "notes"], ["plan", "side"]],
        width_ratios=[1.2, 1.0],
        height_ratios=[0.36 * (rows + 2), 1.2, max(7.0 - 0.36 * rows, 2.5)],
    )
    _plan(places["plan"], design)
    _table(places["table"], design)
    _side(places["side"], design.kit)
    places["notes"].set_axis_off()
    lines = [
        f"U(V = 1) = {design.energy_j / MM:.3g} mJ; U - V_z inside the region: {design.fit.rms:.3f} RMS",
        "lengths in mm as printed; rest: between pin centres (of cables and struts where their force begins)",
    ]
    if design.kit is not None:
        printing = design.kit.printing
        lines.append(
            f"{printing.material.name}: E = {printing.material.young_pa / 1e6:g} MPa, strain up to "
            f"{100 * printing.material.strain:g} %; walls {printing.wall_m / MM:g} mm or more; pins "
            f"{printing.pin_m / MM:g} mm, holes {printing.hole_m / MM:g} mm"
        )
    places["notes"].text(0.5, 0.5, "\n".join(lines), fontsize=9, va="center", ha="center", color=INK)
    canvas.suptitle(
        f"{design.source.name}: truss with U = V_z, {len(design.truss.rest_m)} members, printed "
        f"{design.metre_per_unit / design.source.unit_m:.3g} times the animal's size",
        fontsize=13,
        color=INK,
    )
    return canvas


def _plan(axes: Axes, design: JointDesign) -> None:
    truss, kit = design.truss, design.kit
    grid = [axis * design.metre_per_unit / MM for axis in design.target.axes]
    v = design.target.v.reshape(design.target.shape).T
    axes.contourf(*grid, v, levels=[-1.0, design.wish.level], colors=[REGION])
    axes.contour(*grid, v, levels=[0.5], colors=[FAINT], linewidths=0.8, linestyles="--")
    q = rest_point(design)
    if kit is not None:
        plate = np.array(kit.parts[0].solid.slice(PLATE_MM / 2).to_polygons()[0])
        axes.add_patch(Polygon(plate, closed=True, fill=False, edgecolor=FAINT, linewidth=1.0))
        # width and height of the base plate, with arrows
        (x0, y0), (x1, y1) = plate.min(axis=0), plate.max(axis=0)
        gap = 0.05 * max(x1 - x0, y1 - y0)
        arrow = {"arrowstyle": "<->", "color": FAINT, "linewidth": 0.9}
        axes.annotate("", (x0, y0 - gap), (x1, y0 - gap), arrowprops=arrow)
        axes.annotate("", (x1 + gap, y0), (x1 + gap, y1), arrowprops=arrow)
        axes.text((x0 + x1) / 2, y0 - 1.5 * gap, f"{x1 - x0:.1f} mm", ha="center", va="top", fontsize=8, color=INK)
        axes.text(x1 + 1.4 * gap, (y0 + y1) / 2, f"{y1 - y0:.1f} mm", va="center", rotation=90, fontsize=8, color=INK)
        axes.update_datalim([(x0, y0 - 3.0 * gap), (x1 + 3.0 * gap, y1)])
    nodes = np.concatenate([truss.fixed_m, q[None], equilibria(truss, q[None]).x_m[0]])
    for i, (start, end) in enumerate(truss.ends):
        colour = COLOURS.get(truss.laws[i], SPRING)
        line = nodes[[start, end]] if kit is None else _placed(kit.flexures[i], kit, q, nodes[start])
        axes.plot(*(line.T / MM), color=colour, linewidth=0.9, zorder=3)
        axes.add_patch(Circle(tuple(nodes[start] / MM), 2.0, facecolor="white", edgecolor=INK, zorder=4))
        _label(axes, nodes[start] / MM, nodes[end] / MM, f"{i + 1}")
    axes.plot(0, 0, marker="+", color=INK, markersize=14, zorder=5)
    posts = np.unique(nodes[truss.ends[:, 0]], axis=0) / MM
    _note(axes, np.zeros(2), "joint (0, 0)", posts)
    axes.plot(*(q / MM), "o", color=INK, markersize=6, zorder=5)
    _note(axes, q / MM, f"moving point, least V\n({q[0] / MM:.1f}, {q[1] / MM:.1f})", posts)
    axes.set_aspect("equal")
    axes.margins(0.08)
    axes.set_xlabel("along the parent segment's axis (mm)")
    axes.set_ylabel("across it (mm)")
    axes.set_title(
        f"Plan; {legend(truss.laws)} (drawn as at the point of least V_z);\n"
        "shaded: where V_z < level, dashed: V_z = 0.5",
        fontsize=9,
    )
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def legend(laws: Sequence[str]) -> str:
    """What the colours of the members are, of those that there are: ``springs orange, struts green``."""
    words = [name for name, law in (("cables blue", "cable"), ("struts green", "strut")) if law in laws]
    return ", ".join([*(["springs orange"] if set(laws) - set(COLOURS) else []), *words])


def _note(axes: Axes, at: Array, text: str, posts: Array) -> None:
    """A text beside a point, on the side where it is furthest from the posts, on white."""
    size = max(float(np.ptp(posts, axis=0).max()), 1e-9)
    sides = [np.array([x, y]) for x in (-1.0, 1.0) for y in (-1.0, 1.0)]
    room = [np.linalg.norm(posts - (at + np.array([0.16, 0.06]) * size * side), axis=1).min() for side in sides]
    x, y = sides[int(np.argmax(room))]
    axes.annotate(
        text, tuple(at), xytext=(10 * x, 9 * y), textcoords="offset points", fontsize=8, color=INK, zorder=6,
        ha="left" if x > 0 else "right", va="bottom" if y > 0 else "top",
        bbox={"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.85},
    )  # fmt: skip


def rest_point(design: JointDesign) -> Array:
    """(2,) the moving point where V is least, in printed metres."""
    return design.target.q[np.argmin(design.target.v)] * design.metre_per_unit


def _placed(flexure: Flexure, kit: Kit, q_m: Array, node_m: Array) -> Array:
    """(K, 2) centre line of a member from the moving point to its post."""
    way = node_m - q_m
    length = float(np.linalg.norm(way))
    line = meander_line(flexure, length, kit.printing)
    along = way / length
    across = np.array([-along[1], along[0]])
    inside = np.concatenate([[[0.0, 0.0]], line, [[max(length, line[-1, 0]), 0.0]]])
    return q_m + inside[:, :1] * along + inside[:, 1:] * across


def _label(axes: Axes, node: Array, q: Array, text: str) -> None:
    away = (node - q) / max(float(np.linalg.norm(node - q)), 1e-9)
    axes.annotate(
        text, tuple(node), xytext=tuple(11 * away), textcoords="offset points", ha="center", va="center", fontsize=9,
        fontweight="bold", color=INK,
    )  # fmt: skip


def member_rows(truss: Truss, kit: Kit | None) -> tuple[list[str], list[list[str]]]:
    """Heads and cells of the table of members, lengths in mm and stiffnesses in N/m."""
    posts = ["post x", "post y", "post z"][: truss.dimension]
    heads = ["", "law", *posts, *([] if len(truss.internal_m) == 0 else ["to"]), "rest", "N/m"]
    rows = []
    for i, (start, end) in enumerate(truss.ends):
        where = [f"{c / MM:.2f}" for c in truss.fixed_m[start]] if start < truss.moving else [f"node {start}", ""]
        to = [] if len(truss.internal_m) == 0 else ["point" if end == truss.moving else f"node {end}"]
        rows.append([str(i + 1), truss.laws[i], *where, *to, f"{truss.rest_m[i] / MM:.2f}"])
        rows[-1].append(f"{truss.stiffness_n_m[i]:.4g}")
    if kit is not None:
        heads += ["beams", "width", "thick", "deep", "slot", "strain", "layer"]
        for i, flexure in enumerate(kit.flexures):
            sizes = (flexure.width_m, flexure.thickness_m, flexure.depth_m, flexure.slot_m)
            rows[i] += [str(flexure.beams), *(f"{size / MM:.2f}" for size in sizes)]
            rows[i] += [f"{100 * flexure.strain:.2f} %", str(kit.stack.order.index(i) + 1)]
    return heads, rows


def _table(axes: Axes, design: JointDesign) -> None:
    axes.set_axis_off()
    heads, rows = member_rows(design.truss, design.kit)
    table = axes.table(cellText=rows, colLabels=heads, loc="upper center", cellLoc="center")
    table.auto_set_font_size(False)
    table.set_fontsize(8)
    table.auto_set_column_width(list(range(len(heads))))
    table.scale(1.0, 1.5)
    for (row, _), cell in table.get_celld().items():
        cell.set_edgecolor("#d5dae3")
        if row == 0:
            cell.set_text_props(fontweight="bold", color=INK)


def _side(axes: Axes, kit: Kit | None) -> None:
    axes.set_axis_off()
    if kit is None:
        return
    tops = [bottom + flexure.depth_m / MM for bottom, flexure in zip(kit.bottoms_mm, kit.flexures, strict=True)]
    bars = [(0.0, PLATE_MM, "base plate", FAINT), (PLATE_MM, PLATE_MM + FOOT_MM, "foot of the moving pin", INK)]
    bars += [
        (
            kit.bottoms_mm[i],
            tops[i],
            f"member {i + 1}" + (" (post hangs)" if i in kit.stack.hanging else ""),
            COLOURS.get(kit.flexures[i].law, SPRING),
        )
        for i in kit.stack.order
    ]
    if kit.stack.hanging:
        bars.append((kit.top_mm, kit.top_mm + PLATE_MM, "top plate", FAINT))
    for low, high, name, colour in bars:
        axes.barh((low + high) / 2, 1.0, height=high - low, color=colour, alpha=0.45)
        axes.text(0.5, (low + high) / 2, name, ha="center", va="center", fontsize=7, color=INK)
        axes.text(1.02, (low + high) / 2, f"{low:.2f} to {high:.2f} mm", va="center", fontsize=7, color=INK)
    axes.set_xlim(-0.6, 1.9)
    axes.set_title("layers, from the side", fontsize=9)
