"""Tab: where the cameras stand, and what each of them saw."""

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from scipy.spatial.transform import Rotation

from eal.arrays import Array
from mocap.rerun import palette, paths
from mocap.rerun.blueprint import rows
from mocap.rerun.columns import Single, log_over_time, segments, single, ui
from mocap.rerun.footage import footage
from mocap.rerun.layout import Layout
from mocap.rerun.log_markers import SAMPLE_CLASS
from mocap.rerun.log_video import log_video
from mocap.rerun.scene import Scene, ViewCamera
from mocap.rerun.scene_views import WHISKER_SCALE, camera_order, camera_view, rig_view
from mocap.tracking.result import Result

_LOOKS = {  # colour, radius in points of the screen, drawn over those with a lower order
    "reprojected": (palette.GREEN, 4.0, 30.0),
    "measured": (palette.SKY_BLUE, 2.5, 40.0),
    "rejected": (palette.ORIGIN["rejected"], 5.0, 50.0),
}


def log(rec: rr.RecordingStream, run: Result, layout: Layout) -> None:
    """Cameras, their pixels with residuals, and their movies."""
    scene = layout.scene
    log_cameras(rec, scene)
    if run.cameras:
        log_pixels(rec, scene, run)
    for view, camera, one in zip(scene.cameras, run.cameras, footage(run), strict=False):
        log_video(rec, view, camera, one, run.t_s)


def tab(layout: Layout) -> rrb.Container | None:
    """Where the cameras stand, and what each of them saw."""
    if not layout.bounds_px:
        return None
    tiles = rows([camera_view(layout, name) for name in camera_order(layout)])
    return rrb.Horizontal(rig_view(layout), tiles, column_shares=[2, 3], name="Cameras")


def log_cameras(rec: rr.RecordingStream, scene: Scene) -> None:
    """Pose, lens and frustum of every camera."""
    for camera in scene.cameras:
        pose = rr.Transform3D(translation=camera.position_m, mat3x3=camera.world_from_camera)
        if camera.is_rigid:
            turn = rr.Quaternion(xyzw=Rotation.from_matrix(np.array(camera.world_from_camera)).as_quat())
            pose = rr.Transform3D(translation=camera.position_m, quaternion=turn)
        rec.log(paths.child(paths.CAMERAS, camera.name), pose, static=True)
        away_m = float(np.linalg.norm(camera.position_m - scene.centre_m))
        pinhole = rr.Pinhole(
            image_from_camera=camera.intrinsic,
            resolution=camera.size_px,
            camera_xyz=rr.ViewCoordinates.RDF,
            image_plane_distance=0.1 * away_m,
            color=palette.GREY,
            line_width=0.001 * away_m,
        )
        rec.log(paths.image(camera.name), pinhole, static=True)
        width, height = camera.size_px
        border = [(0, 0), (width, 0), (width, height), (0, height), (0, 0)]
        line = rr.LineStrips2D([border], colors=palette.DIM, radii=ui(0.75))
        rec.log(f"{paths.image(camera.name)}/border", line, static=True)


def log_pixels(rec: rr.RecordingStream, scene: Scene, run: Result) -> None:
    """In each camera: pixels that were used, pixels that were not, reprojections, and residual whiskers.

    A whisker starts at the measured pixel and points to the reprojection, ``WHISKER_SCALE`` times as far.
    """
    for c, camera in enumerate(scene.cameras):
        used = run.used[c][..., None]
        measured = single(camera.pixels(run.ideal_px[c]))
        reprojected = single(camera.pixels(run.reprojected_px[c]))
        believed = np.where(used, measured, np.float32(np.nan))
        _log_points(rec, run.t_s, camera, "measured", believed)
        _log_points(rec, run.t_s, camera, "reprojected", reprojected)
        _log_points(rec, run.t_s, camera, "rejected", np.where(used, np.float32(np.nan), measured))
        path = paths.child(paths.image(camera.name), "residual")
        there = np.isfinite(believed[..., 0]) & np.isfinite(reprojected[..., 0])
        start = believed[there]
        strips = segments(start, start + np.float32(WHISKER_SCALE) * (reprojected[there] - start))
        look = rr.LineStrips2D.from_fields(colors=palette.ORANGE, radii=ui(1.0), draw_order=35.0, show_labels=False)
        log_over_time(rec, path, run.t_s, rr.LineStrips2D.columns(strips=strips), look, counts=there.sum(axis=1))


def _log_points(rec: rr.RecordingStream, t_s: Array, camera: ViewCamera, name: str, uv_px: Single) -> None:
    path = paths.child(paths.image(camera.name), name)
    color, radius, order = _LOOKS[name]
    look = rr.Points2D.from_fields(
        colors=color, radii=ui(radius), draw_order=order, class_ids=SAMPLE_CLASS, show_labels=False
    )
    there = np.isfinite(uv_px[..., 0])
    if name == "rejected":  # rare: only those that there are, with their names
        columns = rr.Points2D.columns(positions=uv_px[there], keypoint_ids=np.nonzero(there)[1])
        log_over_time(rec, path, t_s, columns, look, counts=there.sum(axis=1), rare=True)
    else:
        rec.log(path, rr.Points2D.from_fields(keypoint_ids=np.arange(uv_px.shape[1])), static=True)
        log_over_time(rec, path, t_s, rr.Points2D.columns(positions=uv_px), look)
