"""A joint that moves among its samples, in a plane or in space."""

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from mocap.arrays import Array
from mocap.rerun import palette
from mocap.rerun.columns import segments, single, time_columns


def log_moving(
    rec: rr.RecordingStream,
    path: str,
    t_s: Array,
    samples: Array,
    way: Array,
    *,
    dots: palette.Rgb | NDArray[np.uint8],
    trail: palette.Rgb,
) -> None:
    """Samples, the point where the joint is, and the steps that it took to get there.

    Args:
        rec: Where to.
        path: Parent of the three entities.
        t_s: (T,) times.
        samples: (N, D) points; D is 2 or 3.
        way: (T, D) the joint.
        dots: Colour of all samples, or (N, 3) of each.
        trail: Colour of the steps.
    """
    flat = way.shape[1] == 2
    points, strips = (rr.Points2D, rr.LineStrips2D) if flat else (rr.Points3D, rr.LineStrips3D)
    ui = rr.components.Radius.ui_points
    rec.log(f"{path}/samples", points(single(samples), colors=dots, radii=ui(1.25)), static=True)
    rec.log(f"{path}/now", points.from_fields(colors=palette.VERMILLION, radii=ui(7.0)), static=True)
    rec.log(f"{path}/trail", strips.from_fields(colors=trail, radii=ui(1.5)), static=True)
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
