"""The four ways to calibrate, from files to a report: boards, wand, known points, the markers themselves."""

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from eal.arrays import Array
from mocap.calibration.board_rig import calibrate_boards
from mocap.calibration.boards import Board, detect, pictures_of
from mocap.calibration.calibration_files import CalibrationReport, number, of_pictures, table
from mocap.calibration.dlt import CHECKED_FROM, fit_dlt
from mocap.calibration.intrinsics import CHOICES
from mocap.calibration.refine import KnownDistance, refine_cameras
from mocap.calibration.scene import RigCamera, in_world, rig_lens, upside_down
from mocap.calibration.wand import MOVES, WandCalibration, calibrate_wand
from mocap.cameras.camera import Camera
from mocap.errors import CalibrationError, FormatError
from mocap.io.anipose import read_calibration
from mocap.io.csv_table import has_titles, read_table
from mocap.io.easywand import read_easywand
from mocap.io.profile import read_profile
from mocap.io.registry import as_table, read
from mocap.reading.decided import decided
from mocap.reading.ideal_pixels import with_rays, without_lens
from mocap.recording import Recording
from mocap.records import PixelTracks
from mocap.text import plain

UNITS_M = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
_AXIS = re.compile(r"(?P<axis>[xyz])(?:[ _]*[\[(]?(?P<unit>mm|cm|m)[\])]?)?", re.IGNORECASE)
_CAMERA_AXIS = r"(?:.*[ _.:-])?(?:camera|cam|view|c)[ _.#-]*(?P<camera>\d+)[ _.:-]*(?P<axis>[xyuv])(?: *[\[(]px[\])])?"
Told = Callable[[str], None]


def from_pictures(
    folder: Path, board: Board, *, world_frame: str | None, lens: str, calibration: Path | None, tell: Told
) -> tuple[tuple[Camera, ...], CalibrationReport]:
    """Images of a board to cameras, whose lenses are found or, from a calibration, held.

    Raises:
        CalibrationError: whatever makes that impossible.
    """
    if lens not in ("auto", *CHOICES):
        raise CalibrationError(f"`lens` {lens!r} is not a lens model: give auto, {', '.join(CHOICES)}")
    choices = tuple(CHOICES) if lens == "auto" else (lens,)
    board, views = detect(pictures_of(folder), board, progress=tell)
    lenses = None if calibration is None else {c.name: rig_lens(c) for c in read_calibration(calibration)}
    found = calibrate_boards(views, board, world_frame=world_frame, choices=choices, lenses=lenses, progress=tell)
    pairs = list(zip(found.cameras, found.intrinsics, found.f_sd_px, strict=True))
    rows = [
        [
            c.name,
            f"{len(views[c.name].corners)} of {len(views[c.name].corners) + len(views[c.name].missed)}",
            i.choice,
            _focal(c.lens.f_px[0], sd),
            f"{found.camera_px[c.name][0]:.3f}",
            f"{found.camera_px[c.name][1]:.3f}",
            ", ".join(f"{k} {v:.3f}" for k, v in i.held_out_px.items()) or "-",
        ]
        for c, i, sd in pairs
    ]
    worst = sorted(((v, n, s) for n, per in found.image_px.items() for s, v in per.items()), reverse=True)[:5]
    lines = [
        f"# Calibration of {len(found.cameras)} cameras: {found.rms_px:.3f} px",
        "",
        *table(
            [
                "camera",
                "boards found",
                "lens",
                "f px",
                "RMS px",
                "median px",
                "px on images left out of the fit, by lens model",
            ],
            rows,
        ),
        f"The world is the board of {plain(found.world_frame)}: origin at its first inner corner, x along its rows, z "
        "out of it; metres. Pixels are counted from the upper left, the centre of the first pixel at (0, 0).",
        "",
        "Largest residuals: " + ", ".join(f"{plain(n)} {plain(s)} {v:.2f} px" for v, n, s in worst) + ".",
        "",
        *of_pictures(found.image_px),
    ]
    warned = [
        f"{n}: {share * 100:.1f} % of the image lies outside the range of the lens model"
        for n, share in found.no_ray.items()
        if share
    ]
    warned += [f"{n} {s} was left out: {why}" for (n, s), why in found.left_out.items()]
    lines += [f"- {plain(w)}" for w in warned]
    numbers = {
        "method": "boards",
        "rms_px": found.rms_px,
        "world_frame": found.world_frame,
        "cameras": {
            c.name: {
                "lens": c.lens.model,
                "choice": i.choice,
                "f_px": c.lens.f_px,
                "f_sd_px": sd,
                "centre_px": c.lens.centre_px,
                "distortion": c.lens.coefficients,
                "position_m": c.position_m,
                "rms_px": found.camera_px[c.name][0],
                "median_px": found.camera_px[c.name][1],
                "held_out_px": {k: number(v) for k, v in i.held_out_px.items()},
                "image_rms_px": found.image_px[c.name],
                "left_out": {s: why for (n, s), why in found.left_out.items() if n == c.name},
                "missed": views[c.name].missed,
            }
            for c, i, sd in pairs
        },
        "findings": warned,
    }
    return tuple(c.camera() for c in found.cameras), CalibrationReport(numbers=numbers, lines=lines)


