"""Positions of markers while they are digitised: points, bones, uncertainty, cameras; and a viewer to look at them."""

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np
import rerun as rr

from mocap.cameras.camera import Camera
from mocap.records import MarkerTracks
from mocap.rerun import paths
from mocap.rerun.blueprint import screen
from mocap.rerun.columns import recording_into, single, ui
from mocap.rerun.log_markers import log_looks, log_markers, log_uncertainty
from mocap.rerun.log_world import log_axes, log_world
from mocap.rerun.scene import make_scene
from mocap.rerun.scene_views import eye, world_view
from mocap.rerun.share import QUERY, changed_page, fetched_viewer
from mocap.skeleton import Skeleton

_SCRIPT = """<script>
  const ask = window.fetch;
  window.fetch = (what, ...more) => new URL(what.url ?? what, location).origin === location.origin
    ? ask(what, ...more) : Promise.reject(new TypeError("this page asks no other host"));
</script>
"""


def write_points(markers: MarkerTracks, cameras: Sequence[Camera], skeleton: Skeleton, path: Path) -> None:
    """Write positions with their 95 % ellipsoids, and where the cameras stand, for rerun's viewer.

    Raises:
        RecordingError: rerun does not take it.
    """
    scene = make_scene(cameras, xyz_m=markers.xyz_m, uv_px=None, y_up=False)
    view = world_view(
        paths.WORLD,
        "Positions (m)",
        contents=["$origin/**", paths.CAMERAS],
        ground=(scene.up, scene.ground_m, scene.radius_m),
        look=eye(scene.centre_m, 1.75 * scene.radius_m, scene.up),
        trail=(paths.TRAILS, 1),
    )
    with recording_into(path, application="mocap-digitise", recording_id="points", blueprint=screen(view)) as rec:
        log_world(rec, scene, names=markers.names, skeleton=skeleton)
        log_axes(rec, scene)
        log_looks(rec, len(markers.names))
        log_markers(rec, scene, markers)
        log_uncertainty(rec, scene, markers)
        ahead = np.stack([camera.world_from_camera[:, 2] for camera in scene.cameras])
        eyes = np.stack([camera.position_m for camera in scene.cameras])
        arrows = rr.Arrows3D(
            origins=single(eyes),
            vectors=single(0.15 * ahead * np.linalg.norm(eyes - scene.centre_m, axis=1)[:, None]),
            labels=[camera.name for camera in scene.cameras],
            radii=ui(2.0),
        )
        rec.log(paths.CAMERAS, arrows, static=True)


@cache
def viewer_files(recording: str) -> dict[str, bytes]:
    """Files of the installed rerun's web viewer by name, whose page shows a recording and asks no other host.

    Raises:
        MocapError: the viewer does not start, or is of a version whose page is not known.
    """
    page, script, wasm = fetched_viewer()
    address = f'"&url=" + encodeURIComponent(new URL("{recording}", location))'
    parts = {
        "<html>": f"<html>{_SCRIPT}",
        QUERY: f'new URLSearchParams("theme=dark&hide_welcome_screen&" + location.search.slice(1) + {address})',
        "enable_history: true": "enable_history: false",
    }
    return {"": changed_page(page, parts).encode(), "re_viewer.js": script, "re_viewer_bg.wasm": wasm}
