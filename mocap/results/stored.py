"""A tracked recording as files from which it is restored, and its markers as the package movement lays out poses."""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from mocap.cameras.camera import Camera
from mocap.cameras.lens import MODELS, Lens
from mocap.cleaning.cleaned import Cleaned
from mocap.documents import from_json
from mocap.errors import FormatError, beside
from mocap.io.netcdf import as_netcdf, read_netcdf, variables
from mocap.io.tables import WORDS
from mocap.json_records import AGAIN, plain, record
from mocap.parts import Part
from mocap.reading.decided import Decided
from mocap.reading.reading import in_arguments
from mocap.reading.session import Siblings
from mocap.recording import Source, with_variables
from mocap.records import Status
from mocap.results.earlier import WITHOUT_PARTS, earlier_parts
from mocap.results.files import MARKERS, RECORDING, SKELETON
from mocap.schema import POSITIVE, Entry, Schema, checked, names, tables
from mocap.skeleton import read_skeleton, write_skeleton
from mocap.tracking.model_choice import ModelChoice
from mocap.tracking.potentials import Potentials
from mocap.tracking.report_part import Report
from mocap.tracking.result import Result
from mocap.variables import SIZES, VARIABLES, entry_of

INDIVIDUAL = "id_0"
"""The only animal of a recording, as movement names it."""


def markers_dataset(run: Result) -> xr.Dataset:
    """Positions of all markers with their uncertainty and where each comes from.

    Variables, with the dimensions ``time`` (s), ``space`` (x, y, z), ``keypoint`` (markers) and ``individual``, as in
    movement (Sirmpilatze et al. 2025), version 0.17:

    - ``position`` (time, space, keypoint, individual) in metres; NaN where there is none;
    - ``covariance`` (time, space, space_to, keypoint, individual) in square metres;
    - ``confidence`` (time, keypoint, individual), which movement asks for: NaN, since the covariance says more;
    - ``status`` (time, keypoint, individual): whether measured, predicted, smoothed (a filled gap), rejected, missing;
      its attributes ``flag_values`` and ``flag_meanings`` name the codes (CF conventions);
    - ``repaired`` (time, keypoint, individual): 1 where a sample bore another marker's name in the file, 2 where a
      person corrected it (``edited`` in tables);
    - ``edited`` (time, keypoint, individual): True where it is 2, as movement's own editor states it.
    """
    markers, t_s = run.tracks, run.t_s
    fps = (len(t_s) - 1) / float(t_s[-1] - t_s[0]) if len(t_s) > 1 else 1.0
    flags = {"flag_values": np.array([int(o) for o in Status], dtype=np.int8), "flag_meanings": " ".join(WORDS)}
    sample = ("time", "keypoint", "individual")
    return xr.Dataset(
        {
            "position": (
                ("time", "space", "keypoint", "individual"),
                np.moveaxis(markers.xyz_m, 1, 2)[..., None],
                {"units": "m"},
            ),
            "confidence": (sample, np.full((*markers.status.shape, 1), np.nan)),
            "covariance": (
                ("time", "space", "space_to", "keypoint", "individual"),
                np.moveaxis(markers.cov_m2, 1, 3)[..., None],
                {"units": "m2"},
            ),
            "status": (sample, markers.status[..., None], flags),
            "repaired": (sample, run.repaired[..., None].astype(np.int8)),
            "edited": (sample, run.repaired[..., None] == 2),
        },
        coords={
            "time": ("time", t_s, {"units": "s"}),
            "frame": ("time", np.arange(1, len(t_s) + 1)),
            "space": ["x", "y", "z"],
            "space_to": ["x", "y", "z"],
            "keypoint": list(markers.names),
            "individual": [INDIVIDUAL],
        },
        attrs={
            "source_software": "eal-mocap",
            "ds_type": "poses",
            "fps": fps,
            "time_unit": "seconds",
            "space_unit": "m",
            "motion_model": run.model,
        },
    )


def plane_dataset(run: Result) -> xr.Dataset:
    """As ``markers_dataset``, in x and y, in the unit of the plane."""
    assert run.plane is not None
    unit, factor = run.plane.unit, run.plane.per_m
    found = markers_dataset(run).sel(space=["x", "y"], space_to=["x", "y"])
    found["position"] = (factor * found["position"]).assign_attrs(units=unit)
    found["covariance"] = (factor**2 * found["covariance"]).assign_attrs(units=f"{unit}2")
    return found.assign_attrs(space_unit=unit)


