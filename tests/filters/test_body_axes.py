"""The frame of the body, and the smoother under it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mocap.filters.body_axes import BodyFrames, body_frames, trunk_shape
from mocap.filters.whittaker import fastest_hz, smooth_series, smoother
from scipy.spatial.transform import Rotation, Slerp

DT_S = 0.01


def dense_whittaker(y, weight, penalty):
    """The normal equations of the smoother, written out."""
    second = np.diff(np.eye(len(y)), n=2, axis=0)
    return np.linalg.solve(np.diag(weight) + penalty * second.T @ second, weight[:, None] * y)


@given(seed=st.integers(0, 1000), n=st.integers(3, 40), cutoff_hz=st.floats(0.5, 20))
def test_the_banded_smoother_is_the_dense_one(seed, n, cutoff_hz):
    """Any weights, zero ones and NaN under them included: the minimum of the stated sum, by a dense solve.

    The penalty is up to 1e6 here: 1e-16 x 1e6 x the 1e2 that a gap of tens of frames adds.
    """
    rng = np.random.default_rng(seed)
    y, weight = rng.normal(size=(n, 2)), rng.uniform(0.2, 2, n) * (rng.random(n) < 0.7)
    weight[[0, -1]] = 1.0
    expected = dense_whittaker(y, weight, (2 * np.pi * cutoff_hz * DT_S) ** -4)
    y[weight == 0] = np.nan
    found = smooth_series(y, weight, dt_s=DT_S, cutoff_hz=cutoff_hz)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7)


def test_a_sine_at_the_cutoff_is_halved():
    """Half amplitude at the cutoff, a 17th at twice, 16/17 at half of it: 1 / (1 + (f / fc)^4), to the step's square.

    The second difference has (2 sin(w dt / 2))^4 in place of (w dt)^4: 0.4 % at w dt = 0.3 and 1.5 % at 0.6.
    """
    t = np.arange(4000) * 0.01
    cutoff_hz = 5.0
    for ratio in (0.5, 1.0, 2.0):
        sine = np.sin(2 * np.pi * ratio * cutoff_hz * t)[:, None]
        middle = slice(1000, 3000)  # whole periods, far from the ends
        smooth = smooth_series(sine, np.ones(len(t)), dt_s=0.01, cutoff_hz=cutoff_hz)
        gain = np.sum(smooth[middle] * sine[middle]) / np.sum(sine[middle] ** 2)
        discrete = (2 * np.sin(np.pi * ratio * cutoff_hz * 0.01) / (2 * np.pi * cutoff_hz * 0.01)) ** 4
        assert gain == pytest.approx(1 / (1 + discrete), rel=1e-6)
        assert gain == pytest.approx(1 / (1 + ratio**4), abs=0.01)


def test_gaps_are_bridged_by_cubics_and_ends_by_lines():
    """Inside a gap the fourth difference vanishes, beyond the ends the second: what the penalty alone asks for."""
    rng = np.random.default_rng(1)
    weight = np.ones(60)
    weight[20:35] = weight[:5] = weight[52:] = 0
    y = rng.normal(size=(60, 1))
    smooth = smooth_series(y, weight, dt_s=DT_S, cutoff_hz=10.0)[:, 0]
    np.testing.assert_allclose(np.diff(smooth[18:37], n=4), 0, atol=1e-9)
    np.testing.assert_allclose(np.diff(smooth[:6], n=2), 0, atol=1e-9)
    np.testing.assert_allclose(np.diff(smooth[51:], n=2), 0, atol=1e-9)


def test_lines_pass_and_little_is_averaged():
    """A straight line is its own smoothing; one sample, or one believed sample, is a constant."""
    line = np.linspace(0, 5, 30)[:, None] + [0.0, 3.0]
    weight = np.r_[np.ones(10), np.zeros(10), np.ones(10)]
    np.testing.assert_allclose(smooth_series(line, weight, dt_s=DT_S, cutoff_hz=3.0), line, atol=1e-9)
    np.testing.assert_allclose(smooth_series(line[:1], np.ones(1), dt_s=DT_S, cutoff_hz=3.0), line[:1])
    one = np.zeros(30)
    one[4] = 1
    np.testing.assert_allclose(smooth_series(line, one, dt_s=DT_S, cutoff_hz=3.0), np.repeat(line[4:5], 30, axis=0))


def trunk(rng, n_frames, n_markers):
    """A rigid trunk that turns and moves slowly; its markers in the world, its rotations and positions."""
    shape = rng.normal(0, 0.03, (n_markers, 3))
    t = np.linspace(0, 1, n_frames)
    key = Rotation.from_rotvec([[0, 0, 0], [0.2, 0.1, 0.3], [0.1, -0.2, 0.8], [0.0, 0.3, 1.4]])
    rotation = Slerp([0, 0.3, 0.7, 1], key)(t).as_matrix()
    position = np.stack([2 * t, np.sin(2 * t), 0.1 * t**2], axis=1)
    return np.einsum("tij,kj->tki", rotation, shape) + position[:, None], rotation, position


@given(seed=st.integers(0, 200))
def test_a_rigid_motion_with_gaps_is_recovered(seed):
    """In body coordinates a rigid trunk stands still, whoever is missing when: the smoothing cutoff is far above it.

    The body's axes are those of the world in one frame, so that rotations agree up to one constant turn. The filter of
    30 Hz bends a motion of 1 Hz by (1/30)^4 = 1e-6 of its 1 m; the kinks of the interpolated turn cost 1e-4 rad.
    """
    rng = np.random.default_rng(seed)
    xyz, rotation, _ = trunk(rng, 200, 6)
    seen = xyz.copy()
    seen[rng.random(xyz.shape[:2]) < 0.3] = np.nan
    seen[90:93] = np.nan
    seen[120:123, 2:] = np.nan
    frames = body_frames(seen, dt_s=0.005)
    np.testing.assert_allclose(np.linalg.det(frames.rotation), 1, atol=1e-12)
    turn = np.einsum("tji,tjk->tik", frames.rotation, rotation)
    angle = Rotation.from_matrix(turn @ turn[0].T).magnitude()
    assert np.quantile(angle, 0.9) < 1e-3
    local = frames.to_body(xyz)
    assert np.quantile(np.abs(local - local.mean(axis=0)), 0.95) < 1e-3


def test_a_rigid_motion_without_gaps_is_exact():
    """With every marker seen and no smoothing to speak of, body coordinates are constant to the filter's bend."""
    xyz, _, _ = trunk(np.random.default_rng(2), 300, 5)
    frames = body_frames(xyz, dt_s=1.0, cutoff_hz=1e3)
    local = frames.to_body(xyz)
    np.testing.assert_allclose(local, np.repeat(local.mean(axis=0)[None], 300, axis=0), atol=1e-9)


