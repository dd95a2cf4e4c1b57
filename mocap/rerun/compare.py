"""Runs side by side in one recording, frame by frame: two motion models, two digitisers, two settings."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from mocap.arrays import Array
from mocap.errors import MocapError
from mocap.rerun import palette, paths
from mocap.rerun.camera_errors import usual_limit
from mocap.rerun.columns import numbered_from, segments, single, time_columns
from mocap.rerun.compare_layout import compare_blueprint
from mocap.rerun.landscape import MM_PER_M
from mocap.rerun.row_map import amounts, log_row_map, rms
from mocap.rerun.series import log_line
from mocap.rerun.stored import Stored, read_recording, recording_file
from mocap.rerun.stream import recording_into

APPLICATION = "mocap-compare"
COLORS = (palette.SKY_BLUE, palette.ORANGE, palette.GREEN, palette.PURPLE)
"""Of the runs, where they are shown together."""


Difference = tuple[tuple[str, ...], Array]
"""The M markers in common, and (M, T) distances in mm in the frames of the first run; NaN where one has no position."""


def write_comparison(runs: Sequence[Path], out: Path) -> None:
    """Put runs into one recording, each below a path of its own, with what differs between them.

    Frames are matched by their numbers, markers by their names; differences are to the first run.

    Args:
        runs: Two to four folders of runs, or their recordings.
        out: The ``.rrd`` to write; its folder exists.

    Raises:
        MocapError: too few or too many, one of them is no recording, or they share no marker.
    """
    stored, differences = _read(runs)
    name = " - ".join(s.name for s in stored)
    blueprint = _blueprint(stored, differences)
    with recording_into(out, application=APPLICATION, recording_id=name, blueprint=blueprint) as rec:
        for number, run in enumerate(stored):
            rec.send_chunks([c.with_entity_path(f"{paths.run(number)}{c.entity_path}".rstrip("/")) for c in run.chunks])
            with numbered_from(run.first):
                _log_body(rec, number, run)
        with numbered_from(stored[0].first):
            for number, (names, apart) in enumerate(differences, start=1):
                _log_difference(rec, number, stored[number].name, stored[0].t_s, names, apart)


def comparison_blueprint(runs: Sequence[Path]) -> rrb.Blueprint:
    """What is where on the screen; raises as ``write_comparison``."""
    return _blueprint(*_read(runs))


def _read(runs: Sequence[Path]) -> tuple[list[Stored], list[Difference]]:
    if not 2 <= len(runs) <= len(COLORS):
        raise MocapError(f"{len(runs)} runs: 2 to {len(COLORS)} can be compared")
    stored = [read_recording(path, name=name) for path, name in zip(runs, run_names(runs), strict=True)]
    return stored, [difference_mm(stored[0], other) for other in stored[1:]]


def _blueprint(stored: Sequence[Stored], differences: Sequence[Difference]) -> rrb.Blueprint:
    return compare_blueprint(stored, [usual_limit(apart) for _, apart in differences])


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


def _log_body(rec: rr.RecordingStream, number: int, run: Stored) -> None:
    """Markers and bones in the colour of the run, for the scene that shows all of them."""
    path, ui, index = paths.together(number), rr.components.Radius.ui_points, time_columns(run.t_s)
    rec.log(f"{path}/markers", rr.Points3D.from_fields(colors=COLORS[number], radii=ui(3.0)), static=True)
    rec.send_columns(f"{path}/markers", indexes=index, columns=rr.Points3D.columns(positions=single(run.xyz_m)))
    if run.bones:
        rec.log(f"{path}/bones", rr.LineStrips3D.from_fields(colors=COLORS[number], radii=ui(1.5)), static=True)
        ends = run.xyz_m[:, np.array(run.bones)]  # (T, bones, 2, 3)
        there = np.isfinite(ends).all(axis=(-1, -2))
        columns = rr.LineStrips3D.columns(strips=segments(ends[there][:, 0], ends[there][:, 1]))
        rec.send_columns(f"{path}/bones", indexes=index, columns=columns.partition(there.sum(axis=1)))


def _log_difference(
    rec: rr.RecordingStream, number: int, name: str, t_s: Array, names: tuple[str, ...], apart: Array
) -> None:
    """Distances as a map of all markers, and their root mean square over time."""
    log_row_map(rec, paths.difference(number), amounts(apart, usual_limit(apart)), names=names, t_s=t_s)
    log_line(rec, f"{paths.APART}/{number}", t_s, rms(apart), name=name, color=COLORS[number])
