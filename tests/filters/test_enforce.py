"""A potential enforced implicitly: exact where it is quadratic, stable and never widening where it is not."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from mocap.filters.ensemble import Gaussian
from mocap.filters.motion.potential import Coordinates, enforce, potential_term


def gaussian(rng, n):
    factor = np.tril(rng.normal(0, 0.4, (n, n)))
    factor[np.diag_indices(n)] = rng.uniform(0.5, 1.5, n)
    return Gaussian(rng.normal(size=n), factor)


def held(state, gradient, coordinates):
    """The state under one potential."""
    return enforce(state, [potential_term(gradient, coordinates)])[0]


def leading(state, k):
    """The first k components."""
    return linear(state, np.eye(k))


def linear(state, rows):
    """Linear functions of the first components."""
    reads = rows.shape[1]
    return Coordinates(rows @ state.mean[:reads], rows, rows @ state.cov[:reads])


@given(seed=st.integers(0, 500), k=st.integers(1, 5), more=st.integers(0, 5))
def test_a_quadratic_potential_is_the_product_of_gaussians(seed, k, more):
    """For V = (x - m)^T H (x - m) / 2 of the first k components: information P^-1 + H, mean by its gradient: exactly.

    Components that V does not read move with those that it reads.
    """
    rng = np.random.default_rng(seed)
    state = gaussian(rng, k + more)
    root, centre = rng.normal(size=(k, k)), rng.normal(size=k)
    hessian = root @ root.T
    found = held(state, lambda z: (z - centre) @ hessian, leading(state, k))
    whole = np.zeros((k + more, k + more))
    whole[:k, :k] = hessian
    information = np.linalg.inv(state.cov) + whole
    force = np.zeros(k + more)
    force[:k] = hessian @ (centre - state.mean[:k])
    np.testing.assert_allclose(found.cov, np.linalg.inv(information), rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(found.mean, state.mean + np.linalg.solve(information, force), rtol=1e-7, atol=1e-8)


@given(seed=st.integers(0, 500), n=st.integers(2, 6), d=st.integers(1, 3), k=st.integers(0, 2))
def test_coordinates_may_be_any_linear_ones(seed, n, d, k):
    """The same product of Gaussians for a potential of q = A x, of the components that the first columns move."""
    rng = np.random.default_rng(seed)
    state, d = gaussian(rng, n + k), min(d, n)
    to_q = np.zeros((d, n + k))
    to_q[:, :n] = rng.normal(size=(d, n))
    root, centre = rng.normal(size=(d, d)), rng.normal(size=d)
    hessian = root @ root.T
    found = held(state, lambda q: (q - centre) @ hessian, linear(state, to_q))
    information = np.linalg.inv(state.cov) + to_q.T @ hessian @ to_q
    force = to_q.T @ hessian @ (centre - to_q @ state.mean)
    scale = np.abs(np.linalg.inv(information)).max()
    np.testing.assert_allclose(found.cov, np.linalg.inv(information), atol=1e-7 * max(scale, 1.0))
    np.testing.assert_allclose(found.mean, state.mean + np.linalg.solve(information, force), atol=1e-6)


def test_no_potential_changes_nothing():
    """A zero gradient leaves the state, mean and covariance."""
    state = gaussian(np.random.default_rng(6), 6)
    found = held(state, np.zeros_like, leading(state, 3))
    np.testing.assert_allclose(found.mean, state.mean, atol=1e-14)
    np.testing.assert_allclose(found.cov, state.cov, atol=1e-14)


def test_a_hill_pushes_but_does_not_widen():
    """Of a saddle, the valley contracts and the ridge pushes: no direction gets more variance than it had."""
    state = gaussian(np.random.default_rng(7), 2)
    hessian = np.diag([3.0, -0.5])
    found = held(state, lambda z: z @ hessian, leading(state, 2))
    assert np.linalg.eigvalsh(state.cov - found.cov).min() > -1e-12
    flat = Gaussian(np.array([0.0, 1.0]), np.eye(2))
    ridge = held(flat, lambda z: z @ np.diag([0.0, -0.5]), leading(flat, 2))
    np.testing.assert_allclose(ridge.mean, [0.0, 1.5])  # P grad = 0.5, uphill avoided
    np.testing.assert_allclose(ridge.cov, np.eye(2), atol=1e-12)


def test_stiffness_does_not_blow_up():
    """1e12 times the prior's information pins the coordinate to the valley, with finite, positive variances."""
    state = gaussian(np.random.default_rng(8), 5)
    found = held(state, lambda z: 1e12 * (z - 0.3), leading(state, 2))
    np.testing.assert_allclose(found.mean[:2], 0.3, atol=1e-6)
    assert np.isfinite(found.cov).all()
    assert (np.diag(found.cov) > 0).all()
    assert (np.sqrt(np.diag(found.cov)[:2]) < 1.1e-6).all()


def test_potentials_act_at_once():
    """Two quadratic ones: the information of both, whatever their order."""
    rng = np.random.default_rng(9)
    state = gaussian(rng, 6)
    hessians, centres, terms = [], [], []
    for first in (slice(0, 3), slice(2, 5)):
        root, centre = rng.normal(size=(3, 3)), rng.normal(size=3)
        hessian = np.zeros((6, 6))
        hessian[first, first] = root @ root.T
        hessians.append(hessian)
        centres.append(hessian[:, first] @ centre)
        coordinates = linear(state, np.eye(6)[first])
        terms.append(potential_term(lambda q, c=centre, h=root @ root.T: (q - c) @ h, coordinates))
    information = np.linalg.inv(state.cov) + sum(hessians)
    mean = np.linalg.solve(information, np.linalg.solve(state.cov, state.mean) + sum(centres))
    for order in (terms, terms[::-1]):
        found, _ = enforce(state, order)
        np.testing.assert_allclose(found.cov, np.linalg.inv(information), atol=1e-10)
        np.testing.assert_allclose(found.mean, mean, atol=1e-9)
