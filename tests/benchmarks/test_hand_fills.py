"""Gaps that people filled by hand, beside ours and splines'."""

import numpy as np

from benchmarks.hand_fills import table


def test_recordings_are_pooled_and_samples_without_a_fill_are_left_out():
    """Of two recordings: the median, RMS and largest of 3 and 4 mm; what a spline leaves empty does not count."""
    first = {"this program": np.array([3.0]), "cubic spline": np.array([5.0])}
    second = {"this program": np.array([4.0]), "cubic spline": np.array([np.nan])}
    ours, spline = (line.split()[2:] for line in table([first, second]).splitlines()[1:])
    assert ours == ["2", "3.50", "3.90", f"{12.5**0.5:.2f}", "4.00"]
    assert spline[:2] == ["1", "5.00"]
