"""Rotations against SciPy, and the laws of two-bone limbs."""

import numpy as np
import pytest
from mocap.datasets.linkage import bent, ramp, turn
from scipy.spatial.transform import Rotation


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_turn_is_scipys_rotation(axis):
    angles = np.linspace(-3, 3, 7)
    expected = Rotation.from_euler("xyz"[axis], angles[:, None]).as_matrix()
    np.testing.assert_allclose(turn(axis, angles), expected, atol=1e-15)


def test_bent_keeps_both_lengths_and_bends_to_the_pole():
    rng = np.random.default_rng(0)
    root = rng.normal(size=(200, 3))
    end = root + rng.uniform(0.3, 1.6, (200, 1)) * Rotation.random(200, rng=rng).apply([1.0, 0, 0])
    pole = np.array([0.2, 1.0, -0.1])
    middle = bent(root, end, pole, upper_m=1.0, lower_m=0.8)
    # a few roundings of numbers of size 1 to 4
    np.testing.assert_allclose(np.linalg.norm(middle - root, axis=1), 1.0, atol=4e-15)
    np.testing.assert_allclose(np.linalg.norm(middle - end, axis=1), 0.8, atol=8e-15)
    offset = middle - root
    along = (end - root) / np.linalg.norm(end - root, axis=1, keepdims=True)
    aside = offset - np.sum(offset * along, axis=1, keepdims=True) * along
    assert (aside @ pole > 0).all()


def test_out_of_reach_is_an_error_that_names_the_lengths():
    root, end = np.zeros((1, 3)), np.array([[0.03, 0, 0]])
    with pytest.raises(ValueError, match=r"10\.0 \+ 12\.0 mm cannot span 30\.0"):
        bent(root, end, np.array([0, 1.0, 0]), upper_m=0.010, lower_m=0.012)


def test_ramp_starts_and_ends_at_rest():
    """10 u^3 - 15 u^4 + 6 u^5 is 10 u^3 near 0 and 1 - 10 (1 - u)^3 near 1, and antisymmetric about its middle."""
    u = np.array([-1.0, 0.0, 1e-3, 0.3, 0.5, 1 - 1e-3, 1.0, 2.0])
    expected = [0, 0, 1e-8, 1 - ramp(np.array([0.7]))[0], 0.5, 1 - 1e-8, 1, 1]
    # the next term of the series is 15 u^4
    np.testing.assert_allclose(ramp(u), expected, atol=1.6e-11)
