"""Files that belong together: pixels with their calibration, one camera a file, points beside pixels."""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.bounds import check_stated
from mocap.errors import FormatError
from mocap.io.contents import FileContents, pixel_recording, points_of
from mocap.io.format import Hints
from mocap.io.lines import read_lines
from mocap.io.registry import read, write, writer
from mocap.records import PixelCorner
from mocap.text import number_of, visible


def joined(recordings: Sequence[FileContents]) -> FileContents:
    """One recording from all of them.

    Pixel files of one camera each become one recording with a camera a file, in the order given (or in that of the
    calibration, where its cameras are named so), lenses of one camera each one set, by the numbers in their files'
    names. A calibration, lenses, points, residuals, intervals and offsets go
    with the pixels.

    Raises:
        FormatError: two files hold the same, or the files do not belong together.
    """
    recordings = _without_wand(_one_rig(_one_set_of_lenses(recordings)))
    pixels = [r for r in recordings if r.pixels is not None]
    base = _views(pixels, recordings) if pixels else next((r for r in recordings if r.points is not None), None)
    if base is None:
        base, *rest = recordings
    else:
        rest = [r for r in recordings if r is not base and r not in pixels]
    for other in rest:
        base = _with(base, other)
    return base


def _one_set_of_lenses(recordings: Sequence[FileContents]) -> list[FileContents]:
    """The recordings with Tforms files, which hold a lens each, put together."""
    single = [r for r in recordings if r.lenses and not r.cameras and r.pixels is None and len(r.lenses) == 1]
    if len(single) < 2:
        return list(recordings)
    numbers = [re.search(r"cam(\d+)", r.paths[0].name, re.IGNORECASE) for r in single]
    if all(numbers):
        order = np.argsort([int(number[1]) for number in numbers if number])
        single = [single[i] for i in order]
    names = tuple(f"cam{c + 1}" for c in range(len(single)))
    return _as_one(recordings, single, camera_names=names, lenses=tuple(r.lenses[0] for r in single))


def _as_one(recordings: Sequence[FileContents], single: Sequence[FileContents], **parts: object) -> list[FileContents]:
    paths = tuple(path for r in single for path in r.paths)
    findings = tuple(dict.fromkeys(f for r in single for f in r.findings))
    whole = replace(single[0], paths=paths, findings=findings, **parts)  # type: ignore[arg-type]
    return [*(r for r in recordings if r not in single), whole]


def _without_wand(recordings: Sequence[FileContents]) -> list[FileContents]:
    """Beside files of pixels an easyWand file is a calibration: its wand is left out."""
    if all(r.format == "easywand" or r.pixels is None for r in recordings):
        return list(recordings)
    return [
        replace(r, pixels=None, names=(), frames=np.zeros(0, dtype=np.int64), fps=None) if r.format == "easywand" else r
        for r in recordings
    ]


def _one_rig(recordings: Sequence[FileContents]) -> list[FileContents]:
    """The recordings with calibrations of one camera each put together."""
    single = [r for r in recordings if len(r.cameras) == 1 and r.pixels is None]
    if len(single) < 2:
        return list(recordings)
    names = [r.camera_names[0] for r in single]
    if len(set(names)) != len(names):
        raise FormatError(
            f"{single[0].paths[0].name}: two cameras are called {max(names, key=names.count)!r}: rename one"
        )
    return _as_one(recordings, single, camera_names=tuple(names), cameras=tuple(r.cameras[0] for r in single))


