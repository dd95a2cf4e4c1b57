"""Motion models: transitions and noises that agree with each other and with their stochastic equations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from filters.ensemble import Gaussian
from filters.motion.constant_velocity import ConstantVelocity, white_acceleration
from filters.motion.enforce import enforce
from filters.motion.pose import PoseMotion, rigid_modes
from filters.subspace import PoseSubspace
from mocap.body import BodyFrames

RANK, MARKERS, FRAMES = 3, 4, 5


def constant_velocity():
    rng = np.random.default_rng(1)
    return ConstantVelocity(
        start_m=rng.normal(size=(2, 3)), start_sd_m=0.1, speed_sd_m_s=2.0, density=np.array([3.0, 40.0])
    )


def pose(rate_hz=30.0, **more):
    rng = np.random.default_rng(2)
    subspace = PoseSubspace(
        mean=rng.normal(0, 0.1, 3 * MARKERS),
        basis=np.linalg.qr(rng.normal(size=(3 * MARKERS, RANK)))[0],
        residual_sd=np.repeat(rng.uniform(1e-3, 1e-2, MARKERS), 3),
    )
    return PoseMotion(
        frames=BodyFrames(
            rotation=Rotation.random(FRAMES, rng=rng).as_matrix(), position_m=rng.normal(size=(FRAMES, 3))
        ),
        subspace=subspace,
        density=rng.uniform(0.1, 10, RANK + 6),
        start_sd=rng.uniform(0.1, 1, 2 * (RANK + 6)),
        residual_rate_hz=rate_hz,
        **more,
    )


MODELS = {"constant_velocity": constant_velocity, "pose": pose}


def matrices(model, dt_s):
    """Transition and noise covariance as dense matrices."""
    n = len(model.initial().mean)
    offset = model.step(np.zeros((1, n)), dt_s)[0]
    noise = model.noise(dt_s)
    return (model.step(np.eye(n), dt_s) - offset).T, noise @ noise.T


@pytest.mark.parametrize("name", MODELS)
@given(first=st.floats(1e-4, 0.02), second=st.floats(1e-4, 0.02))
def test_two_steps_are_one(name, first, second):
    """A step of dt1 and one of dt2 is one of dt1 + dt2, in transition and in noise: frame rates do not matter."""
    model = MODELS[name]()
    (a1, q1), (a2, q2), (a, q) = matrices(model, first), matrices(model, second), matrices(model, first + second)
    np.testing.assert_allclose(a2 @ a1, a, rtol=1e-9, atol=1e-12)
    sd = np.sqrt(np.diag(q))
    np.testing.assert_allclose((a2 @ q1 @ a2.T + q2) / np.outer(sd, sd), q / np.outer(sd, sd), atol=1e-6)


@pytest.mark.parametrize("name", MODELS)
def test_noise_is_a_lower_factor(name):
    """What the engine takes for a lower factor is one, with a positive diagonal, down to a step of 10 us."""
    for dt_s in (1e-5, 1e-3, 0.1):
        noise = MODELS[name]().noise(dt_s)
        assert not np.triu(noise, 1).any()
        assert (np.diag(noise) > 0).all()


@pytest.mark.parametrize("name", MODELS)
def test_models_are_affine_where_they_say_so(name):
    """``linear`` holds: a mean of states steps to the mean of the steps, and projects to the mean of the markers."""
    model = MODELS[name]()
    assert model.linear
    rng = np.random.default_rng(3)
    a, b = rng.normal(size=(2, 1, len(model.initial().mean)))
    np.testing.assert_allclose(
        model.step((a + b) / 2, 0.01), (model.step(a, 0.01) + model.step(b, 0.01)) / 2, atol=1e-12
    )
    reads = model.reads
    middle = model.markers((a + b)[:, :reads] / 2, 1)
    np.testing.assert_allclose(
        middle, (model.markers(a[:, :reads], 1) + model.markers(b[:, :reads], 1)) / 2, atol=1e-12
    )


@pytest.mark.parametrize("name", MODELS)
def test_initial_states_fit_their_models(name):
    """The first state has the model's size and is read by its sigma points."""
    model = MODELS[name]()
    start = model.initial()
    assert start.factor.shape == (len(start.mean),) * 2 == (model.points.n,) * 2
    assert 0 < model.reads <= len(start.mean)


