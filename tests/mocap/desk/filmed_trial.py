"""A folder as a person has it: films, clicks with faults of known kinds, calibration and skeleton."""

from dataclasses import replace

import numpy as np

from mocap.digitising.clicks import Click, write_clicks
from mocap.measures import Measures
from mocap.skeleton import Joint, write_skeleton
from tests.mocap.digitising.filmed import NAMES, video

GAP = range(20, 32)
"""Frames, from 0, in which the hand was not digitised in two of three cameras."""
WRONG = (0, 40, NAMES.index("tail"))
"""Camera, frame and marker of a click that is 25 px off."""
SWAPPED = range(45, 50)
"""Frames in which left and right bear each other's names."""
FPS = 100.0


def trial(folder, n_frames=60, *, videos=True):
    """The scene (``tests.mocap.digitising.filmed``), with ``flight_xypts.csv`` beside its calibration."""
    scene = video(folder, n_frames if videos else 1)
    if not videos:
        scene = whole(scene, n_frames)
    uv = scene.uv_px + 0.3 * np.random.default_rng(1).normal(size=scene.uv_px.shape)
    uv[:2, GAP, NAMES.index("hand")] = np.nan
    uv[WRONG] += 25.0
    left, right = NAMES.index("left"), NAMES.index("right")
    uv[:, SWAPPED, left], uv[:, SWAPPED, right] = uv[:, SWAPPED, right].copy(), uv[:, SWAPPED, left].copy()
    clicks = [
        Click(camera=int(c), frame=int(t), marker=int(m), uv_px=tuple(uv[c, t, m].tolist()))
        for c, t, m in np.argwhere(np.isfinite(uv[..., 0]))
    ]
    write_clicks(
        folder / "flight_xypts.csv",
        clicks,
        names=NAMES,
        cameras=[camera.name for camera in scene.cameras],
        n_frames=n_frames,
        fps=FPS,
    )
    wrist = Joint(name="wrist", parent="back", centre="left", child="hand")
    measures = Measures(strokes={"hand": ("left", "hand")}, distances={"span": ("right", "hand")})
    write_skeleton(folder / "skeleton.toml", replace(scene.skeleton, joints=(wrist,), measures=measures))
    return scene


def whole(scene, n_frames):
    """The same scene in more frames than were filmed."""
    from mocap.cameras.camera import record
    from tests.mocap.digitising.filmed import markers

    xyz = markers(n_frames)
    return replace(scene, xyz_m=xyz, uv_px=record(scene.cameras, xyz))
