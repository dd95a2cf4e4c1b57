"""A potential over two coordinates, from above and as a surface, and what moves over it."""

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.rerun import palette
from mocap.rerun.columns import log_over_time, segments, single, ui
from mocap.rerun.scene_views import last_frames
from mocap.tracking.joint_map import JointMap, map_picture

FLIP = np.array([1.0, -1.0])
"""Up in an image is up in the second coordinate, hence a view's second coordinate is its negative."""
PIXELS = 720
"""Along an edge of the picture of a joint's potential."""
_ORDERS = {"samples": 10.0, "limb": 18.0, "trail": 20.0, "now": 30.0}
"""In an image the higher is drawn over the lower."""


def plane_view(path: str, name: str, x: Array, y: Array, trail_frames: int) -> rrb.View:
    """The view of a potential, over a grid of coordinates, from above, with the trail of what moves over it."""
    return rrb.Spatial2DView(
        origin=path,
        name=name,
        background=palette.GROUND,
        visual_bounds=rrb.VisualBounds2D(x_range=[float(x[0]), float(x[-1])], y_range=[-float(y[-1]), -float(y[0])]),
        overrides={f"{path}/trail": last_frames(trail_frames)},
    )


def log_map(rec: rr.RecordingStream, path: str, found: JointMap) -> None:
    """The picture of a joint's potential that all programs show, in millimetres of its plane."""
    left, right, bottom, top = found.bounds_mm
    pixel = (right - left) / PIXELS, (top - bottom) / PIXELS
    rec.log(path, rr.Transform3D(translation=(left, -top, 0), scale=(*pixel, 1)), static=True)
    png = rr.EncodedImage(contents=map_picture(found, pixels=PIXELS), media_type="image/png", draw_order=-10.0)
    rec.log(path, png, static=True)


def log_picture(rec: rr.RecordingStream, path: str, x: Array, y: Array, value: Array) -> None:
    """(rows, columns) values over evenly spaced coordinates, as an image."""
    cell_x, cell_y = float(x[1] - x[0]), float(y[1] - y[0])
    place = rr.Transform3D(translation=(x[0] - cell_x / 2, -y[-1] - cell_y / 2, 0), scale=(cell_x, cell_y, 1))
    smooth = rr.components.MagnificationFilter.Linear
    rec.log(path, place, static=True)
    rec.log(path, rr.Image(palette.depth(value[::-1]), draw_order=-10.0, magnification_filter=smooth), static=True)


def log_surface(rec: rr.RecordingStream, path: str, x: Array, y: Array, value: Array, height: float) -> None:
    """(rows, columns) values as a surface, 1 so high; shaded by a quarter of its slopes: walls of wells stay bright."""
    slope_y, slope_x = np.gradient(0.25 * height * value, y, x)
    upward = np.stack([-slope_x, -slope_y, np.ones_like(slope_x)], axis=-1).reshape(-1, 3)
    at = np.arange(value.size).reshape(value.shape)
    a, b, c, d = at[:-1, :-1].ravel(), at[:-1, 1:].ravel(), at[1:, 1:].ravel(), at[1:, :-1].ravel()
    mesh = rr.Mesh3D(
        vertex_positions=single(np.stack([*np.meshgrid(x, y), height * value], axis=-1).reshape(-1, 3)),
        vertex_normals=single(upward / np.linalg.norm(upward, axis=-1, keepdims=True)),
        vertex_colors=palette.depth(value).reshape(-1, 3),
        triangle_indices=np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])]),
    )
    rec.log(path, mesh, static=True)


def log_moving(
    rec: rr.RecordingStream,
    path: str,
    t_s: Array,
    samples: Array | None,
    way: Array,
    *,
    dots: palette.Rgb | NDArray[np.uint8] = palette.GROUND,
    trail: palette.Rgb,
    limb_radius: float = 0.0,
    limb_color: palette.Rgb = palette.GREY,
    ball_radius: float = 7.0,
) -> None:
    """Samples, the point where the joint is, the steps that it took to get there, and the limb from the centre to it.

    Args:
        rec: Where to.
        path: Parent of these entities.
        t_s: (T,) times.
        samples: (N, D) points; D is 2 or 3. None: what lies below shows them.
        way: (T, D) the joint.
        dots: Colour of all samples, or (N, 3) of each.
        trail: Colour of the steps.
        limb_radius: In points of the screen; 0: without the limb.
        limb_color: Of the limb.
        ball_radius: Of the point where the joint is, in points of the screen.
    """
    flat = way.shape[1] == 2
    points, strips = (rr.Points2D, rr.LineStrips2D) if flat else (rr.Points3D, rr.LineStrips3D)
    if samples is not None:
        rec.log(f"{path}/samples", points(single(samples), colors=dots, radii=ui(1.25)), static=True)
    rec.log(f"{path}/now", points.from_fields(colors=palette.VERMILLION, radii=ui(ball_radius)), static=True)
    rec.log(f"{path}/trail", strips.from_fields(colors=trail, radii=ui(1.5)), static=True)
    if limb_radius:
        rec.log(f"{path}/limb", strips.from_fields(colors=limb_color, radii=ui(limb_radius)), static=True)
        limb = strips.columns(strips=segments(np.zeros_like(way), way))
        log_over_time(rec, f"{path}/limb", t_s, limb, counts=np.ones(len(way)))
    for part, order in _ORDERS.items() if flat else ():
        if (part != "limb" or limb_radius) and (part != "samples" or samples is not None):
            look = (rr.Points2D if part in ("samples", "now") else rr.LineStrips2D).from_fields(draw_order=order)
            rec.log(f"{path}/{part}", look, static=True)
    log_over_time(rec, f"{path}/now", t_s, points.columns(positions=single(way)), counts=np.ones(len(way)))
    if len(way) > 1:
        there = np.isfinite(way[1:]).all(axis=1) & np.isfinite(way[:-1]).all(axis=1)
        steps = strips.columns(strips=segments(way[:-1][there], way[1:][there]))
        log_over_time(rec, f"{path}/trail", t_s, steps, counts=there, at=np.arange(1, len(way)))
