"""Results of the version before, whose arrays were in three files, as the record of this one; goes with the next."""

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from mocap.documents import damaged, from_json, regular_bytes
from mocap.errors import FormatError
from mocap.filters.limb_potential import limb_values
from mocap.io.netcdf import read_netcdf
from mocap.recording import with_variables

EARLIER, MOTION, FORMAT = "run.nc", "motion.nc", "eal-mocap run 2"
WITHOUT_PARTS = "eal-mocap recording 1"
"""The format of a result whose header has all findings in one list, and nothing else of what steps found."""
_POINTS = {"position": "point_position", "covariance": "point_covariance", "two": "end"}
_RAYS = {"reprojected_px": "reprojected", "innovation_px": "innovation", "ideal_px": "ideal", "uv": "pixel"}
_ANGLES = {"angle_angle_rad": "angle_rad", "angle_energies": "energies", "energy_3": "energy"}
_ANGLES |= {"angle_length_m": "segment_length", "angle_length_sd_m": "segment_length_sd"}
_LIMB = {"covariance": "cov"} | {of: of for of in ("x", "y", "value", "samples", "state", "at_state")}


def earlier_parts(header: dict[str, Any], folder: Path) -> dict[str, Any]:
    """What the header of an earlier result tells of its parts, not checked yet: findings, potentials, the report."""
    report = from_json(regular_bytes(folder / "report.json").decode("utf-8", "replace"), str(folder / "report.json"))
    model = report.get("model") if isinstance(report, dict) else None
    parts = {
        "cleaned": {"told": header.get("findings", [])},
        "model": {"why": str(model.get("why", "")) if isinstance(model, dict) else ""},
        "potentials": header.get("potentials"),
        "report": {},
    }
    return {"source": {}, "parts": parts}


def earlier_record(folder: Path, *, again: str) -> tuple[xr.Dataset, dict[str, Any]]:
    """The Dataset and the header of a result of the version before, not checked yet.

    Raises:
        FormatError: a file is missing, cannot be read, or is of another version.
    """
    path = folder / EARLIER
    rest, points = (read_netcdf(folder / name, again=again) for name in (EARLIER, MOTION))
    header = from_json(str(rest.attrs.get("header", "{}")), str(path))
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise FormatError(f"{path}: is no {FORMAT}: track again with this version")
    with damaged(f"{folder}: is not whole as a result of the version before", again):
        return _record(header, read_netcdf(folder / "markers.nc", again=again), rest, points), header


def _record(header: dict[str, Any], markers: xr.Dataset, rest: xr.Dataset, points: xr.Dataset) -> xr.Dataset:
    for camera, matrix in zip(header["cameras"], rest["projection"].values if header["cameras"] else (), strict=True):
        camera["matrix"] = matrix.tolist()
    limbs: dict[str, Any] = {}
    for i, limb in enumerate(header.get("limbs", [])):
        own, pulls = [*limb["markers"]], rest[f"limb_{i}_pull"].values
        every = markers["keypoint"].values.tolist()
        place, pull = np.full(len(every), -1), np.full((len(pulls), len(every), 3), np.nan)
        index = [every.index(name) for name in own]
        place[index], pull[:, index] = np.arange(len(own)), pulls
        limbs[limb["name"]] = {of: rest[f"limb_{i}_{part}"].values for of, part in _LIMB.items()}
        limbs[limb["name"]] |= {"marker": place, "pull": pull}
    one = markers.squeeze("individual", drop=True)
    names = {"keypoint": one["keypoint"].values, "view": [camera["name"] for camera in header["cameras"]]}
    if header.get("angles"):
        names |= {"angle": header["angles"]["names"], "segment": header["angles"]["segments"]}
    data = rest.drop_vars([name for name in rest if str(name).startswith(("limb_", "projection"))])
    joints = {frame: data[f"joint_{frame}_m"].values for frame in header["frames"] if header["joints"]}
    sd = data["joint_world_sd_m"].values if joints else None
    data = data.drop_dims("joint", errors="ignore")
    data = data.rename({old: new for old, new in {**_RAYS, **_ANGLES}.items() if old in {*data, *data.dims}})
    if joints:
        names["joint"] = header["joints"]
        data["joint_sd"] = (("time", "joint"), sd)
        for frame, values in joints.items():
            data[f"joint_{frame}"] = (("time", "joint", "space" if values.shape[2] == 3 else "axis"), values)
    data = data.assign({dim: (dim, np.array(of, dtype=object)) for dim, of in names.items() if len(of)})
    for name in ("position", "covariance", "status", "repaired"):
        data[name] = one[name].variable
    data = data.assign_coords(time=one["time"].variable, frame=one["frame"].variable)
    for name, variable in points.rename(_POINTS).variables.items():
        if name not in ("time", "space"):
            data[name] = variable
    data = data.assign({name: data[name] == 1 for name in ("measured", "used")})
    data = data.set_coords([name for name in (*names, "point") if name in data.variables])
    return with_variables(data, limb_values(limbs), limb=list(limbs)) if limbs else data
