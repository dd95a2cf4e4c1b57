"""The potential of a joint over its plane and in space, on grids round its samples; its energy (Theorem 3)."""

from dataclasses import dataclass

import numpy as np
from contourpy import contour_generator
from scipy.ndimage import map_coordinates

from eal.arrays import Array
from eal.bounds import theorem3
from mocap.tracking.joint_map import JointMap
from mocap.tracking.potentials import JointPotential

GRID, CUBES = 80, 20
"""Points along an edge of a grid over the plane, cubes along the longest edge of one in space."""
STIFFNESS = 20.0
"""1/eps^2 in units of the greatest kinetic energy: that motion alone could raise V by a twentieth."""
_MARGIN = 0.2  # about the joint's range, as a share of it; chosen
MM_PER_M = 1000.0  # the unit of these views


@dataclass(frozen=True, eq=False, kw_only=True)
class JointEnergy:
    """Energy of a joint as a free mass of 1 kg in its plane, held by V_z/eps^2, and how far it could leave the data.

    Attributes:
        strength: 1/eps^2 in J/kg; 0 where the joint is never known in two frames on end.
        kinetic: (T,) |dq/dt|^2 / 2 in J/kg; NaN where unknown.
        potential: (T,) V_z(q) / eps^2 in J/kg.
        bound: (T,) what V_z stays below if the joint is let go where it is fastest: Theorem 3. Where the recorded V_z
            is above it, no free joint of the recorded energy would be.
    """

    strength: float
    kinetic: Array
    potential: Array
    bound: Array


def joint_energy(t_s: Array, path_mm: Array, value: Array) -> JointEnergy:
    """Energy along a path.

    Args:
        t_s: (T,) times.
        path_mm: (T, d) the joint over time; NaN where unknown.
        value: (T,) V_z there.
    """
    speed = np.gradient(path_mm, t_s, axis=0) if len(t_s) > 1 else np.full_like(path_mm, np.nan)
    kinetic = 0.5 * np.square(speed).sum(axis=1) / MM_PER_M**2
    finite = np.flatnonzero(np.isfinite(kinetic) & np.isfinite(value))
    bound, strength = np.full(len(t_s), np.nan), 0.0
    if len(finite):
        fastest = finite[np.argmax(kinetic[finite])]
        strength = STIFFNESS * float(kinetic[fastest])
    if strength > 0:
        bound[:] = theorem3(
            strength, value0=value[fastest], kinetic0=float(kinetic[fastest]), potential0=0.0, potential_min=0.0
        )
    return JointEnergy(strength=strength, kinetic=kinetic, potential=strength * value, bound=bound)


@dataclass(frozen=True, eq=False, kw_only=True)
class Landscape:
    """A potential on a square grid.

    Attributes:
        x_mm: (G,) first coordinate of the grid's points.
        y_mm: (G,) second coordinate; same spacing.
        value: (G, G) potential at (y, x), between 0 and 1.
        height_mm: How high 1 is drawn.
        samples_mm: (N, 2) samples that the potential was learned from.
        samples_value: (N,) potential at these.
        path_mm: (T, 2) the joint over time; NaN where unknown.
        path_value: (T,) potential along the path; NaN where unknown.
        energy: Energy along the path.
        eigenvalues: (r,) of the operator T_z of the samples, decreasing.
        lam: The lambda below which they are filtered.
        effective_rank: Number of functions that the filter leaves.
        map: What a person sees of it.
    """

    x_mm: Array
    y_mm: Array
    value: Array
    height_mm: float
    samples_mm: Array
    samples_value: Array
    path_mm: Array
    path_value: Array
    energy: JointEnergy
    eigenvalues: Array
    lam: float
    effective_rank: float
    map: JointMap

    @property
    def cell_mm(self) -> float:
        """Distance between neighbours on the grid."""
        return float(self.x_mm[1] - self.x_mm[0])

    def lifted(self, xy_mm: Array) -> Array:
        """(..., 3) points on the surface, a little above it, over (..., 2) points of the plane."""
        rows = (xy_mm[..., 1] - self.y_mm[0]) / self.cell_mm
        columns = (xy_mm[..., 0] - self.x_mm[0]) / self.cell_mm
        value = map_coordinates(self.value, [rows, columns], order=1, mode="nearest")
        height = np.where(np.isfinite(rows + columns), value + 0.015, np.nan) * self.height_mm
        return np.concatenate([xy_mm, height[..., None]], axis=-1)

    def contour_mm(self, level: float) -> list[Array]:
        """Lines (n, 2) on which the potential has a value."""
        lines = contour_generator(self.x_mm, self.y_mm, self.value).lines(level)
        return [np.asarray(line, dtype=np.float64) for line in lines]


