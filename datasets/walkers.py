"""People who walk in shoes: markers as optical systems measure them, on segments that are rigid, and shoes that bend.

Joint angles are sums of two harmonics that follow the curves of level walking (Winter 2009, Biomechanics and Motor
Control of Human Movement, appendix A) to a few degrees.
"""

from dataclasses import dataclass

import numpy as np
from mocap.datasets.linkage import draw_wander, ramp, rotated, skin_motion, turn

from eal.arrays import Array
from mocap.records import MarkerTracks, marker_tracks

THIGH_M, SHANK_M, PELVIS_M = 0.42, 0.43, 0.16
_DOWN = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True, kw_only=True)
class Shoe:
    """How a shoe bends.

    Attributes:
        bend_rad: How far its front is turned up against its back where the heel rises, at most; 0: it is rigid.
        varies: By what share strides differ in that (standard deviation).
    """

    bend_rad: float = 0.2
    varies: float = 0.25


STIFF = Shoe(bend_rad=0.0)


def walker(
    seed: int, *, shoe: Shoe, n_frames: int = 300, fps: float = 100.0, skin_m: float = 0.0005, noise_m: float = 2e-4
) -> tuple[MarkerTracks, MarkerTracks]:
    """A walk: pelvis, thighs, shanks of four markers each, shoes of six, of which two are on the part that bends.

    Args:
        seed: Of the motion; the body is the same for all.
        shoe: Of both feet.
        n_frames: Number of frames.
        fps: A second.
        skin_m: Root mean square by which skin carries a marker, a coordinate.
        noise_m: Standard deviation of a measured coordinate.

    Returns:
        The measured markers, and the true ones.
    """
    rng, body = np.random.default_rng([seed, 1]), np.random.default_rng(7)
    t_s = np.arange(n_frames) / fps
    stride_hz = 0.9 * (1 + 0.04 * rng.normal())
    phase = 2 * np.pi * (rng.random() + stride_hz * t_s + 0.01 * draw_wander(rng, band_hz=(0.1, 0.5)).value(t_s))
    sway = [draw_wander(rng, band_hz=(0.2, 0.8)).value(t_s) for _ in range(3)]
    pelvis = np.stack([1.2 * t_s, 0.02 * np.sin(phase) + 0.01 * sway[0], 0.95 + 0.02 * np.cos(2 * phase)], axis=-1)
    facing = turn(2, 0.06 * np.sin(phase) + 0.05 * sway[1]) @ turn(0, 0.04 * np.cos(phase) + 0.02 * sway[2])
    places = body.normal(scale=0.04, size=(4, 3)) * [1.5, 2.0, 0.7]
    parts = {"pelvis": pelvis[:, None] + rotated(facing[:, None], places)}
    for side, sign in (("l", 1.0), ("r", -1.0)):
        own = phase + (np.pi if side == "r" else 0.0)
        hip = pelvis + rotated(facing, np.array([0.0, 0.5 * sign * PELVIS_M, -0.05]))
        parts |= _leg(body, rng, side, own, hip, facing, shoe)
    names = tuple(f"{part}{k + 1}" for part, xyz in parts.items() for k in range(xyz.shape[1]))
    xyz = np.concatenate([*parts.values()], axis=1)
    xyz += rotated(facing[:, None], skin_motion(rng, t_s, phase, np.full(xyz.shape[1], skin_m)))
    return marker_tracks(names, t_s, xyz + noise_m * rng.normal(size=xyz.shape)), marker_tracks(names, t_s, xyz)


def _leg(
    body: np.random.Generator, rng: np.random.Generator, side: str, phase: Array, hip: Array, facing: Array, shoe: Shoe
) -> dict[str, Array]:
    """Markers (T, n, 3) of thigh, shank and foot of a side, whose heel strikes at phase 0."""
    gain = 1 + 0.08 * rng.normal(size=3)
    flexed = gain[0] * (0.15 + 0.38 * np.cos(phase + 0.35) + 0.05 * np.cos(2 * phase))
    knee = gain[1] * (0.42 + 0.38 * np.cos(phase - 4.6) + 0.25 * np.cos(2 * phase - 2.9))
    ankle = gain[2] * (0.02 + 0.12 * np.cos(phase - 2.4) + 0.13 * np.cos(2 * phase - 4.6))
    thigh = facing @ turn(1, -flexed)
    shank = thigh @ turn(1, knee)
    foot = shank @ turn(1, -ankle)
    stride = np.floor(phase / (2 * np.pi)).astype(int)
    at = phase / (2 * np.pi) - stride
    size = shoe.bend_rad * np.maximum(0.0, 1 + shoe.varies * rng.normal(size=int(np.ptp(stride)) + 1))
    bend = size[stride - stride.min()] * (ramp((at - 0.40) / 0.16) - ramp((at - 0.60) / 0.14))  # heel off to swing
    knee_m = hip + THIGH_M * rotated(thigh, _DOWN)
    ankle_m = knee_m + SHANK_M * rotated(shank, _DOWN)
    out = {}
    for name, top, rotation, length in (("thigh", hip, thigh, THIGH_M), ("shank", knee_m, shank, SHANK_M)):
        places = np.column_stack([body.normal(scale=0.05, size=(4, 2)), -length * body.uniform(0.2, 0.8, size=4)])
        out[f"{name}_{side}"] = top[:, None] + rotated(rotation[:, None], places)
    wide = body.uniform(0.03, 0.045, size=3)
    back = np.array(
        [[-0.07, wide[0], -0.05], [-0.07, -wide[0], -0.03], [0.06, wide[1], -0.04], [0.05, -wide[1], -0.03]]
    )
    front = np.array([[0.05, wide[2], 0.0], [0.06, -wide[2], 0.005]])
    ball = ankle_m + rotated(foot, np.array([0.10, 0.0, -0.06]))
    toes = ball[:, None] + rotated((foot @ turn(1, -bend))[:, None], front)
    out[f"foot_{side}"] = np.concatenate([ankle_m[:, None] + rotated(foot[:, None], back), toes], axis=1)
    return out
