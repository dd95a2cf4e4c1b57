"""The 24 markers of the lizard, its bones and joints."""

from itertools import pairwise

from mocap.measures import JointAxes, Measures
from mocap.skeleton import Skeleton

AXIAL = ("snout", "head", "neck", "spine", "pelvis", "tail_1", "tail_2", "tail_3")
LIMBS = {"fore": ("shoulder", "elbow", "wrist", "hand"), "hind": ("hip", "knee", "ankle", "foot")}
MARKERS = AXIAL + tuple(f"{name}_{side}" for limb in LIMBS.values() for side in "lr" for name in limb)
TRUNK = ("neck", "spine", "shoulder_l", "shoulder_r")


def lizard_skeleton() -> Skeleton:
    """The lizard's skeleton; every bone is rigid."""
    bones = [*pairwise(AXIAL), ("shoulder_l", "shoulder_r"), ("hip_l", "hip_r")]
    chains = [AXIAL]
    chains += [
        (girdle, *(f"{name}_{side}" for name in LIMBS[limb]))
        for side in "lr"
        for girdle, limb in (("neck", "fore"), ("pelvis", "hind"))
    ]
    for chain in chains[1:]:
        bones += pairwise(chain)
    return Skeleton(
        name="lizard",
        markers=MARKERS,
        bones=bones,
        joints={triple[1]: triple for chain in chains for triple in zip(chain, chain[1:], chain[2:], strict=False)},
        trunk=TRUNK,
        max_speed_m_s=3.0,
        measures=_measures(),
    )


def _measures() -> Measures:
    """What a paper on locomotion reports."""
    ahead = {"shoulder": ("spine", "neck"), "hip": ("pelvis", "spine")}
    axes = {}
    for limb, (root, middle, end, _) in LIMBS.items():
        across = ("shoulder_r", "shoulder_l") if limb == "fore" else ("hip_r", "hip_l")
        for side in "lr":
            upper, lower = (f"{root}_{side}", f"{middle}_{side}"), (f"{middle}_{side}", f"{end}_{side}")
            axes[upper[0]] = JointAxes(parent=(ahead[root], across), child=(upper, lower))
    return Measures(
        forward=("spine", "neck"),
        left=("shoulder_r", "shoulder_l"),
        axes=axes,
        distances={"snout_vent": ("snout", "pelvis")},
        feet=("hand_l", "foot_r", "hand_r", "foot_l"),
        ground="rod",
        chain=("neck", "spine", "pelvis", "tail_1", "tail_2", "tail_3"),
    )


def extremities() -> tuple[tuple[str, ...], ...]:
    """Sets of markers that are lost together: each hand, each foot, the end of the tail."""
    return (
        *((f"{a}_{side}", f"{b}_{side}") for side in "lr" for a, b in (("wrist", "hand"), ("ankle", "foot"))),
        ("tail_2", "tail_3"),
    )
