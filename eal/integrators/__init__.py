"""Integrators: one step each, in its own file; ``run.integrate`` repeats it, over any batch at once."""

from eal.integrators.adaptive import integrate_adaptive
from eal.integrators.integrate import Trajectory, integrate, simulate
from eal.integrators.midpoint import IntegrationError, midpoint_step
from eal.integrators.rattle import rattle_step
from eal.integrators.rk4 import rk4_step
from eal.integrators.stability import StabilityError, largest_strength
from eal.integrators.verlet import verlet_step

__all__ = [
    "IntegrationError",
    "StabilityError",
    "Trajectory",
    "integrate",
    "integrate_adaptive",
    "largest_strength",
    "midpoint_step",
    "rattle_step",
    "rk4_step",
    "simulate",
    "verlet_step",
]
