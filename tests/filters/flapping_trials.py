"""A small animal that flaps: a body of four markers and two wings that curve, as trials and as one camera sees it."""

import numpy as np
from mocap.filters.poses import MarkerTrial
from scipy.spatial.transform import Rotation

from eal.arrays import Array

NAMES = ("nose", "tail", "left_hip", "right_hip", "elbow_l", "wrist_l", "tip_l", "elbow_r", "wrist_r", "tip_r")
TRUNK = NAMES[:4]
BODY = np.array([[0.06, 0, 0.005], [-0.06, 0, 0], [0, 0.02, -0.01], [0, -0.02, -0.01]])
FPS = 200.0
MATRIX = np.array([[1500.0, 0, 960, 0], [0, 1500.0, 540, 0], [0, 0, 1, 0]])
"""Camera at the origin that looks along z."""


def flapping(seed: int, *, frames: int = 120, lift: tuple[float, float] = (-0.6, 0.9)) -> MarkerTrial:
    """One trial; angles of the wings between ``lift``, with a phase and a rate of its own."""
    rng = np.random.default_rng(seed)
    t = np.arange(frames) / FPS
    phase = 2 * np.pi * (rng.uniform() + (6 + 0.5 * rng.uniform()) * t)
    raise_ = lift[0] + (lift[1] - lift[0]) * 0.5 * (1 + np.sin(phase))
    fold = 0.4 * (1 + np.cos(phase + 0.3))
    out = np.zeros((frames, len(NAMES), 3))
    out[:, :4] = BODY
    for side, first in ((1.0, 4), (-1.0, 7)):
        at = np.tile([0.02, 0.02 * side, 0.0], (frames, 1))
        for k, length in enumerate((0.04, 0.06, 0.07)):
            back = fold * (-1) ** k
            along = np.stack([np.sin(back) * np.cos(raise_), side * np.cos(back) * np.cos(raise_), np.sin(raise_)], 1)
            at = at + length * along
            out[:, first + k] = at
    turn = Rotation.from_euler("zyx", np.column_stack([0.3 * np.sin(1.5 * t), 0.2 * np.cos(2 * t), 0.1 * np.sin(t)]))
    tilt = Rotation.from_euler("xy", [1.0, 0.4])
    place = np.column_stack([0.3 * t, 0.05 * np.sin(3 * t), 1.5 + 0.1 * t])
    world = (tilt * turn).as_matrix()[:, None] @ out[..., None]
    xyz = world[..., 0] + place[:, None] + 3e-4 * rng.normal(size=out.shape)
    return MarkerTrial(name=f"trial{seed}", t_s=t, xyz_m=xyz, sd_m=np.full(out.shape[:2], 3e-4))


def filmed(trial: MarkerTrial, rng: np.random.Generator, *, noise_px: float = 0.5) -> Array:
    """(1, T, M, 2) pixels of one camera."""
    h = trial.xyz_m @ MATRIX[:, :3].T + MATRIX[:, 3]
    return (h[..., :2] / h[..., 2:] + noise_px * rng.normal(size=(*h.shape[:2], 2)))[None]
