"""A run, or points alone, written as one recording."""

import hashlib
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from mocap.cameras.camera import Camera
from mocap.kinematics.cycles import cycles
from mocap.records import MarkerTracks
from mocap.rerun import paths
from mocap.rerun.blueprint import screen
from mocap.rerun.columns import numbered_from, recording_into, single, ui
from mocap.rerun.footage import footage
from mocap.rerun.landscape import block, landscape
from mocap.rerun.layout import Layout, joint_frames, play_fps
from mocap.rerun.log_markers import log_axes, log_looks, log_markers, log_uncertainty, log_world
from mocap.rerun.scene import Scene, make_scene
from mocap.rerun.scene_views import eye, world_view
from mocap.rerun.share import QUERY, changed_page, fetched_viewer
from mocap.rerun.tabs.angles import chosen
from mocap.rerun.tabs.registry import TABS
from mocap.skeleton import Skeleton
from mocap.tracking.result import Result

APPLICATION = "mocap"


def write_recording(run: Result, path: Path, *, first: int = 1, every: int = 1) -> None:
    """Write all views of a run to a file.

    Frames before the first and after the last position of any marker are left out: there is nothing to see in them.
    They are numbered from ``first``, in steps of ``every``: an overview of a longer run has every so manieth frame.

    Raises:
        RecordingError: rerun does not take it.
        OSError: the file cannot be written there.
    """
    known = np.flatnonzero(run.tracks.seen.any(axis=1))
    shown = slice(int(known[0]), int(known[-1]) + 1) if len(known) else slice(0, len(run.t_s))
    part = run if shown == slice(0, len(run.t_s)) else run.at(shown)
    layout = make_layout(part)
    with (
        recording_into(
            path, application=APPLICATION, recording_id=recording_id(run), blueprint=make_blueprint(layout)
        ) as rec,
        numbered_from(first + every * shown.start, every=every),
    ):
        for tab in TABS:
            tab.log(rec, part, layout)


def run_scene(run: Result) -> Scene:
    """The scene of a run."""
    return make_scene(run.cameras, xyz_m=run.xyz_m, uv_px=run.ideal_px if run.cameras else None, y_up=run.y_up)


def make_layout(run: Result) -> Layout:
    """All that is derived from a run before anything is written."""
    frames = joint_frames(run)
    landscapes = {
        name: landscape(run.potentials[name], run.t_s, run.joints_m(frame)[name])
        for name, frame in frames.items()
        if name in run.potentials
    }
    blocks = {
        name: block(spatial, run.joints_m(spatial.frame)[name])
        for name, spatial in run.spatial_potentials.items()
        if name in landscapes
    }
    return Layout(
        run=run,
        scene=run_scene(run),
        landscapes=landscapes,
        blocks=blocks,
        joint_frames=frames,
        angles=chosen(
            run.kinematics.quantities, [j.name for j in run.skeleton.joints], list(run.skeleton.measures.strokes)
        ),
        cycles=cycles(run.kinematics, run.motion, run.skeleton),
    )


def make_blueprint(layout: Layout) -> rrb.Blueprint:
    """The tabs of ``mocap.rerun.tabs``; those without content are left out."""
    tabs = [found for tab in TABS if (found := tab.tab(layout)) is not None]
    return screen(rrb.Tabs(*tabs, active_tab=0, name=layout.name), fps=play_fps(layout.n_frames))


def recording_id(run: Result) -> str:
    """The run's name and a digest of its data: the same for the same run, on every machine."""
    digest = hashlib.blake2b(digest_size=6)
    markers = run.tracks
    arrays = [markers.t_s, markers.xyz_m, markers.status, *(c.matrix for c in run.cameras)]
    if run.cameras:
        arrays.append(run.ideal_px)
    arrays += [one.frames for one in footage(run)]
    arrays += [run.potentials[name].samples_m for name in sorted(run.potentials)]
    digest.update("\n".join([run.name, run.model, *markers.names]).encode())
    for array in arrays:
        digest.update(str(array.shape).encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return f"{run.name}-{digest.hexdigest()}"


_RAY = 0.15  # length of a camera's axis, as a share of its distance from the scene; chosen
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
            vectors=single(_RAY * ahead * np.linalg.norm(eyes - scene.centre_m, axis=1)[:, None]),
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
