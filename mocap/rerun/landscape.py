"""The potential of a joint over the part of its plane where the joint was."""

from dataclasses import dataclass

import numpy as np
from contourpy import contour_generator
from scipy.ndimage import map_coordinates

from eal.arrays import Array
from mocap.pipeline.potentials import JointPotential
from mocap.records import JointTracks
from mocap.rerun.energy import JointEnergy, joint_energy

GRID = 80
_MARGIN = 0.2
MM_PER_M = 1000.0
RANGE = 0.5
"""The value of the potential at the edge of a joint's range."""


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

    @property
    def preferred(self) -> float:
        """The level below which half of the samples lie: preferred configurations, as in Figs 7 and 8 of the paper."""
        return float(np.median(self.samples_value))

    def contour_mm(self, level: float) -> list[Array]:
        """Lines (n, 2) on which the potential has a value."""
        lines = contour_generator(self.x_mm, self.y_mm, self.value).lines(level)
        return [np.asarray(line, dtype=np.float64) for line in lines]


def landscape(joint: JointPotential, tracks: JointTracks) -> Landscape:
    """Sample the potential of a joint round its samples.

    Args:
        joint: The potential and its samples.
        tracks: Joint tracks in the potential's frame of reference; their first two coordinates are taken.

    Raises:
        ValueError: the tracks are of another frame or lack the joint.
    """
    if tracks.frame != joint.frame or joint.joint not in tracks.names:
        raise ValueError(
            f"the potential of joint {joint.joint!r} is in frame {joint.frame!r}, but the joint tracks are in frame "
            f"{tracks.frame!r} and have {', '.join(tracks.names) or 'no joints'}"
        )
    path_m = tracks.q_m[:, tracks.names.index(joint.joint), :2]
    known = np.isfinite(path_m).all(axis=1)
    points = joint.samples_m[np.isfinite(joint.samples_m).all(axis=1)]
    low, high = (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(2), np.zeros(2))
    half = max(float((high - low).max()) * (0.5 + _MARGIN), 1e-4)
    x_m, y_m = ((low + high)[:, None] / 2 + np.linspace(-half, half, GRID)).reshape(2, GRID)
    grid_m = np.stack(np.meshgrid(x_m, y_m), axis=-1)
    value = np.asarray(joint.potential.value(grid_m.reshape(-1, 2) / joint.scale_m)).reshape(GRID, GRID)
    path_value = np.full(len(path_m), np.nan)
    if known.any():
        path_value[known] = joint.potential.value(path_m[known] / joint.scale_m)
    return Landscape(
        x_mm=x_m * MM_PER_M,
        y_mm=y_m * MM_PER_M,
        value=value,
        height_mm=0.8 * half * MM_PER_M,
        samples_mm=joint.samples_m * MM_PER_M,
        samples_value=np.asarray(joint.potential.value(joint.samples_m / joint.scale_m)),
        path_mm=path_m * MM_PER_M,
        path_value=path_value,
        energy=joint_energy(tracks.t_s, path_m * MM_PER_M, path_value),
        eigenvalues=joint.potential.eigenvalues,
        lam=joint.potential.sigma_lambda,
        effective_rank=joint.potential.effective_rank,
    )
