"""Markers of one film, in the plane of its picture: tables, dataset and report, two coordinates each."""

import json
from pathlib import Path

import numpy as np
import xarray as xr

from mocap.io.netcdf import as_netcdf
from mocap.io.tables import origin_words
from mocap.pipeline.plane import in_units
from mocap.pipeline.reading import in_options
from mocap.pipeline.recording import Recording
from mocap.results.dataset import markers_dataset
from mocap.results.tables import column_text, write_columns


def plane_dataset(run: Recording) -> xr.Dataset:
    """As ``markers_dataset``, in x and y, in the unit of the plane."""
    assert run.plane is not None
    unit, factor = run.plane.unit, run.plane.per_m
    found = markers_dataset(run).sel(space=["x", "y"], space_to=["x", "y"])
    found["position"] = (factor * found["position"]).assign_attrs(units=unit)
    found["covariance"] = (factor**2 * found["covariance"]).assign_attrs(units=f"{unit}2")
    return found.assign_attrs(space_unit=unit)


def write_plane(run: Recording, folder: Path) -> None:
    """Write ``markers.csv``, ``markers.nc``, ``report.json`` and ``report.md``.

    ``markers.csv`` has a row a frame: ``frame``, ``t_s``, then ``<name>_x, _y, _sd`` and ``_origin`` a marker, in
    metres; or ``<name>_x_px, _y_px, _sd_px`` where no scale is stated.
    """
    assert run.plane is not None
    markers, (xy, cov) = run.tracks, in_units(run, run.plane)
    sd = np.sqrt(np.trace(cov, axis1=-2, axis2=-1) / 2)
    tail = "_px" if run.plane.unit == "px" else ""
    words = origin_words(markers.status, run.repaired)
    columns = {}
    for i, name in enumerate(markers.names):
        values = (xy[:, i, 0], xy[:, i, 1], sd[:, i])
        for field, value in zip(("x", "y", "sd"), values, strict=True):
            columns[f"{name}_{field}{tail}"] = column_text(value, sd[:, i])
        columns[f"{name}_origin"] = words[:, i]
    write_columns(folder / "markers.csv", markers.t_s, columns)
    (folder / "markers.nc").write_bytes(as_netcdf(plane_dataset(run), packed=True))
    (folder / "report.json").write_text(json.dumps(run.report, indent=1, allow_nan=False), encoding="utf-8")
    (folder / "report.md").write_text(in_options(run.report_text), encoding="utf-8")
