"""The uniform distribution on the unit circle under the Gaussian kernel: everything in closed form.

The anchor of ``docs/paper/errata.md`` and of the tests: eigenvalues, V_rho, V_j and |T_z - T_rho| without
sampling error.
"""

import numpy as np
from scipy.special import ive

from eal.arrays import Array
from eal.spectral import SpectralFilter

MODES = 60
"""Fourier modes kept; I_k(2 beta) is below 1e-16 of I_0 beyond, for beta up to 10."""


def eigenvalues(beta: float, count: int = MODES) -> Array:
    """lambda_k = exp(-2 beta) I_k(2 beta), k = 0, 1, 1, 2, 2, ...: ``count`` of them, decreasing."""
    order = (np.arange(count) + 1) // 2
    return ive(order, 2.0 * beta)


def value(radius: Array, beta: float, spectral_filter: SpectralFilter | None = None, lam: float = 0.0) -> Array:
    """V_rho, or V_j of a filter at lambda, at a distance from the centre.

    1 - sum_k r_k c_k^2 / lambda_k with c_k = exp(-beta (R^2 + 1)) I_k(2 beta R), counted twice for k >= 1; r_k = 1
    for V_rho, and the filter's response for V_j.

    Args:
        radius: (...) distances R.
        beta: Of the kernel.
        spectral_filter: None: V_rho.
        lam: lambda of the filter.

    Returns:
        (...) values.
    """
    radius = np.asarray(radius, dtype=np.float64)
    k = np.arange(MODES // 2)
    lambdas = ive(k, 2.0 * beta)
    c = np.exp(-beta * (radius[..., None] - 1.0) ** 2) * ive(k, 2.0 * beta * radius[..., None])
    response = np.ones_like(lambdas) if spectral_filter is None else spectral_filter.response(lambdas, lam)
    terms = np.where(k == 0, 1.0, 2.0) * response * c**2 / lambdas
    return 1.0 - terms.sum(axis=-1)


def operator_error(angles: Array, beta: float) -> float:
    """|T_z - T_rho|_HS of samples on the circle, exactly: (mean_ij K^2 - |T_rho|^2)^(1/2).

    Args:
        angles: (N,) angles of the samples.
        beta: Of the kernel.
    """
    k = np.arange(1, MODES)
    waves = np.exp(1j * k[:, None] * np.asarray(angles)).mean(axis=1)
    return float(np.sqrt(np.sum(2.0 * ive(k, 4.0 * beta) * np.abs(waves) ** 2)))
