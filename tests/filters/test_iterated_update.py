"""Rays linearised again about smoothed states: towards the exact posterior, and nowhere else."""

import numpy as np
import pytest
from mocap.filters.motion.constant_velocity import ConstantVelocity
from mocap.filters.observations import PixelObservations, PositionObservations, seen_from
from mocap.filters.track import smooth

from mocap.cameras.camera import project
from tests.filters.filmed import hide, pixels, still


def vague(rng, xyz, sd_m):
    """A model whose first prediction is off by a draw from its own deviation."""
    start = xyz[0] + rng.normal(0, sd_m, xyz[0].shape)
    return ConstantVelocity(start_m=start, start_sd_m=sd_m, speed_sd_m_s=1.0, density=np.ones(len(start)))


def found(model, seen, passes):
    """Mean and covariance of the first marker in the first frame."""
    estimate = smooth(model, seen, 0.01 * np.arange(seen.n_frames), passes=passes, settled=0.0)
    return estimate.xyz_m[0, 0], estimate.cov_m2[0, 0]


def exact(seen, model, start):
    """Mean and covariance of one marker's posterior by a grid of 41^3 points, 6 deviations wide each way.

    Steps of 0.3 deviations sum a normal density to rounding; the grid is laid three times about its own moments.
    """
    line = np.linspace(-6, 6, 41)
    grid = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).reshape(-1, 3)
    mean, cov = start
    for _ in range(3):
        x = mean + grid @ np.linalg.cholesky(cov).T
        miss = (project(seen.matrices, x[:, None])[:, :, 0] - seen.uv_px[:, 0]) / seen.sd_px[:, 0, :, None]
        log = -0.5 * np.sum(miss**2, axis=(0, 2)) - 0.5 * np.sum((x - model.start_m[0]) ** 2, axis=1) / (
            model.start_sd_m**2
        )
        weight = np.exp(log - log.max())
        weight /= weight.sum()
        mean = weight @ x
        cov = ((x - mean) * weight[:, None]).T @ (x - mean)
    return mean, cov


def one_marker(seed, sd_m, n_cameras):
    """Rays of one marker that are always used as such."""
    rng = np.random.default_rng(seed)
    seen, xyz = pixels(rng, n_cameras=3, n_frames=1, n_markers=1, wide_m=10.0)
    chosen = {name: getattr(seen, name)[:n_cameras] for name in ("matrices", "uv_px", "sd_px")}
    return PixelObservations(**{**vars(seen), **chosen}), vague(rng, xyz, sd_m)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("sd_m", "n_cameras"), [(0.05, 3), (0.1, 3), (0.2, 3), (0.2, 2), (0.05, 1)])
def test_two_rounds_are_nearer_the_posterior(seed, sd_m, n_cameras):
    """In posterior deviations the second round is several times nearer than the first, four are there.

    What remains after four is that a projection bends over the posterior itself: for two cameras or more, which know
    the marker to 1 mm, by f/z^2 mm^2 = 1e-3 deviations; for one camera along its ray, where the prior's deviation s
    over the distance of 2 m is the share of the bend, s/z = 0.03 deviations and twice that at most.
    """
    seen, model = one_marker(seed, sd_m, n_cameras)
    four = found(model, seen, 4)
    mean, cov = exact(seen, model, four)
    root = np.linalg.inv(np.linalg.cholesky(cov))
    off, wide = [], []
    for m, c in (found(model, seen, 1), found(model, seen, 2), four):
        off.append(np.linalg.norm(root @ (m - mean)))
        wide.append(np.abs(root @ c @ root.T - np.eye(3)).max())
    limit = 2e-3 if n_cameras > 1 else 2 * sd_m / 2.0 * 1.2
    assert off[2] < limit
    assert off[1] < max(0.1 * off[0], limit) if n_cameras > 1 else off[1] < off[0] + 0.02
    assert wide[1] < 0.1 * wide[0]
    assert wide[2] < 0.02


