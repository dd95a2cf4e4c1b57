"""Smooth accelerations: a step's laws, smoothing splines by SciPy, what likelihood finds, and errors as stated."""

from dataclasses import replace

import numpy as np
import pytest
from mocap.filters.anatomy import Anatomy
from mocap.filters.models.base import TrialSet
from mocap.filters.models.smooth_acceleration import SmoothSettings, WeightedMotion, weighted
from mocap.filters.motion.constant_velocity import white_acceleration
from mocap.filters.motion.smooth_acceleration import SmoothAcceleration, generator, smooth_step, stationary
from mocap.filters.moving import Rates
from mocap.filters.observations import PositionObservations, noisier
from mocap.filters.poses import MarkerTrial
from mocap.filters.records import Estimate
from mocap.filters.smoothness import likeliest
from mocap.filters.track import smooth
from mocap.filters.velocities import RatePoints
from scipy.interpolate import make_smoothing_spline
from scipy.linalg import expm

KINDS = [(n, d) for n in (2, 3, 4) for d in range(n + 1)]
ONE = RatePoints(names=("a",))
DT_S = 0.01
ALONE = SmoothSettings(free=(1,))


@pytest.mark.parametrize(("order", "free"), KINDS)
@pytest.mark.parametrize("dt", [1e-4, 0.01, 2.0])
def test_a_step_is_the_exponential_and_two_are_one(order, free, dt):
    """F = exp(A dt); F Q F^T + Q of half steps is Q of the whole, in units of its own deviations."""
    rate = 7.0
    chain, noise = smooth_step(order, free, rate, dt)
    size = dt ** np.arange(order)
    np.testing.assert_allclose(
        chain * size / size[:, None], expm(generator(order, free, rate) * dt) * size / size[:, None], atol=1e-9
    )
    half, kick = smooth_step(order, free, rate, dt / 2)
    sd = np.sqrt(np.diag(noise))
    np.testing.assert_allclose((half @ kick @ half.T + kick) / np.outer(sd, sd), noise / np.outer(sd, sd), atol=1e-8)


@pytest.mark.parametrize(("order", "free"), [kind for kind in KINDS if kind[1] < kind[0]])
def test_what_is_not_free_is_stationary(order, free):
    """F P F^T + Q = P of those derivatives, at every step."""
    lasting, kept = stationary(order, free, 7.0), slice(free, None)
    sd = np.sqrt(np.diag(lasting))
    for dt in (1e-3, 0.1, 3.0):
        chain, noise = (one[kept, kept] for one in smooth_step(order, free, 7.0, dt))
        np.testing.assert_allclose((chain @ lasting @ chain.T + noise - lasting) / np.outer(sd, sd), 0, atol=1e-9)


def test_an_integrated_wiener_process_is_white_acceleration():
    """Order 2, both states free: the closed form of constant velocity."""
    chain, noise = smooth_step(2, 2, 0.0, 0.3)
    l11, l21, l22 = white_acceleration(np.ones(1), 0.3)
    factor = np.array([[l11[0], 0.0], [l21[0], l22[0]]])
    np.testing.assert_allclose(chain, [[1, 0.3], [0, 1]], atol=1e-12)
    np.testing.assert_allclose(noise, factor @ factor.T, rtol=1e-9)


def motion(order, free, *, rate_hz=0.0, density=1.0, start=(0.0, 0.0, 0.0), far=1e3):
    """Of one marker, driven alike at all times."""
    return SmoothAcceleration(
        start_m=np.array([start]), start_sd_m=far, speed_sd_m_s=far, order=order, free=free, rate_hz=rate_hz,
        density=np.array([density]), intensity=np.ones((0, 1)), unit_s=0.05,
    )  # fmt: skip


def test_it_is_the_smoothing_spline():
    """Wahba 1978: with free starts the mean is the cubic smoothing spline of lambda = r / q, here by SciPy.

    Positions, and velocities as its derivative, at uneven times. Starts of 1e3 m in place of any: 1e-6 of it is left.
    """
    rng = np.random.default_rng(0)
    t_s, noise, density = np.cumsum(rng.uniform(0.005, 0.03, 60)), 0.02, 40.0
    xyz = np.stack([np.sin(5 * t_s), t_s, np.cos(3 * t_s)], axis=1) + noise * rng.normal(size=(60, 3))
    seen = PositionObservations(xyz_m=xyz[:, None], sd_m=np.full((60, 1), noise))
    found = smooth(motion(2, 2, density=density), seen, t_s, rate_points=ONE)
    splines = [make_smoothing_spline(t_s, one, lam=noise**2 / density) for one in xyz.T]
    np.testing.assert_allclose(found.xyz_m[:, 0].T, [spline(t_s) for spline in splines], atol=1e-5)
    assert found.rates is not None
    np.testing.assert_allclose(found.rates.velocity_m_s[:, 0].T, [spline(t_s, nu=1) for spline in splines], atol=1e-3)
    assert found.rates.acceleration_m_s2 is None


