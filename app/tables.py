"""A run as files: tables, report and recording, all there or none."""

import csv
import json
import shutil
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.run import Run
from mocap.errors import MocapError
from mocap.formats.cells import as_cells
from mocap.formats.digits import decimals_of
from mocap.records import MarkerTracks, Origin

OURS = {"markers.csv", "joints.csv", "report.json", "report.md", "potentials", "recording.rrd"}
"""All that a run's folder holds."""


def check_target(path: Path, *, force: bool, inputs: Iterable[Path | None] = (), folder: bool = True) -> None:
    """Refuse to write over what exists, and over the input whatever is asked.

    Args:
        path: File or folder to write.
        force: Whether what exists may be replaced.
        inputs: Files that are read; None is skipped.
        folder: Whether a folder will be written.

    Raises:
        MocapError: ``path`` is or holds an input, or exists and may not be replaced.
    """
    target = path.resolve()
    for read in [*(p.resolve() for p in inputs if p is not None), Path.cwd()]:
        if target == read or (folder and target in read.parents):
            raise MocapError(f"{path} is or holds {read}, which is read from: give another --out")
    if not path.exists():
        return
    if not force:
        raise MocapError(f"{path} exists: give --force to replace it, or another --out")
    if path.is_dir() != folder:
        raise MocapError(f"{path} is a {'folder' if path.is_dir() else 'file'}: give another --out")


def write_run(run: Run, folder: Path, *, write_recording: Callable[[Run, Path], None], force: bool = False) -> None:
    """Write ``markers.csv``, ``joints.csv``, ``report.json``, ``report.md`` and ``recording.rrd``.

    All is written to a temporary folder beside the target and renamed when whole. Of a folder that exists an earlier
    run is replaced; whatever else it holds stays.

    Raises:
        MocapError: the folder exists and ``force`` is not given, or it cannot be written.
    """
    check_target(folder, force=force)
    old = folder.with_name(f".{folder.name}.old")
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    except OSError as error:
        raise MocapError(f"{folder}: cannot be written: {error.strerror}; give another --out") from None
    try:
        write_markers(run.tracked.markers, run.repaired, temporary / "markers.csv")
        write_joints(run, temporary / "joints.csv")
        (temporary / "report.json").write_text(json.dumps(run.report, indent=1, allow_nan=False), encoding="utf-8")
        (temporary / "report.md").write_text(run.report_text, encoding="utf-8")
        for name, potential in run.potentials.items():
            (temporary / "potentials").mkdir(exist_ok=True)
            potential.potential.save(temporary / "potentials" / f"{name}.npz")
        write_recording(run, temporary / "recording.rrd")
        temporary.chmod(0o755)
        if folder.exists():
            for stranger in folder.iterdir():
                if stranger.name not in OURS:
                    shutil.move(stranger, temporary / stranger.name)
            folder.replace(old)
        temporary.replace(folder)
        shutil.rmtree(old, ignore_errors=True)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        if old.exists() and not folder.exists():
            old.replace(folder)
        raise


def write_markers(markers: MarkerTracks, repaired: NDArray[np.bool_], path: Path) -> None:
    """A row a frame: ``frame`` (from 1), ``t_s``, then ``<name>_x, _y, _z, _sd`` in metres and ``_origin`` a marker.

    Measured samples that bore another marker's name in the file, (T, M) ``repaired``, have the origin ``repaired``.
    """
    header = ["frame", "t_s"]
    columns = [np.arange(1, len(markers.t_s) + 1).astype(str), np.char.mod("%.9g", markers.t_s)]
    words = np.array([o.name.lower() for o in Origin], dtype="U12")[markers.origin]
    words[repaired & (markers.origin == Origin.MEASURED)] = "repaired"
    sd = markers.sd_m
    for i, name in enumerate(markers.names):
        header += [f"{name}_{field}" for field in ("x", "y", "z", "sd", "origin")]
        columns += [_text(markers.xyz_m[:, i, k], sd[:, i]) for k in range(3)]
        columns += [_text(sd[:, i], sd[:, i]), words[:, i]]
    _write(path, header, columns)


def write_joints(run: Run, path: Path) -> None:
    """A row a frame: ``frame``, ``t_s``, then ``<joint>_<frame>_x, _y[, _z]`` and ``<joint>_sd`` in metres."""
    t_s = run.tracked.markers.t_s
    header = ["frame", "t_s"]
    columns = [np.arange(1, len(t_s) + 1).astype(str), np.char.mod("%.9g", t_s)]
    for i, joint in enumerate(j.name for j in run.skeleton.joints):
        for frame, tracks in run.joints.items():
            for k in range(tracks.q_m.shape[2]):
                header.append(f"{joint}_{frame}_{'xyz'[k]}")
                columns.append(_text(tracks.q_m[:, i, k], run.joints["world"].sd_m[:, i]))
        header.append(f"{joint}_sd")
        columns.append(_text(run.joints["world"].sd_m[:, i], run.joints["world"].sd_m[:, i]))
    _write(path, header, columns)


def _text(values: np.ndarray, sd: np.ndarray) -> np.ndarray:
    """A column as text: seven decimals, and more where two digits of the smallest (T,) deviation ``sd`` need them."""
    form = f"%.{decimals_of(values, sd, least=7)}f"
    return np.where(np.isfinite(values), np.char.mod(form, np.nan_to_num(values)), "NaN")


def _write(path: Path, header: list[str], columns: list[np.ndarray]) -> None:
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(as_cells(header))
        writer.writerows(np.stack(columns, axis=1).tolist())
