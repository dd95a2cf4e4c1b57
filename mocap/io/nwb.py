"""Poses in Neurodata Without Borders files (ndx-pose 0.4; older ones are read): cameras, 3D, covariance and status.

Positions in space are a ``MultiCameraPoseEstimation`` called PoseEstimation (where movement looks for it) with a
``PoseEstimation`` for each camera's pixels, linked to a ``CalibratedCamera``. ndx-pose has no place for uncertainty:
the table ``PoseUncertainty`` beside has a row a frame, and for each body part the columns NAME_covariance (xx, xy, xz,
yy, yz, zz in square metres) and NAME_status (codes of ``mocap.records.Status``). Files are read without pynwb.
"""

import importlib
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np

from eal.arrays import Array
from eal.needs import needs
from mocap.cameras.camera import Camera, decompose, pinhole_camera
from mocap.cameras.lens import BrownLens, FisheyeLens, Lens, RationalLens
from mocap.cameras.triangulate import PAIRS
from mocap.documents import damaged
from mocap.errors import FormatError
from mocap.io.contents import FileContents, pixel_recording, point_recording
from mocap.io.format import Format, Hints
from mocap.io.lines import UNIT_M, rate_of_times, told_apart
from mocap.records import Status

_KINDS = ("MultiCameraPoseEstimation", "PoseEstimation")
_TABLE = "PoseUncertainty"
_UNITS = {"meters": "m", "metres": "m", "meter": "m", "millimeters": "mm", "millimetres": "mm", "centimeters": "cm"}
_LENSES: dict[int, type[Lens]] = {4: FisheyeLens, 5: BrownLens, 8: RationalLens}
_CODES = ", ".join(f"{status.value} {status.name.lower()}" for status in Status)


def _object_name(name: str) -> str:
    """A name of an object of the file, where / and : part names."""
    return name.replace("/", "_").replace(":", "_")


def _read(path: Path, _hints: Hints) -> FileContents:
    import h5py

    advice = "give a file with PoseEstimation of ndx-pose"
    with damaged(f"{path.name}: not readable as poses of ndx-pose", advice), h5py.File(path, "r") as file:
        return _poses(path, file)


def _kind(item: Any) -> str:
    kind = item.attrs.get("neurodata_type", "")
    return kind.decode() if isinstance(kind, bytes) else str(kind)


def _poses(path: Path, file: Any) -> FileContents:
    groups: list[Any] = []
    file.visititems(lambda _, item: groups.append(item) if _kind(item) in _KINDS else None)
    if not groups:
        raise FormatError(
            f"{path.name}: an NWB file without poses (no PoseEstimation of ndx-pose): give one with poses"
        )
    series = [{key: one for key, one in g.items() if _kind(one) == "PoseEstimationSeries"} for g in groups]
    axes = [{int(one["data"].shape[1]) for one in own.values()} for own in series]
    space = [i for i, own in enumerate(axes) if own == {3}]
    views = [i for i, own in enumerate(axes) if own == {2}]
    if len(space) > 1 or not space + views:
        spaces = ", ".join(groups[i].name for i in space) or "none has two or three columns"
        raise FormatError(f"{path.name}: expected one set of positions in space, or pixels, and got {spaces}")
    main = [*space, *views][0]
    nodes = groups[main]["skeleton"]["nodes"][()] if "skeleton" in groups[main] else ()
    order = {_object_name(name): name for name in (v.decode() if isinstance(v, bytes) else str(v) for v in nodes)}
    keys = [*(key for key in order if key in series[main]), *(key for key in series[main] if key not in order)]
    first = series[main][keys[0]]
    t_s = _times(first)
    fps, findings = rate_of_times(path, t_s)
    frames = np.arange(1, len(t_s) + 1) if fps is None else 1 + np.round((t_s - t_s[0]) * fps).astype(np.int64)
    names = [order.get(key, key) for key in keys]
    cameras = [_camera(groups[i]) for i in views]
    rig = tuple(camera for _, camera in cameras if camera is not None)
    labels = told_apart([name for name, _ in cameras])[0]
    common: dict[str, Any] = {"names": names, "frames": frames, "fps": fps, "findings": tuple(findings)}
    pixels = None
    if views:
        uv = np.stack([_stacked(series[i], keys, len(t_s), 2) for i in views])
        score = np.stack([_stacked(series[i], keys, len(t_s), 0) for i in views])
        found = pixel_recording(
            path, "nwb", cameras=labels, uv_px=uv, calibration=rig if len(rig) == len(views) else (),
            pixel_origin="upper-left", score=None if np.isnan(score).all() else score, **common,
        )  # fmt: skip
        if not space:
            return found
        pixels = found
    unit = str(first["data"].attrs.get("unit", "")).strip().lower()
    unit = _UNITS.get(unit, unit if unit in UNIT_M else None)
    xyz = _stacked(series[main], keys, len(t_s), 3)
    cov, status = _uncertainty(path, file, keys, xyz)
    points = point_recording(path, "nwb", xyz=xyz, unit=unit, status=status, **common)
    if cov is not None and points.points is not None:
        points = replace(points, points=replace(points.points, cov_m2=cov))
    if pixels is None:
        return points
    return replace(pixels, unit=points.unit, points=points.points)


