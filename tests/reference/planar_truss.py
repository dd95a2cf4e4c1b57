"""Trusses the slow and obvious way: one member after another, with NumPy, and SciPy's own minimiser."""

import numpy as np
from scipy.optimize import minimize


def w(law, s):
    """Energy of a unit of stiffness and rest length, written out again from the docstrings."""
    e = s - 1
    return {
        "linear": e**2 / 2,
        "neo_hookean": (s**2 + 2 / s - 3) / 6,
        "cable": e**2 / 2 if e > 0 else 0.0,
        "strut": e**2 / 2 if e < 0 else 0.0,
    }[law]


def energy(truss, q, x):
    """Energy in J with the moving point at q and the internal nodes at x."""
    nodes = [*truss.fixed_m, q, *np.reshape(x, (-1, truss.dimension))]
    total = 0.0
    for (a, b), rest, stiffness, law in zip(truss.ends, truss.rest_m, truss.stiffness_n_m, truss.laws, strict=True):
        total += stiffness * rest**2 * w(law, np.linalg.norm(nodes[b] - nodes[a]) / rest)
    return total


def settled(truss, q, start):
    """The minimum over the internal nodes next to a start, by Nelder and Mead's simplex: no derivatives."""
    options = {"xatol": 1e-11, "fatol": 1e-16, "maxiter": 20000, "maxfev": 20000}
    found = minimize(lambda x: energy(truss, q, x), np.ravel(start), method="Nelder-Mead", options=options)
    return found.x.reshape(-1, truss.dimension), found.fun
