"""Where real recordings come from; none is part of the project."""

import os
from dataclasses import dataclass
from pathlib import Path

from mocap.errors import MocapError

VARIABLE = "MOCAP_REAL_DATA"
"""Environment variable: the folder that holds real recordings, each in a folder of its name."""


@dataclass(frozen=True, kw_only=True)
class RealRecording:
    """Recordings that somebody published.

    Attributes:
        name: Of its folder.
        what: One line on what it is.
        source: Where it is from.
        licence: Theirs.
    """

    name: str
    what: str
    source: str
    licence: str


REAL = (
    RealRecording(
        name="bat_windtunnel_dltdv8",
        what="Carollia bats in a wind tunnel, 15 or 16 markers digitised in 4 cameras at 700 Hz, DLTdv8 projects",
        source="https://github.com/biol-jsh/DLC-DLTdv-workflow",
        licence="none stated",
    ),
    RealRecording(
        name="bat_cave_dltdv7",
        what="free-flying bats in a cave, 3 thermal cameras at 25 Hz, DLTdv7, easyWand",
        source="https://github.com/thejasvibr/projectushichka",
        licence="none stated",
    ),
    RealRecording(
        name="snake_glide_qualisys",
        what="gliding snakes, 13 to 18 markers at 179 Hz, raw and filled by the authors",
        source="https://github.com/TheSochaLab/Undulation-enables-gliding-in-flying-snakes",
        licence="none stated; cite Yeaton et al. 2020",
    ),
    RealRecording(
        name="snake_gap_vicon",
        what="snakes that cross gaps, 10 markers at 150 Hz, raw",
        source="https://github.com/TheSochaLab/FlyingSnakeGaps",
        licence="none stated",
    ),
    RealRecording(
        name="mouse_mocap_qtm",
        what="a mouse on a treadmill, 11 markers at 300 Hz, Qualisys",
        source="https://github.com/nRIM-OIST/Marker-based-Mouse-MoCap-eNeuro-2025",
        licence="MIT",
    ),
    RealRecording(
        name="mouse_charuco_4cam",
        what="4 cameras with images of a ChArUco board, Anipose calibration, SLEAP tracks of a mouse",
        source="https://github.com/talmolab/sleap-anipose",
        licence="GPL-3.0 text, BSD-3-Clause in its setup",
    ),
    RealRecording(
        name="charuco_4cam_caliscope",
        what="4 cameras, corners of a ChArUco board and their calibration",
        source="https://github.com/mprib/caliscope",
        licence="BSD-2-Clause",
    ),
    RealRecording(
        name="checkerboard_stereo_pair",
        what="25 pairs of images of a checkerboard and their calibration",
        source="https://github.com/Barry-Liang/stereoCalibrate",
        licence="none stated",
    ),
    RealRecording(
        name="mudskipper_dltdv8_2d",
        what="mudskippers filmed from above and from the side, DLTdv8, without calibration",
        source="https://github.com/FinsAndLimbs/MudskipperLocoComplexMedia",
        licence="none stated",
    ),
    RealRecording(
        name="xmalab_pig",
        what="a feeding pig in X-rays, XMALab exports",
        source="https://github.com/jdlaurence/xromm-tools",
        licence="GPL-3.0",
    ),
    RealRecording(
        name="c3d_samples",
        what="C3D files of several programs and byte orders",
        source="https://github.com/biomechanics-foundation/c3dio",
        licence="MIT or Apache-2.0",
    ),
)
"""Those that the project's tests and benchmarks know."""


def folder() -> Path:
    """Where real recordings lie: ``MOCAP_REAL_DATA``, or ``../shared/data`` beside the project."""
    return Path(os.environ.get(VARIABLE) or Path(__file__).resolve().parents[2] / "shared" / "data")


def real_path(name: str) -> Path:
    """The folder of a real recording that the user has.

    Raises:
        MocapError: it is not known, or not there.
    """
    match = next((recording for recording in REAL if recording.name == name), None)
    if match is None:
        raise MocapError(f"no real recording is called {name!r}; known are {', '.join(r.name for r in REAL)}")
    path = folder() / name
    if not path.is_dir():
        raise MocapError(
            f"{path}: this recording is not there: get it from {match.source}, put it into a folder of that name, "
            f"and set {VARIABLE} to the folder that contains it"
        )
    return path
