"""The potential of a joint in three dimensions, on a grid round its samples."""

from dataclasses import dataclass

import numpy as np

from eal.arrays import Array
from mocap.pipeline.potentials import JointPotential
from mocap.records import JointTracks
from mocap.rerun.landscape import MM_PER_M

GRID = 20
_MARGIN = 0.2


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


def block(joint: JointPotential, tracks: JointTracks) -> Block:
    """Sample the potential of a joint round its samples; ``GRID`` cubes along the longest edge.

    Args:
        joint: A potential of three coordinates, and its samples.
        tracks: Joint tracks in its frame of reference.
    """
    low, high = joint.samples_m.min(axis=0), joint.samples_m.max(axis=0)
    size = float((high - low).max()) * (1 + 2 * _MARGIN)
    cell = max(size, 1e-4) / GRID
    n = np.ceil((high - low) / cell + 2 * _MARGIN * GRID / (1 + 2 * _MARGIN)).astype(int)
    corner = (low + high) / 2 - 0.5 * cell * n
    x, y, z = (corner[k] + cell * (np.arange(n[k]) + 0.5) for k in range(3))
    points = np.stack(np.meshgrid(z, y, x, indexing="ij")[::-1], axis=-1)
    value = np.asarray(joint.potential.value(points.reshape(-1, 3) / joint.scale_m)).reshape(n[::-1])
    return Block(
        corner_mm=corner * MM_PER_M,
        cell_mm=cell * MM_PER_M,
        value=value,
        samples_mm=joint.samples_m * MM_PER_M,
        path_mm=tracks.q_m[:, tracks.names.index(joint.joint)] * MM_PER_M,
    )
