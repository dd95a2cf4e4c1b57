"""Places of cameras whose lenses are known: from points clicked in their images, or one board that lies still."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from eal.arrays import Array
from mocap.calibration.board_rig import UP
from mocap.calibration.boards import KINDS, Board, detect, of_files
from mocap.calibration.calibrate_lenses import board_pictures
from mocap.calibration.calibration_files import CalibrationReport, table
from mocap.calibration.places import PlacedCamera, place_cameras
from mocap.cameras.camera import Camera, KnownLens, stacked, undistorted
from mocap.cameras.triangulate import linear
from mocap.errors import CalibrationError, FormatError
from mocap.io.anipose import read_lenses
from mocap.io.clicked import UNITS_M, read_clicks, read_scene
from mocap.io.registry import as_table, read
from mocap.text import plain


def places_from_points(
    lenses: Path, points: Path, pixels: Path, *, unit: str | None = None, lower_left: bool = False
) -> tuple[tuple[Camera, ...], CalibrationReport]:
    """Cameras from their lenses and known points clicked in an image of each.

    Args:
        lenses: ``lenses.toml``, any ``calibration.toml``, or a folder with one of them.
        points: ``[name,]x,y,z``, a row a point.
        pixels: ``camera,point,x,y``, a row a click; or a row a point; or a tracker's file (as of DLTdv) whose markers
            are the points, of which each point's median over the frames is taken.
        unit: Of the points; None: stated in the titles, or metres.
        lower_left: Whether rows are counted from below.

    Raises:
        CalibrationError: whatever makes that impossible.
        FormatError: a file has other columns.
    """
    if unit is not None and unit not in UNITS_M:
        raise CalibrationError(f"`unit` {unit!r}: expected m, cm or mm")
    own_lenses = read_lenses(lenses)
    with as_table(points) as (file, table_notes):
        labels, xyz_m = read_scene(file, unit)
    uv_px, also = _clicks(pixels, own_lenses, labels)
    if lower_left:
        heights = [k.size_px[1] if k.size_px else None for k in own_lenses]
        if None in heights:
            raise CalibrationError("`origin` lower-left: the lenses do not state the height of the images")
        uv_px[..., 1] = np.array(heights, dtype=float)[:, None] - 1 - uv_px[..., 1]
    seen = [i for i, uv in enumerate(uv_px) if np.isfinite(uv).any()]
    without = [own_lenses[i].name for i in range(len(own_lenses)) if i not in seen]
    if not seen:
        raise CalibrationError(f"{pixels.name}: no point was clicked: expected pixels of {', '.join(labels[:8])}")
    places = place_cameras([own_lenses[i] for i in seen], xyz_m, uv_px[seen], labels=labels)
    notes = [f"{points.name}: {t}" for t in table_notes] + also
    notes += [f"{n}: no point was clicked in its image, so it is left out" for n in without]
    return _reported(places, [own_lenses[i] for i in seen], labels, xyz_m, uv_px[seen], notes, "points")


def places_from_board(
    lenses: Path, folder: Path, board: Board, *, tell: Callable[[str], None] = lambda _: None
) -> tuple[tuple[Camera, ...], CalibrationReport]:
    """Cameras from their lenses and one image a camera of a board that did not move between them.

    The world is the board's: origin at its first inner corner, x along its rows, z out of it.

    Raises:
        CalibrationError: a board that looks the same from both ends, several images of a camera, or no board.
    """
    if board.turnable:
        raise CalibrationError(
            "this checkerboard looks the same when turned by 180 degrees, so two cameras may start it at different "
            "corners: use one with an odd and an even number of inner corners, or a ChArUco board"
        )
    own_lenses = {k.name: k for k in read_lenses(lenses)}
    files = [p for p in sorted(folder.glob("*")) if p.suffix.lower() in KINDS and p.is_file()]
    named = {p.stem: p for p in files if p.stem in own_lenses}
    pictures = {name: of_files({name: path}) for name, path in named.items()} or board_pictures(folder)
    lost = [name for name in pictures if name not in own_lenses]
    if lost:
        raise CalibrationError(
            f"{folder}: camera {lost[0]!r} has no known lens: there are {', '.join(own_lenses)}: name its images so"
        )
    board, views = detect(pictures, board, progress=tell)
    local = board.points()
    uv_px, used, notes = [], [], []
    for name, view in views.items():
        if len(view.corners) > 1:
            raise CalibrationError(
                f"camera {name!r}: the board is seen in {len(view.corners)} images: give one for each camera, of the "
                "board in one place"
            )
        if not view.corners:
            notes.append(f"{name}: the board was not found, so the camera is left out")
            continue
        corners = next(iter(view.corners.values()))
        uv = np.full((len(local), 2), np.nan)
        uv[corners.ids] = corners.uv_px
        uv_px.append(uv)
        used.append(own_lenses[name])
        if own_lenses[name].size_px not in (None, view.size_px):
            raise CalibrationError(
                f"camera {name!r}: its image is {view.size_px}, its lens was calibrated at {own_lenses[name].size_px}: "
                "give uncropped images of the same size"
            )
    xyz_m = local @ UP[:3, :3].T
    labels = [f"corner {i + 1}" for i in range(len(local))]
    places = place_cameras(used, xyz_m, np.stack(uv_px), labels=labels)
    return _reported(places, used, labels, xyz_m, np.stack(uv_px), notes, "board")


def _clicks(path: Path, lenses: Sequence[KnownLens], labels: Sequence[str]) -> tuple[Array, list[str]]:
    names = [k.name for k in lenses]
    with as_table(path) as (file, notes):
        found = read_clicks(file, names, labels)
    if found is not None:
        return found, [f"{path.name}: {t}" for t in notes]
    tracks = read(path).pixels
    if tracks is None:
        raise FormatError(
            f"{path.name}: no clicks; expected camera,point,x,y (one row each), or point,{names[0]}_x,{names[0]}_y,..."
        )
    if len(tracks.cameras) != len(names):
        raise CalibrationError(
            f"{path.name}: {len(tracks.cameras)} cameras, but there are lenses of {len(names)} ({', '.join(names)}): "
            "give the lenses of these cameras, in their order"
        )
    if set(labels) <= set(tracks.names):
        columns = [tracks.names.index(n) for n in labels]
    elif len(tracks.names) == len(labels):
        columns = list(range(len(labels)))
    else:
        raise CalibrationError(
            f"{path.name}: its {len(tracks.names)} markers are not the {len(labels)} points: name them alike"
        )
    order = [tracks.cameras.index(n) for n in names] if set(names) == set(tracks.cameras) else range(len(names))
    uv = tracks.uv_px[list(order)][:, :, columns]
    out = np.full((len(names), len(labels), 2), np.nan)
    some = np.isfinite(uv[..., 0]).any(axis=1)
    for c, p in np.argwhere(some):
        out[c, p] = np.nanmedian(uv[c, :, p], axis=0)
    return out, [f"{path.name}: a tracker's file; of each point the median over the frames was taken"]


def _reported(
    places: Sequence[PlacedCamera],
    lenses: Sequence[KnownLens],
    labels: Sequence[str],
    xyz_m: Array,
    uv_px: Array,
    notes: Sequence[str],
    method: str,
) -> tuple[tuple[Camera, ...], CalibrationReport]:
    cameras = tuple(p.camera.camera() for p in places)
    rows, warned = [], list(notes)
    for place, lens in zip(places, lenses, strict=True):
        half = 1e3 * place.t95 * place.position_sd_m
        turned = np.degrees(place.t95 * place.turn_sd_rad).max()
        used = int(np.isfinite(place.error_px[:, 0]).sum()) - len(place.left_out)
        rows.append(
            [
                place.camera.name,
                used,
                f"{place.rms_px:.3f}",
                ", ".join(f"{x:.4f}" for x in place.camera.position_m),
                ", ".join(f"{x:.1f}" for x in half),
                f"{turned:.2f}",
            ]
        )
        for i in place.left_out:
            miss = float(np.hypot(*place.error_px[i]))
            warned.append(
                f"{place.camera.name}: {labels[i]} has a reprojection error of {miss:.1f} px, the others "
                f"{place.rms_px:.2f}: not used; clicked elsewhere, another point, or measured wrongly?"
            )
        if not lens.free:
            warned.append(f"{lens.name}: its lens was taken as exact, because its file states no covariance")
        if used == 4:
            warned.append(f"{lens.name}: 4 points cannot tell a wrong one: click 6 or more")
    lines = [
        f"# Places of {len(places)} cameras from " + ("one board" if method == "board" else "known points"),
        "",
        *table(
            ["camera", "points", "RMS px", "position m", "± mm (95 %)", "± degrees (95 %)"],
            rows,
        ),
    ]
    numbers: dict[str, object] = {"method": f"places from {method}"}
    if len(cameras) > 1:
        bad = np.zeros(uv_px.shape[:2], dtype=bool)
        for c, place in enumerate(places):
            bad[c, list(place.left_out)] = True
        found = linear(stacked(cameras), undistorted(cameras, np.where(bad[..., None], np.nan, uv_px)))
        off = 1e3 * np.linalg.norm(found - xyz_m, axis=-1)
        off_known = off[np.isfinite(off)]
        if len(off_known):
            worst = int(np.nanargmax(off))
            lines.append(
                f"Triangulated with these cameras, the {len(off_known)} points that two or more see lie "
                f"{np.median(off_known):.2f} mm (median) from where they are stated, at most {off[worst]:.2f} mm "
                f"({plain(labels[worst])})."
            )
            numbers["triangulated_mm"] = {n: float(x) for n, x in zip(labels, off, strict=True) if np.isfinite(x)}
    lines += [f"- {plain(w)}" for w in warned]
    if method == "points":
        names = [p.camera.name for p in places]
        errors = [[labels[i], *[_error(p.error_px[i], i in p.left_out) for p in places]] for i in range(len(labels))]
        lines += ["", "Errors of the clicks in pixels:", "", *table(["point", *names], errors)]
    numbers |= {
        "cameras": {
            p.camera.name: {
                "position_m": p.camera.position_m,
                "position_sd_m": p.position_sd_m,
                "turn_sd_rad": p.turn_sd_rad,
                "t95": p.t95,
                "click_sd_px": p.sd_px,
                "rms_px": p.rms_px,
                "left_out": [labels[i] for i in p.left_out],
                "error_px": {
                    n: float(np.hypot(*e)) for n, e in zip(labels, p.error_px, strict=True) if np.isfinite(e).all()
                },
            }
            for p in places
        },
        "findings": warned,
    }
    return cameras, CalibrationReport(numbers=numbers, lines=lines)


def _error(error: Array, left_out: bool) -> str:
    if not np.isfinite(error).all():
        return "-"
    return f"{np.hypot(*error):.2f}" + (" (not used)" if left_out else "")
