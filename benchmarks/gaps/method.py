"""What the benchmark hands to a method, and what it takes back."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from mocap.arrays import Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Trial:
    """One recording of a set; all trials of a set have the same markers and rate.

    Attributes:
        name: Of the trial.
        names: The M markers.
        t_s: (T,) times, evenly spaced.
        xyz_m: (T, M, 3) measured positions; NaN where not seen, or where hidden by the benchmark.
        sd_m: (M,) standard deviation of a measured coordinate.
        trunk: Markers whose translation and heading define the body.
        limbs: Marker names of each limb.
    """

    name: str
    names: tuple[str, ...]
    t_s: Array
    xyz_m: Array
    sd_m: Array
    trunk: tuple[str, ...]
    limbs: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, eq=False)
class Estimate:
    """What a method estimates of every sample.

    Attributes:
        xyz_m: (T, M, 3) positions; NaN where it has no estimate.
        cov_m2: (T, M, 3, 3) covariance of a measurement there (its noise included); None: the method has no intervals.
    """

    xyz_m: Array
    cov_m2: Array | None


class Filler(Protocol):
    """A method that has learned."""

    def __call__(self, trial: Trial) -> Estimate:
        """Fill a trial; its hidden samples are NaN and are not known in any other way."""
        ...


class Method(Protocol):
    """A way of filling gaps."""

    @property
    def name(self) -> str:
        """For the table."""
        ...

    def learn(self, training: Sequence[Trial]) -> Filler:
        """Learn, and tune whatever there is to tune, on training trials only."""
        ...
