"""Axial energy of a truss member under large displacement, each law under its formula.

The energy of a member of rest length L and stiffness k is k L^2 w(s), s = l / L its stretch. Every law has w(1) = 0,
w'(1) = 0 and w''(1) = 1 (of a cable and a strut on the side where they hold), so that k is the axial stiffness
E A / L at rest, in N/m.
"""

from collections.abc import Sequence
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from eal.optional_jax import jax, jnp

Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]

Law = Literal["linear", "neo_hookean", "cable", "strut", "tape"]
LAWS: tuple[str, ...] = get_args(Law)
"""In the order of the codes of ``law_codes``."""


class DesignError(ValueError):
    """A joint cannot be designed as asked; the message names the limit that binds."""


TAPE_STRAIN = 0.15
"""Strain at which a tape spring's force peaks."""


def linear(s: Any) -> Any:
    """W = (s - 1)^2 / 2: Hooke's law for the engineering strain, at any rotation."""
    return 0.5 * (s - 1.0) ** 2


def neo_hookean(s: Any) -> Any:
    """W = (s^2 + 2/s - 3) / 6: an incompressible neo-Hookean bar pulled along its axis, mu = E / 3.

    Holzapfel, Nonlinear Solid Mechanics (2000), section 6.5; compression to nothing costs infinite energy.
    """
    return (s * s + 2.0 / s - 3.0) / 6.0


def cable(s: Any) -> Any:
    """W = max(s - 1, 0)^2 / 2: linear when taut, nothing when slack."""
    return 0.5 * jnp.maximum(s - 1.0, 0.0) ** 2


def strut(s: Any) -> Any:
    """W = min(s - 1, 0)^2 / 2: linear when pushed together, nothing when apart."""
    return 0.5 * jnp.minimum(s - 1.0, 0.0) ** 2


def tape(s: Any) -> Any:
    """A member like a tape spring: stiff at first, then its force falls from a peak to a plateau, both ways.

    With e = s - 1, c the strain of the peak and p the share of the plateau,
    w = (1 - p) c^2 (1 - exp(-e^2 / 2 c^2)) + p c^2 (sqrt(1 + e^2 / c^2) - 1): the moment and rotation of a tape
    spring (Seffen and Pellegrino 1999) have this shape; it is not their formula.
    """
    c2 = TAPE_STRAIN**2
    e2 = (s - 1.0) ** 2
    peak = c2 * (1.0 - jnp.exp(-e2 / (2.0 * c2)))
    plateau = c2 * (jnp.sqrt(1.0 + e2 / c2) - 1.0)
    return (1.0 - 0.3) * peak + 0.3 * plateau  # a part of the force does not fall again


def pushes(laws: Sequence[Law]) -> Mask:
    """(m,) whether members resist being shortened."""
    return np.array([law != "cable" for law in laws], dtype=bool)


def pulls(laws: Sequence[Law]) -> Mask:
    """(m,) whether members resist being stretched."""
    return np.array([law != "strut" for law in laws], dtype=bool)


def member_energy(s: Any, code: Any) -> Any:
    """W of stretches s by the codes of their laws (``law_codes``); both (...)."""
    return jnp.select([code == i for i in range(len(LAWS))], [linear(s), neo_hookean(s), cable(s), strut(s), tape(s)])


def energy_and_slope(stretch: Array, laws: Sequence[Law]) -> tuple[Array, Array]:
    """W and dw/ds of (..., m) stretches by the laws of m members; both (..., m).

    Raises:
        DesignError: a law has no such name.
    """
    flat = np.asarray(stretch, dtype=np.float64).ravel()
    codes = np.broadcast_to(law_codes(tuple(laws)), stretch.shape).ravel()
    more = (1 << max(len(flat) - 1, 0).bit_length()) - len(flat)
    with jax.enable_x64(True):
        both = _energy_and_slope(np.append(flat, np.ones(more)), np.append(codes, np.zeros(more)))
        w, slope = (np.asarray(part)[: len(flat)].reshape(stretch.shape) for part in both)
    return w, slope


_energy_and_slope = jax.jit(jax.vmap(jax.value_and_grad(member_energy)))


def law_codes(laws: tuple[Law, ...]) -> Array:
    """(m,) codes of member laws.

    Raises:
        DesignError: a law has no such name.
    """
    for law in laws:
        if law not in LAWS:
            raise DesignError(f"a member's law must be one of {', '.join(LAWS)}, but is {law!r}")
    return np.array([LAWS.index(law) for law in laws], dtype=np.float64)
