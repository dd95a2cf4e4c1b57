"""Fixed-lag smoothing: what a recording that ends a little later would have said, in memory that does not grow."""

import tracemalloc

import numpy as np
import pytest
from mocap.filters.body_axes import body_frames
from mocap.filters.gaussian import Markers
from mocap.filters.live import live
from mocap.filters.models.pose import PoseSettings, learn_pose
from mocap.filters.motion.base import Step
from mocap.filters.motion.constant_velocity import ConstantVelocity
from mocap.filters.observations import PositionObservations
from mocap.filters.poses import pose_trial
from mocap.filters.track import filter_forward, smooth

from tests.filters.filmed import pixels, still
from tests.filters.test_learned_models import flapping


def drawn(rng, cov):
    """A draw from normal densities around 0."""
    return np.einsum("mij,mj->mi", np.linalg.cholesky(cov), rng.normal(size=cov.shape[:2]))


def flight(rng, n_frames, *, n_markers=2, gaps=0.3):
    """Markers that move as constant velocity with white acceleration has it, seen with noise and with gaps."""
    t_s = np.cumsum(rng.uniform(0.005, 0.015, n_frames))
    model = ConstantVelocity(
        start_m=rng.normal(size=(n_markers, 3)),
        start_sd_m=0.1,
        speed_sd_m_s=1.0,
        density=rng.uniform(5, 20, n_markers),
    )
    start = model.initial()
    x = [start.mean + drawn(rng, start.cov)]
    for dt in np.diff(t_s):
        move = model.move(start, Step(1, dt))
        x.append(move.forward(x[-1]) + drawn(rng, move.noise))
    truth = np.array(x)[..., :3]
    sd = rng.uniform(2e-3, 6e-3, truth.shape[:2])
    xyz = truth + sd[..., None] * rng.normal(size=truth.shape)
    xyz[rng.random(sd.shape) < gaps] = np.nan
    return model, PositionObservations(xyz_m=xyz, sd_m=sd), t_s, truth


def run(model, seen, t_s, **options):
    """All estimates, which come in the order of the frames, each once."""
    out = list(live(model, seen, t_s, **options))
    assert [e.frame for e in out] == list(range(len(t_s)))
    np.testing.assert_array_equal([e.t_s for e in out], t_s)
    return np.array([e.xyz_m for e in out]), np.array([e.cov_m2 for e in out]), out


def same(found, expected):
    """Equal to rounding."""
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("lag", [59, 60, 1000])
def test_all_the_hindsight_is_the_smoother(lag):
    """With a lag of the recording nothing comes before its end, and then what ``smooth`` says, to rounding."""
    model, seen, t_s, _ = flight(np.random.default_rng(1), 60)
    whole = smooth(model, seen, t_s)
    xyz, cov, out = run(model, seen, t_s, lag=lag)
    same(xyz, whole.xyz_m)
    same(cov, whole.cov_m2)
    for ours, theirs in zip(out, whole.observed, strict=True):
        assert ours.observed.log_likelihood == pytest.approx(theirs.log_likelihood, rel=1e-9)


@pytest.mark.parametrize(("lag", "every"), [(0, 1), (1, 1), (4, 1), (4, 3), (0, 5), (3, 50)])
def test_a_frame_is_smoothed_as_if_the_recording_ended(lag, every):
    """Of frame k with j later ones the estimate is that of ``smooth`` on frames 0 to k + j, to rounding.

    j is ``lag``, up to every - 1 more, and less in the last frames alone.
    """
    model, seen, t_s, _ = flight(np.random.default_rng(2), 23)
    xyz, cov, out = run(model, seen, t_s, lag=lag, every=every)
    for e in out:
        end = e.frame + e.ahead + 1
        short = smooth(model, PositionObservations(xyz_m=seen.xyz_m[:end], sd_m=seen.sd_m[:end]), t_s[:end])
        same(xyz[e.frame], short.xyz_m[e.frame])
        same(cov[e.frame], short.cov_m2[e.frame])
        assert e.ahead <= lag + every - 1
        assert e.ahead >= min(lag, len(t_s) - 1 - e.frame)


def test_no_lag_is_the_filter():
    """Each estimate is there before the next frame is looked at, and is the filtered one."""
    model, seen, t_s, _ = flight(np.random.default_rng(3), 12)
    filtered = list(filter_forward(model, seen, t_s))
    looked = []

    def watched():
        for number, time in enumerate(t_s):
            looked.append(number)
            yield time

    for e in live(model, seen, watched(), lag=0):
        assert looked[-1] == e.frame
        state = filtered[e.frame].state
        markers = Markers(state, model.view(state.mean, e.frame))
        np.testing.assert_array_equal(e.xyz_m, markers.view.mean)
        np.testing.assert_allclose(e.cov_m2, markers.cov, rtol=1e-12)