def test_white_acceleration_is_the_integral():
    """Q = S int_0^dt (dt - s, 1)^T (dt - s, 1) ds, by numerical quadrature."""
    density, dt_s = np.array([0.5, 7.0]), 0.3
    l11, l21, l22 = white_acceleration(density, dt_s)
    s, weight = np.polynomial.legendre.leggauss(5)
    s, weight = (s + 1) / 2 * dt_s, weight / 2 * dt_s
    for i in range(2):
        vectors = np.stack([dt_s - s, np.ones_like(s)])
        expected = density[i] * (vectors * weight) @ vectors.T
        factor = np.array([[l11[i], 0], [l21[i], l22[i]]])
        np.testing.assert_allclose(factor @ factor.T, expected, rtol=1e-12)


def test_the_residual_is_a_matern_process():
    """Transition = exp(A dt) of e'' = -2 a e' - a^2 e, and its noise solves the covariance equation, by SciPy."""
    a, dt_s = 30.0, 0.013
    model = pose(a)
    k, reads = RANK + 6, model.reads
    transition, covariance = matrices(model, dt_s)
    drift = np.array([[0, 1], [-(a**2), -2 * a]])
    pair = [k, reads + k]
    np.testing.assert_allclose(transition[np.ix_(pair, pair)], expm(drift * dt_s), rtol=1e-12)
    variance = model.subspace.residual_sd[0] ** 2
    q = np.diag([0.0, 4 * a**3 * variance])  # the white noise that keeps the variance of e

    def rate(_, flat):
        p = flat.reshape(2, 2)
        return (drift @ p + p @ drift.T + q).ravel()

    grown = solve_ivp(rate, (0, dt_s), np.zeros(4), rtol=1e-10, atol=1e-18).y[:, -1].reshape(2, 2)
    np.testing.assert_allclose(covariance[np.ix_(pair, pair)], grown, rtol=1e-6)


def test_the_residual_is_stationary():
    """A P A^T + Q = P for the residual at its initial variance, at every step: it neither dies nor grows."""
    model = pose()
    k, reads = RANK + 6, model.reads
    residual = np.r_[k:reads, reads + k : 2 * reads]
    start = model.initial().cov[np.ix_(residual, residual)]
    for dt_s in (1e-4, 0.01, 1.0):
        a, q = (m[np.ix_(residual, residual)] for m in matrices(model, dt_s))
        sd = np.sqrt(np.diag(start))
        np.testing.assert_allclose((a @ start @ a.T + q) / np.outer(sd, sd), np.eye(len(sd)), atol=1e-9)


def test_markers_by_the_formula():
    """R (mean + basis z + rigid g + e) + position, a marker at a time, in each frame."""
    model = pose()
    rng = np.random.default_rng(4)
    states = rng.normal(size=(2, model.reads))
    rigid = rigid_modes(model.subspace.mean)
    for frame in range(FRAMES):
        found = model.markers(states, frame)
        for s in range(2):
            z, g, e = np.split(states[s], [RANK, RANK + 6])
            body = model.subspace.mean + model.subspace.basis @ z + rigid @ g + e
            for m in range(MARKERS):
                here = model.frames.rotation[frame] @ body[3 * m : 3 * m + 3] + model.frames.position_m[frame]
                np.testing.assert_allclose(found[s, m], here, atol=1e-12)


def test_rigid_modes_are_small_motions_of_the_whole_body():
    """Six unit columns: a small translation or turn of all markers lies in their span; a stretch does not."""
    rng = np.random.default_rng(5)
    shape = rng.normal(size=(6, 3))
    modes = rigid_modes(shape.ravel())
    np.testing.assert_allclose(np.linalg.norm(modes, axis=0), 1, rtol=1e-12)
    size = 1e-4
    turned = (shape - shape.mean(axis=0)) @ Rotation.from_rotvec(size * rng.normal(size=3)).as_matrix().T
    moved = (turned + shape.mean(axis=0) + size * rng.normal(size=3) - shape).ravel()
    left = moved - modes @ np.linalg.lstsq(modes, moved, rcond=None)[0]
    assert np.linalg.norm(left) < 1e3 * size**2
    stretch = (0.1 * shape).ravel()
    assert np.linalg.norm(stretch - modes @ np.linalg.lstsq(modes, stretch, rcond=None)[0]) > 0.01


def gaussian(rng, n):
    factor = np.tril(rng.normal(0, 0.4, (n, n)))
    factor[np.diag_indices(n)] = rng.uniform(0.5, 1.5, n)
    return Gaussian(rng.normal(size=n), factor)