def _times(series: Any) -> Array:
    if "timestamps" in series:
        return np.asarray(series["timestamps"][()], dtype=np.float64)
    start = series["starting_time"]
    return float(start[()]) + np.arange(len(series["data"])) / float(start.attrs["rate"])


def _stacked(series: dict[str, Any], keys: list[str], frames: int, axes: int) -> Array:
    """(T, M, axes) coordinates, or (T, M) confidences for 0 axes; NaN where a series is not there."""
    out = np.full((frames, len(keys), *((axes,) if axes else ())), np.nan)
    for m, key in enumerate(keys):
        one = series.get(key)
        if one is not None and (axes or "confidence" in one):
            data = one["data"] if axes else one["confidence"]
            out[:, m] = data[()] * float(data.attrs.get("conversion", 1.0))
    return out


def _camera(group: Any) -> tuple[str, Camera | None]:
    device = group.get("device")
    if device is None:
        return group.name.rsplit("/", 1)[-1], None
    link = group.get("device", getlink=True)
    name = str(getattr(link, "path", device.name)).rsplit("/", 1)[-1]
    if not {"intrinsic_matrix", "rotation_matrix", "translation_vector"} <= set(device):
        return name, None
    k = np.asarray(device["intrinsic_matrix"][()], dtype=np.float64)
    bent = np.asarray(device["distortion_coefficients"][()] if "distortion_coefficients" in device else (), np.float64)
    model = _LENSES.get(len(bent))
    lens = None if model is None or not bent.any() else model.of((k[0, 0], k[1, 1]), (k[0, 2], k[1, 2]), bent)
    rotation, shift = (np.asarray(device[n][()], np.float64) for n in ("rotation_matrix", "translation_vector"))
    return name, pinhole_camera(name, intrinsic=k, rotation=rotation, translation_m=shift, lens=lens)


def _uncertainty(path: Path, file: Any, keys: list[str], xyz: Array) -> tuple[Array | None, Any]:
    """(T, M, 3, 3) covariances and (T, M) codes of our table; None where the file has none."""
    table = next((group[_TABLE] for group in file["processing"].values() if _TABLE in group), None)
    if table is None:
        return None, None
    cov = np.full((*xyz.shape, 3), np.nan)
    status = np.where(np.isnan(xyz[..., 0]), Status.MISSING, Status.MEASURED)
    for m, key in enumerate(keys):
        rows, codes = table[f"{key}_covariance"][()], table[f"{key}_status"][()]
        shapes = rows.shape == (len(xyz), 6) and codes.shape == (len(xyz),)
        if not shapes or not set(codes.tolist()) <= set(map(int, Status)):
            raise FormatError(f"{path.name}: {_TABLE}: columns of {key} are not 6 covariances and a status a frame")
        for n, (i, j) in enumerate(PAIRS):
            cov[:, m, i, j] = cov[:, m, j, i] = rows[:, n]
        status[:, m] = codes
    return cov, status


def _packages() -> tuple[Any, Any]:
    needs("writing NWB", "nwb", "pynwb", "ndx_pose")
    return importlib.import_module("pynwb"), importlib.import_module("ndx_pose")


