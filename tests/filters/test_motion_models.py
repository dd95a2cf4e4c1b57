"""Motion models: transitions and noises that agree with each other and with their stochastic equations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mocap.filters.body_axes import BodyFrames
from mocap.filters.ensemble import Gaussian
from mocap.filters.gaussian import Adjoint, Moments, condition
from mocap.filters.motion.base import Step
from mocap.filters.motion.constant_velocity import ConstantVelocity, white_acceleration
from mocap.filters.motion.pose import BodyPath, PoseMotion, Regression, body_path
from mocap.filters.motion.potential import PosePotential
from mocap.filters.motion.shape import LinearShape
from mocap.filters.subspace import PoseSubspace
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

RANK, MARKERS, FRAMES = 3, 4, 5


def constant_velocity():
    rng = np.random.default_rng(1)
    return ConstantVelocity(
        start_m=rng.normal(size=(2, 3)), start_sd_m=0.1, speed_sd_m_s=2.0, density=np.array([3.0, 40.0])
    )


def lower(rng, n):
    """Lower factor with a positive diagonal."""
    return np.tril(rng.normal(0, 0.3, (n, n)), -1) + np.diag(rng.uniform(0.5, 1.5, n))


def free(rng):
    none = np.zeros((RANK, RANK))
    return LinearShape(none, none, none[0], lower(rng, RANK), 0.02)


def oscillating(rng):
    stiffness, damping = rng.normal(0, 200, (2, RANK, RANK))
    return LinearShape(
        stiffness + 3000 * np.eye(RANK), 0.1 * damping + 5 * np.eye(RANK), 50 * np.ones(RANK), lower(rng, RANK), 0.02
    )


def body_of(density, memory_s=0.02):
    """A free body under forces that last, of lower factors of their densities."""
    return LinearShape(*np.zeros((2, 6, 6)), np.zeros(6), np.diag(density), memory_s)


def pose(mechanics=free, rate_hz=30.0, **more):
    """Four markers on a body that stands still at a random place in each frame."""
    rng = np.random.default_rng(2)
    subspace = PoseSubspace(
        mean=rng.normal(0, 0.1, 3 * MARKERS),
        basis=np.linalg.qr(rng.normal(size=(3 * MARKERS, RANK)))[0],
        residual_sd=np.repeat(rng.uniform(1e-3, 1e-2, MARKERS), 3),
    )
    still = BodyFrames(
        rotation=np.repeat(Rotation.random(1, rng=rng).as_matrix(), FRAMES, axis=0),
        position_m=np.repeat(rng.normal(size=(1, 3)), FRAMES, axis=0),
    )
    more = {"path": body_path(still, 0.01 * np.arange(FRAMES))} | more
    return PoseMotion(
        subspace=subspace,
        mechanics=mechanics(rng),
        body=body_of(np.sqrt(rng.uniform(0.1, 10, 6))),
        shape_sd=rng.uniform(0.1, 1, 2 * RANK),
        body_sd=rng.uniform(0.1, 1, 12),
        residual_rate_hz=np.full(3 * MARKERS, rate_hz),
        **more,
    )


MODELS = {"constant_velocity": constant_velocity, "pose": pose, "pose, oscillating": lambda: pose(oscillating)}
FREE = ("constant_velocity", "pose")  # whose noise is exact at any step


def matrices(model, dt_s):
    """Transition and noise covariance as dense matrices, from what a step makes of covariances 0 and 1."""
    start = model.initial()
    n = start.mean.shape[-1]
    move = model.move(start, Step(1, dt_s))
    rows = move.forward(np.broadcast_to(np.eye(n), start.cov.shape))
    return np.swapaxes(rows, -1, -2), move.noise


def turned(matrix):
    return np.swapaxes(matrix, -1, -2)


@pytest.mark.parametrize("name", MODELS)
@given(first=st.floats(1e-4, 0.02), second=st.floats(1e-4, 0.02))
def test_two_steps_are_one(name, first, second):
    """A step of dt1 and one of dt2 is one of dt1 + dt2, in transition and in noise: frame rates do not matter.

    The noise of mechanics with forces is that without them, to first order in the step: see the shape's own tests.
    """
    model = MODELS[name]()
    (a1, q1), (a2, q2), (a, q) = matrices(model, first), matrices(model, second), matrices(model, first + second)
    np.testing.assert_allclose(a2 @ a1, a, rtol=1e-9, atol=1e-9 * np.abs(a).max())
    if name in FREE:
        sd = np.sqrt(np.einsum("...ii->...i", q))
        unit = sd[..., None] * sd[..., None, :]
        np.testing.assert_allclose((a2 @ q1 @ turned(a2) + q2) / unit, q / unit, atol=1e-6)


@pytest.mark.parametrize("name", MODELS)
def test_means_move_as_deviations_do(name):
    """A predicted mean is the predicted mean of zero plus the transition of the state: the model is affine."""
    model = MODELS[name]()
    rng = np.random.default_rng(3)
    start, step = model.initial(), Step(1, 0.01)
    a, q = matrices(model, 0.01)
    root = rng.normal(size=start.cov.shape)
    zero, there = np.zeros_like(start.mean), rng.normal(size=start.mean.shape)
    cov = root @ turned(root)
    ahead, found = (model.move(s, step).ahead(s) for s in (Moments(zero, cov), Moments(there, cov)))
    np.testing.assert_allclose(found.mean, ahead.mean + np.einsum("...ij,...j->...i", a, there), atol=1e-12)
    expected = a @ cov @ turned(a) + q
    np.testing.assert_allclose(found.cov, expected, atol=1e-12 * np.abs(expected).max())
    shared = len(model.move(start, step).shared)  # where a mode may grow; exactly
    np.testing.assert_array_equal(found.cov[..., :shared, :], turned(found.cov)[..., :shared, :])


@pytest.mark.parametrize("name", MODELS)
def test_going_back_is_the_transpose(name):
    """Lambda before a step is F^T Lambda F, lambda F^T lambda: by dense matrices."""
    model, rng = MODELS[name](), np.random.default_rng(4)
    start = model.initial()
    a, _ = matrices(model, 0.01)
    root, vector = rng.normal(size=start.cov.shape), rng.normal(size=start.mean.shape)
    found = model.move(start, Step(1, 0.01)).back(Adjoint(vector, root @ turned(root)))
    expected = turned(a) @ root @ turned(root) @ a
    np.testing.assert_allclose(found.matrix, expected, atol=1e-12 * np.abs(expected).max())
    np.testing.assert_allclose(found.vector, np.einsum("...ji,...j->...i", a, vector), atol=1e-12 * np.abs(a).max())


def test_what_is_not_symmetric_is_not_carried_back():
    """Rounding leaves some in what later frames say: carried back through updates it would grow frame by frame."""
    rng = np.random.default_rng(6)
    root, rows = rng.normal(size=(5, 5)), rng.normal(size=(3, 5))
    cov = root @ root.T
    _, update = condition(Moments(np.zeros(5), cov), rows, rows @ cov, np.ones(3))
    skew = 1e-9 * rng.normal(size=(5, 5))
    found = update.back(Adjoint(np.zeros(5), np.eye(5) + skew - skew.T)).matrix
    np.testing.assert_array_equal(found, found.T)
    np.testing.assert_allclose(found, update.back(Adjoint(np.zeros(5), np.eye(5))).matrix, atol=1e-7)


@pytest.mark.parametrize("name", MODELS)
def test_noise_is_a_covariance(name):
    """In units of its own deviations it is symmetric and positive, down to a step of 10 us."""
    for dt_s in (1e-5, 1e-3, 0.1):
        _, noise = matrices(MODELS[name](), dt_s)
        sd = np.sqrt(np.einsum("...ii->...i", noise))
        np.testing.assert_array_equal(noise, turned(noise))
        assert np.linalg.eigvalsh(noise / (sd[..., None] * sd[..., None, :])).min() > 0


def test_markers_are_affine_but_for_turns():
    """A mean of states projects to the mean of the markers; with turns w the difference is of second order.

    That of a midpoint is an eighth of 2 dw x dy + dw x (dw x y), dw and dy about three times the size: below 4 size^2;
    and halving the size quarters it.
    """
    model = pose()
    a, b = np.random.default_rng(4).normal(size=(2, 1, model.size))

    def apart(size):
        middle = model.markers(size * (a + b) / 2, 1)
        return np.abs(middle - (model.markers(size * a, 1) + model.markers(size * b, 1)) / 2).max()

    assert apart(1e-2) <= 4 * 1e-4 + 1e-15
    assert apart(5e-3) == pytest.approx(apart(1e-2) / 4, rel=0.05, abs=1e-15)


def test_a_view_is_the_derivative_of_the_markers():
    """By central differences of 1e-6, whose square times a third derivative of 1 is left, and 1e-16 over the step."""
    model, rng = pose(), np.random.default_rng(6)
    mean = 0.3 * rng.normal(size=model.size)
    view = model.view(mean, 2)
    np.testing.assert_allclose(view.mean, model.markers(mean[None], 2)[0], atol=1e-14)
    ahead, back = (model.markers(mean + sign * 1e-6 * np.eye(model.size), 2) for sign in (1, -1))
    for change, expected in zip(np.eye(model.size), (ahead - back) / 2e-6, strict=True):
        np.testing.assert_allclose(view.moved(change), expected, atol=1e-9)


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


def test_body_and_shape_are_driven_by_their_own_noise():
    """The blocks of body and shape are those of their mechanics; nothing couples."""
    model, dt_s = pose(), 0.02
    _, q = matrices(model, dt_s)
    shape, g, e, *_ = (np.arange(model.size)[part] for part in model.parts)
    body = np.arange(g[0], e[0])
    for part, moved in ((body, model.body), (shape, model.mechanics)):
        own = moved.noise(dt_s)
        np.testing.assert_allclose(q[np.ix_(part, part)], own @ own.T, rtol=1e-12, atol=1e-18)
    blocks = [shape, body, np.arange(e[0], model.size)]
    for one in range(3):
        for other in range(one):
            assert not q[np.ix_(blocks[one], blocks[other])].any()


def first_chain(model):
    """Where e, e1 and e2 of the first coordinate are, as a square of a matrix."""
    three = model.parts[2].start + 3 * MARKERS * np.arange(3)
    return np.ix_(three, three)


@pytest.mark.parametrize("dt_s", [1e-4, 0.013, 0.3])
def test_the_residual_is_a_matern_process(dt_s):
    """Transition = exp(A dt) of (d/dt + a)^3 e = noise, and its noise solves the covariance equation, by SciPy.

    Both of [e, e', e''], and brought to [e, e1, e2] with e1 = (d/dt + a) e and e2 = (d/dt + a) e1.
    """
    a = 30.0
    model = pose(rate_hz=a)
    transition, covariance = matrices(model, dt_s)
    drift = np.array([[0, 1, 0], [0, 0, 1], [-(a**3), -3 * a**2, -3 * a]])
    bring, three = np.array([[1, 0, 0], [a, 1, 0], [a**2, 2 * a, 1]]), first_chain(model)
    expected = bring @ expm(drift * dt_s) @ np.linalg.inv(bring)
    np.testing.assert_allclose(transition[three], expected, rtol=1e-9, atol=1e-9)
    variance = model.subspace.residual_sd[0] ** 2
    q = np.diag([0.0, 0.0, 16 / 3 * a**5 * variance])  # the white noise that keeps the variance of e

    def rate(_, flat):
        p = flat.reshape(3, 3)
        return (drift @ p + p @ drift.T + q).ravel()

    grown = solve_ivp(rate, (0, dt_s), np.zeros(9), rtol=1e-11, atol=1e-30).y[:, -1].reshape(3, 3)
    grown = bring @ grown @ bring.T
    size = np.sqrt(np.diag(grown))
    np.testing.assert_allclose(covariance[three] / np.outer(size, size), grown / np.outer(size, size), atol=1e-6)


def test_the_residual_is_stationary():
    """A P A^T + Q = P for the residual at its initial covariance, at every step: it neither dies nor grows."""
    model = pose()
    residual = slice(model.parts[2].start, None)
    start = model.initial().cov[residual, residual]
    sd = np.sqrt(np.diag(start))
    for dt_s in (1e-4, 0.01, 1.0):
        a, q = (m[residual, residual] for m in matrices(model, dt_s))
        np.testing.assert_allclose((a @ start @ a.T + q - start) / np.outer(sd, sd), 0, atol=1e-9)


def test_markers_by_the_formula():
    """R exp(w) (mean + basis z + e) + c + p, a marker at a time, in each frame."""
    rng = np.random.default_rng(4)
    frames = BodyFrames(rotation=Rotation.random(FRAMES, rng=rng).as_matrix(), position_m=rng.normal(size=(FRAMES, 3)))
    still = np.zeros((FRAMES, 3))
    model = pose(path=BodyPath(frames=frames, velocity_m_s=still, rate_rad_s=still))
    states = rng.normal(size=(2, model.size))
    for frame in range(FRAMES):
        found = model.markers(states, frame)
        for s in range(2):
            z, _, p, w, _, e, _ = np.split(states[s], 3 * RANK + np.array([-2 * RANK, 0, 3, 6, 18, 18 + 3 * MARKERS]))
            body = model.subspace.mean + model.subspace.basis @ z + e
            turn = frames.rotation[frame] @ expm(np.cross(np.eye(3), w))
            for m in range(MARKERS):
                here = turn @ body[3 * m : 3 * m + 3] + frames.position_m[frame] + p
                np.testing.assert_allclose(found[s, m], here, atol=1e-12)


STEP = Step(1, 0.01)


def test_the_model_holds_its_shape():
    """``constrain`` pulls the shape to a valley at zero, a stiffer valley the more, and never widens the state."""
    rng = np.random.default_rng(9)
    n = pose().size
    state = Gaussian(rng.normal(size=n), lower(rng, n))
    assert pose().constrain(state, STEP) == (state, [])
    for held in (RANK, 2 * RANK):
        sizes = [np.linalg.norm(state.mean[:held])]
        for stiffness in (1e2, 1e3, 1e4):
            valley = PosePotential(
                mean=np.zeros(held),
                on_shape=np.eye(held, 2 * RANK),
                on_residual=np.zeros((held, 3 * MARKERS)),
                samples=np.zeros((0, held)),
                gradient=lambda z, stiffness=stiffness: stiffness * z,
            )
            model = pose(potentials=(valley,))
            found, _ = model.constrain(state, STEP)
            sizes.append(np.linalg.norm(found.mean[:held]))
            assert np.linalg.eigvalsh(state.cov - found.cov).min() > -1e-9
        assert (np.diff(sizes) < 0).all()
        assert sizes[-1] < 0.1 * sizes[0]


def test_a_regression_is_one_more_observation():
    """Conditioning on the positions that a regression has is the product of Gaussians, written out with matrices.

    A marker and a frame without any are left as they are.
    """
    rng = np.random.default_rng(10)
    plain = pose()
    n = plain.size
    state = Gaussian(1e-3 * rng.normal(size=n), 1e-3 * lower(rng, n))  # turns so small that markers are linear in them
    xyz, cov = np.full((FRAMES, MARKERS, 3), np.nan), np.full((FRAMES, MARKERS, 3, 3), np.nan)
    view = plain.view(state.mean, STEP.frame)
    mean = view.mean
    for marker in (0, 2):
        root = 1e-3 * lower(rng, 3)
        xyz[STEP.frame, marker], cov[STEP.frame, marker] = mean[marker] + 2e-3 * rng.normal(size=3), root @ root.T
    model = pose(regression=Regression(xyz, cov))
    slope = np.array([view.moved(change)[[0, 2]].ravel() for change in np.eye(n)]).T
    noise = np.zeros((6, 6))
    noise[:3, :3], noise[3:, 3:] = cov[STEP.frame, 0], cov[STEP.frame, 2]
    information = np.linalg.inv(state.cov) + slope.T @ np.linalg.solve(noise, slope)
    away = (xyz[STEP.frame, [0, 2]] - mean[[0, 2]]).ravel()
    found, _ = model.constrain(state, STEP)
    best = np.linalg.solve(information, slope.T @ np.linalg.solve(noise, away))
    np.testing.assert_allclose(found.mean - state.mean, best, atol=1e-6 * np.abs(best).max())
    np.testing.assert_allclose(found.cov, np.linalg.inv(information), atol=1e-6 * state.cov.max())
    assert model.constrain(state, Step(STEP.frame + 1, STEP.dt_s)) == (state, [])
