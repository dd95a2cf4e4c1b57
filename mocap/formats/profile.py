"""Camera profile text (Argus, easyWand): a line a camera, ``cam f W H cx cy AR k1 k2 p1 p2 k3``."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from mocap.cameras import Camera
from mocap.errors import CalibrationError, FormatError
from mocap.formats.csv_table import whole_file
from mocap.lens import BrownLens

_OTHERS = {13: "an omnidirectional (CMei) camera", 17: "an Argus bundle-adjustment profile", 19: "a Scaramuzza camera"}


def read_profile(path: Path) -> tuple[tuple[BrownLens, tuple[int, int]], ...]:
    """Read lenses and image sizes (width, height), a line a camera in the order of their numbers.

    The pixel aspect ratio AR scales the vertical focal length: fy = f AR.

    Raises:
        FormatError: a line has not 12 numbers, or belongs to a camera model that is not supported.
    """
    try:
        lines = [line.split() for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]
    except OSError as error:
        raise FormatError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise FormatError(f"{path.name}: not a text file; expected a camera profile") from None
    if not lines:
        raise FormatError(f"{path.name}: the file is empty; expected a camera profile, a line a camera")
    lenses = []
    for number, line in enumerate(lines, start=1):
        if len(line) != 12:
            other = f" ({_OTHERS[len(line)]}: not supported here)" if len(line) in _OTHERS else ""
            raise FormatError(
                f"{path.name}: line {number} has {len(line)} columns{other}; "
                "expected 12: cam f W H cx cy AR k1 k2 p1 p2 k3"
            )
        try:
            _, f, width, height, cx, cy, aspect, k1, k2, p1, p2, k3 = map(float, line)
        except ValueError:
            raise FormatError(
                f"{path.name}: line {number} holds something that is not a number: {' '.join(line)}"
            ) from None
        lens = BrownLens(f_px=(f, f * aspect), centre_px=(cx, cy), k=(k1, k2, k3), p=(p1, p2))
        lenses.append((lens, (int(width), int(height))))
    return tuple(lenses)


def with_profile(cameras: Sequence[Camera], path: Path) -> tuple[Camera, ...]:
    """The cameras with the lenses and sizes of a profile.

    Raises:
        CalibrationError: the profile describes another number of cameras.
    """
    lenses = read_profile(path)
    if len(lenses) != len(cameras):
        raise CalibrationError(
            f"{path.name}: describes {len(lenses)} cameras, but the coefficients are for {len(cameras)}: "
            "give the profile of the same calibration"
        )
    pairs = zip(cameras, lenses, strict=True)
    return tuple(replace(c, lens=None if lens.is_identity else lens, size_px=size) for c, (lens, size) in pairs)


def write_profile(path: Path, cameras: Sequence[Camera]) -> None:
    """Write the lenses of cameras.

    Raises:
        FormatError: a camera has no lens or size, which this format must hold.
    """
    with whole_file(path) as stream:
        for number, camera in enumerate(cameras, start=1):
            if camera.lens is None or camera.size_px is None:
                raise FormatError(
                    f"{path.name}: camera {camera.name!r} has no lens or image size, which a profile needs"
                )
            (fx, fy), (cx, cy) = camera.lens.f_px, camera.lens.centre_px
            numbers = (fx, *camera.size_px, cx, cy, fy / fx, *camera.lens.k[:2], *camera.lens.p, camera.lens.k[2])
            stream.write(f"{number} " + " ".join(f"{x:.12g}" for x in numbers) + "\n")
