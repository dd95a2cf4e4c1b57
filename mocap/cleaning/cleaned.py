"""What cleaning finds of a recording, beside the variables that it writes."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from mocap.audit.geometry import HiddenLens
from mocap.audit.samples import Jump
from mocap.audit.stored import StalePoint
from mocap.cleaning.camera_health import BadTime
from mocap.cleaning.click_noise import ClickNoise
from mocap.cleaning.swaps import Swap, exchanged_samples
from mocap.findings import Finding
from mocap.json_records import plain, record
from mocap.recording import Recording
from mocap.records import Status
from mocap.variables import VARIABLES, Values

R = TypeVar("R")


@dataclass(frozen=True, eq=False, kw_only=True)
class Cleaned:
    """What cleaning found.

    Attributes:
        jitter_px: Standard deviation of a coordinate of a pixel, from frame to frame; NaN without cameras.
        bias_px: Standard deviation of the slow ray errors that were removed.
        stated_over_shown: Factor by which all deviations were multiplied, so that they are what the user states of a
            pixel; 1: nothing is stated.
        noise: Relative scales of cameras and markers, and degrees of freedom of cameras, by which rays were weighed;
            None without cameras.
        bad_cameras: Runs of frames in which a camera was bad; contained in ``ray_sd``.
        swaps: Runs of frames in which two markers bore each other's names; undone.
        jumps: Markers that jump.
        stale: Stored positions that do not follow from the pixels; None where there was no file to compare.
        lens: Distortion that the pixels show, and that nobody corrected; None: there is none.
        audited: What pixels and cameras tell of each other, and of faults of the programs that wrote them.
        told: What of all this is told, and what was done about it.
    """

    jitter_px: float = np.nan
    bias_px: float = 0.0
    stated_over_shown: float = 1.0
    noise: ClickNoise | None = None
    bad_cameras: tuple[BadTime, ...] = ()
    swaps: tuple[Swap, ...] = ()
    jumps: tuple[Jump, ...] = ()
    stale: tuple[StalePoint, ...] | None = None
    lens: HiddenLens | None = None
    audited: tuple[Finding, ...] = ()
    told: tuple[Finding, ...] = ()

    step: ClassVar[str] = "clean"
    depends_on: ClassVar[tuple[str, ...]] = ("Decided",)

    def at(self, frames: NDArray[np.int64]) -> Self:
        """Of these frames: runs of them, and jumps whose two frames are among them."""
        new = {int(frame): i for i, frame in enumerate(frames)}

        def bad(one: BadTime) -> BadTime | None:
            inside = [new[frame] for frame in range(one.start, one.stop) if frame in new]
            return replace(one, start=inside[0], stop=inside[-1] + 1) if inside else None

        def swap(one: Swap) -> Swap | None:
            inside = [new[frame] for frame in one.frames.tolist() if frame in new]
            return replace(one, frames=np.array(inside, dtype=np.int64)) if inside else None

        def jump(one: Jump) -> Jump | None:
            start, end = (new.get(frame) for frame in one.frames)
            return None if start is None or end is None else replace(one, frames=(start, end))

        def stale(one: StalePoint) -> StalePoint | None:
            frame = new.get(one.frame - 1)
            return None if frame is None else replace(one, frame=frame + 1)

        return replace(
            self,
            bad_cameras=_kept(bad, self.bad_cameras),
            swaps=_kept(swap, self.swaps),
            jumps=_kept(jump, self.jumps),
            stale=None if self.stale is None else _kept(stale, self.stale),
        )

    def only(self, markers: NDArray[np.int64]) -> Self:
        """Of these markers: exchanges between two of them, and their jumps and factors."""
        new = {int(marker): i for i, marker in enumerate(markers)}
        swaps = [replace(s, a=new[s.a], b=new[s.b]) for s in self.swaps if s.a in new and s.b in new]
        jumps = [
            replace(j, marker=new[j.marker], other=None if j.other is None else new.get(j.other))
            for j in self.jumps
            if j.marker in new
        ]
        noise = None if self.noise is None else replace(self.noise, marker=self.noise.marker[markers])
        return replace(self, swaps=tuple(swaps), jumps=tuple(jumps), noise=noise)

    def findings(self) -> tuple[Finding, ...]:
        """What is told."""
        return self.told

    def to_file(self, folder: Path) -> dict[str, Any]:  # noqa: ARG002
        """All of it."""
        return plain(self)

    @classmethod
    def of_file(cls, entries: Any, folder: Path, where: str) -> Self:  # noqa: ARG003
        """Read back."""
        return record(cls, entries, where)


def cleaned(recording: Recording) -> Cleaned:
    """What cleaning found of a recording; nothing of positions that a model made, or a person."""
    return recording.get(Cleaned) or Cleaned()


SINCE_CLEAN = frozenset(name for name, one in VARIABLES.items() if one.since == "clean")
OF_SAMPLES = frozenset({"rejected", "most_speed", "repaired"})
"""What cleaning writes of any recording; of one with cameras all that is declared since ``clean``."""
DERIVED = frozenset({"status", "repaired"})
"""What follows from the rest, and is never given."""


def written(
    recording: Recording,
    found: Cleaned,
    *,
    rejected: Mapping[str, NDArray[np.bool_]] | None = None,
    **values: Values,
) -> Recording:
    """A recording with what cleaning makes of it: the one place where variables since ``clean`` are written.

    A sample is measured where it has a position, else rejected where some reason says so, else missing; it is repaired
    where names were exchanged (1) or a person corrected it (2).

    Args:
        recording: Cleaned, of which some is changed; or not yet: then all is to be given that is declared since
            ``clean``, but for ``lens_covariance``, which not every recording has.
        found: What was found.
        rejected: (T, M) masks by reason, in place of all others; None: as they are.
        **values: Arrays by the names of their variables.

    Raises:
        ValueError: some of what is declared since ``clean`` is missing, follows from the rest, or is not cleaning's.
    """
    odd = {name for name in values if name in DERIVED or VARIABLES[name].since == "track"}
    needed = SINCE_CLEAN if recording.cameras else OF_SAMPLES
    missing = needed - {"rejected", "repaired", "lens_covariance"} - {*recording.data, *values}
    missing |= {"rejected"} if rejected is None and not recording.cleaned else set()
    if odd:
        raise ValueError(f"{', '.join(sorted(odd))}: follows from the rest, or is not written by cleaning")
    if missing:
        raise ValueError(f"{', '.join(sorted(missing))} is missing of what cleaning writes: see `mocap.variables`")
    reasons = recording.rejected if rejected is None else rejected
    done = recording.having(**values, rejected=reasons or None)
    known, gone = np.isfinite(done.xyz_m[..., 0]), np.any(list(reasons.values()), axis=0)
    status = np.where(known, Status.MEASURED, np.where(gone, Status.REJECTED, Status.MISSING)).astype(np.int8)
    exchanged = np.any(list(exchanged_samples(known.shape, found.swaps).values()), axis=0)
    repaired = np.where(done.edited, 2, exchanged).astype(np.int8)
    return done.having(status=status, repaired=repaired).with_part(found)


def _kept(change: Callable[[R], R | None], given: Iterable[R]) -> tuple[R, ...]:
    """What is left of records."""
    return tuple(one for one in map(change, given) if one is not None)
