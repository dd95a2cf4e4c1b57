"""Slow errors of rays: found where they are, not where they are not."""

import numpy as np
import pytest

from mocap.cameras.camera import project, stacked
from mocap.cameras.triangulate import linear
from mocap.cleaning.bias import ray_bias
from tests.mocap.rigs import cloud, ring

DT_S = 1 / 240


def scene(rng, *, sd=0.5, n_frames=300, n_markers=4, n_cameras=6):
    """Markers that move slowly, their pixels with jitter."""
    matrices = stacked(ring(n_cameras))
    t = np.arange(n_frames) * DT_S
    xyz = cloud(rng, n_markers) + 0.1 * np.sin(2 * np.pi * t[:, None, None] + rng.uniform(0, 6, (n_markers, 3)))
    uv = project(matrices, xyz)
    return matrices, xyz, t, uv + rng.normal(0, sd, uv.shape)


def slow(rng, uv, t, size):
    """A bias of the given root mean square, slower than 1 Hz, of every ray for itself."""
    phase, rate = rng.uniform(0, 2 * np.pi, uv[:, :1].shape), rng.uniform(0.1, 1.0, uv[:, :1].shape)
    return size * np.sqrt(2) * np.sin(2 * np.pi * rate * t[:, None, None] + phase)


def unseen_part(matrices, xyz, bias):
    """What of a bias moves the points, by the linearised least squares: this part no residual can show."""
    step = 1e-6
    j = np.stack([(project(matrices, xyz + step * e) - project(matrices, xyz - step * e)) for e in np.eye(3)], axis=-1)
    j = np.moveaxis(j / (2 * step), 0, 2).reshape(*xyz.shape[:2], -1, 3)
    b = np.moveaxis(bias, 0, 2).reshape(*xyz.shape[:2], -1, 1)
    shared = j @ np.linalg.solve(np.swapaxes(j, -1, -2) @ j, np.swapaxes(j, -1, -2) @ b)
    return np.moveaxis(shared[..., 0].reshape(*xyz.shape[:2], -1, 2), 2, 0)


def test_a_slow_bias_is_found_in_its_observable_part():
    """Biases of 3 px come back, but for the part that all rays of a point share; jitter and size are right.

    What is left is the jitter that a smoother of 8 Hz lets through, 0.5 px sqrt(2 * 8 / 240) = 0.13 px, and as much
    again where points are not quite settled; the share of the bias that moves points is 3 of 12 dimensions.
    """
    rng = np.random.default_rng(1)
    matrices, xyz, t, uv = scene(rng)
    bias = slow(rng, uv, t, 3.0)
    found = ray_bias(matrices, uv + bias, dt_s=DT_S)
    seen = bias - unseen_part(matrices, xyz, bias)
    assert np.sqrt(np.mean((found.bias_px - seen) ** 2)) < 2 * 0.13
    assert found.sd_px == pytest.approx(np.sqrt(np.mean(seen**2)), rel=0.1)
    assert found.jitter_px == pytest.approx(0.5, rel=0.1)


@pytest.mark.parametrize("seed", range(5))
def test_white_noise_has_no_bias(seed):
    """In white noise nothing is found: exactly zero; the jitter is the noise, to 3 % of 1e4 rows."""
    rng = np.random.default_rng(seed)
    matrices, _, _, uv = scene(rng)
    found = ray_bias(matrices, uv, dt_s=DT_S)
    assert found.sd_px == 0.0
    assert not found.bias_px.any()
    assert found.jitter_px == pytest.approx(0.5, rel=0.03)


def test_a_camera_that_drops_out_moves_less():
    """Where a camera with a 7 px bias loses a marker the corrected point jumps less than the raw one, by more rounds.

    At the minimum it would not jump at all; the alternation nears that slowly: each doubling of rounds must gain.
    """
    rng = np.random.default_rng(3)
    matrices, xyz, _, uv = scene(rng, sd=0.3, n_frames=200)
    uv[0] += [6.0, -4.0]
    uv[0, 100:150] = np.nan

    def jump(pixels):
        error = linear(matrices, pixels) - xyz
        return np.linalg.norm(error[100:150].mean(axis=0) - error[50:100].mean(axis=0), axis=1)

    jumps = [jump(uv), *(jump(uv - ray_bias(matrices, uv, dt_s=DT_S, iterations=n).bias_px) for n in (8, 16, 32))]
    assert (np.diff(jumps, axis=0) < 0).all()
    assert (jumps[1] < 0.85 * jumps[0]).all()


def test_nothing_is_invented_where_nothing_is_seen():
    """A bias is zero where a ray was not seen, or was alone; pixels given stay as they are."""
    rng = np.random.default_rng(4)
    matrices, _, t, uv = scene(rng, n_markers=3)
    uv += slow(rng, uv, t, 3.0)
    uv[rng.random(uv.shape[:3]) < 0.2] = np.nan
    uv[1:, :, 2] = np.nan
    before = uv.copy()
    found = ray_bias(matrices, uv, dt_s=DT_S)
    np.testing.assert_array_equal(uv, before)
    assert found.sd_px > 1
    assert not found.bias_px[np.isnan(uv[..., 0])].any()
    assert not found.bias_px[:, :, 2].any()
    assert np.isfinite(found.bias_px).all()


def test_too_short_for_anything_slow():
    """One or two frames know no slow error."""
    rng = np.random.default_rng(5)
    for n_frames in (1, 2):
        matrices, _, _, uv = scene(rng, n_frames=n_frames)
        found = ray_bias(matrices, uv, dt_s=DT_S)
        assert not found.bias_px.any()
        assert found.jitter_px > 0
