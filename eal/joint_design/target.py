"""What a joint's energy should be: a normalised potential on a grid round the region where the joint may go."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from eal.arrays import Array
from eal.joint_design.laws import DesignError, Mask

Value = Callable[[Array], Array]


@dataclass(frozen=True, eq=False, kw_only=True)
class Target:
    """A normalised potential V on a regular grid, in units of one length.

    Attributes:
        q: (n, d) points of the grid.
        v: (n,) V.
        level: The region is where V < level; outside, the energy must be above it.
        axes: d coordinates of the grid's lines; ``q`` runs through them in the order of ``numpy.meshgrid(..., ij)``.
    """

    q: Array
    v: Array
    level: float
    axes: tuple[Array, ...]

    @property
    def inside(self) -> Mask:
        """(n,) whether V < level."""
        return self.v < self.level

    @property
    def shape(self) -> tuple[int, ...]:
        """Lines of the grid by axis."""
        return tuple(len(axis) for axis in self.axes)


def make_target(
    value: Value, samples: Array, *, level: float = 0.9, points: int = 1600, margin: float = 0.25
) -> Target:
    """The potential on a grid over its region below a level, with a margin as in the paper's figure 7.

    Args:
        value: V: (..., d) to (...).
        samples: (N, d) positions in the region; it is looked for round them, ever wider.
        level: Edge of the region.
        points: About how many points the grid has.
        margin: On each side, as a share of the region's largest extent.

    Raises:
        DesignError: level is not in (0, 1), or V stays below it however wide the grid.
    """
    if not 0.0 < level < 1.0:
        raise DesignError(f"level must be between 0 and 1, where V is normalised, but is {level:g}")
    low, high = samples.min(axis=0), samples.max(axis=0)
    extent = float((high - low).max())
    if not extent > 0.0:
        raise DesignError("all samples lie on one point: there is no motion to design a joint for")
    reach = 0.4 * extent
    for _ in range(4):
        wide = _grid(value, low - reach, high + reach, level, points)
        edge = np.zeros(wide.shape, dtype=bool)
        for axis in range(edge.ndim):
            np.moveaxis(edge, axis, 0)[[0, -1]] = True
        if wide.v[edge.reshape(-1)].min() >= level and wide.inside.any():
            low, high = wide.q[wide.inside].min(axis=0), wide.q[wide.inside].max(axis=0)
            around = margin * float((high - low).max()) + wide.axes[0][1] - wide.axes[0][0]
            return _grid(value, low - around, high + around, level, points)
        reach *= 2.0
    raise DesignError(
        f"V stays below {level:g} at {reach / (2 * extent):g} times the samples' extent, or is nowhere below it: there "
        "is no edge to design to; give another level"
    )


def _grid(value: Value, low: Array, high: Array, level: float, points: int) -> Target:
    spacing = float((np.prod(high - low) / points) ** (1.0 / len(low)))
    axes = tuple(np.linspace(a, b, max(round((b - a) / spacing) + 1, 4)) for a, b in zip(low, high, strict=True))
    q = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(low))
    return Target(q=q, v=np.asarray(value(q), dtype=np.float64), level=level, axes=axes)
