"""The lizard twin's joint angles and gait beside published ones.

Published are means of lizards that walk on level ground: leopard geckos (*Eublepharis macularius*; Jagnandan & Higham
2017, Table 1, ten animals with their tails, joints in stance; McElroy et al. 2008, Table 1; Fuller et al. 2011,
abstract), a frog-eyed gecko (*Teratoscincus scincus*, Fuller et al.) and a desert iguana (*Dipsosaurus dorsalis*,
Fieler & Jayne 1998, abstract, at 0.5 m/s). But for the last, the numbers were read where public surveys of gecko gait
quote them, not in the papers. Of *Anolis sagrei* itself only directions could be read: on narrow perches it bends the
knee more in stance than on flat ground (Spezzano & Jayne 2004, J. Exp. Biol. 207, 2115). Joint angles of flying bats
were not to be found with numbers; the wind-tunnel twin is compared with a recording instead (``test_twin_wing.py``).
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest
from mocap.datasets import make_lizard
from mocap.datasets.lizards import Gait

JOINTS = {
    "knee": ("hip", "knee", "ankle", "foot"),
    "ankle": ("knee", "ankle", "foot", "foot"),
    "elbow": ("shoulder", "elbow", "wrist", "hand"),
    "wrist": ("elbow", "wrist", "hand", "hand"),
}
"""Three markers whose angle is the joint's, 180 degrees when straight, and the marker that stands."""

JAGNANDAN = "Jagnandan & Higham 2017, doi:10.1038/s41598-017-11484-7"
FULLER = "Fuller et al. 2011, doi:10.1016/j.zool.2010.11.003"
MCELROY = "McElroy et al. 2008, doi:10.1242/jeb.015503"
FIELER = "Fieler & Jayne 1998, J. Exp. Biol. 201, 609"


@dataclass(frozen=True, kw_only=True)
class Published:
    """A quantity as published.

    Attributes:
        what: Key of what ``gait`` computes.
        low: Least of the published means.
        high: Greatest of them.
        near: Distance from these within which a twin of another species is taken to agree: what species differ by.
        source: Where they stand.
    """

    what: str
    low: float
    high: float
    near: float
    source: str

    def agrees(self, value: float) -> bool:
        """Whether a value lies in the range or near it."""
        return self.low - self.near <= value <= self.high + self.near


# what the published means of one quantity differ by: knees of two geckos at footfall, duties, strides of one gecko in
# two studies; gaits are told apart by an eighth of a cycle
ANGLE, DUTY, STRIDE, PHASE = 19.0, 0.15, 0.11, 0.125
PUBLISHED = (
    Published(what="duty of the hind limb", low=0.63, high=0.78, near=DUTY, source=f"{FIELER}; {MCELROY}; {JAGNANDAN}"),
    Published(what="duty of the forelimb", low=0.7, high=0.7, near=DUTY, source=JAGNANDAN),
    Published(what="fore after hind, cycles", low=0.43, high=0.44, near=PHASE, source=MCELROY),
    Published(what="stride, snout to vent", low=0.62, high=0.73, near=STRIDE, source=JAGNANDAN),
    Published(what="knee at footfall", low=101.6, high=120.6, near=ANGLE, source=FULLER),
    Published(what="knee in stance, most extended", low=164.5, high=164.5, near=ANGLE, source=JAGNANDAN),
    Published(what="knee in stance, excursion", low=98.8, high=98.8, near=ANGLE, source=JAGNANDAN),
    Published(what="ankle in stance, most extended", low=139.7, high=139.7, near=ANGLE, source=JAGNANDAN),
    Published(what="ankle in stance, excursion", low=85.2, high=85.2, near=ANGLE, source=JAGNANDAN),
    Published(what="elbow in stance, excursion", low=92.5, high=92.5, near=ANGLE, source=JAGNANDAN),
    Published(what="wrist in stance, excursion", low=71.9, high=71.9, near=ANGLE, source=JAGNANDAN),
)
"""Published gait, in degrees unless said otherwise."""