def from_wand(
    file: Path,
    *,
    background: Path | None,
    profile: Path | None,
    length_m: float | None,
    moves: str,
    lower_left: bool,
    tell: Told,
) -> tuple[tuple[Camera, ...], tuple[Camera, ...], CalibrationReport]:
    """Wand points to cameras: in the convention of the file, and for rows from the upper left.

    Raises:
        CalibrationError: whatever makes that impossible.
        FormatError: a file cannot be read.
    """
    notes: tuple[str, ...] = ()
    if file.suffix.lower() == ".mat":
        wand = read_easywand(file)
        lenses, sizes, wand_px, back_px = list(wand.lenses), list(wand.sizes_px), wand.wand_px, wand.background_px
        length_m = wand.wand_length if length_m is None else length_m
    else:
        if profile is None or length_m is None:
            raise CalibrationError(
                f"{file.name}: a wand calibration needs the wand's length and the lenses: give `length_m` and `profile`"
            )
        pixels, own_notes = _pixels_of(file)
        if len(pixels.names) != 2:
            raise FormatError(
                f"{file.name}: contains {len(pixels.names)} points ({', '.join(pixels.names[:8])}); expected the two "
                "ends of the wand: export only these"
            )
        with as_table(profile) as (lens_table, how):
            lenses, sizes = (list(x) for x in zip(*read_profile(lens_table), strict=True))
        notes += (*own_notes, *_named(profile, how))
        wand_px = pixels.uv_px
        if len(lenses) != len(wand_px):
            raise CalibrationError(
                f"{profile.name}: describes {len(lenses)} cameras, but {file.name} contains {len(wand_px)}: give the "
                "profile and the pixels of the same cameras"
            )
        back_px = np.full((len(lenses), 0, 1, 2), np.nan)
    if background is not None:
        back, own_notes = _pixels_of(background)
        back_px, notes = back.uv_px, (*notes, *own_notes)
    results: dict[str, WandCalibration] = {}
    for choice in MOVES[:3] if moves == "auto" else (moves,):
        try:
            found = calibrate_wand(lenses, sizes, wand_px, back_px, length_m=length_m, moves=choice)
        except CalibrationError:
            if moves != "auto" or choice == MOVES[0]:
                raise
            continue
        results[choice] = found
        tell(
            f"fitted of the lenses: {choice}; wand score {found.good_score:.3f} over {found.good_wands} of "
            f"{found.wands} wands"
        )
    chosen = min(results, key=lambda c: results[c].good_held_out_score)
    best = results[chosen]
    rig: Sequence[RigCamera] = best.cameras
    upright = rig
    if lower_left:
        rig = in_world(rig, np.diag([1.0, 1.0, -1.0, 1.0]))
        heights = [0.0 if s is None else float(s[1]) for s in sizes]
        upright = [upside_down(c, h) for c, h in zip(rig, heights, strict=True)]
    rows = [
        [c.name, _focal(c.lens.f_px[0], sd), f"{rms:.2f}", ", ".join(f"{x:.3f}" for x in c.position_m)]
        for c, sd, rms in zip(best.cameras, best.f_sd_px, best.camera_px, strict=True)
    ]
    lines = [
        f"# Calibration of {len(rig)} cameras with a wand of {length_m:g} m",
        "",
        f"Wand score (100 SD / mean of its length, linear triangulation) {best.score:.3f} over {best.wands} frames, "
        f"{best.held_out_score:.3f} on frames left out of the fit; over the {best.good_wands} frames without "
        f"outliers {best.good_score:.3f}, **{best.good_held_out_score:.3f}** on those left out of the fit. Fitted "
        f"of the lenses: {chosen}; median reprojection error {best.median_px:.2f} px, {best.believed * 100:.0f} % "
        "of the pixels accepted.",
        "",
        *table(["camera", "f px", "RMS px (outliers included)", "position m"], rows),
        "The world's origin is the centre of all wand positions; its axes are those of the first camera (x right, "
        f"y {'up, z backward' if lower_left else 'down, z forward'}).",
        "",
        "A wand does not show whether pixel rows are counted upwards or downwards: they were assumed to be counted "
        "from the "
        f"{'lower' if lower_left else 'upper'} left. If that is wrong, the world is mirrored: state `origin`.",
    ]
    lines += ["", *(f"- {plain(t)}" for t in notes)] if notes else []
    numbers = {
        "method": "wand",
        "wand_score": number(best.score),
        "held_out_score": number(best.held_out_score),
        "wands": best.wands,
        "good_wands": best.good_wands,
        "good_score": number(best.good_score),
        "good_held_out_score": number(best.good_held_out_score),
        "free": chosen,
        "tried": {
            k: {"score": number(r.good_score), "held_out": number(r.good_held_out_score)} for k, r in results.items()
        },
        "median_px": best.median_px,
        "believed": best.believed,
        "cameras": {
            c.name: {"f_px": c.lens.f_px, "f_sd_px": sd, "rms_px": rms, "position_m": c.position_m}
            for c, sd, rms in zip(best.cameras, best.f_sd_px, best.camera_px, strict=True)
        },
    }
    report = CalibrationReport(numbers=numbers, lines=lines)
    return tuple(c.camera() for c in rig), tuple(c.camera() for c in upright), report


