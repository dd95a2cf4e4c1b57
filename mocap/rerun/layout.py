"""What the blueprint has to know of a run: what there is, how large, and where to look."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from eal.arrays import Array
from mocap.filters.records import HeldLimb
from mocap.kinematics.cycles import Cycle
from mocap.kinematics.records import Quantity
from mocap.pipeline.recording import Recording
from mocap.rerun.camera_errors import CameraErrors, camera_errors
from mocap.rerun.landscape import Landscape
from mocap.rerun.scene import Scene, ViewCamera
from mocap.rerun.series import robust_range
from mocap.rerun.volume import Block

Box = tuple[tuple[float, float], tuple[float, float]]
"""(left, top), (right, bottom)."""

_FRAMES = ("limb", "plane", "body", "world")
_MARGIN = 0.15
_FRAMING_FRAMES = 100


@dataclass(frozen=True, eq=False, kw_only=True)
class Layout:
    """What the blueprint has to know of a run.

    Attributes:
        name: Of the run.
        n_frames: Number of frames.
        scene: The scene.
        bounds_px: For each camera with pixels the part of its image where the motion is; those that saw most first.
        landscapes: For each joint that has a potential, that potential over its plane.
        blocks: For each joint that has one in the body's three coordinates, that potential.
        joint_frames: For each joint the frame of reference in which it is shown.
        errors: Innovations and residuals of each camera; None without cameras.
        nis_limit: Upper end of the axis of the normalised innovation.
        likelihood_range: Ends of the axis of the log-likelihood; None: the viewer's choice.
        angles: Angles and what else is plotted beside the scene, by group.
        cycles: Wing beats, strides, waves.
        limbs: Potentials of limbs that the filter used.
        energies: (T, 3) energy, V_z and its bound (``JointAngles.energies``); None: no Lagrangian moved the animal.
    """

    name: str
    n_frames: int
    scene: Scene
    bounds_px: Mapping[str, Box] = field(default_factory=dict)
    landscapes: Mapping[str, Landscape] = field(default_factory=dict)
    blocks: Mapping[str, Block] = field(default_factory=dict)
    joint_frames: Mapping[str, str] = field(default_factory=dict)
    errors: CameraErrors | None = None
    nis_limit: float = 3.0
    likelihood_range: tuple[float, float] | None = None
    angles: Mapping[str, Sequence[Quantity]] = field(default_factory=dict)
    cycles: Sequence[Cycle] = ()
    limbs: tuple[HeldLimb, ...] = ()
    energies: Array | None = None

    @property
    def trail_frames(self) -> int:
        """Length of the trails behind moving things."""
        return trail_length(self.n_frames)

    @property
    def fps(self) -> float:
        """Frames a second when played."""
        return play_fps(self.n_frames)


def play_fps(n_frames: int) -> float:
    """Frames a second when played: the whole run in a quarter of a minute, if that is no crawl and no blur."""
    return float(np.clip(n_frames / 15, 10, 60))


def trail_length(n_frames: int) -> int:
    """How many frames a trail is long."""
    return int(np.clip(n_frames // 20, 10, 60))


def run_layout(
    run: Recording,
    scene: Scene,
    *,
    landscapes: Mapping[str, Landscape],
    blocks: Mapping[str, Block],
    joint_frames: Mapping[str, str],
    angles: Mapping[str, Sequence[Quantity]] | None = None,
    cycles: Sequence[Cycle] = (),
) -> Layout:
    """The layout of a run."""
    bounds: dict[str, Box] = {}
    if run.cameras:
        every = max(1, len(run.t_s) // _FRAMING_FRAMES)
        most = np.argsort(-run.used.sum(axis=(1, 2)), kind="stable")
        for c in most:
            uv_px = np.concatenate([run.ideal_px[c, ::every], run.reprojected_px[c, ::every]])
            bounds[scene.cameras[c].name] = frame_px(scene.cameras[c], uv_px)
    per_row = run.nis / np.maximum(run.n_rows, 1)
    finite = per_row[np.isfinite(per_row) & (run.n_rows > 0)]
    return Layout(
        name=run.name,
        limbs=run.limbs,
        energies=run.data["energies"].values if "energies" in run.data else None,
        n_frames=len(run.t_s),
        scene=scene,
        bounds_px=bounds,
        landscapes=landscapes,
        blocks=blocks,
        joint_frames=joint_frames,
        errors=camera_errors(run) if run.cameras else None,
        nis_limit=max(3.0, 1.2 * float(np.quantile(finite, 0.98))) if len(finite) else 3.0,
        likelihood_range=robust_range(run.log_likelihood),
        angles=angles or {},
        cycles=cycles,
    )


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
    half = max(*((0.5 + _MARGIN) * (high - low) / camera.size_px), 0.04) * camera.size_px
    (left, top), (right, bottom) = (low + high) / 2 - half, (low + high) / 2 + half
    return (float(left), float(top)), (float(right), float(bottom))


def joint_frames(run: Recording) -> dict[str, str]:
    """The frame of reference in which each joint is shown: that of its potential, or else the most telling one."""
    frames = [f for f in _FRAMES if f in run.joint_tracks] + sorted(set(run.joint_tracks) - set(_FRAMES))
    names = dict.fromkeys(name for f in frames for name in run.joint_tracks[f].names)
    first = {name: next(f for f in frames if name in run.joint_tracks[f].names) for name in names}
    return {name: run.potentials[name].frame if name in run.potentials else first[name] for name in names}
