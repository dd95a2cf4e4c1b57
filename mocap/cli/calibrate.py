"""``mocap calibrate``: cameras from images of boards, a wand, known points, or the marker tracks themselves."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mocap.cli.console import say, show
from mocap.cli.options import AsJson, CameraOptions, Command, Force, Out, PixelOriginOption, Profile, with_records
from mocap.errors import CalibrationError

if TYPE_CHECKING:
    from mocap.calibration.boards import Board
    from mocap.calibration.calibration_files import CalibrationReport

SquareMm = Annotated[float, typer.Option(help="Side of a square in millimetres.")]
LensModel = Annotated[
    str,
    typer.Option(
        help="Lens model: brown2 (k1 k2), brown (5 coefficients), rational (8), fisheye (4), or "
        "auto: chosen on images left out of the fit."
    ),
]

calibrate = typer.Typer(
    no_args_is_help=True,
    help="Calibrate cameras from boards, a wand, known points or markers; implausible results are refused.",
)


@dataclass(frozen=True, kw_only=True)
class BoardOptions:
    """Which board was filmed."""

    checkerboard: Annotated[str | None, typer.Option("--checkerboard", help="Inner corners, as in 9x6.")] = None
    charuco: Annotated[str | None, typer.Option("--charuco", help="Squares of a ChArUco board, as in 7x5.")] = None
    marker_mm: Annotated[float | None, typer.Option(help="Side of a ChArUco marker in millimetres.")] = None
    dictionary: Annotated[str, typer.Option(help="Dictionary of the markers, as OpenCV names it.")] = "DICT_4X4_50"

    def board(self, square_mm: float) -> "Board":
        """A board of squares of this size.

        Raises:
            CalibrationError: the options do not say which board it is.
        """
        from mocap.calibration.boards import Charuco, Checkerboard

        if not square_mm > 0:
            raise CalibrationError(f"--square-mm {square_mm:g}: the side of a square must be above 0")
        if (self.checkerboard is None) == (self.charuco is None):
            raise CalibrationError(
                "state which board was filmed: --checkerboard 9x6 (inner corners) or --charuco 7x5 (squares)"
            )
        if self.checkerboard is not None:
            return Checkerboard(**_size(self.checkerboard, "--checkerboard"), square_m=square_mm / 1e3)
        size = _size(self.charuco or "", "--charuco")
        if self.marker_mm is None:
            raise CalibrationError("--charuco needs the side of the board's markers: give --marker-mm")
        marker_m = self.marker_mm / 1e3
        return Charuco(**size, square_m=square_mm / 1e3, marker_m=marker_m, dictionary=self.dictionary)


def _size(text: str, option: str) -> dict[str, Any]:
    found = re.fullmatch(r"(\d+)\s*[xX]\s*(\d+)", text)
    if found is None:
        raise CalibrationError(f"{option} {text!r}: expected columns x rows, as in 9x6")
    return {"columns": int(found[1]), "rows": int(found[2])}


def _finish(report: "CalibrationReport", out: Path, as_json: bool) -> None:
    if as_json:
        print((out / "report.json").read_text(encoding="utf-8"), end="")  # noqa: T201
    else:
        show("\n".join(report.lines))
        say(f"Wrote {out}/")


def _calibrated(
    made: Callable[[], tuple[Any, ...]],
    out: Path,
    inputs: Sequence[Path | None],
    *,
    force: bool,
    as_json: bool,
    **how: Any,
) -> None:
    """Write the folder of cameras and their report that were made, and say what came of it."""
    from mocap.calibration.calibration_files import write_calibration_folder
    from mocap.io.output import result_folder

    with result_folder(out, "calibration", replace=force, beside=True, inputs=inputs, tell=say) as rig:
        cameras, *upright, report = made()
        written = write_calibration_folder(rig, cameras, report, **dict(zip(["upright"], upright, strict=False)), **how)
    _finish(written, out, as_json)


@calibrate.command(cls=Command)
@with_records
def images(
    *,
    folder: Annotated[Path, typer.Argument(help="Images: <camera>/<frame>.png, or <camera><frame>.png in one folder.")],
    square_mm: SquareMm,
    out: Out,
    filmed: BoardOptions,
    world_frame: Annotated[
        str | None,
        typer.Option(
            help="Frame in which the board defines the world's x-y plane; if not given, the one that most cameras see."
        ),
    ] = None,
    lens: LensModel = "auto",
    lenses: Annotated[
        Path | None,
        typer.Option(
            help="calibration.toml of the same cameras, whose lenses are kept: only positions "
            "and orientations are computed."
        ),
    ] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """From images of a checkerboard or ChArUco board: lenses and positions of 1 to 30 cameras."""
    from mocap.calibration.calibrate import from_pictures

    board = filmed.board(square_mm)
    made = partial(from_pictures, folder, board, world_frame=world_frame, lens=lens, calibration=lenses, tell=say)
    _calibrated(made, out, (folder, lenses), force=force, as_json=as_json)


@calibrate.command(cls=Command)
@with_records
def lenses(
    *,
    folder: Annotated[
        Path,
        typer.Argument(help="A folder or a video for each camera, or images <camera><number>.png; taken at any time."),
    ],
    square_mm: SquareMm,
    out: Out,
    filmed: BoardOptions,
    lens: LensModel = "auto",
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Each camera's lens from its own images or video of a board; `places` then finds where the cameras are."""
    from mocap.calibration.calibrate_lenses import lenses_from_pictures
    from mocap.calibration.calibration_files import write_report
    from mocap.io.anipose import NAME, write_lenses
    from mocap.io.output import result_folder

    board = filmed.board(square_mm)
    with result_folder(out, "lenses", replace=force, beside=True, inputs=[folder], tell=say) as made:
        found, report = lenses_from_pictures(folder, board, lens=lens, tell=say)
        write_lenses(made / NAME, found)
        written = write_report(made, report, [NAME])
    _finish(written, out, as_json)