def _views(pixels: Sequence[FileContents], recordings: Sequence[FileContents]) -> FileContents:
    if len(pixels) == 1:
        return pixels[0]
    several = next((r for r in pixels if len(r.camera_names) != 1), None)
    if several is not None:
        raise FormatError(
            f"{several.paths[0].name}: contains {len(several.camera_names)} cameras; when several pixel files are "
            "given, each must contain one"
        )
    pixels = _sides(pixels)
    calibrated = next((r.camera_names for r in recordings if r.cameras and r not in pixels), ())
    names = [_view_name(r, calibrated) for r in pixels]
    if set(names) == set(calibrated):
        pixels = [pixels[names.index(name)] for name in calibrated]
        names = list(calibrated)
    if len(set(names)) != len(names):
        names = [f"cam{c + 1}" for c in range(len(pixels))]
    markers = list(dict.fromkeys(name for r in pixels for name in r.names))
    frames, views = _on_common_frames(pixels)
    table = np.full((len(pixels), len(frames), len(markers), 3), np.nan)
    for c, (r, view) in enumerate(zip(pixels, views, strict=True)):
        table[c][:, [markers.index(name) for name in r.names]] = view
    lengths = [len(r.frames) for r in pixels]
    findings = [f for r in pixels for f in r.findings]
    if len(set(lengths)) > 1:
        findings.append(f"the views have {min(lengths)} to {max(lengths)} frames: they are matched by frame number")
    alone = [name for name in markers if sum(name in r.names for r in pixels) < 2]
    if alone:
        findings.append(f"only one view has the markers {', '.join(alone[:8])}{', ...' if len(alone) > 8 else ''}")
    origins: set[PixelCorner | None] = {r.pixel_origin for r in pixels}
    found = _of_files(pixels, markers, names, frames, table, origins.pop() if len(origins) == 1 else None, findings)
    return replace(found, animals=pixels[0].animals) if list(pixels[0].names) == markers else found


def _on_common_frames(pixels: Sequence[FileContents]) -> tuple[NDArray[np.int64], list[Array]]:
    """(T,) frames that any of some files of one camera each has, and of each (T, M, 3) pixels and scores in them."""
    frames = np.unique(np.concatenate([r.frames for r in pixels]))
    views = []
    for r in pixels:
        view = np.full((len(frames), len(r.names), 3), np.nan)
        rows = np.searchsorted(frames, r.frames)
        view[rows, :, :2] = r.pixels.uv_px[0] if r.pixels is not None else np.nan
        view[rows, :, 2] = r.score[0] if r.score is not None else np.nan
        views.append(view)
    return frames, views


def _of_files(
    files: Sequence[FileContents],
    names: Sequence[str],
    cameras: Sequence[str],
    frames: NDArray[np.int64],
    table: Array,
    origin: PixelCorner | None,
    findings: Sequence[str],
) -> FileContents:
    """One recording of (C, T, M, 3) pixels and scores from several files, with the times of the first."""
    first = files[0]
    found = pixel_recording(
        first.paths[0],
        first.format,
        names=names,
        cameras=cameras,
        uv_px=table[..., :2],
        frames=frames,
        first=int(frames[0]) if first.fps is None else int(first.frames[0]),
        fps=first.fps,
        pixel_origin=origin,
        score=None if np.isnan(table[..., 2]).all() else table[..., 2],
        findings=tuple(dict.fromkeys(findings)),
    )
    return replace(found, paths=tuple(path for r in files for path in r.paths))


_SIDE = re.compile(r"[ _.-]*(left|right)(?![a-z])", re.IGNORECASE)


def _sides(pixels: Sequence[FileContents]) -> list[FileContents]:
    """Files of the left and the right side of one view put together, their markers named by the side."""
    groups: dict[str, list[FileContents]] = {}
    for r in pixels:
        groups.setdefault(_SIDE.sub("", str(r.paths[0])), []).append(r)
    if max(map(len, groups.values())) < 2:
        return list(pixels)
    out = []
    for files in groups.values():
        frames, views = _on_common_frames(files)
        sides = [_SIDE.search(r.paths[0].name) for r in files]
        names = [f"{n}_{s[1].lower()}" if s else n for s, r in zip(sides, files, strict=True) for n in r.names]
        findings, table = [f for r in files for f in r.findings], np.concatenate(views, axis=1)[None]
        first = files[0]
        out.append(_of_files(files, names, first.camera_names, frames, table, first.pixel_origin, findings))
    return out


