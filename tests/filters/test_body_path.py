"""The path near which a body moves is where it is linearised, and nothing more."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mocap.filters.body_axes import BodyFrames
from mocap.filters.ensemble import Gaussian
from mocap.filters.gaussian import Markers, Moments
from mocap.filters.models.pose import body_mechanics
from mocap.filters.motion.base import Step
from mocap.filters.motion.pose import BodyPath, PoseMotion, body_path
from mocap.filters.motion.shape import LinearShape
from mocap.filters.observations import PositionObservations
from mocap.filters.poses import PoseTrial
from mocap.filters.subspace import PoseSubspace
from mocap.filters.track import filter_forward
from scipy.spatial.transform import Rotation

DT_S, MARKERS, RANK = 0.005, 6, 2
SHAPE = np.random.default_rng(0).normal(0, 0.1, 3 * MARKERS)
BASIS = np.linalg.qr(np.random.default_rng(1).normal(size=(3 * MARKERS, RANK)))[0]


def model(path):
    """A pose whose body may take any way and turn any way; all its directions are alike."""
    return PoseMotion(
        path=path,
        subspace=PoseSubspace(mean=SHAPE, basis=BASIS, residual_sd=np.full(3 * MARKERS, 1e-3)),
        mechanics=LinearShape(*np.zeros((2, RANK, RANK)), np.zeros(RANK), 30 * np.eye(RANK), 0.02),
        body=LinearShape(*np.zeros((2, 6, 6)), np.zeros(6), np.diag(np.sqrt(np.repeat([50.0, 200.0], 3))), DT_S),
        shape_sd=np.full(2 * RANK, 0.05),
        body_sd=np.repeat([0.1, 0.1, 1.0, 1.0], 3),
        residual_rate_hz=50.0,
    )


def curved(rng, n_frames, *, turn_rad=0.2):
    """A path of random steps and turns, whose velocities are not even those of its positions."""
    turns = Rotation.from_rotvec(turn_rad * rng.normal(size=(n_frames, 3)))
    rotation = [Rotation.random(rng=rng)]
    for step in turns[1:]:
        rotation.append(rotation[-1] * step)
    return BodyPath(
        frames=BodyFrames(
            rotation=np.stack([r.as_matrix() for r in rotation]), position_m=rng.normal(size=(n_frames, 3))
        ),
        velocity_m_s=rng.normal(size=(n_frames, 3)),
        rate_rad_s=turn_rad / DT_S * rng.normal(size=(n_frames, 3)),
    )


def body_of(pose, mean, frame):
    """Orientation, position, angular velocity (body axes) and velocity of the body of a state."""
    _, g, _, g_rate, _ = pose.parts
    path = pose.path
    orientation = path.frames.rotation[frame] @ Rotation.from_rotvec(mean[g][3:]).as_matrix()
    return (
        orientation,
        path.frames.position_m[frame] + mean[g][:3],
        path.rate_rad_s[frame] + mean[g_rate][3:],
        path.velocity_m_s[frame] + mean[g_rate][:3],
    )


def flown(pose, size, seed):
    """Body one step later as predicted, and as it is when its velocities do not change."""
    rng = np.random.default_rng(seed)
    mean = np.zeros(pose.size)
    _, g, _, g_rate, _ = pose.parts
    mean[g], mean[g_rate] = size * rng.normal(size=6), size / DT_S * rng.normal(size=6)
    orientation, position, spin, velocity = body_of(pose, mean, 1)
    start = Gaussian(mean, np.eye(len(mean)))
    ahead = pose.move(start, Step(2, DT_S)).ahead(start).mean
    turned = orientation @ Rotation.from_rotvec(DT_S * spin).as_matrix()
    return body_of(pose, ahead, 2), (turned, position + DT_S * velocity, spin, velocity)


@pytest.mark.rare
@given(seed=st.integers(0, 1000))
def test_the_body_flies_on_with_constant_velocity_in_the_world(seed):
    """However the path curves, position and both velocities go on exactly.

    So does the orientation of a body that is on the path; of one that deviates by w and turns to second order.
    """
    pose = model(curved(np.random.default_rng(seed), 3))
    for size in (0.0, 0.1):
        found, expected = flown(pose, size, seed)
        for ours, theirs in zip(found[1:], expected[1:], strict=True):
            np.testing.assert_allclose(ours, theirs, atol=1e-12 * (1 + np.abs(theirs).max()))
        if size == 0:
            np.testing.assert_allclose(found[0], expected[0], atol=1e-12)


def test_steps_of_any_time_are_their_own():
    """What a step predicts does not depend on the times of those before it, to 1e-9 of a step."""
    path = curved(np.random.default_rng(0), 4)
    size = model(path).size
    state, used = Gaussian(np.random.default_rng(1).normal(0, 0.01, size), 0.01 * np.eye(size)), model(path)
    for frame, dt_s in ((1, DT_S), (2, DT_S * (1 + 1e-12)), (3, 3 * DT_S), (2, DT_S)):
        step = Step(frame, dt_s)
        found, fresh = (pose.move(state, step).ahead(state) for pose in (used, model(path)))
        np.testing.assert_allclose(found.mean, fresh.mean, rtol=0, atol=1e-9)
        np.testing.assert_allclose(found.cov, fresh.cov, rtol=0, atol=1e-9)


@pytest.mark.rare
@given(seed=st.integers(0, 1000))
def test_turns_go_on_to_second_order(seed):
    """The orientation misses by the square of the deviation while the path turns little: a tenth of it, a hundredth.

    The path's turn from frame to frame is of the order of the deviation itself: it scales with it.
    """

    def miss(size):
        pose = model(curved(np.random.default_rng(seed), 3, turn_rad=size))
        found, expected = flown(pose, size, seed)
        return np.linalg.norm(Rotation.from_matrix(found[0].T @ expected[0]).as_rotvec())

    assert miss(1e-3) < 30e-6
    assert miss(1e-4) < 30e-8


@given(seed=st.integers(0, 1000))
def test_deviations_turn_with_the_path(seed):
    """Where a body that deviates by w follows a path that turns by phi a step, w is seen in axes turned by phi.

    To first order in w whatever phi: what is left is phi^2 / 24 of what the deviation turns by, and w^2.
    """
    rng = np.random.default_rng(seed)
    phi = 0.3 * rng.normal(size=(1, 3))
    rotation = Rotation.from_rotvec(np.arange(3)[:, None] * phi).as_matrix()
    frames = BodyFrames(rotation=rotation, position_m=np.zeros((3, 3)))
    path = BodyPath(frames=frames, velocity_m_s=np.zeros((3, 3)), rate_rad_s=np.repeat(phi, 3, axis=0) / DT_S)
    found, expected = flown(model(path), 1e-5, seed)
    turn = float(np.linalg.norm(phi))
    off = np.linalg.norm(Rotation.from_matrix(found[0].T @ expected[0]).as_rotvec())
    assert off < 1e-5 * 5 * turn**2 / 24 + 1e-9


def test_velocities_of_a_path():
    """Of an even helix: the velocity of its positions and its constant angular velocity, to differences of step^2 / 6.

    At the ends the differences are one-sided: half a step times the derivative.
    """
    t = DT_S * np.arange(50)
    spin = np.array([1.0, -4.0, 2.0])
    position = np.stack([np.cos(3 * t), np.sin(3 * t), t], axis=1)
    path = body_path(BodyFrames(rotation=Rotation.from_rotvec(t[:, None] * spin).as_matrix(), position_m=position), t)
    np.testing.assert_allclose(path.rate_rad_s, np.tile(spin, (50, 1)), atol=1e-9)
    velocity = np.stack([-3 * np.sin(3 * t), 3 * np.cos(3 * t), np.ones(50)], axis=1)
    np.testing.assert_allclose(path.velocity_m_s[1:-1], velocity[1:-1], atol=27 * DT_S**2 / 6 * 1.01)
    np.testing.assert_allclose(path.velocity_m_s, velocity, atol=9 * DT_S / 2 * 1.01)
    single = body_path(BodyFrames(rotation=np.eye(3)[None], position_m=np.zeros((1, 3))), t[:1])
    assert not single.velocity_m_s.any()
    assert not single.rate_rad_s.any()


@pytest.fixture(scope="module", params=[0.0, 5.0, 20.0])
def flight(request):
    """A body that turns at so many rad/s and beats, as seen: with gaps, with noise of 2 mm, with nothing for 50 ms."""
    rng, turn = np.random.default_rng(2), request.param
    t = DT_S * np.arange(60)
    rotation = Rotation.from_rotvec(turn * np.outer(t, [0.3, 1.0, -0.5]))
    position = np.stack([3 * t, np.sin(5 * t), t**2], axis=1)
    z = 0.03 * np.stack([np.sin(40 * t), np.cos(40 * t)], axis=1)
    xyz = np.einsum("tij,tmj->tmi", rotation.as_matrix(), (SHAPE + z @ BASIS.T).reshape(60, -1, 3)) + position[:, None]
    seen = xyz + 2e-3 * rng.normal(size=xyz.shape)
    seen[rng.random(seen.shape[:2]) < 0.3] = np.nan
    seen[20:30] = np.nan
    return t, rotation, position, seen


def filtered(flight, *, shift_m, turn_rad):
    """Mean, deviation and log-likelihood of the markers, filtered about a path beside the true one.

    The state before the first frame is the same body in every case.
    """
    t, rotation, position, seen = flight
    way = np.sin(1.5 * np.pi * t / t[-1])
    about = body_path(
        BodyFrames(
            rotation=(rotation * Rotation.from_rotvec(turn_rad * np.outer(way, [1.0, -0.5, 0.7]))).as_matrix(),
            position_m=position + shift_m * np.outer(np.cos(9 * t), [1, 2, -1]),
        ),
        t,
    )
    true = body_path(BodyFrames(rotation=rotation.as_matrix(), position_m=position), t)
    pose = model(about)
    _, g, _, g_rate, _ = pose.parts
    start = pose.initial()
    mean = start.mean.copy()
    mean[g][:3] = position[0] - about.frames.position_m[0]
    mean[g_rate][:3] = true.velocity_m_s[0] - about.velocity_m_s[0]
    mean[g_rate][3:] = true.rate_rad_s[0] - about.rate_rad_s[0]
    observations = PositionObservations(xyz_m=seen, sd_m=np.full(seen.shape[:2], 2e-3))
    found = list(filter_forward(pose, observations, t, before=Moments(mean, start.cov), gate_sd=np.inf))
    markers = [Markers(f.state, pose.view(f.state.mean, frame)) for frame, f in enumerate(found)]
    xyz, cov = np.array([m.view.mean for m in markers]), np.array([m.cov for m in markers])
    sd = np.sqrt(np.diagonal(cov, axis1=-2, axis2=-1))
    return xyz, sd, sum(f.observed.log_likelihood for f in found)


def test_paths_beside_each_other_are_one(flight):
    """30 cm to the side nothing changes but rounding."""
    xyz, sd, density = filtered(flight, shift_m=0.0, turn_rad=0.0)
    beside, beside_sd, beside_density = filtered(flight, shift_m=0.3, turn_rad=0.0)
    np.testing.assert_allclose(beside, xyz, atol=1e-12)
    np.testing.assert_allclose(beside_sd, sd, rtol=1e-9)
    assert beside_density == pytest.approx(density, abs=1e-8)


def test_paths_turned_from_each_other_are_nearly_one(flight):
    """About a path turned by up to 0.26 rad the markers are the same to a fraction of their deviation.

    A turn by which the filter corrects itself is seen by the two in axes half that angle apart: corrections of one or
    two deviations differ by a quarter of one at most, by a tenth of that as a rule. It is of second order: with half
    the angle between the paths, half of it.
    """
    xyz, sd, density = filtered(flight, shift_m=0.0, turn_rad=0.0)
    rms = []
    for turn in (0.2, 0.1):
        turned, _, turned_density = filtered(flight, shift_m=0.0, turn_rad=turn)
        apart = np.abs(turned - xyz) / sd
        assert apart.max() < 0.26
        assert turned_density == pytest.approx(density, abs=1.0)
        rms.append(np.sqrt(np.mean(apart**2)))
    assert rms[0] < 0.026
    assert rms[1] < 0.6 * rms[0]


def test_the_body_keeps_its_acceleration():
    """Of its velocities in a step: b memory (1 - exp(-dt / memory)), for translation and rotation alike."""
    rng = np.random.default_rng(4)
    pose = model(curved(rng, 3))
    mean = np.zeros(pose.size)
    _, _, e, g_rate, _ = pose.parts
    mean[g_rate.stop : e.start] = rng.normal(size=6)
    ahead = pose.move(Gaussian(mean, np.eye(len(mean))), Step(2, DT_S)).ahead(Gaussian(mean, np.eye(len(mean)))).mean
    coasting = np.where(np.arange(pose.size) < g_rate.stop, mean, 0.0)
    without = pose.move(Gaussian(coasting, np.eye(len(mean))), Step(2, DT_S))
    without = without.ahead(Gaussian(coasting, np.eye(len(mean)))).mean
    gained = pose.body.memory_s * -np.expm1(-DT_S / pose.body.memory_s)
    np.testing.assert_allclose((ahead - without)[g_rate], gained * mean[g_rate.stop : e.start], rtol=1e-9)


def test_a_body_that_swings_accelerates_as_long_as_it_swings():
    """Along A sin(w t): accelerations of root mean square w^2 A / sqrt 2 that last 1 / w; a still body has the least.

    To 1 %: differences of a hundred frames a period, and the ends.
    """
    t, w, size = np.arange(600) * DT_S, 2 * np.pi / 0.5, np.array([0.2, 0.3, 0.6])
    steady = np.repeat(np.eye(3)[None], len(t), axis=0)
    swings, stands = (
        PoseTrial(
            t_s=t,
            frames=BodyFrames(rotation=steady, position_m=x),
            y=np.zeros((len(t), 3)),
            sd_m=np.zeros((len(t), 1)),
        )
        for x in (np.outer(np.sin(w * t), size), np.zeros((len(t), 3)))
    )
    found = body_mechanics([swings])
    np.testing.assert_allclose(found.memory_s[:3], 1 / w, rtol=0.01)
    np.testing.assert_allclose(found.lasting_sd[:3], w**2 * np.sqrt(np.mean(size**2) / 2), rtol=0.01)
    still = body_mechanics([stands])
    np.testing.assert_allclose(np.diag(still.density) ** 2, np.repeat([1e-6, 1e-4], 3))
    assert np.isfinite(still.noise(DT_S)).all()