def joint_angle(recording, a, b, c):
    """(T,) angle at marker b between a and c in degrees."""
    index = {name: m for m, name in enumerate(recording.truth.names)}
    xyz_m = recording.truth.xyz_m
    u, v = xyz_m[:, index[a]] - xyz_m[:, index[b]], xyz_m[:, index[c]] - xyz_m[:, index[b]]
    return np.degrees(np.arccos(np.sum(u * v, axis=1) / np.linalg.norm(u, axis=1) / np.linalg.norm(v, axis=1)))


def gait(recording):
    """What ``PUBLISHED`` names, of a lizard without skin motion: means over strides from footfall to footfall.

    Args:
        recording: With at least two footfalls of every limb.

    Raises:
        ValueError: a limb has fewer.
    """
    index = {name: m for m, name in enumerate(recording.truth.names)}
    xyz_m = recording.truth.xyz_m

    def footfalls(foot):
        down = np.flatnonzero(np.diff(recording.contact[:, index[foot]].astype(int)) == 1) + 1
        if len(down) < 2:
            raise ValueError(f"{foot} comes down {len(down)} times and must 2 times or more: record more frames")
        return down

    found = {}
    for joint, (a, b, c, foot) in JOINTS.items():
        low, high, first = [], [], []
        for side in "lr":
            angle = joint_angle(recording, f"{a}_{side}", f"{b}_{side}", f"{c}_{side}")
            down, stands = footfalls(f"{foot}_{side}"), recording.contact[:, index[f"{foot}_{side}"]]
            strides = np.split(angle, down)[1:-1]
            stances = [part[on] for part, on in zip(strides, np.split(stands, down)[1:-1], strict=True)]
            low += [stance.min() for stance in stances]
            high += [stance.max() for stance in stances]
            first += [stride[0] for stride in strides]
        found[f"{joint} in stance, most extended"] = np.mean(high)
        found[f"{joint} in stance, excursion"] = np.mean(np.subtract(high, low))
        found[f"{joint} at footfall"] = np.mean(first)
    for limb, foot in (("hind limb", "foot"), ("forelimb", "hand")):
        shares = []
        for side in "lr":
            down = footfalls(f"{foot}_{side}")
            shares.append(recording.contact[down[0] : down[-1], index[f"{foot}_{side}"]].mean())
        found[f"duty of the {limb}"] = np.mean(shares)
    chain = [xyz_m[0, index[name]] for name in ("snout", "head", "neck", "spine", "pelvis")]
    body_m = np.linalg.norm(np.diff(chain, axis=0), axis=1).sum()
    lags, ways = [], []
    for side in "lr":
        hind, fore = footfalls(f"foot_{side}"), footfalls(f"hand_{side}")
        ways += list(np.linalg.norm(np.diff(xyz_m[hind, index["spine"]], axis=0), axis=1))
        for start, stop in pairwise(hind):
            lags += list((fore[(fore >= start) & (fore < stop)] - start) / (stop - start))
    found |= {"stride, snout to vent": np.mean(ways) / body_m, "fore after hind, cycles": np.mean(lags)}
    return {what: float(value) for what, value in found.items()}


DIFFERS = {
    "knee in stance, most extended",
    *(f"{joint} in stance, excursion" for joint in ("knee", "ankle", "elbow", "wrist")),
}
"""What the twin does otherwise than geckos on level ground: it walks with bent limbs, and takes no longer steps."""


@pytest.mark.parametrize("seed", range(2))
def test_the_gait_is_a_lizards_but_for_what_is_said(seed):
    """Duty, footfalls, stride, knee at footfall and ankle lie in published ranges or near them; the rest does not."""
    found = gait(make_lizard(seed=seed, n_frames=1000, skin_m=0))
    assert {row.what for row in PUBLISHED if not row.agrees(found[row.what])} == DIFFERS


def test_what_is_compared_is_what_the_gait_was_made_of():
    """Duty and stride come out as they were put in; a trot lands fore and hind half a cycle apart.

    A footfall is known to a frame of 79; footholds scatter by 1 mm of 44, some 11 strides of each foot were averaged.
    """
    made, found = Gait(), gait(make_lizard(seed=1, n_frames=1000, skin_m=0))
    assert found["duty of the hind limb"] == pytest.approx(made.duty, abs=0.015)
    assert found["fore after hind, cycles"] == pytest.approx(0.5, abs=0.015)
    assert found["stride, snout to vent"] == pytest.approx(made.stride_m / 0.059, rel=0.02)