def drawn(rng, *, rate_hz, density, noise, n_frames=240, markers=3):
    """Positions (T, M, 3) whose velocity is a Matern process of order 5/2, true accelerations, and noisy positions."""
    chain, kick = smooth_step(4, 1, rate_hz, DT_S)
    size = np.sqrt(np.diag(kick))
    root = size[:, None] * np.linalg.cholesky(kick / np.outer(size, size))
    first = np.zeros((4, 4))
    first[1:, 1:] = np.linalg.cholesky(stationary(4, 1, rate_hz))
    state, out = first @ rng.normal(size=(4, 3 * markers)), []
    for _ in range(n_frames):
        out.append(state)
        state = chain @ state + root @ rng.normal(size=state.shape)
    states = np.sqrt(density) * np.array(out).reshape(n_frames, 4, markers, 3)
    return states[:, 0], states[:, 2], states[:, 0] + noise * rng.normal(size=states[:, 0].shape)


def test_likelihood_finds_what_made_the_recording():
    """Rate within a fifth, window within a tenth, noise within 5 %: of 2070 samples 3 deviations are 4.7 %."""
    rate_hz, density, noise = 12.0, 4e5, 1e-3  # stated twice as large; some are not seen
    _, _, seen = drawn(np.random.default_rng(1), rate_hz=rate_hz, density=density, noise=noise)
    seen[100:130, 0] = np.nan
    found = likeliest(seen, np.full(seen.shape[:2], 2 * noise), DT_S, order=4, free=1)
    assert found.noise == pytest.approx(0.5, rel=0.05)
    assert found.rate_hz == pytest.approx(rate_hz, rel=0.2)
    window = (density * DT_S**7 / noise**2) ** (-1 / 7) * DT_S
    np.testing.assert_allclose(found.window_s, window, rtol=0.1)
    other = likeliest(seen, np.full(seen.shape[:2], noise), DT_S, order=3, free=1)
    assert found.log_likelihood > other.log_likelihood + 10  # the true order is likelier by far


def filled(seen, sd_m, settings=ALONE, *, even=False):
    """Accelerations and their deviations, of markers (T, M, 3) with the stated noise; ``even``: driven alike always."""
    trial = MarkerTrial(name="a", t_s=DT_S * np.arange(len(seen)), xyz_m=seen, sd_m=np.full(seen.shape[:2], sd_m))
    fitted = settings.fit(TrialSet([trial], Anatomy(())))
    assert isinstance(fitted, WeightedMotion)
    if even:
        still = (replace(part, motion=replace(part.motion, intensity=np.ones((0, 1)))) for part in fitted.parts)
        fitted = replace(fitted, parts=tuple(still))
    names = tuple(f"m{i}" for i in range(seen.shape[1]))
    found = fitted.fill(PositionObservations(xyz_m=seen, sd_m=trial.sd_m), rate_points=RatePoints(names=names))
    assert found.rates is not None
    assert found.rates.acceleration_m_s2 is not None
    assert found.rates.acceleration_cov is not None
    return found, found.rates.acceleration_m_s2, np.sqrt(np.einsum("tnii->tni", found.rates.acceleration_cov))


def test_accelerations_err_as_stated_with_gaps():
    """Z of drawn motions is 1, of seen frames and in gaps of twenty, whatever noise was stated.

    Errors last for about a window of 5 frames: of 1600 numbers 300 are independent, and z deviates by 4 %; in gaps
    that are 60 numbers and 9 %, of which two and more are let pass.
    """
    rng = np.random.default_rng(2)
    _, truth, seen = drawn(rng, rate_hz=12.0, density=4e5, noise=1e-3)
    gap = np.zeros(seen.shape[:2], dtype=bool)
    for marker in range(seen.shape[1]):
        for start in range(40 + 10 * marker, 200, 70):
            gap[start : start + 20, marker] = True
    seen[gap] = np.nan
    _, found, sd = filled(seen, 3e-3)
    ratio = (found - truth) / sd
    assert np.sqrt(np.mean(ratio[~gap] ** 2)) == pytest.approx(1, abs=0.15)
    assert np.sqrt(np.mean(ratio[gap] ** 2)) == pytest.approx(1, abs=0.2)


