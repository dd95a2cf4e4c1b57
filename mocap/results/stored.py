"""A tracked recording as files from which it is restored, and its markers as the package movement lays out poses."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from eal import load_potential
from eal.archive import ArchiveError
from mocap.cameras.camera import Camera
from mocap.cameras.lens import MODELS, Lens
from mocap.documents import from_json, regular_bytes
from mocap.errors import FormatError, beside
from mocap.findings import Finding, Kind
from mocap.io.netcdf import as_netcdf, read_netcdf, variables
from mocap.io.tables import WORDS
from mocap.joints import FRAMES
from mocap.pipeline.potentials import JointPotential
from mocap.pipeline.recording import Recording, with_variables
from mocap.pipeline.variables import SIZES, VARIABLES, entry_of
from mocap.records import Status
from mocap.results.earlier import EARLIER, earlier_record
from mocap.schema import POSITIVE, Entry, Schema, checked, names, tables
from mocap.skeleton import read_skeleton, write_skeleton
from mocap.text import file_names

INDIVIDUAL = "id_0"
"""The only animal of a recording, as movement names it."""


def markers_dataset(run: Recording) -> xr.Dataset:
    """Positions of all markers with their uncertainty and where each comes from.

    Variables, with the dimensions ``time`` (s), ``space`` (x, y, z), ``keypoint`` (markers) and ``individual``, as in
    movement (Sirmpilatze et al. 2025), version 0.17:

    - ``position`` (time, space, keypoint, individual) in metres; NaN where there is none;
    - ``covariance`` (time, space, space_to, keypoint, individual) in square metres;
    - ``confidence`` (time, keypoint, individual), which movement asks for: NaN, since the covariance says more;
    - ``status`` (time, keypoint, individual): whether measured, predicted, smoothed (a filled gap), rejected, missing;
      its attributes ``flag_values`` and ``flag_meanings`` name the codes (CF conventions);
    - ``repaired`` (time, keypoint, individual): 1 where a sample bore another marker's name in the file, 2 where a
      person corrected it (``edited`` in tables).
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


def plane_dataset(run: Recording) -> xr.Dataset:
    """As ``markers_dataset``, in x and y, in the unit of the plane."""
    assert run.plane is not None
    unit, factor = run.plane.unit, run.plane.per_m
    found = markers_dataset(run).sel(space=["x", "y"], space_to=["x", "y"])
    found["position"] = (factor * found["position"]).assign_attrs(units=unit)
    found["covariance"] = (factor**2 * found["covariance"]).assign_attrs(units=f"{unit}2")
    return found.assign_attrs(space_unit=unit)


FORMAT = "eal-mocap recording 1"
RECORDING, MARKERS, SKELETON = "recording.nc", "markers.nc", "skeleton.toml"
PLANAR, SPATIAL = "potentials", "spatial_potentials"
"""Folders of potentials in the planes of limbs, and in the three coordinates of the body."""
LOOSE = ("point_covariance", "pair_covariance")
"""Not packed: in single precision they would hardly be smaller."""

_AGAIN = "track again"
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
_FINDING: Schema = {
    "kind": Entry(kind="s", words=tuple(Kind)),
    "text": Entry(kind="s"),
    "alarm": Entry(kind="b"),
    "cameras": Entry(kind="s", shape=(None,)),
    "markers": Entry(kind="s", shape=(None,)),
    "frames": Entry(kind="i", shape=(None,)),
    "mends": Entry(kind="s", shape=(None,), needed=False),
}
_POTENTIAL: Schema = {"frame": Entry(kind="s", words=FRAMES), "scale_m": Entry(least=POSITIVE)}


