"""NetCDF files of the package movement (Sirmpilatze et al. 2025), of its version 0.17: single names of dimensions."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from eal.arrays import Array
from mocap.documents import damaged
from mocap.errors import FormatError
from mocap.io.contents import FileContents, of_animals, pixel_recording, point_recording, views_of
from mocap.io.format import Format
from mocap.io.lines import MOST_FRAMES, frame_numbers, metres, rate_of_times, unit_of
from mocap.io.netcdf import as_netcdf, read_netcdf
from mocap.io.tables import WORDS, with_sd
from mocap.records import Status
from mocap.schema import LARGEST, Entry, checked

_AGAIN = "save it again"
_ONE = {"individual": "id_0", "view": "cam1"}
"""The only individual or camera of a file that names none."""


def of_dataset(data: Any, path: Path) -> FileContents:
    """Poses of an ``xarray.Dataset`` as movement lays it out, of a file or a name for messages.

    Raises:
        FormatError: it is laid out otherwise.
    """
    with damaged(f"{path.name}: not a dataset of movement", "expected what movement saves"):
        # with the names of dimensions of this version, of which none is missing
        numbers = ("position", "confidence", "edited", "origin", "status", "sd", "covariance", "time", "frame")
        if odd := [name for name in numbers if name in data.variables and data[name].dtype.kind not in "fiub"]:
            raise FormatError(f"{path.name}: {odd[0]} is {data[odd[0]].dtype}, expected real numbers: save it again")
        data = data.rename({old: old[:-1] for old in ("keypoints", "individuals") if old in data.dims})
        if "shape" in data or data.attrs.get("ds_type") == "bboxes":
            raise FormatError(f"{path.name}: contains bounding boxes; expected poses (ds_type = poses)")
        if "position" not in data or not {"time", "space", "keypoint"} <= set(data["position"].dims):
            dims = tuple(data["position"].dims) if "position" in data else "absent"
            raise FormatError(f"{path.name}: position is {dims}; expected dimensions time, space, keypoint, individual")
        for name in ("individual", "view"):
            if name not in data["position"].dims:
                data = data if name in data.coords else data.assign_coords({name: _ONE[name]})
                data = data.expand_dims(name)
        return _recording(path, data)


def _recording(path: Path, data: Any) -> FileContents:
    order = ("view", "time", "individual", "keypoint")
    position = data["position"].transpose(*order, "space")
    parts, animals, views = ([str(v) for v in data[name].values] for name in ("keypoint", "individual", "view"))
    axes = [str(v) for v in data["space"].values]
    if axes not in (["x", "y"], ["x", "y", "z"]):
        raise FormatError(f"{path.name}: space is {axes}; expected x, y or x, y, z")
    values = np.asarray(position.values, dtype=np.float64)
    values = values.reshape(len(views), values.shape[1], -1, len(axes))
    times = np.asarray(data["time"].values, dtype=np.float64)
    attributes = data.attrs
    in_frames = str(attributes.get("time_unit", "frames")) == "frames"
    fps, findings = rate_of_times(path, times)
    rate = attributes.get("fps")
    fps = float(rate) if rate is not None and float(rate) > 0 else (None if in_frames else fps)
    if fps is None:
        findings = []
    if not np.isfinite(times).all():
        raise FormatError(f"{path.name}: a time is not finite: save it again")
    frames = np.round(times if in_frames else times * (fps or 1.0))
    frames = frame_numbers(path, data["frame"].values if "frame" in data.coords else frames)
    names, pairs = of_animals(animals, parts)
    common: dict[str, Any] = {"names": names, "frames": frames, "first": 0, "fps": fps, "findings": tuple(findings)}
    common["animals"] = pairs if animals != ["id_0"] else ()
    score = _array(path.name, data, "confidence", order)
    edited = _array(path.name, data, "edited", order)
    tables = {} if edited is None or not edited.any() else {"edited": np.any(edited, axis=0).astype(np.float64)}
    if len(axes) == 2:
        found = pixel_recording(path, "movement", cameras=views, uv_px=values, score=score, **common)
        return replace(found, tables=tables)
    if len(views) != 1:
        raise FormatError(f"{path.name}: {len(views)} views of positions in space; expected one")
    origin = _array(path.name, data, "status" if "status" in data else "origin", order)
    if origin is not None:
        whole = origin[0].astype(np.int64) if (np.abs(origin) < MOST_FRAMES).all() else origin[0]
        kept: Any = whole if np.array_equal(whole, origin[0]) else origin[0]
        codes = Entry(kind="i", shape=(None, None), least=0, most=int(max(Status)))
        origin = checked(path.name, {"status": kept}, {"status": codes}, again=_AGAIN)["status"]
    unit = unit_of(str(attributes.get("space_unit", "")))
    sd = _array(path.name, data, "sd", order)
    found = point_recording(
        path,
        "movement",
        xyz=values[0],
        unit=unit,
        t_s=frames / (fps or 1.0) if in_frames else times,
        status=origin,
        score=None if score is None else score[0],
        **common,
    )
    found = replace(found, tables={**found.tables, **tables})
    scale = metres(path, unit) if unit else 1.0
    if sd is not None:
        return with_sd(found, sd[0] * scale)
    both = ("time", "individual", "keypoint", "space", "space_to")
    if found.points is None or "covariance" not in data or set(data["covariance"].dims) - {"view"} != set(both):
        return found
    cov = data["covariance"].isel(view=0) if "view" in data["covariance"].dims else data["covariance"]
    cov = np.asarray(cov.transpose(*both).values, dtype=np.float64).reshape(len(times), -1, 3, 3) * scale**2
    return replace(found, points=replace(found.points, cov_m2=cov))


def _array(where: str, data: Any, name: str, order: tuple[str, ...]) -> Array | None:
    """(C, T, M) values of a variable; None where it is absent or says nothing."""
    if name not in data or set(data[name].dims) != set(order) & set(data["position"].dims):
        return None
    values = np.asarray(data[name].transpose(*order).values, dtype=np.float64)
    values = values.reshape(*values.shape[:2], -1)
    if np.isnan(values).all():
        return None
    least = 0.0 if name == "sd" else -LARGEST
    return checked(where, {name: values}, {name: Entry(shape=(None,) * 3, least=least, missing=0)}, again=_AGAIN)[name]


def write_movement(path: Path, recording: FileContents) -> None:
    """Write poses: ``position``, ``confidence``, ``edited``, ``origin`` of points with CF flags; ``view``: cameras.

    Raises:
        FormatError: there is nothing to write.
    """
    import xarray

    views, axes, t_s, values = views_of(path, recording)
    animals, parts, at = recording.grid()
    shape = (len(views), len(t_s), len(animals), len(parts))

    def spread(array: Array, fill: float, *tail: int) -> Array:
        out = np.full((len(views), len(t_s), len(animals) * len(parts), *tail), fill)
        out[:, :, at] = array.reshape(len(views), len(t_s), -1, *tail)
        return np.moveaxis(out.reshape(*shape, *tail), 0, -1)  # time, individual, keypoint, (space,) view

    position = np.transpose(spread(values, np.nan, len(axes)), (0, 3, 2, 1, 4))
    score = recording.score if recording.score is not None else np.full((len(views), len(t_s), len(at)), np.nan)
    flat = ("time", "keypoint", "individual", "view")
    table: dict[str, Any] = {"position": (("time", "space", *flat[1:]), position)}
    table["confidence"] = (flat, np.transpose(spread(score, np.nan), (0, 2, 1, 3)))
    if recording.points is not None:
        codes = np.transpose(spread(recording.points.status.astype(np.float64), 0.0), (0, 2, 1, 3)).astype(np.int8)
        flags = {"flag_values": np.array([int(o) for o in Status], dtype=np.int8), "flag_meanings": " ".join(WORDS)}
        table["origin"] = (flat, codes, flags)
        if np.isfinite(recording.points.sd_m).any():
            sd = np.transpose(spread(recording.points.sd_m[None] / recording.length_m(path), np.nan), (0, 2, 1, 3))
            table["sd"] = (flat, sd, {"long_name": "standard deviation of the position, root mean square of its axes"})
    if "edited" in recording.tables:  # of all cameras: a file states it of the animal
        edited = np.broadcast_to(recording.tables["edited"], (len(views), len(t_s), len(at)))
        table["edited"] = (flat, np.transpose(spread(edited, 0.0), (0, 2, 1, 3)) > 0)
    coords = {"space": list(axes), "keypoint": parts, "individual": animals, "view": views}
    frames = recording.frames - (int(recording.frames[0]) if recording.fps else 0) if len(recording.frames) else t_s
    coords["time"] = t_s if recording.fps else np.asarray(frames, dtype=np.float64)  # type: ignore[assignment]
    attributes: dict[str, Any] = {
        "source_software": recording.format,
        "ds_type": "poses",
        "time_unit": "seconds" if recording.fps else "frames",
        "log": json.dumps([]),
    }
    attributes |= {"fps": float(recording.fps)} if recording.fps else {}
    unit = "px" if recording.points is None else recording.unit
    attributes |= {"space_unit": unit} if unit else {}
    dataset = xarray.Dataset(table, coords=coords, attrs=attributes)
    dataset = dataset.assign_coords(frame=("time", recording.frames))
    if len(views) == 1:
        dataset = dataset.isel(view=0, drop=recording.points is not None)
    # made in memory: a full disk ends the HDF5 library with a segmentation fault
    path.write_bytes(as_netcdf(dataset))


MOVEMENT = Format(
    name="movement",
    title="poses of the package movement (NetCDF)",
    knows=lambda head: {"position", "space"} <= head.netcdf,
    read=lambda path, _: of_dataset(read_netcdf(path, again=_AGAIN), path),
    write=write_movement,
    holds=frozenset(
        {
            "points",
            "first_frame",
            "frame_numbers",
            "pixels",
            "fps",
            "unit",
            "origin",
            "sd",
            "score",
            "animals",
            "edited",
        }
    ),
    suffixes=(".nc",),
    signs="hdf5 netcdf position confidence time space keypoint",
)
