"""The bat's wing over a beat, and its 34 markers, bones, joints and membranes."""

from dataclasses import dataclass

import numpy as np
from mocap.datasets.linkage import hinged, rotated, turn
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.measures import JointAxes, Measures, Segment
from mocap.skeleton import Skeleton

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


TRUNK = ("sternum", "back", "pelvis", "shoulder_l", "shoulder_r")
AXIAL = ("snout", "head", "ear_l", "ear_r", "sternum", "back", "pelvis", "tail")
MARKERS = AXIAL + tuple(f"{name}_{side}" for side in "lr" for name in (*SEGMENTS, "ankle"))

_AXIAL_BONES = (
    ("snout", "head"),
    ("head", "ear_l"),
    ("head", "ear_r"),
    ("sternum", "back"),
    ("sternum", "pelvis"),
    ("back", "pelvis"),
    ("back", "shoulder_l"),
    ("back", "shoulder_r"),
    ("sternum", "shoulder_l"),
    ("sternum", "shoulder_r"),
    ("pelvis", "tail"),
)
_WING_BONES = (
    *(("shoulder", "elbow"), ("elbow", "wrist")),
    *(("wrist", f"{digit}_mcp") for digit in DIGITS_M),
    *((f"{digit}_mcp", f"{digit}_pip") for digit in DIGITS_M),
    *((f"{digit}_pip", f"{digit}_tip") for digit in DIGITS_M),
)
_WING_JOINTS = {
    "elbow": ("shoulder", "elbow", "wrist"),
    "wrist": ("elbow", "wrist", "d3_mcp"),
    "wrist_d5": ("elbow", "wrist", "d5_mcp"),
    "d3_mcp": ("wrist", "d3_mcp", "d3_pip"),
    "d3_pip": ("d3_mcp", "d3_pip", "d3_tip"),
    "d4_mcp": ("wrist", "d4_mcp", "d4_pip"),
    "d4_pip": ("d4_mcp", "d4_pip", "d4_tip"),
    "d5_mcp": ("wrist", "d5_mcp", "d5_pip"),
    "d5_pip": ("d5_mcp", "d5_pip", "d5_tip"),
}
# a fan of triangles without a corner on another's edge; a name without side is taken from that side of the bat
_MEMBRANES = (
    ("shoulder", "elbow", "wrist"),
    ("shoulder", "elbow", "ankle"),
    ("shoulder", "ankle", "pelvis"),
    ("elbow", "ankle", "d5_tip"),
    ("elbow", "d5_tip", "d5_pip"),
    ("elbow", "d5_pip", "d5_mcp"),
    ("elbow", "d5_mcp", "wrist"),
    ("wrist", "d5_mcp", "d4_mcp"),
    ("d5_mcp", "d5_pip", "d4_mcp"),
    ("d5_pip", "d4_pip", "d4_mcp"),
    ("d5_pip", "d5_tip", "d4_pip"),
    ("d5_tip", "d4_tip", "d4_pip"),
    ("wrist", "d4_mcp", "d3_mcp"),
    ("d4_mcp", "d4_pip", "d3_mcp"),
    ("d4_pip", "d3_pip", "d3_mcp"),
    ("d4_pip", "d4_tip", "d3_pip"),
    ("d4_tip", "d3_tip", "d3_pip"),
    ("pelvis", "ankle", "tail"),
)


def bat_skeleton() -> Skeleton:
    """The bat's skeleton; bones are rigid but the neck and the legs, whose joints carry no marker."""
    bones: list[tuple[str, ...]] = [*_AXIAL_BONES, ("back", "head", "soft")]
    joints: dict[str, tuple[str, str, str]] = {}
    for side in "lr":
        bones += [(f"{a}_{side}", f"{b}_{side}") for a, b in _WING_BONES]
        bones += [("pelvis", f"ankle_{side}", "soft")]
        joints[f"shoulder_{side}"] = ("back", f"shoulder_{side}", f"elbow_{side}")
        joints |= {
            f"{name}_{side}": (f"{a}_{side}", f"{b}_{side}", f"{c}_{side}") for name, (a, b, c) in _WING_JOINTS.items()
        }
    joints["tail"] = ("back", "pelvis", "tail")
    # what a paper on flight reports; the masses are the twin's own (30 g), not measured ones
    axes, areas, strokes = {}, {}, {}
    parts = {"trunk": Segment(start="sternum", end="pelvis", mass_g=21.0, centre=0.4)}
    parts["head"] = Segment(start="head", end="snout", mass_g=4.6, centre=0.3)
    for side in "lr":
        shoulder, elbow, wrist = (f"{name}_{side}" for name in ("shoulder", "elbow", "wrist"))
        tips = [f"{digit}_tip_{side}" for digit in ("d3", "d4", "d5")]
        across = ("shoulder_r", "shoulder_l")
        axes[shoulder] = JointAxes(parent=(("pelvis", "back"), across), child=((shoulder, elbow), (elbow, wrist)))
        areas[f"wing_{side}"] = (shoulder, elbow, wrist, *tips, f"ankle_{side}", "pelvis")
        strokes[f"wing_{side}"] = (shoulder, wrist)
        parts[f"arm_{side}"] = Segment(start=shoulder, end=wrist, mass_g=1.5, centre=0.35)
        parts[f"hand_{side}"] = Segment(start=wrist, end=tips[0], mass_g=0.7, centre=0.3)
    return Skeleton(
        name="bat",
        markers=MARKERS,
        bones=bones,
        joints=joints,
        trunk=TRUNK,
        max_speed_m_s=20.0,
        measures=Measures(
            forward=("pelvis", "back"),
            left=("shoulder_r", "shoulder_l"),
            axes=axes,
            distances={"span": ("d3_tip_l", "d3_tip_r")},
            areas=areas,
            strokes=strokes,
            segments=parts,
        ),
    )


def membranes() -> NDArray[np.intp]:
    """(K, 3) marker indices of the wing and tail membranes of both sides."""
    index = {name: m for m, name in enumerate(MARKERS)}
    return np.array(
        [
            [index[name] if name in index else index[f"{name}_{side}"] for name in triangle]
            for side in "lr"
            for triangle in _MEMBRANES
        ]
    )


def wing_tips() -> tuple[tuple[str, ...], ...]:
    """The markers of each wing tip, which are lost together."""
    return tuple(tuple(f"{name}_{side}" for name in ("d3_pip", "d3_tip", "d4_pip", "d4_tip")) for side in "lr")
