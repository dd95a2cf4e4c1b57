"""Results of the version before, whose arrays were in three files, as the record of this one; goes with the next."""

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from mocap.documents import from_json
from mocap.errors import FormatError
from mocap.filters.records import HeldLimb
from mocap.io.netcdf import read_netcdf
from mocap.pipeline.track_variables import with_limbs

EARLIER, MOTION, FORMAT = "run.nc", "motion.nc", "eal-mocap run 2"
_POINTS = {"position": "point_position", "covariance": "point_covariance", "two": "end"}
_RAYS = {"reprojected_px": "reprojected", "innovation_px": "innovation", "ideal_px": "ideal", "uv": "pixel"}
_ANGLES = {"angle_angle_rad": "angle_rad", "angle_energies": "energies", "energy_3": "energy"}
_ANGLES |= {"angle_length_m": "segment_length", "angle_length_sd_m": "segment_length_sd"}
_LIMB = ("x", "y", "value", "samples", "state", "cov", "at_state", "pull")


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
    try:
        return _record(header, read_netcdf(folder / "markers.nc", again=again), rest, points), header
    except (KeyError, ValueError, TypeError, IndexError, AttributeError) as error:
        raise FormatError(f"{folder}: is not whole as a result of the version before ({error}): {again}") from None


def _record(header: dict[str, Any], markers: xr.Dataset, rest: xr.Dataset, points: xr.Dataset) -> xr.Dataset:
    one = markers.squeeze("individual", drop=True)
    renamed = {old: new for table in (_RAYS, _ANGLES) for old, new in table.items() if old in {*rest, *rest.dims}}
    renamed |= {f"joint_{frame}_m": f"joint_{frame}" for frame in header["frames"]}
    names = {"keypoint": one["keypoint"], "view": [camera["name"] for camera in header["cameras"]]}
    if header.get("angles"):
        names |= {"angle": header["angles"]["names"], "segment": header["angles"]["segments"]}
    if header["joints"]:
        names["joint"] = header["joints"]
        rest["joint_sd"] = rest["joint_world_sd_m"]
        for frame, axis in {"world": "space", "body": "space", "plane": "axis", "limb": "axis"}.items():
            rest[f"joint_{frame}_m"] = (("time", "joint", axis), rest[f"joint_{frame}_m"].values)
    data = rest.rename(renamed).assign_coords(time=one["time"], frame=one["frame"])
    data = data.assign_coords({dim: np.array(of, dtype=object) for dim, of in names.items() if len(of)})
    data = data.assign({name: one[name].drop_vars("space", errors="ignore") for name in ("position", "covariance")})
    data = data.assign(status=one["status"], repaired=one["repaired"] == 1)
    data = data.merge(points.rename(_POINTS).drop_vars("time"), compat="override")
    data["measured"], data["used"] = data["measured"] == 1, data["used"] == 1
    for camera, matrix in zip(header["cameras"], rest.get("projection", ()), strict=True):
        camera["matrix"] = np.asarray(matrix).tolist()
    limbs = [
        HeldLimb(
            name=limb["name"],
            markers=tuple(limb["markers"]),
            **{part: rest[f"limb_{i}_{part}"].values for part in _LIMB},
        )
        for i, limb in enumerate(header.get("limbs", []))
    ]
    gone = [name for name in data if str(name).startswith("limb_") or str(name) == "projection"]
    return with_limbs(data.drop_vars(gone), limbs)
