"""The beating wing of a bat as a chain of rigid bones, posed by its phase.

Segments are given by two angles in the plane of the wing: azimuth from straight outward towards the head, and
elevation towards the back. The whole plane flaps, sweeps and twists. The wing is extended through a broad downstroke
and sharply retracted on the upstroke, as Tian et al. (2006, AIAA 2006-2865) saw it in slow flight; bats of other sizes
differ little in stroke amplitude, stroke plane and camber (Riskin et al. 2010, J. Exp. Biol. 213, 4110). The angles are
round numbers, not fitted to an animal; ``docs/experiments/simulated_animals.md`` has them beside those of a real bat.
"""

from dataclasses import dataclass

import numpy as np
from mocap.datasets.linkage import hinged, rotated, turn

from eal.arrays import Array

# bone lengths in metres: a bat of 30 g, forearm 55 mm
HUMERUS_M, RADIUS_M = 0.032, 0.055
DIGITS_M = {"d3": (0.046, 0.024, 0.028), "d4": (0.044, 0.020, 0.020), "d5": (0.044, 0.016, 0.016)}
SEGMENTS = ("shoulder", "elbow", "wrist", *(f"{d}_{j}" for d in DIGITS_M for j in ("mcp", "pip", "tip")))


@dataclass(frozen=True, eq=False, kw_only=True)
class Beat:
    """What the wing does, apart from its phase; all (T,), 1 or 0 on average.

    Attributes:
        stroke: Scale of the flapping amplitude.
        fold: Scale of the flexion on the upstroke.
        sweep_rad: Added sweep towards the head.
        twist_rad: Added pitch of the wing, leading edge up.
    """

    stroke: Array
    fold: Array
    sweep_rad: Array
    twist_rad: Array


def wing(phase_rad: Array, beat: Beat, *, rolling: float = 0.0, folding: tuple[float, float] = (1.0, 1.0)) -> Array:
    """Joints of a left wing relative to its shoulder, in the axes of the body (x head, y left, z back).

    Args:
        phase_rad: (T,) phase; 0 where the wing is highest, so that the downstroke takes the first half.
        beat: Modulation of this wing.
        rolling: Radius of the condyles of elbow, wrist and fingers as a share of the bone beyond; see ``hinged``.
        folding: How far elbow and wrist fold on the upstroke; 1: by 56 and 62 degrees.

    Returns:
        (T, 12, 3) metres, in the order of ``SEGMENTS``; the shoulder is the origin.
    """
    deg = np.pi / 180
    # the downstroke is a little slower than the upstroke: its phase is stretched
    phi = phase_rad - 0.12 * np.sin(phase_rad)
    sin, cos = np.sin(phi), np.cos(phi)
    # bumps that peak in mid-upstroke, the wrist after the elbow
    fold_elbow = folding[0] * beat.fold * np.exp(1.6 * (np.cos(phi - 1.42 * np.pi) - 1))
    fold_wrist = folding[1] * beat.fold * np.exp(1.6 * (np.cos(phi - 1.52 * np.pi) - 1))

    flap = deg * (6 + 42 * beat.stroke * cos + 4 * np.cos(2 * phi + 0.6))
    sweep = deg * (2 + 17 * beat.stroke * np.cos(phi - 1.1 * np.pi)) + beat.sweep_rad
    twist = deg * (7 - 13 * beat.stroke * sin) + beat.twist_rad
    plane = turn(0, flap) @ turn(2, -sweep) @ turn(1, -twist)

    # the hand lags behind the arm: its tip is bent up on the way down, and down on the way up
    hand = deg * beat.stroke * (15 * np.sin(phi - 0.2))
    camber = deg * (14 + 7 * beat.stroke * np.sin(phi - 0.4))
    chain = {
        "elbow": (HUMERUS_M, -34 - 22 * fold_elbow, -4 + 5 * cos),
        "wrist": (RADIUS_M, 24 + 34 * fold_elbow, 4 + 6 * np.cos(phi - 0.5)),
    }
    # azimuths extended, and what a full fold adds, of the three bones of each digit
    azimuths = {
        "d3": ((-6, -24, -40), (-62, -54, -46)),
        "d4": ((-44, -60, -72), (-36, -28, -22)),
        "d5": ((-84, -94, -102), (-10, -8, -6)),
    }
    bends = {"d3": (0.0, 0.5, 0.8), "d4": (0.15, 1.0, 1.4), "d5": (0.3, 1.5, 2.2)}
    joints = {"shoulder": np.zeros((len(phi), 3))}
    directions: dict[str, Array] = {}

    def add(name: str, parent: str, length_m: float, azimuth_rad: Array, elevation_rad: Array) -> None:
        direction = directions[name] = _direction(azimuth_rad, elevation_rad)
        before = directions.get(parent, direction)
        joints[name] = joints[parent] + hinged(before, direction, length_m=length_m, condyle_m=rolling * length_m)

    for name, parent in (("elbow", "shoulder"), ("wrist", "elbow")):
        length_m, azimuth, elevation = chain[name]
        add(name, parent, length_m, deg * azimuth, deg * elevation)
    for digit, lengths_m in DIGITS_M.items():
        parent = "wrist"
        for k, joint in enumerate(("mcp", "pip", "tip")):
            azimuth = deg * (azimuths[digit][0][k] + azimuths[digit][1][k] * fold_wrist)
            add(f"{digit}_{joint}", parent, lengths_m[k], azimuth, hand - bends[digit][k] * camber)
            parent = f"{digit}_{joint}"
    return rotated(plane[:, None], np.stack([joints[name] for name in SEGMENTS], axis=1))


def _direction(azimuth_rad: Array, elevation_rad: Array) -> Array:
    """(T, 3) unit vectors in the plane of a left wing."""
    level = np.cos(elevation_rad)
    return np.stack([level * np.sin(azimuth_rad), level * np.cos(azimuth_rad), np.sin(elevation_rad)], axis=-1)
