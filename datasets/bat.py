"""A bat in a flight tunnel, filmed by wide action cameras."""

import numpy as np

from datasets.bat_skeleton import MARKERS, TRUNK, bat_skeleton, membranes, wing_tips
from datasets.bat_wing import SEGMENTS, Beat, wing
from datasets.film import film
from datasets.linkage import rotated, turn
from datasets.observe import Digitiser
from datasets.occlusion import Solid
from datasets.recording import SyntheticRecording
from datasets.rig import tunnel_cameras
from datasets.scene import Scene, frame_times
from datasets.wander import Wander, draw_wander, skin_motion
from mocap.arrays import Array

BEAT_HZ = 9.0
_DEG = np.pi / 180
_GRAVITY_M_S2 = 9.81
# markers fixed to the trunk, and the hips, in the axes of the body
_ON_TRUNK_M = {
    "sternum": (0.010, 0.0, -0.0170),
    "back": (0.002, 0.0, 0.0175),
    "pelvis": (-0.036, 0.0, 0.0095),
    "shoulder_l": (0.014, 0.0160, 0.0080),
    "shoulder_r": (0.014, -0.0160, 0.0080),
}
_ON_HEAD_M = {"head": (0.012, 0, 0.0125), "snout": (0.030, 0, 0.001), "ear_l": (0.008, 0.011, 0.024)}
_NECK_M = np.array([0.036, 0, 0.004])
_HIP_M = np.array([-0.036, 0.008, 0.002])
_LEG_M, _TAIL_M = 0.034, 0.026


def make_bat(
    *,
    seed: int = 0,
    n_frames: int = 540,
    fps: float = 240.0,
    n_cameras: int = 8,
    skin_m: float = 0.0005,
    digitiser: Digitiser | None = None,
) -> SyntheticRecording:
    """A bat that flies level in a wind tunnel, against the wind, so that it stays in view.

    The motion depends on the seed only: a longer recording, or one with more cameras, begins with the same flight.

    Args:
        seed: Any integer; the same gives the same bytes.
        n_frames: Number of frames.
        fps: Frames a second.
        n_cameras: Number of cameras, 2 or more.
        skin_m: Root mean square of one coordinate of the markers' motion on the bone; 0: rigid.
        digitiser: Quality of the digitising; None: a human's.

    Returns:
        The recording, with its truth.

    Raises:
        ValueError: fewer than 2 cameras or 1 frame, or a rate that is not positive.
    """
    digitiser = digitiser or Digitiser()
    cameras = tunnel_cameras(n_cameras)
    motion_rng, clicks_rng = np.random.default_rng(seed).spawn(2)
    scene = bat_scene(frame_times(n_frames, fps), motion_rng, skin_m=skin_m)
    card = {
        "name": "bat",
        "species": "bat of 30 g and 0.34 m span, level flight",
        "rig": f"flight tunnel, {n_cameras} wide action cameras with Brown distortion",
        "seed": seed,
        "wing_beat_hz": BEAT_HZ,
        "skin_m": skin_m,
    }
    return film(scene, cameras, name="bat", fps=fps, digitiser=digitiser, rng=clicks_rng, card=card)


