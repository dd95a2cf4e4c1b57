"""Long recordings: filtered in blocks, the same to the last digit."""

import numpy as np
import pytest
from mocap.filters.motion.constant_velocity import ConstantVelocity
from mocap.filters.observations import PositionObservations
from mocap.filters.track import smooth


def walk(n_frames: int) -> tuple[ConstantVelocity, PositionObservations, np.ndarray]:
    """Two markers on a smooth way, with gaps and noise."""
    rng = np.random.default_rng(0)
    t_s = np.arange(n_frames) / 100.0
    xyz = np.stack([np.sin(t_s[:, None] * [1, 2, 3]), np.cos(t_s[:, None] * [3, 1, 2])], axis=1)
    xyz += 1e-3 * rng.standard_normal(xyz.shape)
    xyz[rng.random(xyz.shape[:2]) < 0.2] = np.nan
    model = ConstantVelocity(start_m=np.zeros((2, 3)), start_sd_m=1.0, speed_sd_m_s=3.0, density=np.full(2, 20.0))
    return model, PositionObservations(xyz_m=xyz, sd_m=np.full(xyz.shape[:2], 1e-3)), t_s


@pytest.mark.parametrize("frames_a_block", [2, 7, 50, 99, 100])
def test_blocks_change_nothing(frames_a_block):
    """Filtering a block again from the state before it repeats the same operations: equal to the last digit."""
    model, observations, t_s = walk(100)
    whole = smooth(model, observations, t_s)
    blocks = smooth(model, observations, t_s, most_bytes=frames_a_block * 8 * 2 * 192 + 1)
    for name in ("xyz_m", "cov_m2", "log_likelihood"):
        np.testing.assert_array_equal(getattr(blocks, name), getattr(whole, name), err_msg=name)
    assert len(blocks.observed) == len(whole.observed) == 100
    for ours, theirs in zip(blocks.observed, whole.observed, strict=True):
        np.testing.assert_array_equal(ours.weight, theirs.weight)
        np.testing.assert_array_equal([ours.nis, ours.n_rows], [theirs.nis, theirs.n_rows])


def test_a_single_frame():
    """There is nothing to look back from."""
    model, observations, t_s = walk(1)
    assert smooth(model, observations, t_s).xyz_m.shape == (1, 2, 3)
