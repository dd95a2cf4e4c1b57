"""The 34 markers of the bat, its bones, joints and membranes."""

import numpy as np
from mocap.datasets.bat_wing import DIGITS_M, SEGMENTS
from numpy.typing import NDArray

from mocap.measures import JointAxes, Measures, Segment
from mocap.skeleton import Skeleton

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