def bat_scene(t_s: Array, rng: np.random.Generator, *, skin_m: float) -> Scene:
    """The bat's motion at times (T,); ``skin_m`` as in ``make_bat``."""
    tempo = draw_wander(rng, band_hz=(0.3, 2.0))
    start = rng.uniform(0, 2 * np.pi)
    phase = start + 2 * np.pi * BEAT_HZ * (t_s + 0.035 * tempo.integral(t_s))
    # what both wings share is larger than what tells them apart
    shared, own = _beats(rng, t_s, scale=1.0), [_beats(rng, t_s, scale=0.4) for _ in "lr"]

    position, rotation = _flight(rng, t_s, phase)
    head_yaw, head_pitch, tail_pitch = (draw_wander(rng, band_hz=(0.3, 3.0)).value(t_s) for _ in range(3))
    body = {name: np.broadcast_to(xyz, (len(t_s), 3)) for name, xyz in _ON_TRUNK_M.items()}
    head_turn = turn(2, 7 * _DEG * head_yaw) @ turn(1, _DEG * (4 * head_pitch - 3 * np.sin(phase - 0.5)))
    for name, xyz in _ON_HEAD_M.items():
        body[name] = _NECK_M + rotated(head_turn, np.array(xyz))
    body["ear_r"] = _NECK_M + rotated(head_turn, np.array(_ON_HEAD_M["ear_l"]) * [1, -1, 1])
    tail = rotated(turn(1, -_DEG * (12 + 9 * np.sin(phase - 1.9) + 5 * tail_pitch)), np.array([-1.0, 0, 0]))
    body["tail"] = body["pelvis"] + _TAIL_M * tail

    for side, mirror, beats in zip("lr", (1, -1), own, strict=True):
        flip = np.array([1.0, mirror, 1.0])
        beat = Beat(
            stroke=1 + 0.06 * (shared[0] + beats[0]),
            fold=1 + 0.10 * (shared[1] + beats[1]),
            sweep_rad=3.5 * _DEG * (shared[2] + beats[2]),
            twist_rad=4.0 * _DEG * (shared[3] + beats[3]),
        )
        joints = wing(phase, beat) * flip + body[f"shoulder_{side}"][:, None]
        body |= {f"{name}_{side}": joints[:, k] for k, name in enumerate(SEGMENTS)}
        splay = _DEG * (38 + 6 * np.sin(phase - 2.4) + 4 * beats[1])
        raised = _DEG * (-4 + 14 * np.cos(phase - 0.9) + 4 * beats[2])
        level = np.cos(raised)
        leg = np.stack([-level * np.cos(splay), level * np.sin(splay), np.sin(raised)], axis=-1)
        body[f"ankle_{side}"] = (_HIP_M + _LEG_M * leg) * flip

    xyz = np.stack([body[name] for name in MARKERS], axis=1)
    if skin_m > 0:
        scale = skin_m * np.array([0.6 if name in TRUNK else 1.0 for name in MARKERS])
        xyz = xyz + skin_motion(rng, t_s, phase, scale * rng.uniform(0.6, 1.4, len(MARKERS)))
    trunk = Solid(
        centre_m=position + rotated(rotation, np.array([-0.004, 0, 0])),
        rotation=rotation,
        semi_axes_m=np.array([0.042, 0.0135, 0.0155]),
    )
    skull = Solid(
        centre_m=position + rotated(rotation, _NECK_M + rotated(head_turn, np.array([0.013, 0, 0]))),
        rotation=rotation @ head_turn,
        semi_axes_m=np.array([0.0165, 0.009, 0.0105]),
    )
    return Scene(
        skeleton=bat_skeleton(),
        t_s=t_s,
        xyz_m=position[:, None] + rotated(rotation[:, None], xyz),
        triangles=membranes(),
        solids=(trunk, skull),
        clearance_m=0.003,
        clusters=wing_tips(),
        contact=np.zeros(xyz.shape[:2], dtype=bool),
    )


def _beats(rng: np.random.Generator, t_s: Array, *, scale: float) -> list[Array]:
    """Four (T,) modulations: stroke, fold, sweep, twist; slower than the wing beat, so that they differ by cycle."""
    return [scale * draw_wander(rng, band_hz=(0.3, 4.0)).value(t_s) for _ in range(4)]


def _flight(rng: np.random.Generator, t_s: Array, phase_rad: Array) -> tuple[Array, Array]:
    """Position (T, 3) and rotation (T, 3, 3) of the body: drift upstream, weave, bank, heave with the beat."""
    weave, climb, yaw = (draw_wander(rng, band_hz=(0.2, 0.8), terms=3) for _ in range(3))
    upstream = -0.15 * np.cos(2 * np.pi * 0.2 * t_s)
    heave, surge = -0.006 * np.sin(phase_rad - 0.2), 0.002 * np.cos(phase_rad - 0.6)
    position = np.stack([upstream + surge, 0.03 * weave.value(t_s), 0.02 * climb.value(t_s) + heave], axis=-1)
    rotation = (
        turn(2, 6 * _DEG * yaw.value(t_s))
        @ turn(1, _DEG * (-9 + 2.5 * np.sin(phase_rad - 0.8) + 2 * climb.value(t_s)))
        @ turn(0, _bank(weave, 0.03, t_s) + 1.5 * _DEG * np.sin(phase_rad))
    )
    return position, rotation


def _bank(weave: Wander, scale_m: float, t_s: Array) -> Array:
    """(T,) roll of a level turn, tan(roll) = sideways acceleration / gravity; the wing inside the turn is low."""
    return -np.arctan(scale_m * weave.acceleration(t_s) / _GRAVITY_M_S2)