def test_pixels_too():
    """Rays are linearised about the same predictions as in ``smooth``."""
    seen, _ = pixels(np.random.default_rng(4), n_frames=6)
    model, t_s = still(seen), 0.01 * np.arange(6)
    xyz, _, _ = run(model, seen, t_s, lag=5)
    same(xyz, smooth(model, seen, t_s).xyz_m)


def test_poses_too():
    """A pose held by V_z, learned from the recording: what ``smooth`` says to rounding, dark frames included."""
    rng = np.random.default_rng(10)
    xyz = flapping(rng) + rng.normal(0, 1e-4, (300, 8, 3))
    xyz[100:130, 4:], xyz[200:215] = np.nan, np.nan
    t_s = 0.005 * np.arange(300)
    trial = pose_trial(t_s, xyz, body_frames(xyz[:, :4], dt_s=0.005, cutoff_hz=3.0))
    model = learn_pose([trial], PoseSettings(ranks=(1, 2, 3)))
    seen = PositionObservations(xyz_m=xyz, sd_m=np.full(xyz.shape[:2], 1e-4))
    whole = smooth(model, seen, t_s)
    found, cov, _ = run(model, seen, t_s, lag=300)
    same(found, whole.xyz_m)
    same(cov, whole.cov_m2)


def test_hindsight_helps():
    """On data of the model the error falls with the lag, is as large as stated, and what is stated falls in each frame.

    3 components x 2 markers x 300 frames: the error's deviation over its expectation has sampling error below
    1/sqrt(2 x 300) = 4 % even if only one component a frame were independent; asked to 4 of these.
    """
    model, seen, t_s, truth = flight(np.random.default_rng(5), 300)
    rms, before = [], np.full((300, 2), np.inf)
    for lag in (0, 2, 8):
        xyz, cov, _ = run(model, seen, t_s, lag=lag)
        inside = slice(0, 300 - 8)
        stated = np.trace(cov, axis1=-2, axis2=-1)
        assert (stated[inside] <= before[inside] * (1 + 1e-9)).all()
        rms.append(np.sqrt(np.mean(np.sum((xyz - truth)[inside] ** 2, axis=-1))))
        assert rms[-1] == pytest.approx(np.sqrt(stated[inside].mean()), rel=0.16)
        before = stated
    assert (np.diff(rms) < 0).all()
    assert rms[-1] < 0.8 * rms[0]


def test_memory_is_flat():
    """The peak of 120 frames is that of 50 (to 20 states; 70 frames have 280), with 12 markers a state has 3.5 kB.

    A kept frame has a covariance, the noise of its own time step, rows and gains and what they leave, and small change.
    """
    rng = np.random.default_rng(6)
    model, seen, t_s, _ = flight(rng, 120, n_markers=12)

    def peak(n_frames, lag):
        part = PositionObservations(xyz_m=seen.xyz_m[:n_frames], sd_m=seen.sd_m[:n_frames])
        tracemalloc.start()
        for _ in live(model, part, t_s[:n_frames], lag=lag):
            pass
        size = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return size

    state = 8 * 12 * 6**2
    peak(50, 1)  # what is allocated once
    assert peak(120, 5) < peak(50, 5) + 20 * state
    assert 20 * state < peak(50, 15) - peak(50, 5) < 80 * state


def test_one_frame_and_none():
    """A recording of one frame has one estimate, one of none has none."""
    model, seen, t_s, _ = flight(np.random.default_rng(7), 1)
    xyz, _, out = run(model, seen, t_s, lag=3)
    same(xyz, smooth(model, seen, t_s).xyz_m)
    assert out[0].ahead == 0
    assert list(live(model, seen, iter(()), lag=3)) == []


def test_wrong_use():
    """Errors say what was expected."""
    model, seen, t_s, _ = flight(np.random.default_rng(8), 3)
    with pytest.raises(ValueError, match="frame 2 at"):
        list(live(model, seen, t_s[[0, 1, 1]], lag=1))
    for lag, every in ((-1, 1), (0, 0)):
        with pytest.raises(ValueError, match="lag must be 0 or more"):
            list(live(model, seen, t_s, lag=lag, every=every))


def test_the_smoothed_state_does_not_enter_the_filter():
    """Filtered states behind a lag are those without one: the last frame's estimate does not depend on the lag."""
    model, seen, t_s, _ = flight(np.random.default_rng(9), 30)
    last = [run(model, seen, t_s, lag=lag)[0][-1] for lag in (0, 3, 29)]
    np.testing.assert_array_equal(last[0], last[1])
    np.testing.assert_array_equal(last[0], last[2])