def test_rest_and_strike_have_intervals_of_their_own():
    """Z of a marker that is driven four hundred times as strongly for 1 s of 2.4 is nearer to 1 in calm stretches.

    Compared with one density at all times, under which these are stated too uncertain, and err by more.
    """
    rng = np.random.default_rng(3)
    quiet, strike = (drawn(rng, rate_hz=12.0, density=density, noise=0.0)[0] for density in (2e3, 8e5))
    ramp = 0.5 - 0.5 * np.cos(2 * np.pi * np.clip((np.arange(240) - 70) / 100, 0, 1))[:, None, None]
    xyz = quiet + ramp * (strike - strike[70])
    truth = np.gradient(np.gradient(xyz, DT_S, axis=0), DT_S, axis=0)
    _, found, sd = filled(xyz + 1e-3 * rng.normal(size=xyz.shape), 1e-3)
    _, plain, same = filled(xyz + 1e-3 * rng.normal(size=xyz.shape), 1e-3, even=True)
    calm, quick = np.r_[10:60, 180:230], np.r_[90:150]
    z = [[np.sqrt(np.mean(((a - truth) / s)[k] ** 2)) for k in (calm, quick)] for a, s in ((found, sd), (plain, same))]
    assert abs(np.log(z[0][0])) < 0.8 * abs(np.log(z[1][0]))
    assert 0.7 < z[0][1] < 1.4
    assert np.mean((found - truth)[calm] ** 2) < 0.8 * np.mean((plain - truth)[calm] ** 2)


def estimate(shift, spread):
    """Of one marker in two frames, all numbers of the state moved by so much."""
    six, three = (np.tile(spread * np.eye(k, dtype=np.float32), (2, 1, 1, 1)) for k in (6, 3))
    rates = Rates(
        rate_points=ONE,
        velocity_m_s=np.full((2, 1, 3), shift),
        own=six,
        cross=np.zeros((2, 0, 6, 6), dtype=np.float32),
        kept=np.ones((2, 1, 3)),
        acceleration_m_s2=np.full((2, 1, 3), shift),
        acceleration_cov=three,
    )
    return Estimate(xyz_m=np.full((2, 1, 3), shift), cov_m2=np.tile(spread * np.eye(3), (2, 1, 1, 1)), rates=rates)


def test_weights_are_those_of_a_mixture():
    """Its mean and covariance, by sampling: 4e5 draws have means to 0.005 and variances to 0.02."""
    share = np.array([0.3, 0.7])
    found = weighted([estimate(0.0, 1.0), estimate(2.0, 0.5)], share)
    rng = np.random.default_rng(4)
    one = rng.random(400_000) < share[0]
    draws = np.where(one[:, None], rng.normal(size=(400_000, 6)), 2 + np.sqrt(0.5) * rng.normal(size=(400_000, 6)))
    assert found.rates is not None
    assert found.rates.acceleration_m_s2 is not None
    assert found.rates.acceleration_cov is not None
    np.testing.assert_allclose(found.rates.own[0, 0], np.cov(draws.T), atol=0.02)
    np.testing.assert_allclose(found.rates.acceleration_cov, found.cov_m2)
    for mean in (found.xyz_m, found.rates.velocity_m_s, found.rates.acceleration_m_s2):
        np.testing.assert_allclose(mean, draws.mean(), atol=0.005)


def test_few_frames_and_markers_that_are_hardly_seen():
    """Nine frames teach nothing: constant velocity. A marker of three sightings is filled as the other moves."""
    rng = np.random.default_rng(5)
    _, _, seen = drawn(rng, rate_hz=12.0, density=4e5, noise=1e-3, n_frames=60, markers=2)
    seen[3:, 1] = np.nan
    found, acceleration, sd = filled(seen, 1e-3, SmoothSettings())
    assert np.isfinite(found.xyz_m).all()
    assert np.isfinite(acceleration).all()
    assert (sd[-1, 1] > sd[30, 0]).all()
    short = MarkerTrial(name="a", t_s=DT_S * np.arange(9), xyz_m=seen[:9], sd_m=np.full((9, 2), 1e-3))
    assert SmoothSettings().fit(TrialSet([short], Anatomy(()))).motion.name == "constant_velocity"


def test_noisier_observations():
    """All of them: the distances in deviations are half as far."""
    seen = PositionObservations(xyz_m=np.ones((1, 1, 3)), sd_m=np.ones((1, 1)))
    before, after = (one.sights(0, np.zeros((1, 3)), np.eye(3)[None]) for one in (seen, noisier(seen, 2.0)))
    np.testing.assert_allclose(after.sd, 2 * before.sd)
    with pytest.raises(TypeError, match="expected pixels or positions"):
        noisier("seen", 2.0)  # pyright: ignore[reportArgumentType]