FORMAT = "eal-mocap recording 2"
PARTS: Mapping[str, type] = {
    "decided": Decided,
    "siblings": Siblings,
    "cleaned": Cleaned,
    "model": ModelChoice,
    "potentials": Potentials,
    "report": Report,
}
"""Parts that are kept, by their names in the header, each after those that it depends on."""
LOOSE = ("point_covariance", "pair_covariance")
"""Not packed: in single precision they would hardly be smaller."""

_NEEDED = ("position", "covariance", "status", "repaired", "nis", "n_rows", "log_likelihood")
_MOTION = ("point_position", "velocity", "point_covariance", "pairs", "pair_covariance", "velocity_change", "measured")
_COORDINATES: Schema = {
    "time": Entry(shape=("time",), rising=True, filled=True),
    "frame": Entry(kind="i", shape=("time",), least=0),
    "keypoint": names("keypoint", filled=True),
    "point": names("point", filled=True),
    **{name: names(name, needed=False) for name in ("view", "reason", "joint", "angle", "segment")},
    "limb": Entry(kind="s", shape=("limb",), needed=False),
}
_HEADER: Schema = {"name": Entry(kind="s"), "model": Entry(kind="s"), "y_up": Entry(kind="b")}
_CAMERA: Schema = {
    "name": Entry(kind="s"),
    "matrix": Entry(shape=(3, 4)),
    "size_px": Entry(kind="i", shape=(2,), least=1, needed=False),
    "lens": Entry(kind="s", words=tuple(MODELS), needed=False),
    "f_px": Entry(shape=(2,), least=POSITIVE, needed=False),
    "centre_px": Entry(shape=(2,), needed=False),
    "coefficients": Entry(shape=(None,), needed=False),
}


def write_arrays(recording: Result, folder: Path) -> None:
    """Write what ``read_recording`` needs beside ``report.json`` and ``report.md``, and ``markers.nc`` for others."""
    header = {
        "format": FORMAT,
        "name": recording.name,
        "model": recording.model,
        "y_up": recording.y_up,
        "cameras": [
            {"name": c.name, "matrix": c.matrix.tolist(), "size_px": c.size_px} | _lens(c.lens)
            for c in recording.cameras
        ],
        "source": plain(recording.source.by_names()),
        "parts": {name: recording[kind].to_file(folder) for name, kind in PARTS.items() if kind in recording},
    }
    data = recording.data.assign_attrs(header=json.dumps(header))
    (folder / RECORDING).write_bytes(as_netcdf(data, packed=True, loose=LOOSE))
    (folder / MARKERS).write_bytes(as_netcdf(markers_dataset(recording), packed=True))
    write_skeleton(folder / SKELETON, recording.skeleton)


def read_recording(folder: Path) -> Result:
    """Read what ``write_arrays`` wrote, of this format or the one before (``mocap.results.earlier``); all but movies.

    Raises:
        FormatError: the folder holds no result, or one of another version.
    """
    if not folder.is_dir():
        trouble = "is a file" if folder.exists() else f"there is no such folder{beside(folder)}"
        raise FormatError(f"{folder}: {trouble}: give a folder that `mocap track` or save() wrote")
    for name in (RECORDING, MARKERS, SKELETON, "report.json", "report.md"):
        if not (folder / name).is_file():
            raise FormatError(
                f"{folder}: contains no {name}: expected a folder that `mocap track` or save() of this version wrote"
            )
    path = folder / RECORDING
    found = read_netcdf(path, again=AGAIN)
    header = from_json(str(found.attrs.get("header", "{}")), str(path), finite=False)
    format = header.get("format") if isinstance(header, dict) else header
    if format not in (FORMAT, WITHOUT_PARTS):
        raise FormatError(f"{path}: is {format}, expected {FORMAT}: track again with this version")
    header |= earlier_parts(header, folder) if format == WITHOUT_PARTS else {}
    where = f"{path}: header"
    entries = checked(where, header, _HEADER, again=AGAIN)
    cameras = tuple(
        Camera(
            name=c["name"][()],
            matrix=c["matrix"],
            lens=_lens_of(c, where),
            size_px=tuple(c["size_px"].tolist()) if "size_px" in c else None,
        )
        for c in tables(f"{where}: cameras", header.get("cameras"), _CAMERA, again=AGAIN)
    )
    data = _data(path, found)
    if cameras and (data.sizes.get("view") != len(cameras) or not {"ideal", "reprojected", "used"} <= set(data)):
        raise FormatError(f"{path}: has not the pixels of its {len(cameras)} cameras: {AGAIN}")
    skeleton = read_skeleton(folder / SKELETON).for_markers(tuple(data["keypoint"].values), source=path.name)
    joints = [joint.name for joint in skeleton.joints]
    if joints != (data["joint"].values.tolist() if "joint" in data.coords else []):
        raise FormatError(f"{folder / SKELETON}: has other joints than {path.name}: {AGAIN}")
    found_parts = _parts(header.get("parts"), folder, f"{where}: parts")
    known = found_parts.get(Potentials)
    if known is not None and not {*known.planar, *known.spatial} <= set(joints):  # type: ignore[attr-defined]
        raise FormatError(f"{where}: has potentials of joints that {SKELETON} has not: {AGAIN}")
    source = record(Source, header.get("source"), f"{where}: source")
    return Result(
        name=entries["name"][()],
        data=data.assign_attrs(model=entries["model"][()], y_up=int(entries["y_up"])),
        skeleton=skeleton,
        cameras=cameras,
        source=replace(source, folder=folder),
        parts=found_parts,
    )


