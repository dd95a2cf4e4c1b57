"""What the benchmark hands to a method, and what it takes back."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

from eal.arrays import Array
from mocap.cameras.camera import Camera
from mocap.records import PixelCorner, PixelTracks


@dataclass(frozen=True, eq=False, kw_only=True)
class Film:
    """What the cameras saw of a trial.

    Attributes:
        pixels: As digitised, with the trial's markers and times.
        cameras: The C cameras.
        pixel_origin: Corner that pixel rows are counted from, and
        calibration_origin: that of the cameras, as decided on the whole recording.
    """

    pixels: PixelTracks
    cameras: tuple[Camera, ...]
    pixel_origin: PixelCorner
    calibration_origin: PixelCorner

    def cut(self, frames: slice) -> "Film":
        """Some of its frames, the times of which begin at 0."""
        t_s, uv_px = self.pixels.t_s[frames], self.pixels.uv_px[:, frames]
        return replace(self, pixels=replace(self.pixels, t_s=t_s - t_s[0], uv_px=uv_px))


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
        film: The pixels that the positions follow from; None: there are none. Where a marker is hidden in 3D, rays of
            one camera or two may be left in it.
        animal: Which it is; "": all trials of the set are of one.
        gait: How it moves; "": all trials of the set are of one kind.
        bones: Ends of the bones that a user would state, from the trunk outward: what the product learns limbs from.
    """

    name: str
    names: tuple[str, ...]
    t_s: Array
    xyz_m: Array
    sd_m: Array
    trunk: tuple[str, ...]
    limbs: tuple[tuple[str, ...], ...]
    film: Film | None = None
    animal: str = ""
    gait: str = ""
    bones: tuple[tuple[str, str], ...] = ()


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
    """A way of filling gaps.

    One that uses the rays of ``Trial.film`` says so by an attribute ``reads_rays``; all others see the same whatever
    rays are left, and fill once. One that needs a film says so by ``needs_film``. One that is shown the answer has
    ``learn_with_truth``.
    """

    @property
    def name(self) -> str:
        """For the table."""
        ...

    def learn(self, training: Sequence[Trial]) -> Filler:
        """Learn, and tune whatever there is to tune, on training trials only."""
        ...


@runtime_checkable
class Oracle(Protocol):
    """A method that is shown what it will have to fill, to see how much there is to win."""

    def learn_with_truth(self, training: Sequence[Trial], truth: Trial) -> Filler:
        """Learn from training trials, and from the trial that is filled later, with nothing hidden."""
        ...


def reads_rays(method: Method) -> bool:
    """Whether a method uses the rays of markers that are seen by one camera."""
    return bool(getattr(method, "reads_rays", False)) or needs_film(method)


def needs_film(method: Method) -> bool:
    """Whether a method is of pixels only."""
    return bool(getattr(method, "needs_film", False))
