"""Empirical-analytical Lagrangian models: potentials learned from samples, and mechanics (of eal-mocap)."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from eal.autodiff import system_from_energies
    from eal.choice import Choice, choose
    from eal.comparison import Comparison, compare
    from eal.composite import CoordinateKernel, LinearKernel, ProductKernel, SumKernel
    from eal.constraints import constrained_acceleration
    from eal.integrators import integrate_adaptive, simulate
    from eal.kernels import GaussianKernel, Kernel, LaplaceKernel, Matern32Kernel, Matern52Kernel
    from eal.lagrangian import LagrangianSystem, PenalisedModel
    from eal.potential import EmpiricalPotential, fit_potential, load_potential, usual_kernel
    from eal.rotations import RotationKernel
    from eal.spectral import Projection, SpectralFilter, Tail, Tikhonov

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
    "simulate",
    "system_from_energies",
    "usual_kernel",
]

_PLACES = {
    "Choice": "eal.choice",
    "Comparison": "eal.comparison",
    "CoordinateKernel": "eal.composite",
    "EmpiricalPotential": "eal.potential",
    "GaussianKernel": "eal.kernels",
    "Kernel": "eal.kernels",
    "LagrangianSystem": "eal.lagrangian",
    "LaplaceKernel": "eal.kernels",
    "LinearKernel": "eal.composite",
    "Matern32Kernel": "eal.kernels",
    "Matern52Kernel": "eal.kernels",
    "PenalisedModel": "eal.lagrangian",
    "ProductKernel": "eal.composite",
    "Projection": "eal.spectral",
    "RotationKernel": "eal.rotations",
    "SpectralFilter": "eal.spectral",
    "SumKernel": "eal.composite",
    "Tail": "eal.spectral",
    "Tikhonov": "eal.spectral",
    "choose": "eal.choice",
    "compare": "eal.comparison",
    "constrained_acceleration": "eal.constraints",
    "fit_potential": "eal.potential",
    "integrate_adaptive": "eal.integrators",
    "load_potential": "eal.potential",
    "simulate": "eal.integrators",
    "system_from_energies": "eal.autodiff",
    "usual_kernel": "eal.potential",
}


def __getattr__(name: str) -> Any:
    """A public name, imported when it is first asked for."""
    if name not in _PLACES:
        raise AttributeError(f"module 'eal' has no attribute {name!r}")
    found = globals()[name] = getattr(import_module(_PLACES[name]), name)
    return found