def write_arrays(recording: Recording, folder: Path) -> None:
    """Write what ``read_recording`` needs beside ``report.json`` and ``report.md``, and ``markers.nc`` for others."""
    kinds = {PLANAR: recording.potentials, SPATIAL: recording.spatial_potentials}
    header = {
        "format": FORMAT,
        "name": recording.name,
        "model": recording.model,
        "y_up": recording.y_up,
        "cameras": [
            {"name": c.name, "matrix": c.matrix.tolist(), "size_px": c.size_px} | _lens(c.lens)
            for c in recording.cameras
        ],
        "findings": [one.as_json() for one in recording.findings],
        "potentials": {
            kind: {name: {"frame": p.frame, "scale_m": p.scale_m} for name, p in potentials.items()}
            for kind, potentials in kinds.items()
        },
    }
    data = recording.data.assign_attrs(header=json.dumps(header))
    (folder / RECORDING).write_bytes(as_netcdf(data, packed=True, loose=LOOSE))
    (folder / MARKERS).write_bytes(as_netcdf(markers_dataset(recording), packed=True))
    write_skeleton(folder / SKELETON, recording.skeleton)
    for kind, potentials in kinds.items():
        for name, potential in zip(file_names(potentials), potentials.values(), strict=True):
            (folder / kind).mkdir(exist_ok=True)
            potential.potential.save(folder / kind / f"{name}.npz")


def read_recording(folder: Path) -> Recording:
    """Read what ``write_arrays`` wrote, of this version or the one before; all but movies.

    Raises:
        FormatError: the folder holds no result, or one of another version.
    """
    if not folder.is_dir():
        trouble = "is a file" if folder.exists() else f"there is no such folder{beside(folder)}"
        raise FormatError(f"{folder}: {trouble}: give a folder that `mocap track` or save() wrote")
    early = not (folder / RECORDING).is_file() and (folder / EARLIER).is_file()
    for name in (EARLIER if early else RECORDING, MARKERS, SKELETON, "report.json", "report.md"):
        if not (folder / name).is_file():
            raise FormatError(
                f"{folder}: contains no {name}: expected a folder that `mocap track` or save() of this version wrote"
            )
    path = folder / (EARLIER if early else RECORDING)
    if early:
        found, header = earlier_record(folder, again=_AGAIN)
    else:
        found = read_netcdf(path, again=_AGAIN)
        header = from_json(str(found.attrs.get("header", "{}")), str(path), finite=False)
        format = header.get("format") if isinstance(header, dict) else header
        if format != FORMAT:
            raise FormatError(f"{path}: is {format}, expected {FORMAT}: track again with this version")
    where = f"{path}: header"
    entries = checked(where, header, _HEADER, again=_AGAIN)
    cameras = tuple(
        Camera(
            name=c["name"][()],
            matrix=c["matrix"],
            lens=_lens_of(c, where),
            size_px=tuple(c["size_px"].tolist()) if "size_px" in c else None,
        )
        for c in tables(f"{where}: cameras", header.get("cameras"), _CAMERA, again=_AGAIN)
    )
    data = _data(path, found)
    if cameras and (data.sizes.get("view") != len(cameras) or not {"ideal", "reprojected", "used"} <= set(data)):
        raise FormatError(f"{path}: has not the pixels of its {len(cameras)} cameras: {_AGAIN}")
    skeleton = read_skeleton(folder / SKELETON).for_markers(tuple(data["keypoint"].values), source=path.name)
    joints = [joint.name for joint in skeleton.joints]
    if joints != (data["joint"].values.tolist() if "joint" in data.coords else []):
        raise FormatError(f"{folder / SKELETON}: has other joints than {path.name}: {_AGAIN}")
    report = from_json(_text(folder / "report.json"), str(folder / "report.json"))
    if not isinstance(report, dict):
        raise FormatError(f"{folder / 'report.json'}: is no report, which is a table: {_AGAIN}")
    potentials = {kind: _potentials_of(folder, kind, where, header, joints) for kind in (PLANAR, SPATIAL)}
    return Recording(
        name=entries["name"][()],
        data=data.assign_attrs(model=entries["model"][()], y_up=int(entries["y_up"])),
        skeleton=skeleton,
        cameras=cameras,
        cleaned=True,
        findings=_findings(where, header),
        potentials=potentials[PLANAR],
        spatial_potentials=potentials[SPATIAL],
        report=report,
        report_text=_text(folder / "report.md"),
        folder=folder,
    )


