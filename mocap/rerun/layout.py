"""What the blueprint has to know of a run: what there is, how large, and where to look."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from eal.arrays import Array
from mocap.kinematics.cycles import Cycle
from mocap.kinematics.records import Quantity
from mocap.rerun.landscape import Block, Landscape
from mocap.rerun.row_map import rms
from mocap.rerun.scene import Scene, ViewCamera
from mocap.tracking.result import Result

Box = tuple[tuple[float, float], tuple[float, float]]
"""(left, top), (right, bottom)."""

_FRAMES = ("limb", "plane", "body", "world")


@dataclass(frozen=True, eq=False, kw_only=True)
class Layout:
    """A run, and what is derived from it before anything is written.

    Attributes:
        run: The run.
        scene: The scene.
        landscapes: For each joint that has a potential, that potential over its plane.
        blocks: For each joint that has one in the body's three coordinates, that potential.
        joint_frames: For each joint the frame of reference in which it is shown.
        angles: Angles and what else is plotted beside the scene, by group.
        cycles: Wing beats, strides, waves.
    """

    run: Result
    scene: Scene
    landscapes: Mapping[str, Landscape]
    blocks: Mapping[str, Block]
    joint_frames: Mapping[str, str]
    angles: Mapping[str, Sequence[Quantity]]
    cycles: Sequence[Cycle]

    @property
    def name(self) -> str:
        """Of the run."""
        return self.run.name

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(self.run.t_s)

    @cached_property
    def bounds_px(self) -> dict[str, Box]:
        """For each camera with pixels the part of its image where the motion is; those that saw most first."""
        run, found = self.run, {}
        for c in np.argsort(-run.used.sum(axis=(1, 2)), kind="stable") if run.cameras else ():
            some = slice(None, None, max(1, self.n_frames // 100))
            uv_px = np.concatenate([run.ideal_px[c, some], run.reprojected_px[c, some]])
            found[self.scene.cameras[c].name] = frame_px(self.scene.cameras[c], uv_px)
        return found

    @cached_property
    def errors_px(self) -> tuple[Array, Array]:
        """(C, T) innovations and residuals of each camera, root mean squares over the markers in use; NaN: none."""
        run = self.run
        differences_px = (run.innovation_px, run.ideal_px - run.reprojected_px)
        lengths_px = (np.where(run.used, np.linalg.norm(px, axis=-1), np.nan) for px in differences_px)
        innovation_px, residual_px = (rms(px, axis=-1) for px in lengths_px)
        return innovation_px, residual_px

    @property
    def trail_frames(self) -> int:
        """Length of the trails behind moving things."""
        return trail_length(self.n_frames)

    @cached_property
    def scene_trail_frames(self) -> int:
        """Of the trails in the scene: what moves fastest leaves one half as long as the animal is."""
        xyz = self.run.tracks.xyz_m
        if xyz.shape[1] == 0 or not np.isfinite(xyz).any():
            return self.trail_frames
        there = xyz[np.isfinite(xyz).any(axis=(1, 2))]
        span = np.median(np.linalg.norm(np.nanmax(there, axis=1) - np.nanmin(there, axis=1), axis=-1))
        steps = np.linalg.norm(np.diff(xyz, axis=0), axis=-1)
        step = np.quantile(steps[np.isfinite(steps)], 0.9) if np.isfinite(steps).any() else 0.0
        return (
            int(np.clip(span / (2 * step), min(5, self.trail_frames), self.trail_frames)) if step else self.trail_frames
        )


def play_fps(n_frames: int) -> float:
    """Frames a second when played: the whole run in a quarter of a minute, if that is no crawl and no blur."""
    return float(np.clip(n_frames / 15, 10, 60))


def trail_length(n_frames: int) -> int:
    """How many frames a trail is long."""
    return int(np.clip(n_frames // 20, 10, 60))


def frame_px(camera: ViewCamera, uv_px: Array) -> Box:
    """The part of an image that holds nearly all pixels, with a margin, in the shape of the image.

    Args:
        camera: The camera.
        uv_px: (..., 2) pixels of the recording; NaN where there is none.
    """
    width, height = camera.size_px
    seen = camera.pixels(uv_px[np.isfinite(uv_px).all(axis=-1)])
    seen = seen[((seen > -camera.size_px) & (seen < 2 * camera.size_px)).all(axis=-1)]
    if not len(seen):
        return (0.0, 0.0), (float(width), float(height))
    low, high = np.quantile(seen, (0.005, 0.995), axis=0)
    half = max(*(0.65 * (high - low) / camera.size_px), 0.04) * camera.size_px
    (left, top), (right, bottom) = (low + high) / 2 - half, (low + high) / 2 + half
    return (float(left), float(top)), (float(right), float(bottom))


def joint_frames(run: Result) -> dict[str, str]:
    """The frame of reference in which each joint is shown: that of its potential, or else the most telling one."""
    first = next((frame for frame in _FRAMES if run.joints_m(frame)), "")
    return {name: run.potentials[name].frame if name in run.potentials else first for name in run.joints_m(first)}