@calibrate.command(cls=Command)
@with_records
def places(
    *,
    lenses: Annotated[
        Path, typer.Option(help="lenses.toml of `calibrate lenses`, any calibration.toml, or a folder with one.")
    ],
    out: Out,
    points: Annotated[
        Path | None, typer.Option(help="Known points: name,x,y,z, one row for each point (CSV, .xlsx).")
    ] = None,
    pixels: Annotated[
        Path | None,
        typer.Option(
            help="Where they were clicked: camera,point,x,y, one row for each click; or a row for each point; or "
            "DLTdv's xypts."
        ),
    ] = None,
    unit: Annotated[
        str | None, typer.Option(help="Unit of the points (m, cm or mm), if their titles do not state it.")
    ] = None,
    origin: PixelOriginOption = None,
    board: Annotated[
        Path | None,
        typer.Option(help="In place of points: one image from each camera of one board that lies still."),
    ] = None,
    square_mm: Annotated[float, typer.Option(help="Side of a square of that board in millimetres.")] = 0.0,
    filmed: BoardOptions,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Where cameras with known lenses are: from known points clicked in each image, or one board on the floor."""
    from mocap.calibration.calibrate_places import places_from_board, places_from_points

    if (board is None) == (points is None or pixels is None):
        raise CalibrationError("state what is known: --points and --pixels, or --board with the board's size")

    def made() -> tuple[Any, ...]:
        if board is not None:
            return places_from_board(lenses, board, filmed.board(square_mm), tell=say)
        assert points is not None
        assert pixels is not None
        return places_from_points(lenses, points, pixels, unit=unit, lower_left=origin == "lower-left")

    _calibrated(made, out, (lenses, points, pixels, board), force=force, as_json=as_json)


@calibrate.command(cls=Command)
def wand(
    file: Annotated[
        Path,
        typer.Argument(
            help="easyWandData.mat, or pixels of the wand's two ends (DLTdv xypts, or "
            "any format that mocap info knows)."
        ),
    ],
    out: Out,
    background: Annotated[
        Path | None, typer.Option(help="Pixels of other points that several cameras saw, as in easyWand.")
    ] = None,
    profile: Profile = None,
    length_m: Annotated[float | None, typer.Option(help="Distance of the wand's ends in metres.")] = None,
    free: Annotated[
        str,
        typer.Option(
            help="What is fitted of the lenses: none, focal, focal+centre, lens; auto: chosen by the "
            "wand score on frames left out of the fit."
        ),
    ] = "auto",
    origin: PixelOriginOption = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """From two points of known distance (a wand) moved through the volume, and background points."""
    from mocap.calibration.calibrate import from_wand

    how = {"background": background, "profile": profile, "length_m": length_m, "moves": free, "tell": say}
    made = partial(from_wand, file, lower_left=origin == "lower-left", **how)
    _calibrated(made, out, (file, background, profile), force=force, as_json=as_json)


@calibrate.command(cls=Command)
def dlt(
    points: Annotated[
        Path, typer.Argument(help="Table of known points: x, y, z, one row for each point (CSV, .xlsx).")
    ],
    pixels: Annotated[
        Path,
        typer.Argument(help="Table of their pixels: x, y of each camera, the same rows; empty or NaN where not seen."),
    ],
    out: Out,
    unit: Annotated[str, typer.Option(help="Unit of the points: m, cm or mm.")] = "m",
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """From points of known position: 11 DLT coefficients for each camera."""
    from mocap.calibration.calibrate import UNITS_M, from_points

    scale = UNITS_M.get(unit)
    if scale is None:
        raise CalibrationError(f"--unit {unit!r}: expected m, cm or mm")
    made = partial(from_points, points, pixels, unit_m=scale)
    _calibrated(made, out, (points, pixels), force=force, as_json=as_json, lenses=False)


@calibrate.command(cls=Command)
@with_records
def refine(
    tracks: Annotated[
        Path,
        typer.Argument(help="Pixels of a recording: DLTdv xypts, dvProject.mat, or any format that mocap info knows."),
    ],
    out: Out,
    options: CameraOptions,
    bone: Annotated[
        list[str] | None,
        typer.Option(
            help="first,second[,metres]: two markers at a fixed distance, which sets the scale; may be repeated."
        ),
    ] = None,
    focal: Annotated[bool, typer.Option("--focal", help="Refine the focal lengths too.")] = False,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """From the markers of a recording: refine camera positions and orientations until its rays intersect."""
    import mocap
    from mocap.calibration.calibrate import from_tracks

    recording = mocap.read(tracks, fps=1.0, **options.arguments())
    made = partial(from_tracks, recording, bones=bone or [], focal=focal)
    _calibrated(made, out, recording.inputs, force=force, as_json=as_json, lenses=False)
