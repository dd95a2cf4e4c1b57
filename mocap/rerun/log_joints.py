"""Joints over time, and over their empirical potentials: as a surface and as a map, in millimetres."""

import numpy as np
import rerun as rr

from mocap.arrays import Array
from mocap.records import JointTracks
from mocap.rerun import palette, paths
from mocap.rerun.chart import log_chart
from mocap.rerun.columns import segments, single, time_columns
from mocap.rerun.energy import JointEnergy
from mocap.rerun.landscape import MM_PER_M, RANGE, Landscape, normals, triangles
from mocap.rerun.log_moving import log_moving
from mocap.rerun.series import log_line

COORDINATES = ("q1", "q2", "q3")
_DECADES = 8
"""Decades of eigenvalues that are drawn."""


def log_coordinates(rec: rr.RecordingStream, tracks: JointTracks, name: str) -> None:
    """The coordinates of one joint of the tracks, in millimetres."""
    lines = tracks.q_m[:, tracks.names.index(name)] * MM_PER_M
    n_lines = lines.shape[1]
    path = f"{paths.joint_series(name)}/coordinates"
    log_line(rec, path, tracks.t_s, lines, name=COORDINATES[:n_lines], color=palette.SERIES[:n_lines])


def log_potential(rec: rr.RecordingStream, name: str, t_s: Array, land: Landscape) -> None:
    """A joint's potential with its samples, its range and preferred configurations, and the joint moving over it.

    Args:
        rec: Where to.
        name: Joint name.
        t_s: (T,) times.
        land: Potential, samples and path.
    """
    _log_surface(rec, paths.surface(name), t_s, land)
    _log_heat_map(rec, paths.heat_map(name), t_s, land)
    _log_energy(rec, paths.joint_series(name), t_s, land.path_value, land.energy)
    _log_spectrum(rec, paths.spectrum(name), land)


def _log_energy(rec: rr.RecordingStream, path: str, t_s: Array, value: Array, energy: JointEnergy) -> None:
    """V_z on the way with the bound of Theorem 3, and the energy that this bound rests on."""
    log_line(
        rec,
        f"{path}/potential/bound",
        t_s,
        energy.bound,
        name="Theorem 3, released at the fastest instant",
        color=palette.GREY,
    )
    log_line(rec, f"{path}/potential/value", t_s, value, name="V_z(q(t))", color=palette.ORANGE)
    lines = {
        "total": (energy.kinetic + energy.potential, palette.WHITE),
        "kinetic": (energy.kinetic, palette.SKY_BLUE),
        "V_z / eps²": (energy.potential, palette.ORANGE),
    }
    values = np.column_stack([line for line, _ in lines.values()])
    log_line(rec, f"{path}/energy", t_s, values, name=tuple(lines), color=[color for _, color in lines.values()])


def _log_spectrum(rec: rr.RecordingStream, path: str, land: Landscape) -> None:
    """Eigenvalues of T_z over their number on a logarithmic scale, and lambda across."""

    def height(value: Array) -> Array:
        return 1 + np.log10(np.maximum(value, 10.0**-_DECADES)) / _DECADES

    n = len(land.eigenvalues)
    shown = land.eigenvalues > 10.0**-_DECADES
    number = np.arange(1, n + 1)[shown]
    most = max(int(number[-1]) if len(number) else 1, 2)
    dots = np.column_stack([(number - 1) / (most - 1), height(land.eigenvalues[shown])])
    level = float(height(np.array(land.lam)))
    log_chart(
        rec,
        path,
        lines=[(np.array([(0.0, level), (1.0, level)]), palette.ORANGE)],
        dots=(dots, palette.SKY_BLUE),
        ticks=[
            *((-0.07, 1 - d / _DECADES, f"1e-{d}" if d else "1") for d in range(0, _DECADES, 2)),
            (0.0, 0.0, "1"),
            (1.0, 0.0, f"{most}"),
            (0.75, level + 0.14, f"lambda {land.lam:.0e}, rank {land.effective_rank:.0f}"),
        ],
    )