def _parts(found: Any, folder: Path, where: str) -> dict[type, Part]:
    """What each step found.

    Raises:
        FormatError: a part is not as it was written.
    """
    if not isinstance(found, dict) or not found.keys() <= PARTS.keys():
        raise FormatError(f"{where}: expected a table of {', '.join(PARTS)}: {AGAIN}")
    there = {name: kind for name, kind in PARTS.items() if name in found}
    parts = {kind: kind.of_file(found[name], folder, f"{where}: {name}") for name, kind in there.items()}
    if isinstance(report := parts.get(Report), Report):
        parts[Report] = replace(report, text=in_arguments(report.text))
    return parts


def _data(path: Path, found: xr.Dataset) -> xr.Dataset:
    """The Dataset of a recording, each variable as it is declared.

    Raises:
        FormatError: a variable is missing, or not as declared.
    """
    sizes = dict(SIZES)
    empty = {name: found[name].astype(object) for name in _COORDINATES if name in found and not found[name].size}
    coordinates = variables(str(path), found.assign_coords(empty), _COORDINATES, sizes=sizes, again=AGAIN)
    there = [name for name in VARIABLES if name in found or name in (*_NEEDED, *_MOTION)]
    values = variables(str(path), found, {name: entry_of(name) for name in there}, sizes=sizes, again=AGAIN)
    values["status"] = values["status"].astype(np.int8)
    for name in LOOSE:  # velocities may be unknown where positions are not
        parts = {f"{name}[{i}, {j}]": values[name][..., i : i + 3, j : j + 3] for i in (0, 3) for j in (0, 3)}
        checked(str(path), parts, dict.fromkeys(parts, Entry(shape=(None, None, 3, 3), missing=2)), again=AGAIN)
    attrs = {name: found.attrs[name] for name in ("fps", "space_unit", "format") if name in found.attrs}
    kept = {name: ("time" if name == "frame" else name, values) for name, values in coordinates.items()}
    data = with_variables(xr.Dataset(coords=kept, attrs=attrs), values)
    data["time"].attrs["units"] = "s"
    return data


def _lens(lens: Lens | None) -> dict[str, Any]:
    if lens is None:
        return {}
    return {
        "lens": lens.model,
        "f_px": lens.f_px,
        "centre_px": lens.centre_px,
        "coefficients": lens.coefficients.tolist(),
    }


def _lens_of(entries: Mapping[str, Any], where: str) -> Lens | None:
    """The lens of a camera's record; None: it has none."""
    parts = [entries.get(name) for name in ("f_px", "centre_px", "coefficients")]
    if "lens" not in entries:
        return None
    model = MODELS[entries["lens"][()]]
    if any(part is None for part in parts) or len(parts[2]) != model.n_coefficients:  # type: ignore[arg-type]
        raise FormatError(f"{where}: cameras: a {model.model} lens has not its {model.n_coefficients} numbers: {AGAIN}")
    f_px, centre_px, coefficients = (part.tolist() for part in parts)  # type: ignore[union-attr]
    return model.of(f_px, centre_px, coefficients)