@given(seed=st.integers(0, 500), k=st.integers(1, 5), more=st.integers(0, 5), rounds=st.integers(1, 3))
def test_a_quadratic_potential_is_the_product_of_gaussians(seed, k, more, rounds):
    """For V = (x - m)^T H (x - m) / 2 of the first k components: information P^-1 + H, mean by its gradient: exactly.

    However often it is linearised anew; components that V does not read move with those that it reads.
    """
    rng = np.random.default_rng(seed)
    state = gaussian(rng, k + more)
    root, centre = rng.normal(size=(k, k)), rng.normal(size=k)
    hessian = root @ root.T
    found = enforce(state, lambda z: (z - centre) @ hessian, k, iterations=rounds)
    whole = np.zeros((k + more, k + more))
    whole[:k, :k] = hessian
    information = np.linalg.inv(state.cov) + whole
    force = np.zeros(k + more)
    force[:k] = hessian @ (centre - state.mean[:k])
    np.testing.assert_allclose(found.cov, np.linalg.inv(information), rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(found.mean, state.mean + np.linalg.solve(information, force), rtol=1e-7, atol=1e-8)
    assert not np.triu(found.factor, 1).any()


def test_no_potential_changes_nothing():
    """A zero gradient leaves the state, mean and covariance."""
    state = gaussian(np.random.default_rng(6), 6)
    found = enforce(state, np.zeros_like, 3)
    np.testing.assert_allclose(found.mean, state.mean, atol=1e-14)
    np.testing.assert_allclose(found.cov, state.cov, atol=1e-14)
    assert pose().constrain(state, 0.01) is state


def test_a_hill_pushes_but_does_not_widen():
    """Of a saddle, the valley contracts and the ridge pushes: no direction gets more variance than it had."""
    state = gaussian(np.random.default_rng(7), 2)
    hessian = np.diag([3.0, -0.5])
    found = enforce(state, lambda z: z @ hessian, 2)
    assert np.linalg.eigvalsh(state.cov - found.cov).min() > -1e-12
    ridge = enforce(Gaussian(np.array([0.0, 1.0]), np.eye(2)), lambda z: z @ np.diag([0.0, -0.5]), 2)
    np.testing.assert_allclose(ridge.mean, [0.0, 1.5])  # P grad = 0.5, uphill avoided
    np.testing.assert_allclose(ridge.cov, np.eye(2), atol=1e-12)


def test_stiffness_does_not_blow_up():
    """1e12 times the prior's information pins the coordinate to the valley, with a finite, positive factor."""
    state = gaussian(np.random.default_rng(8), 5)
    found = enforce(state, lambda z: 1e12 * (z - 0.3), 2)
    np.testing.assert_allclose(found.mean[:2], 0.3, atol=1e-6)
    assert np.isfinite(found.factor).all()
    assert (np.diag(found.factor) > 0).all()
    assert (np.sqrt(np.diag(found.cov)[:2]) < 1.1e-6).all()


def test_enforcing_nears_the_minimum_of_a_bent_valley():
    """Rounds of linearisation settle for a quartic valley, within the prior's reach, at the penalised minimum.

    With a prior of 1e-3 the sigma points see the potential at one place: the implicit Euler step by a root finder.
    """
    sd, start, stiffness = 1e-3, 1.0, 1e5
    state = Gaussian(np.array([start, 0.0]), np.diag([sd, 1.0]))
    found = enforce(state, lambda z: stiffness * z**3, 1, iterations=20)
    expected = brentq(lambda x: (x - start) / sd**2 + stiffness * x**3, 0, 2)
    assert found.mean[0] == pytest.approx(expected, abs=1e-4 * abs(start - expected) + 3 * sd**2)


def test_the_model_holds_its_shape():
    """``constrain`` pulls the shape to a valley at zero, a stiffer valley the more, and never widens the state."""
    state = gaussian(np.random.default_rng(9), 2 * pose().reads)
    sizes = [np.linalg.norm(state.mean[:RANK])]
    for stiffness in (1e2, 1e3, 1e4):
        found = pose(gradient=lambda z, stiffness=stiffness: stiffness * z).constrain(state, 0.01)
        sizes.append(np.linalg.norm(found.mean[:RANK]))
        assert np.linalg.eigvalsh(state.cov - found.cov).min() > -1e-9
    assert (np.diff(sizes) < 0).all()
    assert sizes[-1] < 0.1 * sizes[0]
