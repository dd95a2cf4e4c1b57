"""A run as files: tables, report and recording."""

import csv
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from mocap.io.csv_table import as_cells, decimals_of
from mocap.io.netcdf import as_netcdf
from mocap.io.profile import write_profile
from mocap.io.tables import origin_words
from mocap.joints import FRAMES
from mocap.kinematics.cycles import Cycle, cycles_table, mean_angles
from mocap.kinematics.extremes import cycle_statistics
from mocap.kinematics.records import WORDS as REST_WORDS
from mocap.kinematics.records import Kinematics
from mocap.reading.decided import decided
from mocap.reading.reading import in_options
from mocap.records import MarkerTracks
from mocap.results.stored import plane_dataset, write_arrays
from mocap.tracking.result import Result

if TYPE_CHECKING:
    import pandas as pd

LENSES = "camera_profile.txt"
"""Lenses that were estimated from the recording, for other trials of its cameras, and for one camera."""
ENERGIES = ("energy_j", "v_z", "v_z_bound")
"""Columns of a Lagrangian."""


def write_run(run: Result, folder: Path, *, write_recording: Callable[[Result, Path], None] | None) -> None:
    """Write tables, arrays (``.nc``), the report, the skeleton, potentials and ``recording.rrd``."""
    write_arrays(run, folder)
    write_markers(run.tracks, run.repaired, folder / "markers.csv")
    write_joints(run, folder / "joints.csv")
    if run.angles is not None:
        table = angle_table(run.angles)
        table.to_csv(folder / "joint_angles.csv", index=False, float_format="%.6g", lineterminator="\n")
    write_report(run, folder)
    how = decided(run)
    if how.lens is not None and how.rows is not None:
        y_up = how.rows.coefficients == "lower-left"
        write_profile(folder / LENSES, how.lens.cameras(run.cameras, y_up=y_up))
    if write_recording is not None:
        write_recording(run, folder / "recording.rrd")


def write_plane(run: Result, folder: Path) -> None:
    """Write ``markers.csv``, ``markers.nc``, ``report.json`` and ``report.md``.

    ``markers.csv`` has a row a frame: ``frame``, ``t_s``, then ``<name>_x, _y, _sd`` and ``_origin`` a marker, in
    metres; or ``<name>_x_px, _y_px, _sd_px`` where no scale is stated.
    """
    assert run.plane is not None
    xy, cov = run.plane.in_units(run.tracks)
    sd, tail = np.sqrt(np.trace(cov, axis1=-2, axis2=-1) / 2), "_px" if run.plane.unit == "px" else ""
    write_positions(run.tracks, xy, sd, run.repaired, folder / "markers.csv", tail=tail)
    (folder / "markers.nc").write_bytes(as_netcdf(plane_dataset(run), packed=True))
    write_report(run, folder)


def write_report(run: Result, folder: Path) -> None:
    """``report.json`` and ``report.md``."""
    (folder / "report.json").write_text(json.dumps(run.report, indent=1, allow_nan=False), encoding="utf-8")
    (folder / "report.md").write_text(in_options(run.report_text), encoding="utf-8")


def write_markers(markers: MarkerTracks, repaired: NDArray[np.int8], path: Path) -> None:
    """A row a frame: ``frame`` (from 1), ``t_s``, then ``<name>_x, _y, _z, _sd`` in metres and ``_origin`` a marker.

    Measured samples that bore another marker's name in the file (``repaired`` is 1) have the origin ``repaired``, those
    that a person corrected (2) ``edited``.
    """
    write_positions(markers, markers.xyz_m, markers.sd_m, repaired, path)


def write_positions(
    markers: MarkerTracks, x: np.ndarray, sd: np.ndarray, repaired: NDArray[np.int8], path: Path, *, tail: str = ""
) -> None:
    """``markers.csv`` of (T, M, 2 or 3) positions with (T, M) deviations, in a unit that ``tail`` names."""
    columns, words = {}, origin_words(markers.status, repaired)
    for i, name in enumerate(markers.names):
        parts = {**dict(zip("xyz", x[:, i].T, strict=False)), "sd": sd[:, i]}
        columns |= {f"{name}_{part}{tail}": column_text(values, sd[:, i]) for part, values in parts.items()}
        columns[f"{name}_origin"] = words[:, i]
    write_columns(path, markers.t_s, columns)