def _log_surface(rec: rr.RecordingStream, path: str, t_s: Array, land: Landscape) -> None:
    x, y = np.meshgrid(land.x_mm, land.y_mm)
    vertices = np.stack([x, y, land.value * land.height_mm], axis=-1)
    mesh = rr.Mesh3D(
        vertex_positions=single(vertices.reshape(-1, 3)),
        vertex_normals=single(normals(land).reshape(-1, 3)),
        vertex_colors=palette.depth(land.value).reshape(-1, 3),
        triangle_indices=triangles(*land.value.shape),
    )
    rec.log(path, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    rec.log(f"{path}/potential", mesh, static=True)
    _log_frame(rec, f"{path}/frame", land)
    way = land.lifted(land.path_mm)
    log_moving(rec, path, t_s, land.lifted(land.samples_mm), way, dots=palette.GROUND, trail=palette.BLUE)
    ui = rr.components.Radius.ui_points
    lifted = [land.lifted(line) for line in land.contour_mm(RANGE)]
    rec.log(f"{path}/range", rr.LineStrips3D(lifted, colors=palette.WHITE, radii=ui(1.0)), static=True)


def _log_frame(rec: rr.RecordingStream, path: str, land: Landscape) -> None:
    """The rectangle under the surface, with its ends in millimetres."""
    (x0, x1), (y0, y1) = land.x_mm[[0, -1]], land.y_mm[[0, -1]]
    corners = np.array([(x0, y0, 0), (x1, y0, 0), (x1, y1, 0), (x0, y1, 0), (x0, y0, 0), (x0, y0, land.height_mm)])
    rec.log(
        f"{path}/box",
        rr.LineStrips3D([corners], colors=palette.GREY, radii=rr.components.Radius.ui_points(1.0)),
        static=True,
    )
    middle_x, middle_y = (x0 + x1) / 2, (y0 + y1) / 2
    ticks = [
        ((x0, y0, 0), f"{x0:.0f}, {y0:.0f}"),
        ((middle_x, y0, 0), "q1 / mm"),
        ((x1, y0, 0), f"{x1:.0f}"),
        ((x1, middle_y, 0), "q2 / mm"),
        ((x1, y1, 0), f"{y1:.0f}"),
        ((x0, y0, land.height_mm), "V = 1"),
    ]
    rec.log(
        f"{path}/ticks",
        rr.Points3D(
            [at for at, _ in ticks],
            labels=[text for _, text in ticks],
            colors=palette.GREY,
            radii=rr.components.Radius.ui_points(1.5),
            show_labels=True,
        ),
        static=True,
    )


def _log_heat_map(rec: rr.RecordingStream, path: str, t_s: Array, land: Landscape) -> None:
    """The map; up in the picture is up in q2, hence the view's second coordinate is -q2."""
    half = land.cell_mm / 2
    place = rr.Transform3D(
        translation=(land.x_mm[0] - half, -land.y_mm[-1] - half, 0), scale=(land.cell_mm, land.cell_mm, 1)
    )
    picture = palette.depth(land.value[::-1])
    rec.log(f"{path}/potential", place, static=True)
    rec.log(
        f"{path}/potential",
        rr.Image(picture, draw_order=-10.0, magnification_filter=rr.components.MagnificationFilter.Linear),
        static=True,
    )
    flip = np.array([1.0, -1.0])
    ui = rr.components.Radius.ui_points
    edge = [line * flip for line in land.contour_mm(RANGE)]
    rec.log(f"{path}/range", rr.LineStrips2D(edge, colors=palette.WHITE, radii=ui(1.25), draw_order=15.0), static=True)
    _log_axes(rec, f"{path}/axes", land)
    preferred = land.samples_value <= land.preferred
    dots = np.where(preferred[:, None], palette.VERMILLION, palette.GROUND).astype(np.uint8)
    log_moving(rec, path, t_s, land.samples_mm * flip, land.path_mm * flip, dots=dots, trail=palette.BLUE)
    limb = segments(np.zeros_like(land.path_mm), land.path_mm * flip)
    look = rr.LineStrips2D.from_fields(colors=palette.GREY, radii=ui(1.5), draw_order=18.0)
    rec.log(f"{path}/limb", look, static=True)
    ones = np.ones(len(limb), dtype=int)
    columns = rr.LineStrips2D.columns(strips=limb).partition(ones)
    rec.send_columns(f"{path}/limb", indexes=time_columns(t_s), columns=columns)


def _log_axes(rec: rr.RecordingStream, path: str, land: Landscape) -> None:
    """What the edges of the map are, in millimetres."""
    (x0, x1), (y0, y1) = land.x_mm[[0, -1]], land.y_mm[[0, -1]]
    near, low = x0 + 0.07 * (x1 - x0), -y0 - 0.03 * (y1 - y0)
    ticks = [
        (near, low, f"{x0:.0f}"),
        ((x0 + x1) / 2, low, "q1 / mm"),
        (x1 - 0.07 * (x1 - x0), low, f"{x1:.0f}"),
        (near, -y0 - 0.12 * (y1 - y0), f"{y0:.0f}"),
        (near, -(y0 + y1) / 2, "q2 / mm"),
        (near, -y1 + 0.03 * (y1 - y0), f"{y1:.0f}"),
    ]
    places, texts = [(x, y) for x, y, _ in ticks], [text for *_, text in ticks]
    names = rr.Points2D(places, labels=texts, colors=palette.GREY, radii=0.0, show_labels=True, draw_order=40.0)
    rec.log(path, names, static=True)
