"""Empirical-analytical Lagrangian models: potentials learned from samples, and mechanics (of eal-mocap)."""

from eal.composite import CoordinateKernel, ProductKernel, SumKernel
from eal.kernels import GaussianKernel, Kernel, LaplaceKernel, Matern32Kernel, Matern52Kernel
from eal.potential import EmpiricalPotential, fit_potential, load_potential, usual_kernel
from eal.spectral import Projection, SpectralFilter, Tail, Tikhonov

__all__ = [
    "CoordinateKernel",
    "EmpiricalPotential",
    "GaussianKernel",
    "Kernel",
    "LaplaceKernel",
    "Matern32Kernel",
    "Matern52Kernel",
    "ProductKernel",
    "Projection",
    "SpectralFilter",
    "SumKernel",
    "Tail",
    "Tikhonov",
    "fit_potential",
    "load_potential",
    "usual_kernel",
]