def write_joints(run: Result, path: Path) -> None:
    """A row a frame: ``frame``, ``t_s``, then ``<joint>_<frame>_x, _y[, _z]`` and ``<joint>_sd`` in metres."""
    columns = {}
    for i, joint in enumerate(j.name for j in run.skeleton.joints):
        sd = run.data["joint_sd"].values[:, i]
        for frame in FRAMES:
            values = zip("xyz", run.joints_m(frame)[joint].T, strict=False)
            columns |= {f"{joint}_{frame}_{axis}": column_text(one, sd) for axis, one in values}
        columns[f"{joint}_sd"] = column_text(sd, sd)
    write_columns(path, run.t_s, columns)


def angle_table(angles: xr.Dataset) -> "pd.DataFrame":
    """A row a frame: ``frame`` (from 1), ``t_s``, then ``<name>_deg`` and ``<name>_deg_sd``; then energies."""
    import pandas as pd  # a quarter of a second, which a description of a table does without

    table = {"frame": np.arange(1, angles.sizes["time"] + 1), "t_s": angles["time"].values}
    for i, name in enumerate(angles["angle"].values):
        of = {f"{name}_deg": "angle_rad", f"{name}_deg_sd": "angle_sd_rad"}
        table |= {title: np.degrees(angles[one].values[:, i]) for title, one in of.items()}
    if "energies" in angles:
        table |= dict(zip(ENERGIES, angles["energies"].values.T, strict=True))
    return pd.DataFrame(table)


def write_kinematics(found: Kinematics, folder: Path, *, stem: str = "kinematics") -> None:
    """``<stem>.csv``, a row a frame with ``<quantity>_<unit>``, ``..._sd`` and ``..._status``; ``<stem>.nc``.

    Values have as many digits as their smallest standard deviation is worth, two of it.
    """
    columns, words = {}, np.array(REST_WORDS)
    for one in found.quantities:
        positive = one.sd[np.isfinite(one.sd) & (one.sd > 0)]
        digits = 6 if not len(positive) else int(np.clip(2 - np.floor(np.log10(positive.min())), 0, 9))
        value, sd = _text(one.value, digits), _text(one.sd, digits)
        columns |= {one.name: value, f"{one.name}_sd": sd, f"{one.name}_status": words[one.rests]}
    write_columns(folder / f"{stem}.csv", found.t_s, columns)
    (folder / f"{stem}.nc").write_bytes(as_netcdf(found.to_dataset(), packed=True))


def cycle_tables(found: Kinematics, rows: Sequence[Cycle]) -> "dict[str, pd.DataFrame]":
    """``cycles.csv`` and ``angles.csv``: a row a cycle, as mixed models are fed (``mocap.kinematics.cycles``).

    ``peaks.csv``: a row for each cycle, quantity and statistic (``mocap.kinematics.extremes``).
    """
    return {
        "cycles.csv": cycles_table(rows),
        "angles.csv": mean_angles(found, rows),
        "peaks.csv": cycle_statistics(found, rows),
    }


def write_cycles(found: Kinematics, rows: Sequence[Cycle], folder: Path) -> None:
    """Write these tables."""
    for name, table in cycle_tables(found, rows).items():
        write_table(table, folder / name)


def write_table(table: "pd.DataFrame", path: Path) -> None:
    """Six digits, UTF-8."""
    path.write_text(table.to_csv(index=False, float_format="%.6g", lineterminator="\n"), encoding="utf-8", newline="")


def column_text(values: np.ndarray, sd: np.ndarray) -> np.ndarray:
    """A column as text: seven decimals, and more where two digits of the smallest (T,) deviation ``sd`` need them."""
    return _text(np.where(np.isfinite(values), values, np.nan), decimals_of(values, sd, least=7))


def _text(values: np.ndarray, decimals: int) -> np.ndarray:
    form = f"%.{decimals}f\n" * len(values)  # all in one call: NumPy's formatting takes three times as long
    return np.array((form % tuple(values.tolist())).replace("nan", "NaN").split("\n")[:-1], dtype=object)


def write_columns(path: Path, t_s: np.ndarray, columns: dict[str, np.ndarray]) -> None:
    """A row a frame: ``frame`` (from 1), ``t_s``, then columns of text."""
    head = {"frame": np.arange(1, len(t_s) + 1).astype(str), "t_s": np.char.mod("%.9g", t_s)}
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(as_cells([*head, *columns]))
        writer.writerows(zip(*(column.tolist() for column in (head | columns).values()), strict=True))
