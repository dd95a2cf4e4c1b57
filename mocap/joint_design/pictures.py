"""Potential and strain energy side by side, as the paper's figures 7 and 9, and the truss at work."""

from typing import cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure as Canvas
from mpl_toolkits.mplot3d import Axes3D
from numpy.typing import NDArray

from eal.arrays import Array
from eal.joint_design import LEVELS, member_forces
from mocap.joint_design.design import JointDesign
from mocap.joint_design.drawing import COLOURS, INK, SPRING
from mocap.joint_design.flexure import MM

_FRAMES = 6


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
        axes.contourf(x, y, value, levels=np.linspace(0.0, 1.0, 21), cmap="viridis")
        axes.plot(*samples.T, ".", color="white", markersize=1.5, alpha=0.5)
        axes.contour(x, y, value, levels=LEVELS, colors="white", linewidths=1.0)
        axes.set_aspect("equal")
        axes.set_xlabel("$q_1$ (mm)")
        axes.set_ylabel("$q_2$ (mm)")
    maps[1].contour(x, y, v, levels=LEVELS, colors="black", linewidths=1.0, linestyles="--")
    maps[0].set_title("white: levels 0.25, 0.5, 0.75; dots: samples", fontsize=9)
    maps[1].set_title("white: levels of U, cut at 1; black dashed: the same levels of $V_z$", fontsize=9)
    scale = ScalarMappable(Normalize(0.0, 1.0), "viridis")
    canvas.colorbar(scale, ax=maps, label="normalised: $V_z$, and (U - U stored) / U(V = 1)", shrink=0.8)
    return canvas


def _surface(axes: Axes3D, x: Array, y: Array, value: Array, name: str) -> None:
    axes.plot_surface(
        *np.meshgrid(x, y), value, cmap="viridis", vmin=0, vmax=1, rstride=1, cstride=1, antialiased=False
    )
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
    chosen = _moments(states.q_m)
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


def _moments(q: Array) -> Array:
    """(6,) frames, one nearest to each of six evenly spaced places along the principal direction of the way."""
    centred = q - q.mean(axis=0)
    along = centred @ np.linalg.svd(centred, full_matrices=False)[2][0]
    wanted = np.linspace(along.min(), along.max(), _FRAMES)
    return np.array([int(np.argmin(np.abs(along - place))) for place in wanted])


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
