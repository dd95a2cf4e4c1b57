"""Animals of other sizes are scaled to the one that is tracked."""

from dataclasses import replace

import numpy as np
import pytest
from mocap.filters.anatomy import Anatomy
from mocap.filters.bones import relative_size, size_factor, sized_like
from mocap.filters.models.base import TrialSet

from tests.filters.test_anatomy import walker


@pytest.mark.parametrize("factor", [0.7, 0.9, 1.1, 1.4])
def test_a_scaled_animal_is_brought_to_size(factor):
    """The factor is found within 2 %, from other motion of the same build, with gaps; bones then have one length."""
    small, large = walker(1), walker(2)
    hidden = np.random.default_rng(0).random(large.xyz_m.shape[:2]) < 0.3
    large = replace(large, xyz_m=factor * np.where(hidden[..., None], np.nan, large.xyz_m), sd_m=factor * large.sd_m)
    log_ratio, error = relative_size(large, small)
    assert log_ratio == pytest.approx(np.log(factor), abs=0.02)
    assert error < 0.03
    back = TrialSet([small, large], Anatomy((0, 1, 2, 3))).trials[0]
    thigh = [np.linalg.norm(t.xyz_m[:, 4] - t.xyz_m[:, 5], axis=-1) for t in (back, large)]
    assert np.nanmean(thigh[0]) == pytest.approx(np.nanmean(thigh[1]), rel=0.02)
    np.testing.assert_allclose(back.sd_m / small.sd_m, back.xyz_m[0, 0, 0] / small.xyz_m[0, 0, 0])


def test_the_same_animal_is_left_as_it_is():
    """Other motion of the same size, and animals of which too little is seen, are not scaled."""
    one, other = walker(1), walker(2)
    assert sized_like([one], other)[0] is one
    dark = replace(other, xyz_m=np.where(np.arange(240)[:, None, None] < 5, other.xyz_m, np.nan))
    assert relative_size(dark, one) == (0.0, np.inf)
    assert sized_like([one], dark)[0] is one


def test_the_factor_is_told():
    """What a report says of a scaled trial is what it was multiplied by; of one of the same size exactly 1."""
    small, large = walker(1), walker(2)
    large = replace(large, xyz_m=1.3 * large.xyz_m, sd_m=1.3 * large.sd_m)
    factor = size_factor(small, large)
    assert factor == pytest.approx(1.3, rel=0.02)
    np.testing.assert_array_equal(sized_like([small], large)[0].xyz_m, factor * small.xyz_m)
    assert size_factor(walker(1), walker(2)) == 1.0
