"""The pendulums of the paper filmed by cameras: markers on a stand and on the mass, clicked as a person does."""

from functools import partial

import numpy as np
from mocap.datasets.film import film
from mocap.datasets.linkage import rotated, turn
from mocap.datasets.observe import Digitiser
from mocap.datasets.pendulums import GRAVITY_M_S2, Pendulum, pendulum_motion
from mocap.datasets.recording import SyntheticRecording
from mocap.datasets.rig import aimed
from mocap.datasets.scene import Scene

from eal.arrays import Array
from mocap.cameras.camera import Camera
from mocap.cameras.lens import BrownLens
from mocap.measures import Measures, Segment
from mocap.skeleton import Bone, Joint, Skeleton

STAND_M = {"top": (0.0, 0.0, 0.4), "front": (0.35, 0.0, 0.15), "side": (0.0, 0.35, 0.15), "pivot": (0.0, 0.0, 0.0)}
"""Markers that stand still; the pivot is the joint's centre, z is up."""
HEADING_RAD = 0.45
"""The planar pendulum swings in the vertical plane through this horizontal direction."""


def make_pendulum_film(
    kind: Pendulum,
    *,
    seed: int = 0,
    n_frames: int = 600,
    fps: float = 100.0,
    swing_rad: float = np.pi / 6,
    azimuth_rad: float = 0.0,
) -> SyntheticRecording:
    """A pendulum of 1 m and 1 kg before four cameras.

    Args:
        kind: ``planar`` or ``spherical``.
        seed: Of clicks and losses; the motion does not depend on it.
        n_frames: Number of frames.
        fps: Frames a second.
        swing_rad: Angle above the horizontal at which the planar pendulum is released at rest.
        azimuth_rad: Turn of the spherical pendulum's start about the vertical.

    Returns:
        The recording, with its truth: markers ``top``, ``front``, ``side``, ``pivot``, ``bob``.
    """
    return film(
        partial(_scene, kind=kind, swing_rad=swing_rad, azimuth_rad=azimuth_rad),
        _cameras(),
        name=f"{kind}_pendulum",
        seed=seed,
        n_frames=n_frames,
        fps=fps,
        digitiser=Digitiser(bursts_per_s=1.5, burst_frames=(10, 40)),  # lost in all cameras at times
        card={
            "name": f"{kind} pendulum on a stand",
            "length_m": 1.0,
            "mass_kg": 1.0,
            "gravity_m_s2": GRAVITY_M_S2,
            "rig": "four cameras, 3 m from the pivot",
        },
    )


def pendulum_skeleton() -> Skeleton:
    """A stand that is the trunk, one joint, and a mass."""
    return Skeleton(
        name="pendulum",
        markers=(*STAND_M, "bob"),
        bones=(Bone(a="top", b="pivot"), Bone(a="front", b="pivot"), Bone(a="side", b="pivot")),
        joints=(Joint(name="pivot", parent="top", centre="pivot", child="bob"),),
        trunk=tuple(STAND_M),
        measures=Measures(segments={"bob": Segment(start="bob", end="bob", mass_g=1000.0)}),
    )


def _scene(t_s: Array, *, kind: Pendulum, swing_rad: float, azimuth_rad: float) -> Scene:
    q = pendulum_motion(kind, t_s, swing_rad=swing_rad, azimuth_rad=azimuth_rad)[0]
    if kind == "planar":
        bob = np.stack([q[:, 0] * np.cos(q[:, 1]), np.zeros(len(q)), q[:, 0] * np.sin(q[:, 1])], axis=1)
        bob = rotated(turn(2, HEADING_RAD), bob)
    else:
        bob = q
    stand = np.broadcast_to(np.array(list(STAND_M.values())), (len(q), len(STAND_M), 3))
    return Scene(
        skeleton=pendulum_skeleton(),
        t_s=t_s,
        xyz_m=np.concatenate([stand, bob[:, None]], axis=1),
        triangles=np.empty((0, 3), dtype=int),
        solids=(),
        clearance_m=0.001,
        clusters=(("bob",),),
        contact=np.zeros((len(q), len(STAND_M) + 1), dtype=bool),
    )


def _cameras() -> tuple[Camera, ...]:
    cameras = []
    for i in range(4):
        azimuth, elevation = np.deg2rad(20 + 90 * i), np.deg2rad((15, 35)[i % 2])
        around = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
        lens = BrownLens(f_px=(1000.0, 1000.0), centre_px=(640.0, 512.0), k=(-0.1, 0.03, 0.0))
        target = np.array([0.0, 0.0, -0.2])
        cameras.append(
            aimed(f"cam{i + 1}", position_m=target + 3.4 * around, target_m=target, size_px=(1280, 1024), lens=lens)
        )
    return tuple(cameras)
