"""What members and nodes may be, in the units of the design."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eal.arrays import Array
from eal.joint_design.laws import DesignError, Law, pulls, pushes


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
