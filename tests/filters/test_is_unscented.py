"""The engine is an unscented filter: where a model is linear its sigma points are done without, and nothing else."""

import numpy as np
import pytest
from mocap.filters.ensemble import Gaussian, default_points, predict, smooth_step, update
from mocap.filters.gaussian import Markers
from mocap.filters.motion.base import Step
from mocap.filters.observations import PositionObservations
from mocap.filters.track import filter_forward, smooth

from tests.filters.test_motion_models import FRAMES, MARKERS, free, oscillating, pose

T_S = 0.01 * np.arange(FRAMES)


def rooted(cov):
    """Lower factor, by correlations."""
    sd = np.sqrt(np.diag(cov))
    return sd[:, None] * np.linalg.cholesky(cov / np.outer(sd, sd))


def straight(mechanics):
    """A pose whose body does not turn, so that its markers are linear in the state; and what is seen of it."""
    rng = np.random.default_rng(7)
    model = pose(mechanics)
    still = np.repeat([1.0, 1e-7, 1.0, 1e-7], 3)
    model.body_sd[:] *= still
    model.body.density[:] *= still[:6]
    state, xyz = model.initial(), []
    x = rng.normal(size=model.size) * np.sqrt(np.diag(state.cov))
    for frame in range(FRAMES):
        if frame:
            move = model.move(state, Step(frame, 0.01))
            x = move.forward(x) + move.shift + rooted(move.noise) @ rng.normal(size=model.size)
        xyz.append(model.markers(x[None], frame)[0] + 1e-3 * rng.normal(size=(MARKERS, 3)))
    xyz = np.array(xyz)
    xyz[1, 2], xyz[3, [0, 1]] = np.nan, np.nan
    return model, PositionObservations(xyz_m=xyz, sd_m=np.full(xyz.shape[:2], 1e-3))


@pytest.mark.parametrize("mechanics", [free, oscillating])
def test_it_is_the_unscented_transform_of_the_whole_state(mechanics):
    """Filtered and smoothed: all 2n + 1 sigma points through dynamics and markers, covariances as sums of squares.

    To 2e-9 of deviations: the first frame makes variances 1e6 times smaller, so that a unit in the last digit of its
    rows moves states by 0.4 to 1.0e-9 (measured); and of the body's turns, 1e-7, the square is left out.
    """
    model, seen = straight(mechanics)
    start, points = model.initial(), default_points(model.size)
    state = Gaussian(start.mean, rooted(start.cov))
    states, predictions, density = [], [], 0.0
    for frame in range(FRAMES):
        if frame:
            move = model.move(start, Step(frame, 0.01))
            ahead = predict(state, lambda x, m=move: m.forward(x) + m.shift, rooted(move.noise), points)
            predictions.append(ahead)
            state = ahead.state
        there = np.isfinite(seen.xyz_m[frame])
        found = update(
            state,
            lambda x, f=frame, t=there: model.markers(x, f)[:, t],
            seen.xyz_m[frame][there],
            np.full(there.sum(), 1e-3),
            points,
        )
        state, density = found.state, density + found.log_likelihood
        states.append(state)
    for ours, theirs in zip(filter_forward(model, seen, T_S, gate_sd=np.inf), states, strict=True):
        sd = np.sqrt(np.diag(theirs.cov))
        np.testing.assert_allclose(ours.state.mean / sd, theirs.mean / sd, atol=2e-9)
        unit = np.outer(sd, sd)
        np.testing.assert_allclose(ours.state.cov / unit, theirs.cov / unit, atol=1e-9)
    back = states[-1:]
    for frame in range(FRAMES - 2, -1, -1):
        back.insert(0, smooth_step(states[frame], predictions[frame], back[0]))
    found = smooth(model, seen, T_S, gate_sd=np.inf)
    for frame, theirs in enumerate(back):
        markers = Markers(theirs, model.view(theirs.mean, frame))
        sd = np.sqrt(np.diagonal(markers.cov, axis1=1, axis2=2))
        np.testing.assert_allclose(found.xyz_m[frame] / sd, markers.view.mean / sd, atol=1e-9)
        np.testing.assert_allclose(found.cov_m2[frame], markers.cov, atol=1e-9 * sd.max() ** 2)
    assert found.log_likelihood.sum() == pytest.approx(density, rel=1e-8)


@pytest.mark.parametrize("mechanics", [free, oscillating])
@pytest.mark.parametrize("sd_m", [1e-6, 1e-8])
def test_positions_without_noise_leave_a_covariance(mechanics, sd_m):
    """Known to a millionth and less of the metre that the body is before: 1e12 and 1e16 in variance.

    What is seen is where it is seen, to its deviation, and no covariance turns indefinite.
    """
    model, seen = straight(mechanics)
    sharp = PositionObservations(xyz_m=seen.xyz_m, sd_m=np.full(seen.sd_m.shape, sd_m))
    found = smooth(model, sharp, T_S, gate_sd=np.inf)
    assert np.linalg.eigvalsh(found.cov_m2).min() > 0.5 * sd_m**2
    there = np.isfinite(seen.xyz_m[..., 0])
    np.testing.assert_allclose(found.xyz_m[there], seen.xyz_m[there], atol=sd_m)
