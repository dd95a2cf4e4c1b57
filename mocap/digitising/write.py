"""What digitising found, as files: DLTdv's tables, the clicks, what is asked next, and a report."""

import csv
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mocap.cameras.lens import BrownLens
from mocap.digitising.asking import Question, pixel_sd
from mocap.digitising.clicks import places, write_clicks
from mocap.digitising.engine import Engine
from mocap.io.anipose import write_calibration
from mocap.io.csv_table import write_table
from mocap.io.dltdv import write_coefficients, write_pixels, write_points
from mocap.io.profile import write_profile
from mocap.records import MarkerTracks, PixelTracks
from mocap.skeleton import write_skeleton
from mocap.text import number_of

Report = dict[str, object]


def named_pixels(engine: Engine, fps: float) -> PixelTracks:
    """(C, T, M) places of named dots and of clicks, as recorded; a dot that may be two markers' in one is none's."""
    tracks, shape = engine.tracks, engine.tracks.dot.shape
    uv_px = np.full((*shape, 2), np.nan)
    camera = np.arange(shape[0])[:, None]
    for frame, dots in enumerate(tracks.dots):
        if dots.shape[1]:
            chosen = tracks.dot[:, frame]
            found = dots[camera, np.maximum(chosen, 0), :2]
            own = (chosen >= 0) & ~tracks.merged[:, frame]
            uv_px[:, frame] = np.where(own[..., None], found, np.nan)
    clicked = places(engine.clicks, shape)
    uv_px = np.where(np.isnan(uv_px) & np.isfinite(clicked), clicked, uv_px)
    names = tuple(c.name for c in engine.cameras)
    return PixelTracks(names=engine.names, cameras=names, t_s=np.arange(shape[1]) / fps, uv_px=uv_px)


def report_of(engine: Engine, error_px: float) -> Report:
    """Numbers of the report."""
    tracks = engine.tracks
    n_frames, n_markers = tracks.rays.shape
    sd = pixel_sd(engine)
    unnamed = 0
    for frame, dots in enumerate(tracks.dots):
        unnamed += int(np.isfinite(dots[..., 0]).sum() - (tracks.dot[:, frame] >= 0).sum())
    look = engine.look
    return {
        "frames": n_frames,
        "markers": n_markers,
        "cameras": len(engine.cameras),
        "films": [movie.path.name for movie in engine.videos.movies],
        "offset_frames": list(engine.videos.offset_frames),
        "clicks": sum(click.uv_px is not None for click in engine.clicks),
        "not_to_be_seen": sum(click.uv_px is None for click in engine.clicks),
        "clicks_per_100": 100 * len(engine.clicks) / max(n_frames * n_markers, 1),
        "dot_radius_px": None if look is None else look.radius_px,
        "dots_are": None if look is None else "bright" if look.bright else "dark",
        "dot_sd_px": engine.observer.sd_px,
        "textures": [name for name, bare in zip(engine.names, engine.observer.textured, strict=True) if bare],
        "unnamed_dots": unnamed,
        "error_px": error_px,
        "markers_found": {
            name: {
                "in_two_cameras": float((tracks.rays[:, m] >= 2).mean()),
                "known_well_enough": float((sd[:, m] <= error_px).mean()),
                "doubtful_frames": int(tracks.doubtful[:, m].sum()),
            }
            for m, name in enumerate(engine.names)
        },
        "known_well_enough": float((sd <= error_px).mean()),
    }


def _dots(report: Report) -> list[str]:
    found = []
    if report["dots_are"] is not None:
        found.append(
            f"Dots are {report['dots_are']}, of {report['dot_radius_px']} px radius; a coordinate has a standard "
            f"deviation of {report['dot_sd_px']:.2f} px. {report['unnamed_dots']} dots were left unnamed."
        )
    bare = report["textures"]
    if isinstance(bare, list) and bare:
        found.append(
            f"No dot was found where {', '.join(bare)} {'was' if len(bare) == 1 else 'were'} clicked: followed by "
            "texture. If there are dots, the clicks do not belong to these videos, or count rows from the lower left "
            "corner."
        )
    return found


