"""The potential of a joint in the three coordinates of the body: a cloud that is dense where the joint goes."""

import numpy as np
import rerun as rr

from mocap.arrays import Array
from mocap.rerun import palette, paths
from mocap.rerun.columns import segments, time_columns
from mocap.rerun.log_moving import log_moving
from mocap.rerun.volume import Block


def log_volume(rec: rr.RecordingStream, name: str, t_s: Array, cloud: Block) -> None:
    """1 - V_z as a volume, the samples in it, and the limb from the joint's centre to where it is.

    Args:
        rec: Where to.
        name: Joint name.
        t_s: (T,) times.
        cloud: Potential, samples and path.
    """
    path = paths.volume(name)
    volume = rr.Volume3D(
        (1 - cloud.value).astype(np.float16),
        voxel_size=(cloud.cell_mm,) * 3,
        translation=cloud.corner_mm,
        value_range=(0.0, 1.0),
        gamma=2.0,
        optical_density=5.0,
        colormap=rr.components.Colormap.Viridis,
    )
    rec.log(path, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    rec.log(f"{path}/potential", volume, static=True)
    log_moving(rec, path, t_s, cloud.samples_mm, cloud.path_mm, dots=palette.WHITE, trail=palette.ORANGE)
    ui = rr.components.Radius.ui_points
    rec.log(f"{path}/limb", rr.LineStrips3D.from_fields(colors=palette.GREY, radii=ui(2.0)), static=True)
    limb = segments(np.zeros_like(cloud.path_mm), cloud.path_mm)
    columns = rr.LineStrips3D.columns(strips=limb).partition(np.ones(len(limb), dtype=int))
    rec.send_columns(f"{path}/limb", indexes=time_columns(t_s), columns=columns)
