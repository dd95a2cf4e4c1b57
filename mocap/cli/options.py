"""What several commands take."""

from pathlib import Path
from typing import Annotated, Literal

import typer

PixelOrigin = Literal["upper-left", "lower-left"]
"""Where pixel rows are counted from."""

Tracks = Annotated[Path, typer.Argument(help="Pixels or positions, in any format that mocap info knows.")]
Dlt = Annotated[
    Path | None,
    typer.Option("--dlt", help="Calibration: DLT coefficients, calibration.toml, easyWand, ..."),
]
Profile = Annotated[
    Path | None, typer.Option(help="Camera profile, a line a camera: cam f W H cx cy AR k1 k2 p1 p2 k3.")
]
PixelOriginOption = Annotated[
    PixelOrigin | None,
    typer.Option("--origin", help="Corner that pixel rows are counted from; if not given, found by the residual."),
]
DltOrigin = Annotated[PixelOrigin | None, typer.Option(help="The same for the coefficients, if it differs.")]
ImageHeight = Annotated[float | None, typer.Option(help="Image height in pixels, to flip rows without a profile.")]
Fps = Annotated[float | None, typer.Option(help="Frames per second, where the files do not hold it (or hold another).")]
Unit = Annotated[str | None, typer.Option(help="Unit of lengths (m, mm, cm, in, ft), where the files do not state it.")]
FormatName = Annotated[str | None, typer.Option("--format", help="Format of the files, if not found by content.")]
SparseCameras = Annotated[int | None, typer.Option("--cameras", min=1, help="Number of cameras of sparse pixel files.")]
Columns = Annotated[
    str | None,
    typer.Option(help="Columns of a plain table: tip=x1,y1,z1;root=x2,y2,z2;time=t (titles, or numbers from 1)."),
]
Sheet = Annotated[
    str | None,
    typer.Option(help="Sheet of a workbook (.xlsx) that has several: its name, or its number from 1."),
]
SkeletonFile = Annotated[Path | None, typer.Option("--skeleton", help="Skeleton in TOML: markers, bones, joints.")]
PixelSd = Annotated[float | None, typer.Option(help="Standard deviation of a pixel; if not given, estimated.")]
Force = Annotated[bool, typer.Option("--force", help="Replace what exists.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON, for machines.")]
Out = Annotated[Path, typer.Option(help="Folder to write.")]
