"""What a user states: each option once, with its type, its default, its help, and what the command line calls it.

``mocap.read`` and ``mocap.from_pixels`` have these fields as arguments, the commands as options, a manifest of a batch
as columns. Nothing heavy is imported, as every command imports this.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import Field, dataclass, field, fields
from functools import wraps
from inspect import Signature, cleandoc, signature
from os import PathLike
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, Protocol, TypeVar, overload

from mocap.errors import MocapError
from mocap.pixel_corner import PixelCorner

if TYPE_CHECKING:
    from mocap.skeleton import Skeleton

PathText = str | PathLike[str]
R = TypeVar("R")
OPTION = "option"
"""Where a field's metadata have its ``Option``."""


@dataclass(frozen=True, kw_only=True)
class Option:
    """What there is to say of an option.

    Attributes:
        help: In a sentence or two, on the terminal and in Python.
        of: What a word of the command line or a cell of a manifest is; None: neither states it.
        more: What Python's help adds.
        flags: Its names on the command line, the first one shown; empty: of the field's name.
        cell: Whether a manifest of a batch has a column of it.
    """

    help: str
    of: type | None
    more: str = ""
    flags: tuple[str, ...] = ()
    cell: bool = True


def stated(
    of: type | None, text: str, more: str = "", *, flags: Sequence[str] = (), cell: bool = True
) -> dict[str, Any]:
    """Metadata of a field that is an option."""
    return {OPTION: Option(help=text, of=of, more=more, flags=tuple(flags), cell=cell)}


@dataclass(frozen=True, kw_only=True)
class FilmedOptions:
    """What is stated of a recording of pixels, from files or in memory."""

    fps: float | None = field(
        default=None, metadata=stated(float, "Frames per second, if the files do not state it or state it wrongly.")
    )
    unit: str | None = field(
        default=None, metadata=stated(str, "Unit of length, if the files do not state it: m, mm, cm, in, ft.")
    )
    skeleton: "PathText | Skeleton | None" = field(
        default=None,
        metadata=stated(
            Path,
            "Markers, bones and joints; mocap skeleton proposes one.",
            "A skeleton TOML, or a ``mocap.Skeleton``; a list of names (.txt, .csv), one for each marker of the file "
            "in its order, names the markers.",
        ),
    )
    origin: PixelCorner | None = field(
        default=None, metadata=stated(str, "Image origin. Default: whichever gives the smaller reprojection error.")
    )
    calibration_origin: PixelCorner | None = field(
        default=None,
        metadata=stated(
            str, "Image origin of the calibration, if it differs.", flags=("--calibration-origin", "--dlt-origin")
        ),
    )
    image_height_px: float | None = field(
        default=None,
        metadata=stated(float, "Image height, to flip rows where there is no profile.", flags=("--image-height",)),
    )
    pixel_sd: float | None = field(
        default=None, metadata=stated(float, "SD of a digitised coordinate. Default: estimated.")
    )
    correct_lag: bool = field(
        default=False,
        metadata=stated(
            bool, "Interpolate cameras that are found not to be synchronised.", flags=("--correct-lag", "--in-step")
        ),
    )
    fit_lens: bool = field(
        default=False,
        metadata=stated(
            bool,
            "Estimate radial lens distortion from the recording where no profile is given.",
            "Refused where it is not determined.",
            flags=("--fit-lens",),
        ),
    )


@dataclass(frozen=True, kw_only=True)
class ReadOptions(FilmedOptions):
    """What is stated of a recording in files."""

    calibration: PathText | None = field(
        default=None,
        metadata=stated(
            Path,
            "DLT coefficients, calibration.toml, easyWand, ...",
            "None: ``tracks`` holds it, or positions.",
            flags=("--calibration", "--dlt"),
        ),
    )
    profile: PathText | None = field(
        default=None,
        metadata=stated(
            Path,
            "Lens distortion: a camera profile (one line per camera: cam f W H cx cy AR k1 k2 p1 p2 k3), or a "
            "Tforms.mat for all cameras.",
        ),
    )
    stored_points: PathText | None = field(
        default=None,
        metadata=stated(Path, "Stored 3D points to check. Default: xyzpts beside xypts.", flags=("--stored",)),
    )
    point_sd_mm: float | None = field(
        default=None,
        metadata=stated(
            float,
            "SD of a coordinate of 3D positions without pixels. Default: as their file states it, else estimated.",
            flags=("--point-sd",),
        ),
    )
    crop: PathText | Sequence[PathText] | None = field(
        default=None,
        metadata=stated(
            Path,
            "Crop offsets of cropped videos: a folder, or one file per camera (repeat the option). Default: those "
            "beside the tracks.",
            "MATLAB files with ``XYtop_left``, one row per frame; DeepLabCut's config.yaml or meta file; tables x,y. "
            "Those beside the tracks are found by their names, and used if rays then meet better.",
        ),
    )
    hints: Any = field(  # a mocap.Hints, which stands above this file
        default=None,
        metadata=stated(
            None,
            "How the file is to be read where it does not say so itself: its format, the columns of a plain table, the "
            "number of cameras of a sparse pixel file, the sheet of a workbook, what samples at exactly zero are, "
            "which of several animals is meant.",
        ),
    )
    mm_per_px: float | None = field(
        default=None,
        metadata=stated(
            float,
            "Scale of a single camera without calibration. Default: positions are pixels.",
            "But where the titles of a table or ``unit`` state that its two columns per point are lengths in a plane.",
            flags=("--mm-per-px",),
        ),
    )
    edits: PathText | None = field(
        default=None,
        metadata=stated(
            Path,
            "Corrections made by hand (`mocap desk`).",
            "Its ``edits.jsonl``, or movement's list of swaps and drops (``.json``).",
        ),
    )
    edits_anyway: bool = field(
        default=False,
        metadata=stated(
            bool,
            "Replay corrections that were made on another recording, or changed files.",
            flags=("--edits-anyway",),
        ),
    )


