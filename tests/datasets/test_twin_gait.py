"""The lizard's gait beside that of real lizards."""

import numpy as np
import pytest

from benchmarks.twins_published import PUBLISHED, gait, joint_angle
from datasets import make_lizard
from datasets.gait import Gait

DIFFERS = {
    "knee in stance, most extended",
    *(f"{joint} in stance, excursion" for joint in ("knee", "ankle", "elbow", "wrist")),
}
"""What the twin does otherwise than geckos on level ground: it walks with bent limbs, and takes no longer steps."""


@pytest.mark.parametrize("seed", range(3))
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


def test_angles_are_those_of_the_bones():
    """The law of cosines on the three distances between hip, knee and ankle."""
    recording = make_lizard(seed=2, n_frames=60)
    names = list(recording.truth.names)
    hip, knee, ankle = (recording.truth.xyz_m[:, names.index(f"{name}_l")] for name in ("hip", "knee", "ankle"))
    a, b, c = (np.linalg.norm(v, axis=1) for v in (hip - knee, ankle - knee, hip - ankle))
    expected = np.degrees(np.arccos((a**2 + b**2 - c**2) / (2 * a * b)))
    np.testing.assert_allclose(joint_angle(recording, "hip_l", "knee_l", "ankle_l"), expected, atol=1e-9)


def test_a_standing_lizard_has_no_gait():
    with pytest.raises(ValueError, match="comes down"):
        gait(make_lizard(seed=0, n_frames=20))