def _data(path: Path, found: xr.Dataset) -> xr.Dataset:
    """The Dataset of a recording, each variable as it is declared.

    Raises:
        FormatError: a variable is missing, or not as declared.
    """
    sizes = dict(SIZES)
    empty = {name: found[name].astype(object) for name in _COORDINATES if name in found and not found[name].size}
    coordinates = variables(str(path), found.assign_coords(empty), _COORDINATES, sizes=sizes, again=_AGAIN)
    there = [name for name in VARIABLES if name in found or name in (*_NEEDED, *_MOTION)]
    values = variables(str(path), found, {name: entry_of(name) for name in there}, sizes=sizes, again=_AGAIN)
    values["status"] = values["status"].astype(np.int8)
    for name in LOOSE:  # velocities may be unknown where positions are not
        parts = {f"{name}[{i}, {j}]": values[name][..., i : i + 3, j : j + 3] for i in (0, 3) for j in (0, 3)}
        checked(str(path), parts, dict.fromkeys(parts, Entry(shape=(None, None, 3, 3), missing=2)), again=_AGAIN)
    attrs = {name: found.attrs[name] for name in ("fps", "space_unit", "format") if name in found.attrs}
    kept = {name: ("time" if name == "frame" else name, values) for name, values in coordinates.items()}
    data = with_variables(xr.Dataset(coords=kept, attrs=attrs), values)
    data["time"].attrs["units"] = "s"
    return data


def _findings(where: str, header: Mapping[str, Any]) -> tuple[Finding, ...]:
    every = header.get("findings", [])
    found = tables(f"{where}: findings", every, _FINDING, again=_AGAIN)
    return tuple(
        Finding(
            kind=Kind(one["kind"][()]),
            text=one["text"][()],
            alarm=bool(one["alarm"]),
            numbers=raw["numbers"] if isinstance(raw.get("numbers"), dict) else {},
            **{part: tuple(one[part].tolist()) for part in ("cameras", "markers", "frames", "mends") if part in one},
        )
        for one, raw in zip(found, every, strict=True)
    )


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
        raise FormatError(
            f"{where}: cameras: a {model.model} lens has not its {model.n_coefficients} numbers: {_AGAIN}"
        )
    f_px, centre_px, coefficients = (part.tolist() for part in parts)  # type: ignore[union-attr]
    return model.of(f_px, centre_px, coefficients)


def _potentials_of(
    folder: Path, kind: str, where: str, header: Mapping[str, Any], joints: list[str]
) -> dict[str, JointPotential]:
    """The potentials of a kind."""
    every = header.get("potentials")
    found = every.get(kind) if isinstance(every, dict) else None
    if not isinstance(found, dict) or not found.keys() <= set(joints):
        raise FormatError(f"{where}: potentials: {kind}: expected a table by names of joints: {_AGAIN}")
    out, wanted = {}, 2 if kind == PLANAR else 3
    for (name, one), file in zip(found.items(), file_names(found), strict=True):
        entries = checked(f"{where}: potentials: {kind}: {name}", one, _POTENTIAL, again=_AGAIN)
        try:
            potential = load_potential(folder / kind / f"{file}.npz")
        except ArchiveError as error:
            raise FormatError(f"{error}: {_AGAIN}") from None
        if potential.dimension != wanted:
            raise FormatError(
                f"{folder / kind / file}.npz: has {potential.dimension} coordinates, expected {wanted}: {_AGAIN}"
            )
        scale_m = float(entries["scale_m"])
        samples_m = scale_m * potential.samples
        out[name] = JointPotential(
            joint=name, frame=entries["frame"][()], scale_m=scale_m, samples_m=samples_m, potential=potential
        )
    return out


def _text(path: Path) -> str:
    try:
        return regular_bytes(path).decode("utf-8")
    except UnicodeDecodeError as error:
        raise FormatError(f"{path}: is no text ({error}): {_AGAIN}") from None
