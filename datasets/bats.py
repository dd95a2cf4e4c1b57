"""A bat in a flight tunnel, level or in U-turns, filmed by wide action cameras."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np
from mocap.datasets.bat_skeleton import MARKERS, SEGMENTS, TRUNK, Beat, bat_skeleton, membranes, wing, wing_tips
from mocap.datasets.film import FilmedScene, Motion, SyntheticRecording, film
from mocap.datasets.linkage import Wander, draw_wander, rotated, skin_motion, turn
from mocap.datasets.observe import WIND_TUNNEL, Digitiser
from mocap.datasets.occlusion import Solid
from mocap.datasets.rig import LensKind, tunnel_cameras, wind_tunnel_cameras

from eal.arrays import Array
from eal.systems import GRAVITY_M_S2
from mocap.cameras.camera import Camera

_DEG = np.pi / 180
# a U-turn of a bat of 55 g: speed from 2.0 to 0.5 m/s, bank 20 to 40 degrees, 0.2 m gained (Windes et al. 2020)
_SPEED_M_S, _SPEED_SWING = 1.5, 0.54
_HALF_LAP_S, _TURN_SWING = 0.65, 0.45
_HEADING_LEAD_S = 0.03  # by which the body's course is ahead of its way; chosen


@dataclass(frozen=True, eq=False, kw_only=True)
class Path:
    """A level closed path that is flown lap after lap.

    Attributes:
        position_m: (T, 3) positions, the middle of the lap at the origin.
        course_rad: (T,) direction of flight, from x to y.
        speed_m_s: (T,) horizontal speed.
        turning_rad_s: (T,) rate of the course.
    """

    position_m: Array
    course_rad: Array
    speed_m_s: Array
    turning_rad_s: Array


def laps(t_s: Array) -> Path:
    """Laps with a U-turn at each end, slow in the turn and fast between them, in closed form.

    The course is w t - a sin 2 w t with half a lap in pi / w, the speed v (1 + b cos 2 w t). Height is traded for
    speed, z = -(speed^2 - mean) / 2 g, so that mechanical energy is kept. The position is the integral of
    speed exp(i course), a Fourier series of odd harmonics of w, term by term.

    Args:
        t_s: (T,) times; at 0 the bat is in the middle of the tunnel, at its fastest.

    Returns:
        The path; with 64 samples a lap the series is exact to rounding, for its coefficients are Bessel functions.
    """
    omega = np.pi / _HALF_LAP_S
    theta = omega * t_s
    course = theta - _TURN_SWING * np.sin(2 * theta)
    speed = _SPEED_M_S * (1 + _SPEED_SWING * np.cos(2 * theta))
    sample = 2 * np.pi * np.arange(64) / 64
    velocity = _SPEED_M_S * (1 + _SPEED_SWING * np.cos(2 * sample))
    velocity = velocity * np.exp(1j * (sample - _TURN_SWING * np.sin(2 * sample)))
    odd = np.arange(-31, 32, 2)
    weights = np.fft.fft(velocity)[odd] / 64 / (1j * odd * omega)
    plane = np.exp(1j * np.multiply.outer(theta, odd)) @ weights
    mean_square = _SPEED_M_S**2 * (1 + _SPEED_SWING**2 / 2)
    return Path(
        position_m=np.stack([plane.real, plane.imag, (mean_square - speed**2) / (2 * GRAVITY_M_S2)], axis=-1),
        course_rad=course,
        speed_m_s=speed,
        turning_rad_s=omega * (1 - 2 * _TURN_SWING * np.cos(2 * theta)),
    )


def level_flight(rng: np.random.Generator, t_s: Array, phase_rad: Array) -> tuple[Array, Array]:
    """Level flight in a wind tunnel: drift upstream, weave, bank, heave with the beat.

    Args:
        rng: Source of the weave.
        t_s: (T,) times.
        phase_rad: (T,) phase of the wing beat.

    Returns:
        Position (T, 3) in metres and rotation (T, 3, 3) of the body.
    """
    weave, climb, yaw = _wanders(rng)
    upstream = -0.15 * np.cos(2 * np.pi * 0.2 * t_s)
    heave, surge = -0.006 * np.sin(phase_rad - 0.2), 0.002 * np.cos(phase_rad - 0.6)
    position = np.stack([upstream + surge, 0.03 * weave.value(t_s), 0.02 * climb.value(t_s) + heave], axis=-1)
    # tan(roll) = sideways acceleration / gravity; the wing inside the turn is low
    bank = -np.arctan(0.03 * weave.acceleration(t_s) / GRAVITY_M_S2)
    rotation = (
        turn(2, 6 * _DEG * yaw.value(t_s))
        @ turn(1, _DEG * (-9 + 2.5 * np.sin(phase_rad - 0.8) + 2 * climb.value(t_s)))
        @ turn(0, bank + 1.5 * _DEG * np.sin(phase_rad))
    )
    return position, rotation


def turning_flight(rng: np.random.Generator, t_s: Array, phase_rad: Array) -> tuple[Array, Array]:
    """U-turns at both ends of a flight tunnel; arguments and results as in ``level_flight``.

    The bank is that of a turn without slip, tan(bank) = speed x turning / gravity, up to 38 degrees. The body turns
    before the path does, as Iriarte-Diaz & Swartz (2008, J. Exp. Biol. 211) found of Cynopterus brachyotis; the speeds,
    banks and the height gained are the size of those of one U-turn of Hipposideros armiger (Windes, Tafti & Mueller
    2020, PLoS ONE 15, e0241489).
    """
    weave, climb, yaw = _wanders(rng)
    side = 1.0 if rng.random() < 0.5 else -1.0
    start = rng.uniform(0, 2 * _HALF_LAP_S)
    path, ahead = laps(t_s + start), laps(t_s + start + _HEADING_LEAD_S)
    heave, surge = -0.006 * np.sin(phase_rad - 0.2), 0.002 * np.cos(phase_rad - 0.6)
    position = path.position_m * [1.0, side, 1.0]
    position[:, 1:] += np.stack([0.01 * weave.value(t_s), 0.01 * climb.value(t_s) + heave], axis=-1)
    position[:, :2] += surge[:, None] * np.stack([np.cos(path.course_rad), side * np.sin(path.course_rad)], axis=-1)
    bank = np.arctan(path.speed_m_s * path.turning_rad_s / GRAVITY_M_S2)
    rotation = (
        turn(2, side * ahead.course_rad + 3 * _DEG * yaw.value(t_s))
        @ turn(1, _DEG * (-14 + 2.5 * np.sin(phase_rad - 0.8) + 2 * climb.value(t_s)))
        @ turn(0, -side * bank + 1.5 * _DEG * np.sin(phase_rad))
    )
    return position, rotation


def _wanders(rng: np.random.Generator) -> tuple[Wander, Wander, Wander]:
    weave, climb, yaw = (draw_wander(rng, band_hz=(0.2, 0.8), terms=3) for _ in range(3))
    return weave, climb, yaw


Manoeuvre = Literal["level", "turn"]
BEAT_HZ = 9.0  # chosen; not measured
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
    rolling: float = 0.0,
    folding: tuple[float, float] = (1.0, 1.0),
    manoeuvre: Manoeuvre = "level",
    lens: LensKind = "brown",
    cameras: Sequence[Camera] | None = None,
    start_spread_frames: float = 0.0,
    digitiser: Digitiser | None = None,
) -> SyntheticRecording:
    """A bat that flies level in a wind tunnel, against the wind, or that turns at both ends of a flight tunnel.

    The motion depends on the seed only: a longer recording, or one with more cameras, begins with the same flight.

    Args:
        seed: Any integer; the same gives the same bytes.
        n_frames: Number of frames.
        fps: Frames a second.
        n_cameras: Number of cameras, 2 or more.
        skin_m: Root mean square of one coordinate of the markers' motion on the bone; 0: rigid.
        rolling: Radius of the condyles of elbow, wrist and fingers as a share of the bone beyond, so that the
            centres of these joints wander; 0: ideal joints.
        folding: How far elbow and wrist fold on the upstroke; 1: by 56 and 62 degrees.
        manoeuvre: ``level`` or ``turn``.
        lens: Kind of the cameras' lenses, ``brown`` or ``fisheye``.
        cameras: Cameras of another rig about the world's origin, in place of ``n_cameras`` of the flight tunnel.
        start_spread_frames: Cameras start within so much of a frame of each other; 0: at the same instant.
        digitiser: Quality of the digitising; None: a human's.

    Returns:
        The recording, with its truth.

    Raises:
        ValueError: fewer than 2 cameras or 1 frame, or a rate that is not positive.
    """
    rig = f"flight tunnel, {n_cameras} wide action cameras with {lens} lenses"
    if cameras is None:
        cameras = tunnel_cameras(n_cameras, lens=lens)
    else:
        rig = f"{len(cameras)} cameras given by the caller"
    card = {
        "species": f"bat of 30 g and 0.34 m span, {'level flight' if manoeuvre == 'level' else 'U-turns'}",
        "rig": rig,
        "wing_beat_hz": BEAT_HZ,
        "skin_m": skin_m,
        "rolling": rolling,
    }
    return film(
        bat_motion(seed, skin_m=skin_m, rolling=rolling, folding=folding, manoeuvre=manoeuvre),
        cameras,
        name="bat",
        seed=seed,
        n_frames=n_frames,
        fps=fps,
        digitiser=digitiser or Digitiser(),
        card=card,
        start_spread_frames=start_spread_frames,
    )


def make_bat_wind_tunnel(
    *, seed: int = 0, n_frames: int = 270, digitiser: Digitiser = WIND_TUNNEL
) -> SyntheticRecording:
    """The bat as a real one was recorded: 4 cameras at 700 Hz in a wind tunnel, clicked by a human over half a second.

    Rig, clicks and folding are tuned to three flights (078A3 F2, F3, F5) of the recordings that ``mocap data path
    bat_windtunnel_dltdv8`` names; ``docs/experiments/simulated_animals.md`` says how near it comes.
    """
    recording = make_bat(
        seed=seed,
        n_frames=n_frames,
        fps=700.0,
        cameras=wind_tunnel_cameras(),
        folding=(1.6, 0.1),
        digitiser=digitiser,
    )
    return replace(recording, card={**recording.card, "rig": "wind tunnel, 4 high-speed cameras about 1 m away"})


def bat_motion(
    seed: int,
    *,
    skin_m: float = 0.0005,
    rolling: float = 0.0,
    folding: tuple[float, float] = (1.0, 1.0),
    manoeuvre: Manoeuvre = "level",
) -> Motion:
    """The bat that ``make_bat`` films, as a function of time."""
    own = np.random.SeedSequence(seed).spawn(3)[0]
    return partial(bat_scene, seed=own, skin_m=skin_m, rolling=rolling, folding=folding, manoeuvre=manoeuvre)


def beats_done(seed: int, t_s: Array) -> Array:
    """(T,) wing beats done since time 0 by the bat of a seed: its phase, of which single turning points stray."""
    own = np.random.SeedSequence(seed).spawn(3)[0]
    phase = _phase(np.random.default_rng(own), np.concatenate([[0.0], t_s]))
    return (phase[1:] - phase[0]) / (2 * np.pi)


def _phase(rng: np.random.Generator, t_s: Array) -> Array:
    """(T,) phase of the beat, rad: its rate wanders slowly, by 3.5 %."""
    tempo = draw_wander(rng, band_hz=(0.3, 2.0))
    return rng.uniform(0, 2 * np.pi) + 2 * np.pi * BEAT_HZ * (t_s + 0.035 * tempo.integral(t_s))


def bat_scene(
    t_s: Array,
    *,
    seed: np.random.SeedSequence,
    skin_m: float,
    rolling: float,
    folding: tuple[float, float],
    manoeuvre: Manoeuvre,
) -> FilmedScene:
    """The bat's motion at times (T,), the same function of time for the same seed; others as in ``make_bat``."""
    rng = np.random.default_rng(seed)
    phase = _phase(rng, t_s)
    # what both wings share is larger than what tells them apart
    shared, own = _beats(rng, t_s, scale=1.0), [_beats(rng, t_s, scale=0.4) for _ in "lr"]

    position, rotation = (level_flight if manoeuvre == "level" else turning_flight)(rng, t_s, phase)
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
        joints = wing(phase, beat, rolling=rolling, folding=folding) * flip + body[f"shoulder_{side}"][:, None]
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
    return FilmedScene(
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