def test_a_sharp_prediction_needs_no_second_round():
    """Of markers known to 10 um projections bend by 3e-8 px, a ten-millionth of the noise."""
    rng = np.random.default_rng(1)
    seen, xyz = pixels(rng, n_frames=1)
    model = vague(rng, xyz, 1e-5)
    (m1, c1), (m2, c2) = found(model, seen, 1), found(model, seen, 2)
    np.testing.assert_allclose(m2, m1, atol=1e-5 * 1e-6)
    np.testing.assert_allclose(c2, c1, rtol=1e-6, atol=1e-16)


def test_positions_are_linear():
    """A second round repeats the first, to rounding: smoothed markers, likelihoods, weights; gaps included."""
    rng = np.random.default_rng(2)
    xyz = rng.normal(0, 0.01, (6, 3, 3))
    xyz[2, 1], xyz[4] = np.nan, np.nan
    seen, t_s = PositionObservations(xyz_m=xyz, sd_m=np.full((6, 3), 1e-3)), 0.01 * np.arange(6)
    model = ConstantVelocity(start_m=np.zeros((3, 3)), start_sd_m=0.1, speed_sd_m_s=1.0, density=np.full(3, 10.0))
    once, again = smooth(model, seen, t_s), smooth(model, seen, t_s, passes=3)
    np.testing.assert_allclose(again.xyz_m, once.xyz_m, atol=1e-12)
    np.testing.assert_allclose(again.cov_m2, once.cov_m2, rtol=1e-10, atol=1e-18)
    np.testing.assert_allclose(again.log_likelihood, once.log_likelihood, atol=1e-9)


def test_passes_end_when_nothing_moves():
    """Each pass asks for the sights of every frame, twice after the first; few of many passes are made."""
    rng = np.random.default_rng(3)
    seen, _ = pixels(rng)
    asked = []

    class Watched:
        n_frames = seen.n_frames

        def sights(self, frame, mean, cov):
            asked.append(frame)
            return seen.sights(frame, mean, cov)

    t_s, model = 0.01 * np.arange(4), still(seen)
    smooth(model, Watched(), t_s)
    assert asked == [0, 1, 2, 3]
    smooth(model, Watched(), t_s, passes=9)
    made, rest = divmod(len(asked) - 4 - 4, 8)  # one pass; then one, and those after it
    assert rest == 0
    assert 1 <= made <= 4


def test_the_same_rows_from_elsewhere():
    """Rows y = slope (x - about) + e as innovations of another mean: conditioning on them gives the same marker."""
    rng = np.random.default_rng(4)
    seen, _ = pixels(rng, n_markers=3)
    mean, about = rng.uniform(-0.3, 0.3, (2, 3, 3))
    there = seen.sights(0, about, np.tile(1e-4 * np.eye(3), (3, 1, 1)))
    here = seen_from(there, about - mean)
    for g, (_, marker) in enumerate(there.where):
        expected = there.innovation[g] + there.slope[g] @ (about[marker] - mean[marker])
        np.testing.assert_allclose(here.innovation[g], expected, rtol=1e-12)
    for name in ("where", "slope", "sd", "size", "dof"):
        assert getattr(here, name) is getattr(there, name)


def test_blocks_and_all_at_once_agree():
    """Passes are the same in blocks, frames that show nothing pass, and the truth is nearer."""
    rng = np.random.default_rng(5)
    seen, xyz = pixels(rng, n_frames=5, still=True, wide_m=10.0)
    blank = np.zeros(seen.uv_px.shape[:3], dtype=bool)
    blank[:, 2], blank[1:, 3] = True, True
    seen = hide(seen, blank)
    model, t_s = vague(rng, xyz, 0.1), 0.01 * np.arange(5)
    whole = smooth(model, seen, t_s, passes=2)
    blocks = smooth(model, seen, t_s, passes=2, most_bytes=1.0)
    np.testing.assert_array_equal(blocks.xyz_m, whole.xyz_m)
    once = smooth(model, seen, t_s)
    assert np.abs(whole.xyz_m - xyz).max() < np.abs(once.xyz_m - xyz).max()
