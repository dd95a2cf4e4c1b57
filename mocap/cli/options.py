"""Options that several commands share; those that belong together are one dataclass, which a command takes as one."""

import dataclasses
import inspect
from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from typer.core import TyperArgument, TyperCommand

from mocap.cli.offered import offered
from mocap.entrances import UNASKED
from mocap.options import ReadOptions, TrackOptions, flags_of, options_of
from mocap.pixel_corner import PixelCorner

if TYPE_CHECKING:
    from mocap.io.format import Hints
    from mocap.recording import Recording

STATED = options_of(ReadOptions) | options_of(TrackOptions)
"""What there is to say of the options that ``mocap.read`` and ``mocap.track`` have, too."""


def shared(name: str, *, also: str = "", **more: Any) -> Any:
    """The option of that name, of which the record of options says what it does and what it is called.

    Args:
        name: The field's.
        also: What this command adds to that.
        **more: What concerns a terminal alone, as ``typer.Option`` takes it.
    """
    option = STATED[name]
    text = f"{option.help} {also}".rstrip()
    if name == "validate":  # what is shown is what changes the default: --no-validate
        return typer.Option(help=f"Do not {text[0].lower()}{text[1:]}", **more)
    return typer.Option(*flags_of(name, option), help=text, **more)


Tracks = Annotated[Path, typer.Argument(help="2D or 3D coordinates in any supported format.")]
Views = Annotated[
    list[Path],
    typer.Argument(
        help="2D or 3D coordinates in any supported format, or one 2D file per camera; after 3D ones XMALab's or "
        "Qualisys' rigid bodies."
    ),
]
Crop = Annotated[list[Path] | None, shared("crop")]
Calibration = Annotated[Path | None, shared("calibration")]
Profile = Annotated[Path | None, shared("profile")]
PixelOriginOption = Annotated[PixelCorner | None, shared("origin")]
CalibrationOrigin = Annotated[PixelCorner | None, shared("calibration_origin")]
ImageHeight = Annotated[float | None, shared("image_height_px")]
Fps = Annotated[float | None, shared("fps")]
Unit = Annotated[str | None, shared("unit")]
FormatName = Annotated[
    str | None,
    typer.Option("--format", help="File format, if it is not recognised.", autocompletion=offered("read_formats")),
]
SparseCameras = Annotated[
    int | None, typer.Option("--cameras", min=1, help="Number of cameras in sparse (TSV) 2D files.")
]
Columns = Annotated[
    str | None,
    typer.Option(
        help="Columns of a plain table, by title or number: tip=x1,y1,z1; root=x2,y2,z2; time=t. Two are 2D. Also "
        "frame=n; likelihood=p."
    ),
]
Sheet = Annotated[
    str | None, typer.Option(help="Sheet of an Excel file, by name or number.", autocompletion=offered("sheets"))
]
ZeroOption = Annotated[
    Literal["position", "missing"] | None,
    typer.Option("--zero", help="What samples at exactly (0, 0, 0) are. Default: judged by how the markers move."),
]
Individual = Annotated[str | None, typer.Option(help="Of a file with several animals, the one to read.")]
SkeletonFile = Annotated[Path | None, shared("skeleton")]
Edits = Annotated[Path | None, shared("edits")]
EditsAnyway = Annotated[bool, shared("edits_anyway")]
PixelSd = Annotated[float | None, shared("pixel_sd")]
PointSd = Annotated[float | None, shared("point_sd_mm")]
StoredPoints = Annotated[Path | None, shared("stored_points")]
CorrectLag = Annotated[bool, shared("correct_lag")]
FitLens = Annotated[bool, shared("fit_lens")]
MmPerPx = Annotated[float | None, shared("mm_per_px")]
ModelName = Annotated[str, shared("model", autocompletion=offered("models"))]
Validate = Annotated[bool, shared("validate")]
Seed = Annotated[int, shared("seed", min=0)]
Force = Annotated[bool, typer.Option("--force", help="Replace an earlier result.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
Verbose = Annotated[bool, typer.Option("--verbose", help="Print the whole report.")]
Out = Annotated[Path, typer.Option(help="Folder to write.")]
Jobs = Annotated[
    int | None,
    typer.Option(
        min=1, envvar="MOCAP_JOBS", help="Processes, each with its own memory. Default: one per core, at most 4."
    ),
]
LimitS = Annotated[
    float | None,
    typer.Option(
        min=0.001,
        help="Seconds that a trial may take, and reading a file at most; what takes longer is left, and the others are "
        "done. Default: an hour for a trial and a minute for a file, and more by their size.",
    ),
]

UntilIdle = Annotated[
    float | None,
    typer.Option(
        min=0.001,
        metavar="MINUTES",
        help="End the page when it was not used for so long, and nothing is being tracked. Default: it stays until its "
        "button End, Ctrl-C or another signal.",
    ),
]


def seconds(minutes: float | None) -> float | None:
    """Of minutes; None stays."""
    return None if minutes is None else 60.0 * minutes


PANELS = {
    "Files": {"tracks": "FILE", "fps": "HZ", "unit": "UNIT"},
    "Cameras": {"calibration": "FILE", "profile": "FILE", "fit_lens": "", "video": "FILE"},
    "Animal": {"skeleton": "FILE", "model": "NAME|FILE"},
    "Output": {"out": "PATH", "force": "", "verbose": ""},
    "Expert": {
        "format_name": "NAME",
        "cameras": "N",
        "columns": "TEXT",
        "sheet": "NAME",
        "zero": "position|missing",
        "individual": "NAME",
        "origin": "CORNER",
        "calibration_origin": "CORNER",
        "image_height_px": "PIXELS",
        "crop": "FILE",
        "pixel_sd": "PIXELS",
        "point_sd_mm": "MM",
        "edits": "FILE",
        "edits_anyway": "",
        "stored_points": "FILE",
        "correct_lag": "",
        "mm_per_px": "MM",
        "video_offset": "FRAMES",
        "video_undistorted": "",
        "validate": "",
        "seed": "N",
        "blocks": "FRAMES",
        "jobs": "N",
        "limit_s": "SECONDS",
        "as_json": "",
    },
}
"""Options as ``--help`` shows them: panels and their order, and what a value is, in a word; empty: a flag."""


_WORDS = {
    "bool": "",
    "int": "N",
    "int range": "N",
    "float": "NUMBER",
    "float range": "NUMBER",
    "str": "TEXT",
    "Path": "FILE",
    "path": "FILE",
}


def _word(parameter: Any, ctx: Any) -> str | None:
    """What a value is, in the field's words instead of Python's; choices as they are."""
    if parameter.metavar is not None or not hasattr(parameter, "display_type"):  # typer before 0.29
        return parameter.metavar
    shown = parameter.display_type(ctx)
    bare = shown.strip("<>").removeprefix("list[").removesuffix("]")
    return _WORDS.get(bare, bare if "|" in bare else "VALUES")


class Command(TyperCommand):
    """A command whose help shows its options by ``PANELS``, each under its first name."""

    def get_help_option(self, ctx: Any) -> Any:
        """``--help`` stands below Output."""
        found = super().get_help_option(ctx)
        if found is not None:
            found.metavar, found.rich_help_panel = "", "Output"  # type: ignore[attr-defined]
        return found

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Print the help."""
        panel = {name: title for title, words in PANELS.items() for name in words}
        word = {name: text for words in PANELS.values() for name, text in words.items()}
        order = list(panel)
        all_names, self.params = self.params, [copy(one) for one in self.params]
        for one in self.params:
            if one.default is not None or not one.secondary_opts:  # else both names of a switch do something
                one.opts = one.secondary_opts or one.opts[:1]  # what changes the default
                one.secondary_opts = []
            one.show_default = one.show_default and not isinstance(one.default, bool)  # type: ignore[attr-defined]
            one.metavar = word.get(str(one.name), _word(one, ctx))  # type: ignore[attr-defined]
            if isinstance(one, TyperArgument):
                one.display_type_rich = lambda ctx: None  # type: ignore[method-assign]  # noqa: ARG005
            else:
                one.rich_help_panel = panel.get(one.name)  # type: ignore[attr-defined]
        self.params.sort(key=lambda one: order.index(one.name) if one.name in panel else -1)
        try:
            super().format_help(ctx, formatter)
        finally:
            self.params = all_names


@dataclass(frozen=True, kw_only=True)
class FileOptions:
    """How a file is to be read, where it does not say so itself."""

    format_name: FormatName = None
    cameras: SparseCameras = None
    columns: Columns = None
    sheet: Sheet = None
    zero: ZeroOption = None
    individual: Individual = None

    def hints(self) -> "Hints":
        """As readers take it."""
        from mocap.io.format import Hints
        from mocap.io.plain import parse_columns

        return Hints(
            cameras=self.cameras,
            columns=parse_columns(self.columns or ""),
            format=self.format_name,
            sheet=self.sheet,
            zero=self.zero,
            individual=self.individual,
        )


@dataclass(frozen=True, kw_only=True)
class CameraOptions(FileOptions):
    """What is stated about the cameras."""

    calibration: Calibration = None
    profile: Profile = None
    origin: PixelOriginOption = None
    calibration_origin: CalibrationOrigin = None
    image_height_px: ImageHeight = None
    crop: Crop = None

    def arguments(self) -> dict[str, Any]:
        """As ``mocap.read`` takes it: what is stated, by the names of ``ReadOptions``."""
        own = {one.name for one in dataclasses.fields(self)}
        given = {name: getattr(self, name) for name in options_of(ReadOptions) if name in own}
        return {name: value for name, value in given.items() if value is not None and value is not False} | {
            "hints": self.hints()
        }


@dataclass(frozen=True, kw_only=True)
class RecordingOptions(CameraOptions):
    """What is stated about a recording."""

    fps: Fps = None
    unit: Unit = None
    skeleton: SkeletonFile = None
    pixel_sd: PixelSd = None
    point_sd_mm: PointSd = None
    edits: Edits = None
    edits_anyway: EditsAnyway = False
    stored_points: StoredPoints = None
    correct_lag: CorrectLag = False
    fit_lens: FitLens = False
    mm_per_px: MmPerPx = None

    @property
    def stage(self) -> str:
        """What ``read`` does, as progress names it."""
        return "read, estimate the lens" if self.fit_lens else "read"

    def read(self, tracks: Path | list[Path], **more: Any) -> "Recording":
        """The recording in a file, with what is stated about it."""
        import mocap

        return mocap.read(tracks, **{**self.arguments(), **more})


@dataclass(frozen=True, kw_only=True)
class TrackingOptions:
    """How recordings are tracked."""

    model: ModelName = "auto"
    validate: Validate = True
    seed: Seed = 0


@dataclass(frozen=True, kw_only=True)
class BatchTracking(TrackingOptions):
    """The same of many trials, of which a model can be learned first."""

    model: Annotated[str, shared("model", also="learn: of all trials, first.", autocompletion=offered("models"))] = (
        "auto"
    )


@dataclass(frozen=True, kw_only=True)
class PrintOptions:
    """What is replaced, and what is printed."""

    force: Force = False
    as_json: AsJson = False
    verbose: Verbose = False


def with_records(command: Callable[..., None]) -> Callable[..., None]:
    """A command for typer, in which each field of a dataclass that the command takes is an option of its own.

    Args:
        command: Annotated with types, not with their names as text; the fields of its dataclasses are annotated as
            options of typer are.

    Raises:
        TypeError: two of its records, or a record and an argument, have a name in common.
    """
    parameters: dict[str, inspect.Parameter] = {}
    records: dict[str, type] = {}
    for name, parameter in inspect.signature(command).parameters.items():
        found = [parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY)]
        if dataclasses.is_dataclass(parameter.annotation):
            records[name] = parameter.annotation  # type: ignore[assignment]
            found = [_parameter(field) for field in dataclasses.fields(parameter.annotation)]
        for one in found:
            if one.name in parameters:
                raise TypeError(f"{command.__name__} has two options {one.name}")
            parameters[one.name] = one

    @wraps(command)
    def called(**given: Any) -> None:
        for name, record in records.items():
            given[name] = record(**{field.name: given.pop(field.name) for field in dataclasses.fields(record)})
        command(**given)

    called.__signature__ = inspect.Signature(list(parameters.values()))  # type: ignore[attr-defined]
    called.__annotations__ = {name: one.annotation for name, one in parameters.items()}
    del called.__wrapped__  # type: ignore[attr-defined]
    return called


def refusing(command: Callable[..., None]) -> Callable[..., None]:
    """A command for typer that says why it does not take an option of a recording (``mocap.entrances.UNASKED``)."""
    reasons, taken = UNASKED[command.__name__], inspect.signature(command).parameters
    hidden: dict[str, Any] = {}
    for name in reasons:
        kind, default = (bool, False) if STATED[name].of is bool else (str | None, None)
        option = Annotated[kind, shared(name, hidden=True)]
        hidden[name] = inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=option)

    @wraps(command)
    def called(**given: Any) -> None:
        for name, why in reasons.items():
            if given.pop(name) not in (None, False):
                raise typer.BadParameter(why, param_hint=flags_of(name, STATED[name])[0])
        command(**given)

    called.__signature__ = inspect.Signature([*taken.values(), *hidden.values()])  # type: ignore[attr-defined]
    called.__annotations__ = {name: one.annotation for name, one in {**taken, **hidden}.items()}
    del called.__wrapped__  # type: ignore[attr-defined]
    return called


def _parameter(field: dataclasses.Field) -> inspect.Parameter:
    default = inspect.Parameter.empty if field.default is dataclasses.MISSING else field.default
    return inspect.Parameter(field.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=field.type)