def _view_name(recording: FileContents, calibrated: Sequence[str]) -> str:
    """Name of a view: that of the calibrated camera which the path names, else as the file says."""
    path: Path = recording.paths[0].absolute()
    in_stem = [c for c in calibrated if re.search(rf"{re.escape(c)}(?!\d)", path.stem, re.IGNORECASE)]
    if len(in_stem) == 1:
        return in_stem[0]
    named = [name for name in calibrated if name in (recording.camera_names[0], path.parent.name)]
    named = named or [name for name in calibrated if name.lower() in path.stem.lower()]
    return named[0] if len(named) == 1 else recording.camera_names[0]


def _with(base: FileContents, other: FileContents) -> FileContents:
    """The base with what the other file holds."""
    where = f"{other.paths[0].name} beside {base.paths[0].name}"
    changes: dict[str, object] = {"paths": base.paths + other.paths}
    if other.cameras or other.lenses:
        counts = {len(base.camera_names) or len(other.camera_names), len(other.camera_names)}
        if len(counts) > 1:
            raise FormatError(
                f"{where}: {len(other.camera_names)} cameras calibrated, {len(base.camera_names)} in the pixels: give "
                "the calibration of this recording"
            )
        if other.cameras and base.cameras:
            raise FormatError(f"{where}: both contain a calibration: give only one")
        order = [other.camera_names.index(n) for n in base.camera_names if n in other.camera_names]
        order = order if len(order) == len(other.camera_names) else list(range(len(other.camera_names)))
        changes["camera_names"] = base.camera_names or other.camera_names
        if other.cameras:
            changes["cameras"], changes["unit"] = tuple(other.cameras[i] for i in order), base.unit or other.unit
        else:
            changes["lenses"] = tuple(other.lenses[i] for i in order)
    if other.points is not None:
        if base.points is not None and set(other.names) == set(base.names):
            raise FormatError(f"{where}: {_versions(base, other)}: give one of them")
        if base.points is not None or len(other.frames) != len(base.frames) or set(other.names) != set(base.names):
            raise FormatError(
                f"{where}: {len(other.frames)} frames of {len(other.names)} points beside {len(base.frames)} of "
                f"{len(base.names)}: the files do not belong together"
            )
        pick = [other.names.index(name) for name in base.names]
        points = other.points
        changes["points"] = replace(
            points,
            names=base.names,
            t_s=base.pixels.t_s if base.pixels is not None else points.t_s,
            xyz_m=points.xyz_m[:, pick],
            cov_m2=points.cov_m2[:, pick],
            status=points.status[:, pick],
        )
        changes["unit"] = base.unit or other.unit
    elif other.tables:
        changes["tables"] = {**base.tables, **_tables(base, other, where)}
    elif not (other.cameras or other.lenses) and other.names and len(other.names) == len(base.names):
        return replace(base, **changes).renamed(other.names)  # type: ignore[arg-type]
    merged = replace(base, **changes)  # type: ignore[arg-type]
    if not (merged.cameras and merged.lenses) or base.lenses:
        return merged
    pairs = zip(merged.cameras, merged.lenses, strict=True)
    cameras = (replace(c, lens=lens.if_bent, size_px=size or c.size_px) for c, (lens, size) in pairs)
    return replace(merged, cameras=tuple(cameras))


