"""A small filmed scene: seven markers on a body that turns and bends, three cameras, and its exact pixels."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from mocap.datasets.rig import aimed

from mocap.cameras.camera import Camera, record
from mocap.cameras.lens import BrownLens
from mocap.digitising.clicks import Click
from mocap.io.anipose import write_calibration
from mocap.skeleton import Bone, Skeleton, write_skeleton

SIZE = (320, 240)
NAMES = ("nose", "back", "hip", "left", "right", "hand", "tail")


@dataclass(frozen=True, eq=False, kw_only=True)
class Scene:
    """Films with their truth.

    Attributes:
        folder: Holds ``films``, ``calibration.toml``, ``skeleton.toml``.
        cameras: Three.
        xyz_m: (T, M, 3) markers.
        uv_px: (C, T, M, 2) where the films show them; NaN where they are not drawn.
        skeleton: Of the markers.
    """

    folder: Path
    cameras: tuple[Camera, ...]
    xyz_m: np.ndarray
    uv_px: np.ndarray
    skeleton: Skeleton

    def clicks(self, frame=0, *, sd_px=0.5, cameras=(0, 1)):
        """Clicks of a person on all markers that a frame shows."""
        rng = np.random.default_rng(frame)
        return [
            Click(camera=c, frame=frame, marker=m, uv_px=tuple(self.uv_px[c, frame, m] + sd_px * rng.normal(size=2)))
            for m in range(len(NAMES))
            for c in cameras
            if np.isfinite(self.uv_px[c, frame, m, 0])
        ]

    @property
    def arguments(self):
        """Of ``mocap.digitise``, but for the first clicks."""
        where = self.folder
        return {"calibration": where / "calibration.toml", "skeleton": where / "skeleton.toml", "fps": 100.0}


def rig():
    """Three cameras about 0.5 m away, with the lenses of action cameras."""
    cameras = []
    for i, place in enumerate(([0.5, 0.1, 0.2], [-0.1, 0.5, 0.15], [-0.3, -0.35, 0.3])):
        lens = BrownLens(f_px=(520.0, 520.0), centre_px=(160.0, 120.0), k=(-0.2, 0.05, 0.0))
        name = f"cam{i + 1}"
        cameras.append(aimed(name, position_m=np.array(place), target_m=np.zeros(3), size_px=SIZE, lens=lens))
    return tuple(cameras)


def markers(n_frames):
    """(T, 7, 3) positions."""
    t = np.arange(n_frames) / 100.0
    at = np.zeros((n_frames, 7, 3))
    turn = 0.6 * np.sin(2 * np.pi * 1.2 * t)
    along = np.stack([np.cos(turn), np.sin(turn), 0 * t], axis=-1)
    across = np.stack([-np.sin(turn), np.cos(turn), 0 * t], axis=-1)
    middle = np.stack([0.02 * np.sin(6 * t), 0.1 * t - 0.02, 0.01 * np.cos(9 * t)], axis=-1)
    at[:, 0], at[:, 1], at[:, 2] = middle + 0.05 * along, middle, middle - 0.04 * along
    at[:, 3], at[:, 4] = middle + 0.03 * across, middle - 0.03 * across + 0.01 * along
    swing = 2 * np.pi * 2.5 * t
    at[:, 5] = at[:, 3] + 0.03 * np.stack([np.cos(swing), 0.6 * np.sin(swing), 0.8 * np.sin(swing)], axis=-1)
    at[:, 6] = at[:, 2] - 0.02 * along + np.stack([0 * t, 0 * t, 0.02 * np.sin(12 * t)], axis=-1)
    return at


def video(folder, n_frames=40, *, hide=(), noise=2.0, bare=(), faint=()):
    """Write films as folders of pictures, calibration and skeleton; ``hide`` lists (camera, frames, marker).

    Markers of ``bare`` have no dot but a texture. ``faint`` lists (frames, marker, shift_m): where the marker is moved
    to there is a spot of 0.4 of a dot's contrast in all pictures.
    """
    cameras, xyz = rig(), markers(n_frames)
    uv = record(cameras, xyz)
    for camera, frames, marker in hide:
        uv[camera, frames, marker] = np.nan
    spots = np.full((len(cameras), n_frames, len(faint), 2), np.nan)
    for k, (frames, marker, shift_m) in enumerate(faint):
        spots[:, frames, k] = record(cameras, xyz[frames, marker] + shift_m)
    rng = np.random.default_rng(0)
    for c, camera in enumerate(cameras):
        where = folder / "films" / camera.name
        where.mkdir(parents=True)
        for frame in range(n_frames):
            dots = np.where(np.isin(np.arange(len(NAMES)), bare)[:, None], np.nan, uv[c, frame])
            picture = drawn(dots, rng, noise, spots[c, frame])
            for m in bare:
                picture = textured(picture, uv[c, frame, m], 0.004 * frame + m)
            cv2.imwrite(str(where / f"{frame:04d}.png"), picture)
    bones = tuple(Bone(a=a, b=b) for a, b in (("nose", "back"), ("back", "hip"), ("back", "left"), ("left", "hand")))
    skeleton = Skeleton(name="small", markers=NAMES, bones=bones, trunk=("nose", "back", "hip", "left", "right"))
    write_calibration(folder / "calibration.toml", cameras)
    write_skeleton(folder / "skeleton.toml", skeleton)
    return Scene(folder=folder, cameras=cameras, xyz_m=xyz, uv_px=uv, skeleton=skeleton)


def drawn(uv_px, rng, noise, faint_px=()):
    """(240, 320) picture of white dots of 2.5 px radius, and grey ones, each pixel the mean of 8 x 8 points."""
    fine = np.full((SIZE[1] * 8, SIZE[0] * 8), 40, dtype=np.uint8)
    for places, grey in ((faint_px, 112), (uv_px, 220)):
        for u, v in places:
            if not np.isfinite(u):
                continue
            # the centre of the first pixel is at (1, 1), its corner at (0.5, 0.5); of the fine ones 3.5 are before it
            at = tuple(round(x) for x in ((u - 0.5) * 128 - 8, (v - 0.5) * 128 - 8))
            cv2.circle(fine, at, round(2.5 * 128), grey, cv2.FILLED, cv2.LINE_8, 4)
    coarse = cv2.resize(fine, SIZE, interpolation=cv2.INTER_AREA).astype(float)
    return np.clip(np.rint(coarse + noise * rng.normal(size=coarse.shape)), 0, 255).astype(np.uint8)


def textured(picture, uv_px, turn_rad, *, seed=0):
    """The picture with a round piece of skin of 13 px radius about a place, turned by an angle."""
    if not np.isfinite(uv_px).all():
        return picture
    coarse = np.random.default_rng(seed).normal(size=(16, 16))
    skin = cv2.resize(coarse, (64, 64), interpolation=cv2.INTER_CUBIC)
    v, u = np.mgrid[: picture.shape[0], : picture.shape[1]] - (np.asarray(uv_px)[::-1] - 1)[:, None, None]
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    at = np.stack([c * u + s * v, -s * u + c * v], axis=-1) * 1.6 + 31.5
    grey = cv2.remap(skin, *np.moveaxis(at.astype(np.float32), -1, 0), cv2.INTER_LINEAR)
    inside = np.hypot(u, v) < 13
    return np.where(inside, np.clip(np.rint(90 + 20 * grey), 0, 255), picture).astype(np.uint8)
