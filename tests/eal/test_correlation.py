"""The effective number of samples along a trajectory."""

import numpy as np
import pytest

from eal import GaussianKernel
from eal.radius import effective_sample_size


def test_independent_samples_are_all_effective_and_repeated_ones_are_not(rng):
    """White samples: nearly N. Each sample held for 10: N/10 (correlation 1 - l/10 over lags l < 10 sums to 4.5)."""
    angle = rng.uniform(0, 2 * np.pi, 1000)
    z = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    assert effective_sample_size(z, GaussianKernel(1.0)) > 600
    held = np.repeat(z[:200], 10, axis=0)
    assert effective_sample_size(held, GaussianKernel(1.0)) == pytest.approx(200, rel=0.35)