@dataclass(frozen=True, kw_only=True)
class TrackOptions:
    """How a recording is tracked."""

    model: PathText = field(
        default="auto",
        metadata=stated(
            str,
            "A file of mocap learn, or eal, mixture, articulated, lagrangian, smooth_acceleration, constant_velocity; "
            "auto: mixture, unless constant velocity fills hidden points better; of one to three markers "
            "smooth_acceleration.",
        ),
    )
    validate: bool = field(
        default=True,
        metadata=stated(bool, "Hide some points to measure how well they are filled."),
    )
    seed: int = field(default=0, metadata=stated(int, "Random seed of the points that are hidden."))

    def __post_init__(self) -> None:
        """Refuse what is no seed, or neither true nor false: what hides points would say it after minutes."""
        if isinstance(self.seed, bool) or not hasattr(self.seed, "__index__") or self.seed < 0:
            raise MocapError(f"`seed` must be a whole number from 0 on, but is {self.seed!r:.40}: correct it")
        if self.validate not in (True, False):
            raise MocapError(f"`validate` must be True or False, but is {self.validate!r:.40}: correct it")


def options_of(record: type) -> dict[str, Option]:
    """The options of a record by the names of their fields; of a field that is none nothing."""
    return {one.name: one.metadata[OPTION] for one in fields(record) if OPTION in one.metadata}


def flags_of(name: str, option: Option) -> tuple[str, ...]:
    """What the command line calls it."""
    return option.flags or (f"--{name.replace('_', '-')}",)


def explained(one: Field[Any]) -> str:
    """What Python's help says of a field."""
    option: Option = one.metadata[OPTION]
    return f"{option.help} {option.more}".strip()


def part_of(record: type[R], whole: Any) -> R:
    """What a record of more options has of one of fewer."""
    return record(**{one.name: getattr(whole, one.name) for one in fields(record)})  # type: ignore[arg-type]


Given = ParamSpec("Given")
First = TypeVar("First")
Second = TypeVar("Second")
Options = TypeVar("Options", covariant=True)
Made = TypeVar("Made")


class _Taking(Protocol[Given, Options]):
    """Makes a function of one or two things and a record one of these and the record's fields."""

    @overload
    def __call__(self, function: Callable[[First, Options], Made], /) -> Callable[Concatenate[First, Given], Made]: ...
    @overload
    def __call__(
        self, function: Callable[[First, Second, Options], Made], /
    ) -> Callable[Concatenate[First, Second, Given], Made]: ...


def taking(record: Callable[Given, Options]) -> _Taking[Given, Options]:
    """A function whose last argument is a record of options, as a function that has each option as an argument by name.

    Its signature has the fields of the record, with their types and defaults, and its docstring what there is to say of
    them (``mocap.options``), in place of the record.

    Args:
        record: A dataclass whose fields are given by name.
    """
    made: Callable[..., Options] = record

    def decorate(function: Callable[..., Any]) -> Any:
        *leading, last = signature(function).parameters.values()
        named = signature(record).parameters.values()
        takes = Signature([*leading, *named], return_annotation=signature(function).return_annotation)

        @wraps(function)
        def call(*arguments: Any, **options: Any) -> Any:
            given = takes.bind(*arguments, **options).arguments
            return function(*[given.pop(one.name) for one in leading], made(**given))

        del call.__wrapped__  # it has another signature
        call.__signature__ = takes  # type: ignore[attr-defined]
        call.__annotations__ = {one.name: one.annotation for one in takes.parameters.values()}
        lines = [line for one in fields(record) if OPTION in one.metadata for line in _explained(one)]  # type: ignore[arg-type]
        own = re.compile(rf"^    {last.name}: .*$", re.MULTILINE)
        call.__doc__ = own.sub(lambda _: "\n".join(lines), cleandoc(function.__doc__ or ""))
        return call

    return decorate


def _explained(one: Any) -> list[str]:
    return wrap(f"{one.name}: {explained(one)}", 116, initial_indent="    ", subsequent_indent="        ")
