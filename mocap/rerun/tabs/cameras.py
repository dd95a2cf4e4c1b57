"""Tab: where the cameras stand, and what each of them saw."""

import rerun as rr
import rerun.blueprint as rrb

from mocap.pipeline.run import Run
from mocap.rerun.layout import Layout
from mocap.rerun.log_cameras import log_cameras, log_pixels
from mocap.rerun.log_video import log_video
from mocap.rerun.scene_views import camera_order, camera_view, rig_view


def log(rec: rr.RecordingStream, run: Run, layout: Layout) -> None:
    """Cameras, their pixels with residuals, and their movies."""
    scene = layout.scene
    log_cameras(rec, scene)
    if run.ideal_px is not None:
        log_pixels(rec, scene, run.ideal_px, run.tracked)
    for view, camera, footage in zip(scene.cameras, run.cameras, run.footage, strict=False):
        log_video(rec, view, camera, footage, run.tracked.markers.t_s)


def tab(layout: Layout) -> rrb.Container | None:
    """Where the cameras stand, and what each of them saw."""
    if not layout.bounds_px:
        return None
    tiles = rrb.Grid(*(camera_view(layout, name) for name in camera_order(layout)))
    return rrb.Horizontal(rig_view(layout), tiles, column_shares=[2, 3], name="Cameras")
