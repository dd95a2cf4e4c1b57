"""What a joint's energy should be: a normalised potential on a grid round the region where the joint may go."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from eal.arrays import Array
from eal.joint_design.laws import DesignError, Law, Mask, pulls, pushes

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


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits of a design; lengths in one unit.

    Attributes:
        members: Most members.
        shortest: No member becomes shorter while the point is in the region: room for a spring and two pins.
        longest: No member becomes longer.
        reach: Fixed nodes lie within this distance of the joint.
        contraction: No member of a law that pushes becomes shorter than (1 - contraction) times its rest length.
        extension: No member of a law that pulls becomes longer than (1 + extension) times its rest length.
        spacing: Two fixed nodes are at least so far from each other.
        laws: What members may be.
        prestress: What storing energy everywhere costs: residual a square root of stored energy over normalised one.
    """

    members: int = 12
    shortest: float
    longest: float
    reach: float
    contraction: float = 0.5
    extension: float = 0.8
    spacing: float = 0.0
    laws: tuple[Law, ...] = ("linear", "cable", "strut")
    prestress: float = 0.02

    def __post_init__(self) -> None:
        """Check."""
        if self.members < 2:
            raise DesignError(f"a point in the plane is held by 2 members or more, but members is {self.members}")
        if not 0.0 < self.shortest < self.longest:
            raise DesignError(f"shortest ({self.shortest:g}) must be above 0 and below longest ({self.longest:g})")
        if not (0.0 < self.contraction < 1.0 and self.extension > 0.0 and self.reach > 0.0):
            raise DesignError(
                f"contraction must be in (0, 1), extension and reach above 0, but they are {self.contraction:g}, "
                f"{self.extension:g} and {self.reach:g}"
            )
        if not self.laws:
            raise DesignError("laws is empty: name at least one law of members")


def broken(limits: Limits, lengths: Array, rest: Array, laws: Sequence[Law], from_joint: Array) -> dict[str, Array]:
    """By how much each member breaks each limit; not above 0 where it keeps it.

    Args:
        limits: The limits.
        lengths: (m, 2) least and greatest length of each member in the region.
        rest: (m,) rest lengths.
        laws: m laws.
        from_joint: (m,) distance of its farthest fixed node from the joint.

    Returns:
        By limit, (m,) relative excess.
    """
    low, high = lengths.T
    return {
        "shortest": 1.0 - low / limits.shortest,
        "longest": high / limits.longest - 1.0,
        "reach": from_joint / limits.reach - 1.0,
        "contraction": np.where(pushes(laws), 1.0 - limits.contraction - low / rest, -1.0),
        "extension": np.where(pulls(laws), high / rest - 1.0 - limits.extension, -1.0),
    }
