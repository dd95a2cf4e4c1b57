"""Gaps filled from the other markers of the same frame."""

import numpy as np
import pytest
from mocap.filters.interpolate import blended, by_chains, by_poses, interpolated


@pytest.mark.parametrize("kind", ["conditional_gaussian", "principal_components"])
def test_poses_of_few_components_are_completed(kind):
    """Twelve markers move by three motions: one that is hidden for half a second follows from the others.

    The motions span the poses, so what is left is the ridge and the noise of 0.01 mm; a line through the gap misses
    the whole stroke of 20 mm.
    """
    rng = np.random.default_rng(3)
    t_s = np.arange(300) / 100
    rest = rng.normal(0, 0.1, (12, 3))
    directions = rng.normal(0, 0.01, (3, 12, 3))
    directions[:, :4] = 0  # the trunk
    motions = np.stack([np.sin(2 * np.pi * f * t_s) for f in (1.3, 2.1, 3.7)])
    xyz = rest + np.einsum("kt,kmd->tmd", motions, directions) + rng.normal(0, 1e-5, (300, 12, 3))
    shown = xyz.copy()
    shown[100:150, 7] = np.nan
    found = by_poses(shown, t_s, range(4), kind=kind)
    error = np.linalg.norm((found - xyz)[100:150, 7], axis=-1)
    line = np.linalg.norm((interpolated(shown, t_s, kind="linear") - xyz)[100:150, 7], axis=-1)
    assert error.max() < 0.05 * line.max()
    known = np.isfinite(shown)
    np.testing.assert_allclose(found[known], xyz[known], atol=1e-12)


def test_a_fill_joins_what_was_measured():
    """A model that is off by a line is put right exactly; a column that shows nothing is the model's."""
    t = np.linspace(0, 1, 21)
    truth = np.column_stack([np.sin(t), np.cos(t)])
    model = truth + np.column_stack([0.3 + 0.1 * t, t])
    y = truth.copy()
    y[5:12, 0] = np.nan
    y[:, 1] = np.nan
    np.testing.assert_allclose(blended(y, model), np.column_stack([truth[:, 0], model[:, 1]]), atol=1e-12)


def test_chains_keep_the_lengths_of_bones():
    """A double pendulum on a moving trunk, its bones given in any order: both ends of a bone hidden, lengths stay.

    A bone that does not turn goes with its trunk, exactly, where a spline through the gap does not.
    """
    t_s = np.arange(200) / 100
    first, second = 0.8 * np.sin(9 * t_s), 1.1 * np.sin(9 * t_s + 0.7)
    trunk = np.column_stack([2 * t_s, np.sin(20 * t_s), np.cos(9 * t_s)])
    down = [np.column_stack([np.sin(a), 0 * a, -np.cos(a)]) for a in (first, second)]
    elbow = trunk + 0.3 * down[0]
    xyz = np.stack([trunk, elbow, elbow + 0.2 * down[1], trunk + np.array([0.0, 0.1, 0.2])], axis=1)
    shown = xyz.copy()
    shown[60:95, 1:] = np.nan
    found = by_chains(shown, t_s, [(2, 1), (0, 1), (0, 3)], [0])
    for (a, b), length in (((0, 1), 0.3), ((1, 2), 0.2)):
        np.testing.assert_allclose(np.linalg.norm(found[:, b] - found[:, a], axis=-1), length, rtol=1e-12)
    np.testing.assert_allclose(found[:, 3], xyz[:, 3], atol=1e-12)
    assert np.abs(interpolated(shown, t_s, kind="cubic")[:, 3] - xyz[:, 3]).max() > 0.1
    known = np.isfinite(shown)
    np.testing.assert_allclose(found[known], shown[known], atol=1e-12)
