"""V = 1 - |B^T k(q)|^2 and -log(1 - V), with gradients and Hessians, over a batch of configurations.

B (m, r) and the centres z (m, d) come from ``eal.fitting``; k(q) = (K(q, z_1), ..., K(q, z_m)). With the weights
w_i = (B B^T k)_i k_i and g_i = grad log K_i the gradient of |B^T k|^2 is 2 sum_i w_i g_i, and half of its Hessian is
P^T P + sum_i w_i (hess log K_i + g_i g_i^T) with P = B^T diag(k) g.
"""

from collections.abc import Callable

import numpy as np

from eal.arrays import Array
from eal.kernels import Kernel


def value(kernel: Kernel, centres: Array, root: Array, q: Array) -> Array:
    """V at (n, d) configurations: (n,). Rounding below 0 is cut."""
    a = kernel.gram(q, centres) @ root
    return np.maximum(1.0 - np.einsum("nr,nr->n", a, a), 0.0)


def gradient(kernel: Kernel, centres: Array, root: Array, q: Array) -> Array:
    """Gradient of V at (n, d) configurations: (n, d)."""
    k = kernel.gram(q, centres)
    w = ((k @ root) @ root.T) * k
    w *= -2.0
    return kernel.weighted_gradient(q, centres, w)


def hessian(kernel: Kernel, centres: Array, root: Array, q: Array) -> Array:
    """Hessian of V at (n, d) configurations: (n, d, d)."""
    k = kernel.gram(q, centres)
    return -2.0 * _half_hessian(kernel, centres, root, q, k, k @ root, np.zeros_like(q))


def barrier_value(kernel: Kernel, centres: Array, root: Array, q: Array) -> Array:
    """-log(1 - V) at (n, d) configurations: (n,), finite at any distance from the samples."""
    k, top = _scaled(kernel, centres, q)
    a = k @ root
    return np.maximum(-2.0 * top - np.log(np.einsum("nr,nr->n", a, a)), 0.0)


def barrier_gradient(kernel: Kernel, centres: Array, square: Array, q: Array) -> Array:
    """Gradient of -log(1 - V): (n, d), from B B^T (m, m). The common factor exp(2 top) cancels."""
    k, _ = _scaled(kernel, centres, q)
    w = (k @ square) * k
    w *= (-2.0 / w.sum(axis=1))[:, None]
    return kernel.weighted_gradient(q, centres, w)


def barrier_hessian(kernel: Kernel, centres: Array, root: Array, q: Array) -> Array:
    """Hessian of -log(1 - V): (n, d, d).

    1 - V times exp(-2 c.q), c half the gradient of log(1 - V), has the same Hessian of its logarithm and no gradient
    at q: with g_i - c for g_i nothing large cancels.
    """
    k, _ = _scaled(kernel, centres, q)
    a = k @ root
    total = np.einsum("nr,nr->n", a, a)
    shift = kernel.weighted_gradient(q, centres, (a @ root.T) * k / total[:, None])
    return (-2.0 / total)[:, None, None] * _half_hessian(kernel, centres, root, q, k, a, shift)


def in_blocks(function: Callable[[Array], Array], q: Array, width: int) -> Array:
    """``function`` on (..., d) configurations, a bounded number at a time.

    Args:
        function: (n, d) to (n, ...).
        q: (..., d) configurations.
        width: Numbers that the function holds for one configuration.

    Returns:
        (..., ...) the values, leading axes as in ``q``.
    """
    flat = q.reshape(-1, q.shape[-1])
    size = max(1, (1 << 22) // width)  # 32 MiB of kernel values
    if len(flat) <= size:
        result = function(flat)
    else:
        result = np.concatenate([function(flat[i : i + size]) for i in range(0, len(flat), size)])
    return result.reshape(q.shape[:-1] + result.shape[1:])


def _scaled(kernel: Kernel, centres: Array, q: Array) -> tuple[Array, Array]:
    """K / exp(top) (n, m) and top = max_i log K_i (n,)."""
    logs = kernel.log_gram(q, centres)
    top = logs.max(axis=1)
    logs -= top[:, None]
    return np.exp(logs, out=logs), top


def _half_hessian(kernel: Kernel, centres: Array, root: Array, q: Array, k: Array, a: Array, shift: Array) -> Array:
    """Half of the Hessian of |B^T k|^2 exp(-2 shift.q) over exp(-2 shift.q): (n, d, d); k (n, m), a = B^T k (n, r)."""
    n, d = q.shape
    slopes = kernel.log_gradients(q, centres) - shift[:, None, :]
    w = (a @ root.T) * k
    p = ((slopes * k[:, :, None]).transpose(0, 2, 1).reshape(n * d, -1) @ root).reshape(n, d, -1)
    outer = (slopes * w[:, :, None]).transpose(0, 2, 1) @ slopes
    return p @ p.transpose(0, 2, 1) + outer + kernel.weighted_curvature(q, centres, w)
