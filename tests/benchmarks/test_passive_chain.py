"""The chain that swings freely: constant lengths, constant energy, no moments."""

import numpy as np
import pytest

from benchmarks.passive_chain import LENGTH_M, MASS_KG, accelerations, mass_matrix, skeleton, swing
from eal.systems import GRAVITY_M_S2
from mocap.kinematics.moments import _Loads
from mocap.kinematics.points import distal_parts


@pytest.mark.parametrize("kind", ["plane", "space"])
def test_no_moment_acts(kind):
    """Lengths to 1e-9 m and energy to 1e-6 of what moves (DOP853 at 1e-10); moments to 1e-5 of weight times length."""
    x, v, a = swing(kind, 4)
    lengths = np.linalg.norm(np.diff(x[:, 1:], axis=1), axis=-1)
    np.testing.assert_allclose(lengths, LENGTH_M * np.ones((len(x), 3)), atol=1e-9)
    kinetic = 0.5 * np.einsum("ij,tik,tjk->t", mass_matrix(), v[:, 2:], v[:, 2:])
    middle = 0.5 * (x[:, 1:-1, 2] + x[:, 2:, 2])
    energy = kinetic + GRAVITY_M_S2 * middle @ MASS_KG
    np.testing.assert_allclose(energy, energy[0], atol=1e-6 * np.ptp(kinetic))
    assert (np.ptp(x[:, 2:, 1]) > 1e-3) == (kind == "space")
    gravity, names = np.array([0, 0, -GRAVITY_M_S2]), list("abcde")
    for part in distal_parts(skeleton()).values():
        index = [names.index(name) for name in part.markers]
        _, moment = _Loads(part, gravity)(x[:, index], a[:, index])
        assert np.abs(moment).max() < 1e-5 * MASS_KG.sum() * GRAVITY_M_S2 * LENGTH_M.sum()


def test_a_chain_that_hangs_stays():
    """Straight down and at rest nothing accelerates; level and at rest the first rod of three falls."""
    down = np.cumsum(LENGTH_M)[:, None] * [0, 0, -1.0]
    np.testing.assert_allclose(accelerations(down, 0 * down), 0, atol=1e-12)
    level = np.cumsum(LENGTH_M)[:, None] * [1.0, 0, 0]
    assert accelerations(level, 0 * level)[0, 2] < 0