def _write(path: Path, recording: FileContents) -> list[str]:
    pynwb, ndx_pose = _packages()
    remarks = ["the time of the session is not known: session_start_time is now; a subject is needed for DANDI"]
    now = datetime.now(UTC)
    file = pynwb.NWBFile(
        session_description=f"Motion capture of {recording.paths[0].stem}",
        identifier=str(uuid4()),
        session_start_time=now,
    )
    skeleton = ndx_pose.Skeleton(name="skeleton", nodes=list(recording.names))
    keys = [_object_name(name) for name in recording.names]
    t_s = (recording.pixels if recording.points is None else recording.points).t_s  # type: ignore[union-attr]
    even = bool((np.diff(recording.frames) == 1).all())
    timing = {"rate": recording.fps, "starting_time": float(t_s[0])} if even else {"timestamps": t_s}
    source: dict[str, Any] = {"source_software": "eal-mocap", "source_software_version": version("eal-mocap")}

    def series(values: Array, unit: str, frame: str, score: Array | None) -> list[Any]:
        definition = {} if score is None else {"confidence_definition": "probability of being near the true point"}
        return [
            ndx_pose.PoseEstimationSeries(
                name=key, data=values[:, m], unit=unit, reference_frame=frame, **timing,
                confidence=None if score is None else score[:, m], **definition,
            )
            for m, key in enumerate(keys)
        ]  # fmt: skip

    views = []
    for c, name in enumerate(recording.camera_names if recording.pixels is not None else ()):
        device, lost = _device(recording.cameras[c] if recording.cameras else None, name)
        remarks += lost
        file.add_device(device)
        score = None if recording.score is None else np.clip(recording.score[c], 0, 1)
        uv = recording.pixels.uv_px[c]  # type: ignore[union-attr]
        one = series(uv, "pixels", "(0, 0) is the upper left corner of the image", score)
        views.append(
            ndx_pose.PoseEstimation(
                name=f"{_object_name(name)}_pixels" if recording.points is not None or c else "PoseEstimation",
                pose_estimation_series=one, device=device, skeleton=skeleton, source_software="eal-mocap",
                description=f"Points as camera {name} shows them",
            )
        )  # fmt: skip
    module = file.create_processing_module("behavior", "positions of body parts")
    module.add(ndx_pose.Skeletons(skeletons=[skeleton]))
    if recording.points is None:
        for view in views:
            module.add(view)
    else:
        unit = "meters" if recording.unit else "unknown"
        where = "the world of the cameras' calibration"
        module.add(
            ndx_pose.MultiCameraPoseEstimation(
                name="PoseEstimation", pose_estimation_series=series(recording.points.xyz_m, unit, where, None),
                pose_estimations=views, skeleton=skeleton, description="Positions in space", scorer="eal-mocap",
                **source,
            )
        )  # fmt: skip
        module.add(_table(recording, keys))
    with pynwb.NWBHDF5IO(path, "w") as io:
        io.write(file)
    return remarks


def _device(camera: Camera | None, name: str) -> tuple[Any, list[str]]:
    """A camera of the file, and what it cannot say."""
    pynwb, ndx_pose = _packages()
    label = _object_name(name)
    if camera is None:
        return pynwb.device.Device(name=label, description="camera, not calibrated"), []
    found, lens, remarks = decompose(camera), camera.lens, []
    if lens is not None and not np.allclose(lens.intrinsic, found.intrinsic, rtol=1e-6, atol=1e-3):
        remarks = [
            f"not written: the lens of camera {name}, whose focal length or centre is not that of its projection"
        ]
        lens = None
    mirrored = "; mirrored: the rotation has determinant -1" if found.mirrored else ""
    return ndx_pose.CalibratedCamera(
        name=label, description=f"pixels = K (R x + t), x in metres{mirrored}", intrinsic_matrix=found.intrinsic,
        rotation_matrix=found.rotation, translation_vector=found.translation_m,
        distortion_coefficients=None if lens is None else lens.coefficients,
    ), remarks  # fmt: skip


def _table(recording: FileContents, keys: list[str]) -> Any:
    """The covariance and the status of each body part, a row a frame."""
    common: Any = importlib.import_module("hdmf.common")
    points = recording.points
    columns = []
    for m, key in enumerate(keys):
        cov = np.stack([points.cov_m2[:, m, i, j] for i, j in PAIRS], axis=1)  # type: ignore[union-attr]
        what = f"covariance of the position of {recording.names[m]}: xx, xy, xz, yy, yz, zz in square metres"
        columns.append(common.VectorData(name=f"{key}_covariance", description=what, data=cov))
        codes = points.status[:, m].astype(np.int8)  # type: ignore[union-attr]
        columns.append(
            common.VectorData(name=f"{key}_status", description=f"where it comes from: {_CODES}", data=codes)
        )
    return common.DynamicTable(name=_TABLE, description="A row for each frame of PoseEstimation", columns=columns)


NWB = Format(
    name="nwb",
    title="poses in an NWB file (ndx-pose)",
    knows=lambda head: {"session_description", "processing"} <= head.hdf5,
    read=_read,
    write=_write,
    holds=frozenset({"points", "pixels", "cameras", "fps", "unit", "origin", "sd", "score", "pixel_origin"}),
    both=True,
    needs=frozenset({"fps"}),
    suffixes=(".nwb",),
)
