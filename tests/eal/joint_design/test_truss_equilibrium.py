"""Internal nodes in equilibrium: beside closed forms, a simplex without derivatives, and differences."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from eal.joint_design import DesignError, Truss, equilibria, follow
from tests.reference import planar_truss


def series(k1, k2, law="linear"):
    return Truss(
        fixed_m=np.array([[0.0, 0.0]]),
        internal_m=np.array([[1.0, 0.0]]),
        ends=np.array([[0, 2], [2, 1]]),
        rest_m=np.array([1.0, 0.5]),
        stiffness_n_m=np.array([k1, k2]),
        laws=(law, law),
    )


def braced(rng):
    """A truss in space with two internal nodes between four fixed ones and the moving point."""
    fixed = 2.0 * rng.standard_normal((4, 3))
    ends = [(0, 5), (1, 5), (2, 6), (3, 6), (5, 6), (5, 4), (6, 4), (0, 4), (3, 5), (1, 6)]
    return Truss(
        fixed_m=fixed,
        internal_m=0.3 * rng.standard_normal((2, 3)),
        ends=np.array(ends),
        rest_m=rng.uniform(0.8, 1.6, len(ends)),
        stiffness_n_m=rng.uniform(1.0, 4.0, len(ends)),
        laws=(
            "linear",
            "neo_hookean",
            "cable",
            "linear",
            "strut",
            "linear",
            "neo_hookean",
            "linear",
            "linear",
            "linear",
        ),
    )


@pytest.mark.rare
def test_springs_in_series_are_one_spring():
    """U = k (l - L)^2 / 2 with 1/k = 1/k1 + 1/k2, L the sum, when pulled; stiffness along k, across F / l."""
    found = equilibria(series(3.0, 5.0), np.array([[2.1, 0.0], [0.0, 1.9]]), np.array([[[1.2, 0.0]], [[0.0, 1.1]]]))
    k = 3.0 * 5.0 / 8.0
    np.testing.assert_allclose(found.energy_j, k / 2 * np.array([0.6, 0.4]) ** 2, rtol=1e-10)
    np.testing.assert_allclose(found.force_n, [[0.6 * k, 0], [0, 0.4 * k]], atol=1e-9)
    np.testing.assert_allclose(found.stiffness_n_m[0], [[k, 0], [0, 0.6 * k / 2.1]], atol=1e-8)
    assert found.found.all()


@pytest.mark.rare
def test_energy_is_that_of_a_simplex_search(rng):
    """Nelder and Mead's simplex, without derivatives, ends within 1e-10 J of the same minimum from the same start."""
    truss, q = braced(rng), 0.8 * rng.standard_normal(3)
    ours = equilibria(truss, q[None])
    _, energy = planar_truss.settled(truss, q, ours.x_m[0] + 1e-3)
    assert ours.found[0]
    assert ours.stable[0] > 0
    assert ours.energy_j[0] == pytest.approx(planar_truss.energy(truss, q, ours.x_m[0]), rel=1e-12)
    assert ours.energy_j[0] == pytest.approx(energy, abs=1e-10)


@pytest.mark.rare
def test_force_and_stiffness_are_derivatives(rng):
    """Central differences of U and of its gradient over 1e-5: error of order 1e-10 times third derivatives, 1e-6."""
    truss, q = braced(rng), 0.5 * rng.standard_normal(3)
    at, h = equilibria(truss, q[None]), 1e-5
    moved = equilibria(truss, np.concatenate([q + h * np.eye(3), q - h * np.eye(3)]), at.x_m[0])
    np.testing.assert_allclose(at.force_n[0], (moved.energy_j[:3] - moved.energy_j[3:]) / (2 * h), atol=1e-6)
    np.testing.assert_allclose(at.stiffness_n_m[0], (moved.force_n[:3] - moved.force_n[3:]) / (2 * h), atol=1e-6)


def test_a_turned_truss_has_the_same_energy(rng):
    """Turning nodes and point together changes neither energy nor stretch, however large the turn."""
    truss, q = braced(rng), np.array([[0.4, -0.3, 0.2]])
    turn = Rotation.from_rotvec([1.2, -1.2, 1.0]).as_matrix()
    turned = Truss(
        fixed_m=truss.fixed_m @ turn.T,
        internal_m=truss.internal_m @ turn.T,
        ends=truss.ends,
        rest_m=truss.rest_m,
        stiffness_n_m=truss.stiffness_n_m,
        laws=truss.laws,
    )
    one, other = equilibria(truss, q), equilibria(turned, q @ turn.T)
    np.testing.assert_allclose(one.energy_j, other.energy_j, rtol=1e-12)
    np.testing.assert_allclose(one.stretch, other.stretch, rtol=1e-9)


def test_scales_are_units(rng):
    """Metres times 3 and joules times 7: the energy is 7 times, at 3 times the place."""
    truss, q = braced(rng), np.array([[0.4, -0.3, 0.2]])
    scaled = equilibria(truss.scaled(metres=3.0, joules=7.0), 3.0 * q)
    np.testing.assert_allclose(scaled.energy_j, 7.0 * equilibria(truss, q).energy_j, rtol=1e-10)


def test_impossible_trusses_are_refused():
    with pytest.raises(DesignError, match="between 0 and 1"):
        Truss(
            fixed_m=np.zeros((1, 2)),
            internal_m=np.empty((0, 2)),
            ends=np.array([[0, 2]]),
            rest_m=np.ones(1),
            stiffness_n_m=np.ones(1),
            laws=("linear",),
        )


def test_without_internal_nodes_there_is_nothing_to_follow(rng):
    """The path gives the same energies as single positions, and no snap."""
    truss = Truss(
        fixed_m=rng.standard_normal((3, 2)),
        internal_m=np.empty((0, 2)),
        ends=np.array([[0, 3], [1, 3], [2, 3]]),
        rest_m=np.ones(3),
        stiffness_n_m=np.ones(3),
        laws=("linear", "cable", "strut"),
    )
    path = rng.standard_normal((5, 2))
    led = follow(truss, path)
    assert led.snaps == ()
    expected = [planar_truss.energy(truss, q, np.empty((0, 2))) for q in path]
    np.testing.assert_allclose(led.states.energy_j, expected, rtol=1e-12)
