"""Options that several commands share."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

if TYPE_CHECKING:
    from mocap.io.format import Hints
    from mocap.pipeline.recording import Recording

PixelOrigin = Literal["upper-left", "lower-left"]
"""Where pixel rows are counted from."""

Tracks = Annotated[Path, typer.Argument(help="Pixels or positions, in any format that mocap info knows.")]
Views = Annotated[
    list[Path],
    typer.Argument(
        help="Pixels or positions, in any format that mocap info knows; or the pixel files of one trial, one a camera."
    ),
]
Crop = Annotated[
    list[Path] | None,
    typer.Option(
        help="Crop offsets of cropped films, added to the pixels: a folder, or a file for each camera (give the option "
        "once for each, in their order); if not given, those beside the tracks."
    ),
]
Calibration = Annotated[
    Path | None,
    typer.Option("--calibration", "--dlt", help="DLT coefficients, calibration.toml, easyWand, ..."),
]
Profile = Annotated[
    Path | None,
    typer.Option(
        help="Camera profile (lenses), one line for each camera: cam f W H cx cy AR k1 k2 p1 p2 k3; or the Tforms.mat "
        "of a lens that all cameras have."
    ),
]
PixelOriginOption = Annotated[
    PixelOrigin | None,
    typer.Option(
        "--origin",
        help="Corner that pixel rows are counted from; if not given, the one with the smaller triangulation residual.",
    ),
]
CalibrationOrigin = Annotated[
    PixelOrigin | None,
    typer.Option(
        "--calibration-origin", "--dlt-origin", help="Corner that the calibration counts from, if it differs."
    ),
]
ImageHeight = Annotated[float | None, typer.Option(help="Image height in pixels, to flip rows without a profile.")]
Fps = Annotated[
    float | None, typer.Option(help="Frames per second, where the files do not state it (or state a wrong one).")
]
Unit = Annotated[str | None, typer.Option(help="Unit of lengths (m, mm, cm, in, ft), where the files do not state it.")]
FormatName = Annotated[
    str | None, typer.Option("--format", help="Name of the format, if it is not recognised by content.")
]
SparseCameras = Annotated[
    int | None, typer.Option("--cameras", min=1, help="Number of cameras in sparse (TSV) pixel files.")
]
Columns = Annotated[
    str | None,
    typer.Option(
        help="Columns of a plain table: tip=x1,y1,z1;root=x2,y2,z2;time=t (titles, or column numbers from 1). Two "
        "columns are pixels, also with a third that is titled likelihood, score or confidence; frame=n, likelihood=p."
    ),
]
Sheet = Annotated[
    str | None,
    typer.Option(help="Sheet of a workbook (.xlsx) that has several: its name, or its number from 1."),
]
SkeletonFile = Annotated[Path | None, typer.Option("--skeleton", help="Skeleton in TOML: markers, bones, joints.")]
PixelSd = Annotated[
    float | None, typer.Option(help="Standard deviation of a pixel coordinate; if not given, estimated.")
]
FitLens = Annotated[
    bool,
    typer.Option(
        "--fit-lens",
        help="Estimate radial lens distortion from the recording itself, where no lens is given, and correct it.",
    ),
]
Force = Annotated[bool, typer.Option("--force", help="Replace an earlier result.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
Out = Annotated[Path, typer.Option(help="Folder to write.")]
Jobs = Annotated[
    int | None,
    typer.Option(
        min=1,
        envvar="MOCAP_JOBS",
        help="Processes that work side by side, each with its own memory; if not given, one for each core, at most 4.",
    ),
]


@dataclass(frozen=True, kw_only=True)
class FileOptions:
    """How a file is to be read, where it does not say so itself."""

    format_name: FormatName = None
    cameras: SparseCameras = None
    columns: Columns = None
    sheet: Sheet = None

    def hints(self) -> "Hints":
        """As readers take it."""
        from mocap.io.format import Hints
        from mocap.io.plain import parse_columns

        columns = parse_columns(self.columns or "")
        return Hints(cameras=self.cameras, columns=columns, format=self.format_name, sheet=self.sheet)


@dataclass(frozen=True, kw_only=True)
class CameraOptions(FileOptions):
    """What is stated about the cameras."""

    calibration: Calibration = None
    profile: Profile = None
    origin: PixelOriginOption = None
    calibration_origin: CalibrationOrigin = None
    image_height: ImageHeight = None
    crop: Crop = None

    def stated(self) -> dict[str, Any]:
        """As ``mocap.read`` takes it."""
        return {
            "calibration": self.calibration,
            "profile": self.profile,
            "origin": self.origin,
            "calibration_origin": self.calibration_origin,
            "image_height_px": self.image_height,
            "crop": self.crop,
            "hints": self.hints(),
        }


@dataclass(frozen=True, kw_only=True)
class RecordingOptions(CameraOptions):
    """What is stated about a recording."""

    fps: Fps = None
    unit: Unit = None
    skeleton: SkeletonFile = None
    pixel_sd: PixelSd = None

    def stated(self) -> dict[str, Any]:
        """As ``mocap.read`` takes it."""
        own = {"fps": self.fps, "unit": self.unit, "skeleton": self.skeleton, "pixel_sd": self.pixel_sd}
        return super().stated() | own

    def read(self, tracks: Path | list[Path], **more: Any) -> "Recording":
        """The recording in a file, with what is stated about it."""
        import mocap

        return mocap.read(tracks, **self.stated(), **more)