def report_text(report: Report, questions: Sequence[Question], names: Sequence[str]) -> str:
    """The report as markdown."""
    found = report["markers_found"]
    lines = [
        "# Digitised videos",
        "",
        f"{report['frames']} frames of {report['cameras']} cameras, {report['markers']} markers; {report['clicks']} "
        f"clicks ({report['clicks_per_100']:.2f} a 100 marker-frames), {report['not_to_be_seen']} answers 'not to be "
        "seen'.",
        *_dots(report),
        f"{100 * float(str(report['known_well_enough'])):.1f} % of all positions are known to "
        f"{report['error_px']:g} px (standard deviation in every image).",
        "",
        "| marker | in two cameras or more % | known well enough % | doubtful frames |",
        "|---|---|---|---|",
    ]
    rows = found if isinstance(found, dict) else {}
    lines += [
        f"| {name} | {100 * row['in_two_cameras']:.1f} | {100 * row['known_well_enough']:.1f} | "
        f"{row['doubtful_frames']} |"
        for name, row in rows.items()
    ]
    lines += [
        "",
        f"{number_of(len(questions), 'click is', 'clicks are')} asked for next (`asked.csv`)."
        if questions
        else "No click is asked for.",
    ]
    for q in questions[:5]:
        lines.append(f"- {names[q.marker]} in frame {q.frame + 1} of camera {q.camera + 1}")
    return "\n".join([*lines, ""])


def write_digitised(
    folder: Path,
    engine: Engine,
    pixels: PixelTracks,
    points: MarkerTracks,
    report: Report,
    questions: Sequence[Question],
) -> None:
    """Write all files of a result into an empty folder."""
    fps = 1 / float(pixels.t_s[1] - pixels.t_s[0]) if len(pixels.t_s) > 1 else 1.0
    write_pixels(folder / "xypts.csv", pixels)
    write_points(folder / "xyzpts.csv", points, sd=True)
    n_frames = len(pixels.t_s)
    offsets = np.broadcast_to(np.array(engine.videos.offset_frames, dtype=float), (n_frames, len(engine.cameras)))
    write_table(folder / "offsets.csv", [f"cam{c}_offset" for c in range(1, offsets.shape[1] + 1)], offsets)
    write_coefficients(folder / "dltCoefs.csv", engine.cameras)
    sized = all(camera.size_px is not None for camera in engine.cameras)
    if sized and all(isinstance(camera.lens, BrownLens) for camera in engine.cameras):
        write_profile(folder / "camera_profile.txt", engine.cameras)
    if all(camera.lens is not None and camera.size_px is not None for camera in engine.cameras):
        write_calibration(folder / "calibration.toml", engine.cameras)
    write_skeleton(folder / "skeleton.toml", engine.skeleton)
    write_clicks(
        folder / "clicks_xypts.csv",
        engine.clicks,
        names=engine.names,
        cameras=pixels.cameras,
        n_frames=n_frames,
        fps=fps,
    )
    _write_origin(folder / "origin.csv", engine, pixels, points)
    with (folder / "asked.csv").open("w", encoding="utf-8", newline="") as stream:
        table = csv.writer(stream)
        table.writerow(["camera", "frame", "marker", "u_px", "v_px", "sd_px"])
        for q in questions:
            sd = float(np.sqrt(np.trace(q.cov_px2) / 2))
            table.writerow(
                [q.camera + 1, q.frame + 1, engine.names[q.marker], *(f"{x:.2f}" for x in q.uv_px), f"{sd:.2f}"]
            )
    (folder / "report.json").write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    (folder / "report.md").write_text(report_text(report, questions, engine.names), encoding="utf-8")


def _write_origin(path: Path, engine: Engine, pixels: PixelTracks, points: MarkerTracks) -> None:
    """Where each sample is from, for each camera, and the standard deviation in space.

    By hand: ``click`` (clicked, dragged, or given another name) and ``deleted``; else ``dot`` or nothing.
    """
    shape = engine.tracks.dot.shape
    clicked, deleted = np.isfinite(places(engine.clicks, shape)[..., 0]), np.zeros(shape, dtype=bool)
    for click in engine.clicks:
        deleted[click.camera, click.frame, click.marker] = click.uv_px is None
    origin = np.where(clicked, "click", np.where(deleted, "deleted", np.where(pixels.seen, "dot", "")))
    n_cameras, n_frames, n_markers = origin.shape
    with path.open("w", encoding="utf-8", newline="") as stream:
        table = csv.writer(stream)
        header = ["frame"]
        for name in pixels.names:
            header += [*(f"{name}_cam{c + 1}" for c in range(n_cameras)), f"{name}_sd_m"]
        table.writerow(header)
        sd = points.sd_m
        for frame in range(n_frames):
            row: list[str] = [str(frame + 1)]
            for m in range(n_markers):
                row += [*origin[:, frame, m].tolist(), f"{sd[frame, m]:.3g}"]
            table.writerow(row)