def _versions(base: FileContents, other: FileContents) -> str:
    frames, i, j = np.intersect1d(base.frames, other.frames, return_indices=True)
    pick = [other.names.index(name) for name in base.names]
    a, b = points_of(base.paths[0], base).xyz_m[i], points_of(other.paths[0], other).xyz_m[j][:, pick]
    seen_a, seen_b = np.isfinite(a[..., 0]), np.isfinite(b[..., 0])
    both = seen_a & seen_b
    if not both.any():
        return f"both contain positions of the same {len(pick)} points"
    off = np.linalg.norm(a - b, axis=-1)[both]
    same = int((off <= 2e-6 * max(1.0, float(np.nanmax(np.abs(a))))).sum())
    filled = ", ".join(
        f"{number_of(count, 'sample is', 'samples are')} only in {r.paths[0].name}"
        for r, count in ((base, int((seen_a & ~seen_b).sum())), (other, int((seen_b & ~seen_a).sum())))
        if count
    )
    return (
        f"both contain positions of the same {len(pick)} points in {len(frames)} common frames, {same} of {both.sum()} "
        f"common samples are identical{f', {filled}' if filled else ''}: two versions of one recording"
    )


def _tables(base: FileContents, other: FileContents, where: str) -> dict[str, Array]:
    if len(other.frames) != len(base.frames) or (other.names and set(other.names) != set(base.names)):
        raise FormatError(
            f"{where}: {len(other.frames)} rows of {len(other.names)} points beside {len(base.frames)} of "
            f"{len(base.names)}: the files do not belong together, or one is a part of a recording"
        )
    pick = [other.names.index(name) for name in base.names] if other.names else []
    return {name: table if name == "offset_frames" else table[:, pick] for name, table in other.tables.items()}


def convert_files(
    files: Sequence[Path],
    out: Path,
    *,
    hints: Hints,
    to: str | None = None,
    fps: float | None = None,
    unit: str | None = None,
    filled: bool = False,
    contents: FileContents | None = None,
) -> dict[str, Any]:
    """Read, join and write.

    Args:
        files: Files of any format.
        out: File to write, as ``mocap.io.output.result_file`` gives it; DLTdv's set has its name's beginning.
        hints: What the user states of the files.
        to: Format, as ``filled`` an argument of ``mocap.io.registry.write``.
        fps: Frames a second; replaces what the files say.
        unit: Of lengths, where the files do not state it.
        filled: See above.
        contents: What is written in place of what the files hold; None: that.

    Returns:
        ``format``, names of the files ``written``, ``remarks`` on what is not held or held otherwise, ``findings``.

    Raises:
        MocapError: a file cannot be read, the format cannot hold it, or a file exists.
    """
    check_stated("fps", fps)
    format = writer(out, to)
    hints = replace(hints, fps=fps)
    recording = joined([read(path, hints) for path in files]) if contents is None else contents
    if not (recording.names or recording.cameras or recording.bodies):
        raise recording.without_markers()
    recording = recording if fps is None else recording.with_rate(fps)
    recording = recording if unit is None else recording.with_unit(unit)
    remarks = write(recording, out, format.name, filled=filled)
    return {
        "format": format.name,
        "written": [path.name for path in format.files(out, recording)],
        "remarks": remarks,
        "findings": list(recording.remarks),
    }


def point_names(given: Path | Sequence[str], count: int) -> list[str]:
    """The names of so many points, in their order.

    They are given as a list; as a text with a name a line (``pointnames.txt``), or all in one, between commas or
    tabs; or by a file of any known format.

    Raises:
        FormatError: there are not as many, or one appears twice.
    """
    where = given.name if isinstance(given, Path) else "`names`"
    if not isinstance(given, Path):
        names = list(given)
    else:
        try:
            names = list(read(given).names)
        except FormatError:
            lines = [line.strip() for line in read_lines(given) if line.strip()]
            cells = lines if len(lines) > 1 else lines[0].replace("\t", ",").split(",")
            names = [visible(cell.strip().strip('"')) for cell in cells]
    if len(names) != count:
        raise FormatError(
            f"{where}: {len(names)} names for {count} points of the recording: give one name a line, in its order"
        )
    if len(set(names)) != count:
        raise FormatError(f"{where}: {max(names, key=names.count)!r} appears twice: rename one")
    return names
