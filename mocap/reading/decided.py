"""What reading decides of what files hold or leave open."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Literal, Self

from mocap.cameras.lens_of_tracks import TrackLens
from mocap.cameras.origin import PixelOrigin
from mocap.findings import Finding
from mocap.io.contents import FileContents
from mocap.json_records import plain, record
from mocap.parts import of_the_whole
from mocap.recording import Recording

From = Literal["stated", "file", "playback", "assumed", "nowhere"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Decided:
    """How a recording was read.

    Attributes:
        rows: Where pixel rows are counted from; None: without two cameras that see something, or where its pixels
            cannot tell (``clean`` says so).
        lens: What was estimated of the lenses from the pixels themselves, and taken out; None: nothing.
        unit: Unit of the lengths in the files; None: not known, or none are.
        unit_from: Where it is known from.
        rate_from: Where the frame rate is known from; ``playback``: of a file whose program may state the rate at which
            a video is played.
        rate_in_file: What a file states, where another is stated; None: nothing.
        assumed_unit: What is to be said of a unit that nobody states; None: it is stated.
        of_pixels: What else was decided of pixels and their calibration.
        of_files: What else was decided of files: rates, numbers of frames, whatever they leave open.
        beside: Positions of a file that are compared with those of the pixels; None: there are none, or they were.
    """

    rows: PixelOrigin | None = None
    lens: TrackLens | None = None
    unit: str | None = None
    unit_from: From = "nowhere"
    rate_from: From = "nowhere"
    rate_in_file: float | None = None
    assumed_unit: Finding | None = None
    of_pixels: tuple[Finding, ...] = ()
    of_files: tuple[Finding, ...] = ()
    beside: FileContents | None = None

    step: ClassVar[str] = "read"
    depends_on: ClassVar[tuple[str, ...]] = ()

    at = only = of_the_whole

    def findings(self) -> tuple[Finding, ...]:
        """The unit, pixels and calibration, files."""
        return (*(() if self.assumed_unit is None else (self.assumed_unit,)), *self.of_pixels, *self.of_files)

    def to_file(self, folder: Path) -> dict[str, Any]:  # noqa: ARG002
        """All but the positions beside, which cleaning compared."""
        return plain(replace(self, beside=None))

    @classmethod
    def of_file(cls, entries: Any, folder: Path, where: str) -> Self:  # noqa: ARG003
        """Read back."""
        return record(cls, entries, where)


def decided(recording: Recording) -> Decided:
    """How a recording was read; of positions that a model or a person made, nothing was decided."""
    return recording.get(Decided) or Decided()
