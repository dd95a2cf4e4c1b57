"""How many independent samples a run along a trajectory is worth."""

import numpy as np

from eal.arrays import Array
from eal.kernels import Kernel


def effective_sample_size(samples: Array, kernel: Kernel, *, most: int = 2000) -> float:
    """N / (1 + 2 sum of the correlations of K_z (x) K_z over lags), for samples in the order of time.

    The variance of T_z is (1/N) sum over lags of c_l = E K(z_t, z_(t+l))^2 - |T|^2; the sum stops at the first lag
    whose pair with the next is negative (Geyer 1992). At most N: anticorrelation is not counted on.

    Args:
        samples: (N, d) samples.
        kernel: The kernel.
        most: Longest run used; longer ones are cut.

    Returns:
        The size, between 1 and N.
    """
    z = np.asarray(samples, dtype=np.float64)[:most]
    n = len(z)
    squared = kernel.gram(z, z) ** 2
    norm2 = float(squared.mean())
    lags = np.array([np.mean(np.diagonal(squared, lag)) for lag in range(n // 2)]) - norm2
    if lags[0] <= 0.0:
        return 1.0
    total, lag = 0.0, 1
    while lag + 1 < len(lags) and lags[lag] + lags[lag + 1] > 0.0:
        total += lags[lag] + lags[lag + 1]
        lag += 2
    return float(np.clip(len(samples) / (1.0 + 2.0 * total / lags[0]), 1.0, len(samples)))
