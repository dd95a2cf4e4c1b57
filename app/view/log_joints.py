"""Joints over time, and over their empirical potentials: as a surface and as a map, in millimetres."""

import numpy as np
import rerun as rr

from app.view import palette, paths
from app.view.columns import segments, single, time_columns
from app.view.landscape import MM_PER_M, Landscape, normals, triangles
from app.view.log_health import log_line
from mocap.arrays import Array
from mocap.records import JointTracks

COORDINATES = ("q1", "q2", "q3")


def log_coordinates(rec: rr.RecordingStream, tracks: JointTracks, name: str) -> None:
    """The coordinates of one joint of the tracks, in millimetres."""
    lines = tracks.q_m[:, tracks.names.index(name)] * MM_PER_M
    n_lines = lines.shape[1]
    path = f"{paths.joint_series(name)}/coordinates"
    log_line(rec, path, tracks.t_s, lines, name=COORDINATES[:n_lines], color=palette.SERIES[:n_lines])


def log_potential(rec: rr.RecordingStream, name: str, t_s: Array, land: Landscape) -> None:
    """A joint's potential with its samples, and the joint moving over it.

    Args:
        rec: Where to.
        name: Joint name.
        t_s: (T,) times.
        land: Potential, samples and path.
    """
    _log_surface(rec, paths.surface(name), t_s, land)
    _log_heat_map(rec, paths.heat_map(name), t_s, land)
    series = f"{paths.joint_series(name)}/potential"
    log_line(rec, series, t_s, land.path_value, name="V_z(q(t))", color=palette.ORANGE)


def _log_surface(rec: rr.RecordingStream, path: str, t_s: Array, land: Landscape) -> None:
    x, y = np.meshgrid(land.x_mm, land.y_mm)
    vertices = np.stack([x, y, land.value * land.height_mm], axis=-1)
    mesh = rr.Mesh3D(
        vertex_positions=single(vertices.reshape(-1, 3)),
        vertex_normals=single(normals(land).reshape(-1, 3)),
        vertex_colors=palette.viridis(land.value).reshape(-1, 3),
        triangle_indices=triangles(*land.value.shape),
    )
    rec.log(path, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    rec.log(f"{path}/potential", mesh, static=True)
    _log_frame(rec, f"{path}/frame", land)
    _log_moving(rec, path, t_s, land.lifted(land.samples_mm), land.lifted(land.path_mm))


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
    picture = palette.viridis(land.value[::-1])
    rec.log(f"{path}/potential", place, static=True)
    rec.log(
        f"{path}/potential",
        rr.Image(picture, draw_order=-10.0, magnification_filter=rr.components.MagnificationFilter.Linear),
        static=True,
    )
    flip = np.array([1.0, -1.0])
    _log_moving(rec, path, t_s, land.samples_mm * flip, land.path_mm * flip)


def _log_moving(rec: rr.RecordingStream, path: str, t_s: Array, samples: Array, way: Array) -> None:
    """Samples, the point where the joint is, and the steps that it took to get there.

    Args:
        rec: Where to.
        path: Parent of the three entities.
        t_s: (T,) times.
        samples: (N, D) points; D is 2 or 3.
        way: (T, D) the joint.
    """
    flat = way.shape[1] == 2
    points, strips = (rr.Points2D, rr.LineStrips2D) if flat else (rr.Points3D, rr.LineStrips3D)
    ui = rr.components.Radius.ui_points
    rec.log(f"{path}/samples", points(single(samples), colors=palette.WHITE, radii=ui(1.25)), static=True)
    rec.log(f"{path}/now", points.from_fields(colors=palette.VERMILLION, radii=ui(7.0)), static=True)
    rec.log(f"{path}/trail", strips.from_fields(colors=palette.ORANGE, radii=ui(1.5)), static=True)
    if flat:
        for name, order in (("samples", 10.0), ("trail", 20.0), ("now", 30.0)):
            look = rr.LineStrips2D if name == "trail" else rr.Points2D
            rec.log(f"{path}/{name}", look.from_fields(draw_order=order), static=True)
    columns = points.columns(positions=single(way)).partition(np.ones(len(way), dtype=int))
    rec.send_columns(f"{path}/now", indexes=time_columns(t_s), columns=columns)
    if len(way) > 1:
        there = np.isfinite(way[1:]).all(axis=1) & np.isfinite(way[:-1]).all(axis=1)
        steps = segments(way[:-1][there], way[1:][there])
        rec.send_columns(
            f"{path}/trail",
            indexes=time_columns(t_s, at=np.arange(1, len(way))),
            columns=strips.columns(strips=steps).partition(there.astype(int)),
        )
