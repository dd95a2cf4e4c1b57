"""Where the bat's body is: level flight against the wind, or turns at both ends of the tunnel."""

from dataclasses import dataclass

import numpy as np
from mocap.datasets.linkage import turn
from mocap.datasets.wander import Wander, draw_wander

from eal.arrays import Array

_DEG = np.pi / 180
_GRAVITY_M_S2 = 9.81
# a U-turn of a bat of 55 g: speed from 2.0 to 0.5 m/s, bank 20 to 40 degrees, 0.2 m gained (Windes et al. 2020)
_SPEED_M_S, _SPEED_SWING = 1.5, 0.54
_HALF_LAP_S, _TURN_SWING = 0.65, 0.45


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
        position_m=np.stack([plane.real, plane.imag, (mean_square - speed**2) / (2 * _GRAVITY_M_S2)], axis=-1),
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
    bank = -np.arctan(0.03 * weave.acceleration(t_s) / _GRAVITY_M_S2)
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
    path, ahead = laps(t_s + start), laps(t_s + start + 0.03)
    heave, surge = -0.006 * np.sin(phase_rad - 0.2), 0.002 * np.cos(phase_rad - 0.6)
    position = path.position_m * [1.0, side, 1.0]
    position[:, 1:] += np.stack([0.01 * weave.value(t_s), 0.01 * climb.value(t_s) + heave], axis=-1)
    position[:, :2] += surge[:, None] * np.stack([np.cos(path.course_rad), side * np.sin(path.course_rad)], axis=-1)
    bank = np.arctan(path.speed_m_s * path.turning_rad_s / _GRAVITY_M_S2)
    rotation = (
        turn(2, side * ahead.course_rad + 3 * _DEG * yaw.value(t_s))
        @ turn(1, _DEG * (-14 + 2.5 * np.sin(phase_rad - 0.8) + 2 * climb.value(t_s)))
        @ turn(0, -side * bank + 1.5 * _DEG * np.sin(phase_rad))
    )
    return position, rotation


def _wanders(rng: np.random.Generator) -> tuple[Wander, Wander, Wander]:
    weave, climb, yaw = (draw_wander(rng, band_hz=(0.2, 0.8), terms=3) for _ in range(3))
    return weave, climb, yaw