def from_points(points: Path, pixels: Path, *, unit_m: float) -> tuple[tuple[Camera, ...], CalibrationReport]:
    """Known points and their pixels to DLT coefficients.

    Raises:
        CalibrationError: too few points, or pixels that do not belong to them.
        FormatError: a file has other columns.
    """
    (xyz_titles, xyz, notes), (uv_titles, uv, also) = _numbers(points), _numbers(pixels)
    _check_unit(points, xyz_titles, unit_m)
    xyz, uv = xyz[:, _order_of_points(xyz_titles)], uv[:, _order_of_pixels(uv_titles)]
    if xyz.shape[1] != 3:
        raise FormatError(f"{points.name}: {xyz.shape[1]} columns; expected x, y, z: one row for each known point")
    if uv.shape[1] % 2 or not uv.shape[1]:
        raise FormatError(
            f"{pixels.name}: {uv.shape[1]} columns; expected x, y of each camera: one row for each known point"
        )
    if len(xyz) != len(uv):
        raise CalibrationError(
            f"{points.name} contains {len(xyz)} points, but {pixels.name} {len(uv)}: both need the same points in the "
            "same order, one in each row (NaN where a camera does not see it)"
        )
    fits = [fit_dlt(f"cam{c + 1}", xyz * unit_m, uv[:, 2 * c : 2 * c + 2]) for c in range(uv.shape[1] // 2)]
    rows = [
        [
            f.camera.name,
            f.places,
            f"{f.rms_px:.3f}",
            "not checked" if np.isnan(f.left_out_px) else f"{f.left_out_px:.3f}",
            f"{f.gain:.1f}",
        ]
        for f in fits
    ]
    lines = [
        f"# DLT coefficients of {len(fits)} cameras from {max(f.places for f in fits)} known points",
        "",
        *table(
            ["camera", "points", "RMS px (2n - 11)", "RMS px of points left out of the fit", "gain"],
            rows,
        ),
        "Lengths are in metres; pixels are counted from the same corner as in the file. Gain: by how many pixels an "
        "error of 1 px in one point moves what lies between the points, at most.",
    ]
    unchecked = [f.camera.name for f in fits if np.isnan(f.left_out_px)]
    if unchecked:
        lines += [
            "",
            f"NOTHING WAS CHECKED in {', '.join(unchecked)}: {CHECKED_FROM} different points are needed to leave "
            "out each in turn; a small RMS of fewer says nothing.",
        ]
    lines += ["", *(f"- {plain(t)}" for t in (*notes, *also))] if notes or also else []
    numbers = {
        "method": "dlt",
        "cameras": {
            f.camera.name: {
                "places": f.places,
                "gain": f.gain,
                "rms_px": f.rms_px,
                "left_out_px": number(f.left_out_px),
                "error_px": [number(float(np.hypot(*e))) for e in f.error_px],
            }
            for f in fits
        },
    }
    return tuple(f.camera for f in fits), CalibrationReport(numbers=numbers, lines=lines)


def from_tracks(
    source: Recording, *, bones: Sequence[str], focal: bool
) -> tuple[tuple[Camera, ...], CalibrationReport]:
    """Marker tracks and their calibration to a better one.

    Raises:
        MocapError: whatever makes that impossible.
    """
    film, names = with_rays(source), source.names
    ideal = without_lens(film, film.data["pixels"].values, iterations=3)
    found = refine_cameras(film.cameras, ideal, bones=[_bone(b, names) for b in bones], focal=focal)
    rows = [
        [c.name, f"{1e3 * m:.1f}", f"{np.degrees(a):.3f}", f"{f:.4f}"]
        for c, m, a, f in zip(found.cameras, found.moved_m, found.turned_rad, found.f_ratio, strict=True)
    ]
    lines = [
        f"# {len(rows)} cameras refined from {found.points} points of the recording",
        "",
        f"Median residual of points left out of the fit: {found.before_px:.3f} px before, **{found.after_px:.3f} "
        "px** after.",
        "",
        *table(["camera", "moved mm", "turned degrees", "focal length / old one"], rows),
        *(f"- {plain(b)}: {r:.4f} times the stated length" for b, r in zip(bones, found.length_ratio, strict=True)),
        *(f"- {plain(str(finding))}" for finding in decided(film).of_pixels),
        "",
        "Coefficients are for the same (undistorted) pixels as before: use the same camera profile with them.",
    ]
    numbers = {
        "method": "refine",
        "before_px": found.before_px,
        "after_px": found.after_px,
        "points": found.points,
        "moved_m": found.moved_m,
        "turned_rad": found.turned_rad,
        "f_ratio": found.f_ratio,
        "length_ratio": dict(zip(bones, found.length_ratio.tolist(), strict=True)),
    }
    bare = tuple(replace(c, lens=None) for c in found.cameras)
    return bare, CalibrationReport(numbers=numbers, lines=lines)


def _bone(text: str, names: Sequence[str]) -> KnownDistance:
    """From ``first,second`` or ``first,second,length in metres``."""
    parts = [p.strip() for p in text.split(",")]
    if len(parts) not in (2, 3) or any(p not in names for p in parts[:2]):
        raise CalibrationError(
            f"`bone` {text!r}: expected two of {', '.join(names[:30])}, and optionally a length in metres"
        )
    try:
        length = float(parts[2]) if len(parts) == 3 else None
    except ValueError:
        raise CalibrationError(f"`bone` {text!r}: {parts[2]!r} is not a length in metres") from None
    if length is not None and not length > 0:
        raise CalibrationError(f"`bone` {text!r}: the length must be above 0")
    return KnownDistance(first=names.index(parts[0]), second=names.index(parts[1]), length_m=length)


def _focal(f_px: float, sd_px: float) -> str:
    """A focal length and its standard deviation, for a table."""
    return f"{f_px:.1f} ± {sd_px:.1f}" if sd_px > 0 else f"{f_px:.1f} (not fitted)"


def _numbers(path: Path) -> tuple[list[str], Array, tuple[str, ...]]:
    """Titles (none without a line of them), numbers, and how the text of a table was read."""
    with as_table(path) as (file, notes):
        return *read_table(file, header=has_titles(file)), _named(path, notes)


def _pixels_of(path: Path) -> tuple[PixelTracks, tuple[str, ...]]:
    """The pixels of a file of any format, and how it was read.

    Raises:
        FormatError: it contains none.
    """
    found = read(path)
    if found.pixels is None:
        raise FormatError(
            f"{path.name}: contains no pixels ({found.format}); expected columns such as pt1_cam1_X, pt1_cam1_Y: is "
            "this the 2D file?"
        )
    return found.pixels, _named(path, found.assumed)


def _named(path: Path, sentences_: Sequence[str]) -> tuple[str, ...]:
    return tuple(f"{path.name}: {sentence}" for sentence in sentences_)


def _check_unit(path: Path, titles: Sequence[str], unit_m: float) -> None:
    """A unit in the titles is the one that is stated.

    Raises:
        CalibrationError: it is another.
    """
    for title in titles:
        match = _AXIS.fullmatch(title.strip())
        if match and match["unit"] and UNITS_M[match["unit"].lower()] != unit_m:
            raise CalibrationError(
                f"{path.name}: the title {title!r} states {match['unit']}, but coordinates would be read as "
                f"{next(name for name, metres in UNITS_M.items() if metres == unit_m)}: give `unit`"
            )


def _order_of_points(titles: Sequence[str]) -> list[int] | slice:
    """Columns x, y, z by their titles, which may state a unit; all columns where titles do not name the three."""
    axes = [match["axis"].lower() if (match := _AXIS.fullmatch(title.strip())) else "" for title in titles]
    return [axes.index(axis) for axis in "xyz"] if all(axes.count(axis) == 1 for axis in "xyz") else slice(None)


def _order_of_pixels(titles: Sequence[str]) -> list[int] | slice:
    """Columns x, y of the first camera, the second ... by their titles; all columns where these do not name them."""
    found = [re.fullmatch(_CAMERA_AXIS, title.strip(), re.IGNORECASE) for title in titles]
    where = {(int(m["camera"]), "xyuv".index(m["axis"].lower()) % 2): i for i, m in enumerate(found) if m}
    cameras = sorted({camera for camera, _ in where})
    whole = bool(where) and len(where) == sum(m is not None for m in found) == 2 * len(cameras)
    return [where[camera, axis] for camera in cameras for axis in (0, 1)] if whole else slice(None)