def test_the_frame_is_the_worlds_where_most_is_seen():
    """The axes of the body are those of the world in the frame that sees most markers."""
    xyz, rotation, _ = trunk(np.random.default_rng(3), 100, 5)
    xyz[:40, 0] = np.nan
    xyz[41:, 0] = np.nan
    frames = body_frames(xyz, dt_s=1.0, cutoff_hz=1e3)
    np.testing.assert_allclose(frames.rotation[40], np.eye(3), atol=1e-6)
    np.testing.assert_allclose(frames.rotation[70], rotation[70] @ rotation[40].T, atol=1e-6)


def test_a_mirror_image_is_never_a_rotation():
    """A flat trunk fits its mirror image as well as itself: rotations stay proper all the same."""
    rng = np.random.default_rng(4)
    xyz, _, _ = trunk(rng, 50, 4)
    flat = xyz.copy()
    flat[:, 3] = flat[:, :3].mean(axis=1)
    frames = body_frames(flat + rng.normal(0, 1e-5, flat.shape), dt_s=DT_S, cutoff_hz=10.0)
    np.testing.assert_allclose(np.linalg.det(frames.rotation), 1, atol=1e-12)


def test_few_markers():
    """Two markers give a place and no rotation; none ever seen is an error; one frame is enough."""
    xyz, _, position = trunk(np.random.default_rng(5), 50, 2)
    frames = body_frames(xyz, dt_s=DT_S, cutoff_hz=10.0)
    np.testing.assert_array_equal(frames.rotation, np.repeat(np.eye(3)[None], 50, axis=0))
    assert np.abs(frames.position_m - position).max() < 0.2
    with pytest.raises(ValueError, match="no trunk marker is ever seen: name other markers"):
        body_frames(np.full((5, 3, 3), np.nan), dt_s=DT_S, cutoff_hz=10.0)
    whole, _, _ = trunk(np.random.default_rng(6), 1, 4)
    single = body_frames(whole, dt_s=DT_S, cutoff_hz=10.0)
    np.testing.assert_allclose(single.position_m, whole.mean(axis=1), atol=1e-12)
    np.testing.assert_allclose(single.rotation, np.eye(3)[None], atol=1e-12)


