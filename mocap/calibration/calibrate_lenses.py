"""Each camera's lens from its own images or video of a board, taken at any time."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mocap.calibration.boards import KINDS, Board, BoardViews, CameraImages, Corners, detect, of_files, pictures_of
from mocap.calibration.calibration_files import CalibrationReport, number, of_pictures, table
from mocap.calibration.intrinsics import CHOICES, Intrinsics, fit_intrinsics, without_ray
from mocap.cameras.camera import KnownLens
from mocap.errors import CalibrationError
from mocap.io.movies import FILMS, Movie, open_movie
from mocap.text import plain


def lenses_from_pictures(
    folder: Path, board: Board, *, lens: str = "auto", tell: Callable[[str], None] = lambda _: None
) -> tuple[tuple[KnownLens, ...], CalibrationReport]:
    """Images or videos of a board to the lens of each camera, by its own images alone.

    Args:
        folder: A folder or a video a camera, or images named by camera and number.
        board: The board.
        lens: One of ``CHOICES``, or ``auto``: chosen on images left out of the fit.
        tell: Told of each camera.

    Raises:
        CalibrationError: too few images show the board, or they do not determine the lens; with advice.
    """
    if lens not in ("auto", *CHOICES):
        raise CalibrationError(f"`lens` {lens!r} is not a lens model: give auto, {', '.join(CHOICES)}")
    choices = tuple(CHOICES) if lens == "auto" else (lens,)
    board, views = detect(board_pictures(folder), board, progress=tell)
    fits: dict[str, Intrinsics] = {}
    views = {name: replace(seen, corners=_distinct(seen)) for name, seen in views.items()}
    for name, seen in views.items():
        found = fit_intrinsics(list(seen.corners.values()), seen.size_px, name=name, choices=choices)
        _refuse(name, found, seen)
        tell(f"{name}: {found.choice} lens, f {found.lens.f_px[0]:.1f} ± {found.f_sd_px:.1f} px, {found.rms_px:.3f} px")
        fits[name] = found
    lenses = tuple(
        KnownLens(name=n, lens=f.lens, size_px=views[n].size_px, free=f.free, cov=f.cov) for n, f in fits.items()
    )
    return lenses, _report(lenses, fits, views)


def _distinct(seen: BoardViews) -> dict[str, Corners]:
    """Views whose boards moved from every earlier one kept: a board held still in a video is one view, not many."""
    kept: dict[str, Corners] = {}
    least = 0.01 * max(seen.size_px)  # a board that moved by less is seen as before
    for label, corners in seen.corners.items():
        if all(_moved_px(corners, other) > least for other in kept.values()):
            kept[label] = corners
    return kept


def _moved_px(one: Corners, other: Corners) -> float:
    _, i, j = np.intersect1d(one.ids, other.ids, return_indices=True)
    return float(np.median(np.hypot(*(one.uv_px[i] - other.uv_px[j]).T))) if len(i) else np.inf


def board_pictures(folder: Path) -> dict[str, CameraImages]:
    """Images by camera; of a video some frames, evenly spaced.

    A camera is a folder (of images and videos, however deep), a video in ``folder``, or the name in front of the number
    of an image in ``folder``.

    Raises:
        CalibrationError: there is neither an image nor a video.
        FormatError: a video cannot be read.
    """
    if not folder.is_dir():
        raise CalibrationError(f"{folder}: there is no such folder: give the folder of the images or videos")
    films: dict[str, list[Path]] = defaultdict(list)
    for path in sorted(p for p in folder.rglob("*") if p.suffix.lower() in FILMS and p.is_file()):
        inside = path.relative_to(folder)
        films[inside.parts[0] if len(inside.parts) > 1 else path.stem].append(path)
    any_picture = any(p.suffix.lower() in KINDS and p.is_file() for p in folder.rglob("*"))
    if not films and not any_picture:
        raise CalibrationError(
            f"{folder}: contains no images and no videos; expected a folder or a video for each camera"
        )
    pictures = pictures_of(folder, instants=False) if any_picture else {}
    return {
        camera: _joined([*([of_files(pictures[camera])] if camera in pictures else []), *map(_of_film, films[camera])])
        for camera in sorted({*pictures, *films})
    }


def _of_film(path: Path) -> CameraImages:
    movie = open_movie(path)
    count = min(movie.n_frames, 80)  # evenly spaced
    frames = np.unique(np.linspace(0, movie.n_frames - 1, count).round().astype(np.int64))
    return CameraImages(
        labels=tuple(f"{path.name} frame {f + 1}" for f in frames), read=lambda wanted: _grey(movie, frames[wanted])
    )


def _grey(movie: Movie, frames: NDArray[np.int64]) -> Iterator[NDArray[np.uint8]]:
    for frame in movie.frames(frames):
        if frame is not None:
            yield np.asarray(frame.to_ndarray(format="gray"), dtype=np.uint8)


def _joined(parts: Sequence[CameraImages]) -> CameraImages:
    if len(parts) == 1:
        return parts[0]
    ends = np.cumsum([len(p.labels) for p in parts])

    def read(wanted: Sequence[int]) -> Iterator[NDArray[np.uint8]]:
        at = np.asarray(wanted)
        for part, end in zip(parts, ends, strict=True):
            own = at[(at >= end - len(part.labels)) & (at < end)] - (end - len(part.labels))
            yield from part.read(own.tolist())

    return CameraImages(labels=tuple(label for p in parts for label in p.labels), read=read)


def _refuse(name: str, found: Intrinsics, seen: BoardViews) -> None:
    if found.f_sd_px > 0.03 * found.lens.f_px[0]:
        raise CalibrationError(
            f"camera {name!r}: its images do not determine its focal length ({found.lens.f_px[0]:.0f} +- "
            f"{found.f_sd_px:.0f} px): tilt the board by 30 degrees or more in some images"
        )
    if found.rms_px > 2e-3 * max(seen.size_px):
        raise CalibrationError(
            f"camera {name!r}: the RMS reprojection error of corners is {found.rms_px:.1f} px, where their "
            "detection is accurate to tenths of a pixel: check that all images are "
            "this camera's, at one zoom and focus, none cropped, and the board flat"
        )


def _report(
    lenses: Sequence[KnownLens], fits: dict[str, Intrinsics], views: dict[str, BoardViews]
) -> CalibrationReport:
    rows, warned = [], []
    images = {name: dict(zip(views[name].corners, fit.image_px, strict=True)) for name, fit in fits.items()}
    left_out = {n: {list(views[n].corners)[i]: why for i, why in fit.left_out.items()} for n, fit in fits.items()}
    for k in lenses:
        found, seen = fits[k.name], views[k.name]
        sd = k.sd
        rows.append(
            [
                k.name,
                len(seen.corners) - len(found.left_out),
                found.choice,
                f"{k.lens.f_px[0]:.1f} ± {sd[0]:.1f}",
                f"{k.lens.centre_px[0]:.1f} ± {sd[2]:.1f}, {k.lens.centre_px[1]:.1f} ± {sd[3]:.1f}",
                f"{k.lens.coefficients[0]:.4f} ± {sd[4]:.4f}",
                f"{found.rms_px:.3f}",
                f"{found.held_out_px[found.choice]:.3f}" if found.held_out_px else "-",
            ]
        )
        warned += [f"{k.name} {label} was left out: {why}" for label, why in left_out[k.name].items()]
        if share := without_ray(k.lens, seen.size_px):
            warned.append(f"{k.name}: {share * 100:.1f} % of the image lies outside the range of the lens model")
        corners = np.concatenate([c.uv_px for c in seen.corners.values()])
        reach = np.ptp(corners, axis=0) / np.asarray(seen.size_px)
        if (reach < 0.6).any():
            warned.append(
                f"{k.name}: the board was held in {reach[0] * 100:.0f} % of the image's width and "
                f"{reach[1] * 100:.0f} % of its height; outside of it the lens is extrapolated"
            )
    lines = [
        f"# Lenses of {len(lenses)} cameras, each from its own images",
        "",
        *table(
            [
                "camera",
                "boards",
                "lens",
                "f px",
                "principal point px",
                "k1",
                "RMS px",
                "held-out px",
            ],
            rows,
        ),
        "± is one standard deviation; corners of one image are taken to err together. Boards that did not move "
        "between images count once. Pixels are counted from the upper left, the centre of the first pixel at (0, 0). "
        "Where the cameras stand is not in these images: mocap calibrate places.",
        "",
        *of_pictures(images),
        *(f"- {plain(w)}" for w in warned),
    ]
    numbers = {
        "method": "lenses",
        "cameras": {
            k.name: {
                "lens": k.lens.model,
                "choice": fits[k.name].choice,
                "f_px": k.lens.f_px,
                "centre_px": k.lens.centre_px,
                "distortion": k.lens.coefficients,
                "sd": k.sd,
                "rms_px": fits[k.name].rms_px,
                "pictures": len(views[k.name].corners) - len(fits[k.name].left_out),
                "image_rms_px": {label: number(px) for label, px in images[k.name].items()},
                "left_out": left_out[k.name],
                "missed": views[k.name].missed,
                "held_out_px": {c: number(v) for c, v in fits[k.name].held_out_px.items()},
            }
            for k in lenses
        },
        "findings": warned,
    }
    return CalibrationReport(numbers=numbers, lines=lines)
