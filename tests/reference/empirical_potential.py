"""The empirical potential by the letter: loops, the full eigendecomposition, extended precision. Slow on purpose."""

import math

import numpy as np


def kernel_value(name, beta, x, y):
    """K(x, y) of one pair, from its textbook formula."""
    r = math.sqrt(sum((a - b) ** 2 for a, b in zip(x, y, strict=True)))
    return {
        "GaussianKernel": lambda: math.exp(-beta * r * r),
        "LaplaceKernel": lambda: math.exp(-beta * r),
        "Matern32Kernel": lambda: (1 + beta * r) * math.exp(-beta * r),
        "Matern52Kernel": lambda: (1 + beta * r + (beta * r) ** 2 / 3) * math.exp(-beta * r),
    }[name]()


def gain(name, sigma, lam):
    """g_lambda(sigma) of one eigenvalue."""
    if name == "tail":
        return 1 / sigma if sigma >= lam else 1 / lam
    if name == "projection":
        return 1 / sigma if sigma > lam else 0.0
    return 1 / (max(sigma, 0.0) + lam)


def potential(samples, queries, *, kernel, beta, lam, filter_name="tail"):
    """V_z = 1 - (1/N) k^T U diag(g(s/N)) U^T k, equations 12, 14, 29 and 30, one query at a time."""
    n = len(samples)
    gram = [[kernel_value(kernel, beta, x, y) for y in samples] for x in samples]
    s, vectors = np.linalg.eigh(np.array(gram))
    values = []
    for q in queries:
        k = np.array([kernel_value(kernel, beta, z, q) for z in samples])
        total = 0.0
        for i in range(n):
            total += gain(filter_name, s[i] / n, lam) * float(vectors[:, i] @ k) ** 2 / n
        values.append(1.0 - total)
    return np.array(values)


def gaussian_barrier(centres, root, beta, q):
    """-log |B^T k(q)|^2 of one query in extended precision, whose exponent reaches 1e-4932."""
    z, b, x = (np.asarray(a, dtype=np.longdouble) for a in (centres, root, q))
    k = np.exp(-np.longdouble(beta) * ((x - z) ** 2).sum(axis=1))
    return float(-np.log(((k @ b) ** 2).sum()))