def test_world_and_body_agree():
    """Rotating a body coordinate back and moving it gives the world point: the inverse by hand."""
    rng = np.random.default_rng(7)
    rotation = Rotation.random(4, rng=rng).as_matrix()
    frames = BodyFrames(rotation=rotation, position_m=rng.normal(size=(4, 3)))
    xyz = rng.normal(size=(4, 5, 3))
    local = frames.to_body(xyz)
    for t in range(4):
        np.testing.assert_allclose(local[t] @ rotation[t].T + frames.position_m[t], xyz[t], atol=1e-12)


def turn_rate(frames, dt_s=DT_S):
    """(T - 1,) angle between neighbouring frames, rad/s."""
    step = np.einsum("tji,tjk->tik", frames.rotation[:-1], frames.rotation[1:])
    return Rotation.from_matrix(step).magnitude() / dt_s


@pytest.mark.parametrize("seed", range(4))
def test_markers_in_a_line_do_not_spin(seed):
    """A trunk of four markers in a line says nothing of its roll: the body does not roll with the noise.

    The line yaws by 0.4 rad at 0.5 Hz, at most 1.3 rad/s. Its noise turns it by 0.5 mm / 64 mm = 0.8e-2 rad a frame,
    smoothed at 3 Hz (2 pi 3 0.8e-2 = 0.15 rad/s); rolling freely would be a random angle a frame, 100 rad/s smoothed.
    What is left is the slow roll of 0.3 rad about the moving average of 0.5 s.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(400) * 0.005
    yaw = 0.4 * np.sin(2 * np.pi * 0.5 * t)
    ahead = np.stack([np.cos(yaw), np.sin(yaw), 0 * yaw], axis=1)
    xyz = np.array([-0.04, -0.01, 0.02, 0.05])[:, None] * ahead[:, None] + t[:, None, None]
    frames = body_frames(xyz + rng.normal(0, 5e-4, xyz.shape), dt_s=0.005, cutoff_hz=3.0)
    assert turn_rate(frames, 0.005).max() < 5
    axis = np.einsum("tij,ti->tj", frames.rotation, ahead)  # in the body it stands still, to 0.8e-2 rad and the filter
    off = np.arccos(np.clip(axis @ (axis.mean(axis=0) / np.linalg.norm(axis.mean(axis=0))), -1, 1))
    assert off.max() < 0.04


@pytest.mark.parametrize("loose_rad", [0.01, 0.3, 3.0])
def test_a_rigid_trunk_is_followed_however_loose(loose_rad):
    """Without misfit there is no prior: each frame's rotation is Kabsch's, by SciPy, whatever ``loose_rad`` is."""
    rng = np.random.default_rng(8)
    xyz, _, _ = trunk(rng, 60, 5)
    shape = trunk_shape(xyz)
    frames = body_frames(xyz, dt_s=1.0, cutoff_hz=1e3, loose_rad=loose_rad)
    for t in range(60):
        kabsch, _ = Rotation.align_vectors(xyz[t] - xyz[t].mean(axis=0), shape)
        np.testing.assert_allclose(frames.rotation[t], kabsch.as_matrix(), atol=1e-6)


def test_what_bends_is_followed_less():
    """A trunk that wobbles out of its shape at random: the tighter ``loose_rad``, the slower the body turns."""
    rng = np.random.default_rng(9)
    xyz, _, _ = trunk(rng, 200, 4)
    bent = xyz + rng.normal(0, 0.01, xyz.shape)
    rates = [
        turn_rate(body_frames(bent, dt_s=DT_S, cutoff_hz=20.0, loose_rad=loose)).mean() for loose in (0.03, 0.3, 3.0)
    ]
    assert rates[0] < 0.7 * rates[1] < 0.7 * rates[2]


def test_axes_that_keep_their_direction():
    """``turns=False``: one rotation, that which is nearest to all frames together; positions follow as before."""
    xyz, rotation, position = trunk(np.random.default_rng(10), 80, 5)
    frames = body_frames(xyz, dt_s=1.0, cutoff_hz=1e3, turns=False)
    np.testing.assert_array_equal(frames.rotation, np.repeat(frames.rotation[:1], 80, axis=0))
    followed = body_frames(xyz, dt_s=1.0, cutoff_hz=1e3)
    mean = Rotation.from_matrix(np.array(followed.rotation)).mean().as_matrix()
    # the covariance weighs axes by the trunk's extent, the mean of rotations does not: a share of the 0.8 rad of turns
    assert Rotation.from_matrix(frames.rotation[0] @ mean.T).magnitude() < 0.1
    np.testing.assert_allclose(frames.position_m, xyz.mean(axis=1), atol=1e-6)
    assert np.ptp(rotation[:, 0, 0]) > 0.2
    assert np.ptp(position[:, 0]) == pytest.approx(np.ptp(frames.position_m[:, 0]), abs=0.03)


def test_trials_share_the_axes_of_one_shape():
    """Two recordings of one trunk, turned apart: about their common shape both have the same body coordinates."""
    rng = np.random.default_rng(11)
    xyz, _, _ = trunk(rng, 120, 5)
    parts = [xyz, xyz[::-1] @ Rotation.from_rotvec([0.3, 1.0, -0.5]).as_matrix().T + [1.0, 2.0, 3.0]]
    shape = trunk_shape(np.concatenate(parts))
    local = [body_frames(part, dt_s=1.0, cutoff_hz=1e3, shape=shape).to_body(part) for part in parts]
    np.testing.assert_allclose(local[0], np.repeat(shape[None], 120, axis=0), atol=1e-6)
    np.testing.assert_allclose(local[1], local[0], atol=1e-6)


def test_the_mean_shape_is_the_trunks():
    """Distances between its markers are those of the rigid trunk, about its centre; a marker never seen is there."""
    xyz, _, _ = trunk(np.random.default_rng(12), 60, 6)
    xyz[:, 4] = np.nan
    xyz[::3, 1] = np.nan
    shape = trunk_shape(xyz)
    np.testing.assert_array_equal(shape[4], 0)
    ever = [0, 1, 2, 3, 5]
    np.testing.assert_allclose(shape[ever].mean(axis=0), 0, atol=1e-12)
    apart, expected = (
        np.linalg.norm(points[:, None] - points[None], axis=-1) for points in (shape[ever], xyz[1][ever])
    )
    np.testing.assert_allclose(apart, expected, atol=1e-6)
    with pytest.raises(ValueError, match="no trunk marker is ever seen"):
        trunk_shape(np.full((5, 3, 3), np.nan))


def test_many_series_at_once_are_each_smoothed_alone():
    """The equations of different series do not touch, whatever their weights and gaps."""
    rng = np.random.default_rng(3)
    y, weight = rng.normal(size=(5, 40, 2)), rng.uniform(0.5, 2, (5, 40)) * (rng.random((5, 40)) < 0.8)
    y[weight == 0] = np.nan
    found = smoother(weight, dt_s=DT_S, cutoff_hz=5.0)(y)
    for one, of, w in zip(found, y, weight, strict=True):
        np.testing.assert_allclose(one, smooth_series(of, w, dt_s=DT_S, cutoff_hz=5.0), rtol=1e-9, atol=1e-9)


def test_a_trunk_is_followed_up_to_30_hz():
    """The smoother halves a sine of its cutoff: 1 / (1 + (f / cutoff)^4); clicks allow a fifth of their rate."""
    t_s = np.arange(1000) / 1000
    sway = np.zeros((len(t_s), 1, 3))
    sway[:, 0, 0] = np.sin(2 * np.pi * 30 * t_s)
    frames = body_frames(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]) + sway, dt_s=1e-3)
    middle = slice(200, 800)
    gain = frames.position_m[middle, 0] @ sway[middle, 0, 0] / np.sum(sway[middle, 0, 0] ** 2)
    assert gain == pytest.approx(
        0.5, abs=0.02
    )  # 2 pi 30 Hz dt is 0.19: its second difference errs by 0.3 %, four times
    assert fastest_hz(1 / 100) == pytest.approx(20)
