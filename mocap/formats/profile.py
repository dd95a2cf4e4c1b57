"""Camera profile text (Argus, easyWand): a line a camera, ``cam f W H cx cy AR k1 k2 p1 p2 k3``."""

from collections.abc import Sequence
from dataclasses import replace
from math import isfinite
from pathlib import Path

from mocap.cameras import Camera
from mocap.errors import CalibrationError, FormatError
from mocap.formats.csv_table import whole_file
from mocap.lens import BrownLens

_OTHERS = {13: "an omnidirectional (CMei) camera", 17: "an Argus bundle-adjustment profile", 19: "a Scaramuzza camera"}


def read_profile(path: Path) -> tuple[tuple[BrownLens, tuple[int, int]], ...]:
    """Read lenses and image sizes (width, height) of all cameras, in the order of their numbers.

    The pixel aspect ratio AR scales the vertical focal length: fy = f AR.

    Raises:
        FormatError: a line has not 12 numbers, belongs to a camera model that is not supported, or repeats a camera.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except OSError as error:
        raise FormatError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise FormatError(f"{path.name}: not a text file; expected a camera profile") from None
    if not any(line.strip() for line in lines):
        raise FormatError(f"{path.name}: the file is empty; expected a camera profile, a line a camera")
    lenses: dict[float, tuple[BrownLens, tuple[int, int]]] = {}
    for number, line in ((i, text.split()) for i, text in enumerate(lines, start=1) if text.strip()):
        if len(line) != 12:
            other = f" ({_OTHERS[len(line)]}: not supported here)" if len(line) in _OTHERS else ""
            raise FormatError(
                f"{path.name}: line {number} has {len(line)} columns{other}; "
                "expected 12: cam f W H cx cy AR k1 k2 p1 p2 k3"
            )
        try:
            camera, f, width, height, cx, cy, aspect, k1, k2, p1, p2, k3 = map(float, line)
        except ValueError:
            raise FormatError(
                f"{path.name}: line {number} holds something that is not a number: {' '.join(line)}"
            ) from None
        if not (all(map(isfinite, map(float, line))) and f > 0 and aspect > 0 and width >= 1 and height >= 1):
            raise FormatError(
                f"{path.name}: line {number} describes no camera: focal length, aspect ratio and image size must be "
                f"positive, all numbers finite: {' '.join(line)}"
            )
        if camera in lenses:
            raise FormatError(
                f"{path.name}: line {number} describes camera {line[0]} again: number the cameras 1, 2, ..."
            )
        lens = BrownLens(f_px=(f, f * aspect), centre_px=(cx, cy), k=(k1, k2, k3), p=(p1, p2))
        lenses[camera] = (lens, (int(width), int(height)))
    return tuple(lenses[camera] for camera in sorted(lenses))


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
            if not isinstance(camera.lens, BrownLens):
                raise FormatError(
                    f"{path.name}: camera {camera.name!r} has a {camera.lens.model} lens, but a profile holds Brown's "
                    "(k1 k2 p1 p2 k3) only: write calibration.toml, or calibrate with --lens brown"
                )
            (fx, fy), (cx, cy) = camera.lens.f_px, camera.lens.centre_px
            numbers = (fx, *camera.size_px, cx, cy, fy / fx, *camera.lens.k[:2], *camera.lens.p, camera.lens.k[2])
            stream.write(f"{number} " + " ".join(f"{x:.12g}" for x in numbers) + "\n")
