"""Empirical-analytical Lagrangian models: potentials learned from samples, and mechanics (of eal-mocap).

Samples of configurations come in, as arrays. Potentials, Lagrangians, trajectories and the paper's bounds go out. It
touches a file only where a potential is saved or loaded.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from eal.autodiff import system_from_energies
    from eal.choice import Choice, choose
    from eal.comparison import Comparison, compare
    from eal.composite import CoordinateKernel, LinearKernel, ProductKernel, SumKernel
    from eal.integrators import integrate_adaptive, simulate
    from eal.kernels import GaussianKernel, Kernel, LaplaceKernel, Matern32Kernel, Matern52Kernel
    from eal.lagrangian import LagrangianSystem, PenalisedModel
    from eal.potential import EmpiricalPotential, fit_potential, load_potential, usual_kernel
    from eal.rotation_share import Mobility, mobility
    from eal.rotations import RotationKernel
    from eal.spectral import Projection, SpectralFilter, Tail, Tikhonov
    from eal.systems import constrained_acceleration

__all__ = [
    "Choice",
    "Comparison",
    "CoordinateKernel",
    "EmpiricalPotential",
    "GaussianKernel",
    "Kernel",
    "LagrangianSystem",
    "LaplaceKernel",
    "LinearKernel",
    "Matern32Kernel",
    "Matern52Kernel",
    "Mobility",
    "PenalisedModel",
    "ProductKernel",
    "Projection",
    "RotationKernel",
    "SpectralFilter",
    "SumKernel",
    "Tail",
    "Tikhonov",
    "choose",
    "compare",
    "constrained_acceleration",
    "fit_potential",
    "integrate_adaptive",
    "load_potential",
    "mobility",
    "simulate",
    "system_from_energies",
    "usual_kernel",
]

_NAMES = {
    "eal.autodiff": "system_from_energies",
    "eal.choice": "Choice choose",
    "eal.comparison": "Comparison compare",
    "eal.composite": "CoordinateKernel LinearKernel ProductKernel SumKernel",
    "eal.systems": "constrained_acceleration",
    "eal.integrators": "integrate_adaptive simulate",
    "eal.kernels": "GaussianKernel Kernel LaplaceKernel Matern32Kernel Matern52Kernel",
    "eal.lagrangian": "LagrangianSystem PenalisedModel",
    "eal.rotation_share": "Mobility mobility",
    "eal.potential": "EmpiricalPotential fit_potential load_potential usual_kernel",
    "eal.rotations": "RotationKernel",
    "eal.spectral": "Projection SpectralFilter Tail Tikhonov",
}
_PLACES = {name: place for place, names in _NAMES.items() for name in names.split()}


def __getattr__(name: str) -> Any:
    """A public name, imported when it is first asked for."""
    if name not in _PLACES:
        raise AttributeError(f"module 'eal' has no attribute {name!r}")
    found = globals()[name] = getattr(import_module(_PLACES[name]), name)
    return found
