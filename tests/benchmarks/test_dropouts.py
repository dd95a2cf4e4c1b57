"""The run of ``benchmarks.dropouts``, shorter."""

import pytest

from benchmarks.dropouts import run


@pytest.mark.parametrize(("n", "n_frames"), [(12, 2000), (60, 200)])
def test_dropouts_leave_a_covariance(n, n_frames):
    """Rows that come and go, dark stretches, precise rows and vague states: always a covariance, and an honest one.

    Of 20 x 12 components looked at 95 % lie inside 1.96 deviations, to three of the 1.4 % that chance allows were they
    independent, and three times that as neighbours in time and space are not.
    """
    out = run(n, n_frames, every=n_frames // 20)
    assert out.dark > 0
    assert out.least_pivot > 0
    assert out.least_eigenvalue > 0
    assert out.inside == pytest.approx(0.95, abs=0.13)