def landscape(joint: JointPotential, t_s: Array, path_m: Array) -> Landscape:
    """Sample the potential of a joint round its samples.

    Args:
        joint: The potential and its samples.
        t_s: (T,) times.
        path_m: (T, d) the joint in the potential's frame of reference; the first two coordinates are taken.
    """
    path_m = path_m[:, :2]
    finite = np.isfinite(path_m).all(axis=1)
    points = joint.samples_m[np.isfinite(joint.samples_m).all(axis=1)]
    low, high = (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(2), np.zeros(2))
    half = max(float((high - low).max()) * (0.5 + _MARGIN), 1e-4)
    x_m, y_m = ((low + high)[:, None] / 2 + np.linspace(-half, half, GRID)).reshape(2, GRID)
    grid_m = np.stack(np.meshgrid(x_m, y_m), axis=-1)
    value = np.asarray(joint.potential.value(grid_m.reshape(-1, 2) / joint.scale_m)).reshape(GRID, GRID)
    path_value = np.full(len(path_m), np.nan)
    if finite.any():
        path_value[finite] = joint.potential.value(path_m[finite] / joint.scale_m)
    return Landscape(
        x_mm=x_m * MM_PER_M,
        y_mm=y_m * MM_PER_M,
        value=value,
        height_mm=0.8 * half * MM_PER_M,
        samples_mm=joint.samples_m * MM_PER_M,
        samples_value=np.asarray(joint.potential.value(joint.samples_m / joint.scale_m)),
        path_mm=path_m * MM_PER_M,
        path_value=path_value,
        energy=joint_energy(t_s, path_m * MM_PER_M, path_value),
        eigenvalues=joint.potential.eigenvalues,
        lam=joint.potential.sigma_lambda,
        effective_rank=joint.potential.effective_rank,
        map=joint.map,
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Block:
    """A potential on a grid of cubes.

    Attributes:
        corner_mm: (3,) corner of the first cube.
        cell_mm: Edge of a cube.
        value: (nz, ny, nx) potential in the middle of each cube.
        samples_mm: (N, 3) samples that the potential was learned from.
        path_mm: (T, 3) the joint over time; NaN where unknown.
    """

    corner_mm: Array
    cell_mm: float
    value: Array
    samples_mm: Array
    path_mm: Array

    @property
    def centre_mm(self) -> Array:
        """(3,) middle of the grid."""
        return self.corner_mm + 0.5 * self.cell_mm * np.array(self.value.shape[::-1])

    @property
    def extent_mm(self) -> float:
        """Longest edge of the grid."""
        return self.cell_mm * max(self.value.shape)


def block(joint: JointPotential, path_m: Array) -> Block:
    """Sample the potential of a joint that moved along (T, 3) round its samples; ``CUBES`` along the longest edge."""
    low, high = joint.samples_m.min(axis=0), joint.samples_m.max(axis=0)
    size = float((high - low).max()) * (1 + 2 * _MARGIN)
    cell = max(size, 1e-4) / CUBES
    n = np.ceil((high - low) / cell + 2 * _MARGIN * CUBES / (1 + 2 * _MARGIN)).astype(int)
    corner = (low + high) / 2 - 0.5 * cell * n
    x, y, z = (corner[k] + cell * (np.arange(n[k]) + 0.5) for k in range(3))
    points = np.stack(np.meshgrid(z, y, x, indexing="ij")[::-1], axis=-1)
    value = np.asarray(joint.potential.value(points.reshape(-1, 3) / joint.scale_m)).reshape(n[::-1])
    return Block(
        corner_mm=corner * MM_PER_M,
        cell_mm=cell * MM_PER_M,
        value=value,
        samples_mm=joint.samples_m * MM_PER_M,
        path_mm=path_m * MM_PER_M,
    )
