"""Runs side by side in one recording, frame by frame: two motion models, two digitisers, two settings."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from eal.arrays import Array
from mocap.errors import MocapError
from mocap.rerun import palette, paths
from mocap.rerun.blueprint import log_line, screen, series_view
from mocap.rerun.columns import log_over_time, numbered_from, recording_into, segments, single, ui
from mocap.rerun.landscape import MM_PER_M
from mocap.rerun.layout import play_fps, trail_length
from mocap.rerun.over_plane import PIXELS
from mocap.rerun.row_map import amounts, log_row_map, rms, row_map_view, usual_limit
from mocap.rerun.scene_views import eye, last_frames, world_view
from mocap.rerun.stored import Stored, read_recording, recording_file
from mocap.sides import words

APPLICATION = "mocap-compare"
COLORS = (palette.SKY_BLUE, palette.ORANGE, palette.GREEN, palette.PURPLE)
"""Of the runs, where they are shown together."""


Difference = tuple[tuple[str, ...], Array]
"""The M markers in common, and (M, T) distances in mm in the frames of the first run; NaN where one has no position."""


def write_comparison(runs: Sequence[Path], out: Path) -> None:
    """Put runs into one recording, each below a path of its own, with what differs between them.

    Frames are matched by their numbers, markers by their names; differences are to the first run.

    Raises:
        MocapError: too few or too many, one of them is no recording, or they share no marker.
    """
    stored, differences = stored_runs(runs)
    name = " - ".join(s.name for s in stored)
    blueprint = compare_blueprint(stored, differences)
    with recording_into(out, application=APPLICATION, recording_id=name, blueprint=blueprint) as rec:
        for number, run in enumerate(stored):
            rec.send_chunks([c.with_entity_path(f"{paths.run(number)}{c.entity_path}".rstrip("/")) for c in run.chunks])
            with numbered_from(run.first):
                # markers and bones in the colour of the run, for the scene that shows all of them
                path = paths.together(number)
                look = rr.Points3D.from_fields(colors=COLORS[number], radii=ui(3.0))
                log_over_time(rec, f"{path}/markers", run.t_s, rr.Points3D.columns(positions=single(run.xyz_m)), look)
                if run.bones:
                    look = rr.LineStrips3D.from_fields(colors=COLORS[number], radii=ui(1.5))
                    ends = run.xyz_m[:, np.array(run.bones)]  # (T, bones, 2, 3)
                    there = np.isfinite(ends).all(axis=(-1, -2))
                    columns = rr.LineStrips3D.columns(strips=segments(ends[there][:, 0], ends[there][:, 1]))
                    log_over_time(rec, f"{path}/bones", run.t_s, columns, look, counts=there.sum(axis=1))
        with numbered_from(stored[0].first):
            for number, (names, apart) in enumerate(differences, start=1):
                # distances as a map of all markers, and their root mean square over time
                t_s = stored[0].t_s
                log_row_map(rec, paths.difference(number), amounts(apart, usual_limit(apart)), names=names, t_s=t_s)
                log_line(
                    rec, f"{paths.APART}/{number}", t_s, rms(apart), name=stored[number].name, color=COLORS[number]
                )


def stored_runs(runs: Sequence[Path]) -> tuple[list[Stored], list[Difference]]:
    """Runs that are compared, and how far each but the first is from it.

    Raises:
        MocapError: too few or too many, one of them is no recording, or they share no marker.
    """
    if not 2 <= len(runs) <= len(COLORS):
        raise MocapError(f"{len(runs)} runs: 2 to {len(COLORS)} can be compared")
    stored = [read_recording(path, name=name) for path, name in zip(runs, run_names(runs), strict=True)]
    return stored, [difference_mm(stored[0], other) for other in stored[1:]]


def recording_of(runs: Sequence[Path], folder: Path) -> Path:
    """The recording of one run, or a comparison of several, which is written to a folder.

    Raises:
        MocapError: see ``write_comparison``.
    """
    if len(runs) == 1:
        return recording_file(runs[0])
    out = folder / "comparison.rrd"
    write_comparison(runs, out)
    return out


def run_names(runs: Sequence[Path]) -> list[str]:
    """Names that tell the runs apart: those of their folders or files, numbered where they are alike."""
    plain = [path.resolve().name if path.is_dir() else path.stem for path in runs]
    plain = [path.resolve().parent.name if n == "recording" else n for n, path in zip(plain, runs, strict=True)]
    return plain if len(set(plain)) == len(plain) else [f"{name} ({i + 1})" for i, name in enumerate(plain)]


def difference_mm(first: Stored, other: Stored) -> Difference:
    """How far the markers of two runs are apart.

    Raises:
        MocapError: they share no marker.
    """
    names = tuple(name for name in first.names if name in other.names)
    if not names:
        raise MocapError(f"{first.name} and {other.name} share no marker: compare runs of one recording")
    begin = max(first.first, other.first)
    end = max(min(first.first + len(first.t_s), other.first + len(other.t_s)), begin)
    a, b = (
        run.xyz_m[begin - run.first : end - run.first][:, [run.names.index(name) for name in names]]
        for run in (first, other)
    )
    apart = np.full((len(names), len(first.t_s)), np.nan)
    apart[:, begin - first.first : end - first.first] = MM_PER_M * np.linalg.norm(a - b, axis=-1).T
    return names, apart


def compare_blueprint(runs: Sequence[Stored], differences: Sequence[Difference]) -> rrb.Blueprint:
    """Tabs: Together, Side by side, Cameras, Joints, Filter diagnostics, Reports; a column a run."""
    # all bodies in one scene, and how far they are from the first
    colors = ("blue", "orange", "green", "purple")
    title = ", ".join(f"{run.name} {color}" for run, color in zip(runs, colors, strict=False))
    scene = _scene(runs, paths.TOGETHER, f"Scene (m): {title}", [f"{paths.TOGETHER}/**"], (paths.TOGETHER, 0))
    maps = [
        row_map_view(paths.difference(i), f"{runs[i].name} from {runs[0].name}: dark 0 to yellow {limit:.3g} mm")
        for i, limit in enumerate([usual_limit(apart) for _, apart in differences], start=1)
    ]
    lines = series_view(paths.APART, f"Distance from {runs[0].name}, rms of all markers (mm)")
    # the first cameras that all runs have, a row a camera
    common = [c for c in runs[0].below(paths.CAMERAS) if all(c in run.below(paths.CAMERAS) for run in runs)][:2]
    rows = []
    for camera in common:
        tiles = []
        for i, run in enumerate(runs):
            image, root = f"{paths.run(i)}{paths.CAMERAS}/{camera}/image", paths.run(i)
            contents = ["$origin/**", f"{root}{paths.SKELETON}", f"{root}{paths.MARKERS}/filled"]
            tile = rrb.Spatial2DView(
                origin=image,
                name=f"{run.name}, {camera} (px)",
                contents=contents,
                background=palette.GROUND,
                visual_bounds=_tile_bounds(run, f"{paths.CAMERAS}/{camera}/image/reprojected"),
            )
            tiles.append(tile)
        rows.append(rrb.Horizontal(*tiles))
    tabs = [
        rrb.Horizontal(scene, rrb.Vertical(*maps, lines), column_shares=[3, 2], name="Together"),
        _side_by_side(runs),
        *([rrb.Vertical(*rows, name="Cameras")] if rows else []),
        *_joints(runs),
        _health(runs),
    ]
    reports = [
        rrb.TextDocumentView(origin=f"{paths.run(i)}{paths.REPORT}", name=run.name) for i, run in enumerate(runs)
    ]
    content = rrb.Tabs(*tabs, rrb.Horizontal(*reports, name="Reports"), active_tab=0)
    return screen(content, fps=play_fps(len(runs[0].t_s)))


def _side_by_side(runs: Sequence[Stored]) -> rrb.Container:
    """A scene a run, and who was seen when."""
    frames = trail_length(len(runs[0].t_s))
    columns = []
    for i, run in enumerate(runs):
        root = paths.run(i)
        shown = [paths.SKELETON, paths.PATH, paths.TRAILS, f"{paths.MARKERS}/**", f"{paths.UNCERTAINTY}/**"]
        contents = [f"{root}{path}" for path in shown]
        scene = _scene(runs, f"{root}{paths.WORLD}", f"{run.name} (m)", contents, (f"{root}{paths.TRAILS}", frames))
        gaps = row_map_view(f"{root}{paths.GAP_MAP}", f"{run.name}: measured blue, filled yellow, rejected red")
        columns.append(rrb.Vertical(scene, gaps, row_shares=[3, 2]))
    return rrb.Horizontal(*columns, name="Side by side")


def _joints(runs: Sequence[Stored]) -> list[rrb.Container]:
    """Potentials of the joints that all runs have, from above, and V_z on the way."""
    common = [j for j in runs[0].below(paths.JOINTS) if all(j in run.below(paths.JOINTS) for run in runs)]
    tabs = []
    for joint in common:
        columns = []
        for i, run in enumerate(runs):
            root = f"{paths.run(i)}{paths.JOINTS}/{joint}"
            trail = last_frames(trail_length(len(run.t_s)))
            # the part of a view that holds a map, from where its image was put
            path = f"{paths.JOINTS}/{joint}/map/potential"
            corner, cell = (run.static(path, f"Transform3D:{part}")[0] for part in ("translation", "scale"))
            try:
                shape = run.static(path, "Image:format")[0]  # of a recording of before November 2026
            except KeyError:
                shape = {"width": PIXELS, "height": PIXELS}
            ends = [(corner[k], corner[k] + cell[k] * shape[side]) for k, side in enumerate(("width", "height"))]
            heat_map = rrb.Spatial2DView(
                origin=f"{root}/map",
                name=f"{run.name}, {words(joint)}",
                background=palette.GROUND,
                visual_bounds=rrb.VisualBounds2D(x_range=ends[0], y_range=ends[1]),
                overrides={f"{root}/map/trail": trail},
            )
            value = series_view(f"{root}/series/potential", f"{run.name}, {words(joint)}: joint potential")
            columns.append(rrb.Vertical(heat_map, value, row_shares=[5, 2]))
        tabs.append(rrb.Horizontal(*columns, name=joint))
    return [rrb.Tabs(*tabs, active_tab=0, name="Joints")] if tabs else []


def _tile_bounds(run: Stored, path: str) -> rrb.VisualBounds2D | None:
    """The part of an image that holds nearly all of the motion; None where there is none."""
    uv_px = run.points2d(path)
    if not len(uv_px):
        return None
    low, high = np.quantile(uv_px, (0.005, 0.995), axis=0)
    margin = 0.15 * max(high - low)
    return rrb.VisualBounds2D(x_range=[low[0] - margin, high[0] + margin], y_range=[low[1] - margin, high[1] + margin])


def _health(runs: Sequence[Stored]) -> rrb.Container:
    series = (
        (paths.NIS, "squared prediction error over its expected value (NIS), 95 % band"),
        (paths.LOG_LIKELIHOOD, "log-likelihood (nat)"),
    )
    columns = [
        rrb.Vertical(*(series_view(f"{paths.run(i)}{path}", f"{run.name}: {what}") for path, what in series))
        for i, run in enumerate(runs)
    ]
    return rrb.Horizontal(*columns, name="Filter diagnostics")


def _scene(
    runs: Sequence[Stored],
    origin: str,
    name: str,
    contents: Sequence[str],
    trail: tuple[str, int],
) -> rrb.View:
    points = np.concatenate([run.xyz_m.reshape(-1, 3) for run in runs])
    points = points[np.isfinite(points).all(axis=1)]
    low, high = np.quantile(points, (0.005, 0.995), axis=0) if len(points) else np.zeros((2, 3))
    radius_m, up = max(float(np.linalg.norm(high - low)) / 2, 1e-3), runs[0].up
    height_m = float(min(low @ up, high @ up)) - 0.3 * radius_m
    return world_view(
        origin,
        name,
        contents=contents,
        ground=(up, height_m, radius_m),
        look=eye((low + high) / 2, 1.75 * radius_m, up),
        trail=trail,
    )
