"""DANNCE's predictions and Label3D's labels (Dunn et al. 2021): points in MATLAB files."""

from pathlib import Path
from typing import Any

import numpy as np

from eal.arrays import Array
from mocap.errors import FormatError
from mocap.io.apart import variables
from mocap.io.contents import FileContents, point_recording
from mocap.io.format import Format, Head, Hints, file_format
from mocap.io.lines import frame_numbers, rate, told_apart


def _numbers(path: Path, value: Any, what: str) -> Array:
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise FormatError(f"{path.name}: {what} contains no numbers: export it again") from None


def _recording(
    path: Path, format: str, xyz: Array, frames: Array | None, *, names: list[str] | None = None, **parts: Any
) -> FileContents:
    """A recording of (T, A, M, 3) points of A animals, whose frames are ``frames`` (None: one after another)."""
    count, animals, points = xyz.shape[:3]
    findings = list[str]()
    if names is None or len(names) != points:
        names = [f"point{m + 1}" for m in range(points)]
        findings.append("names of points are not in the file: they are numbered in the order of the skeleton")
    if frames is not None and frames.size != count:
        raise FormatError(f"{path.name}: {frames.size} frame numbers for {count} frames: export it again")
    own = [(f"animal{a + 1}", name) for a in range(animals) for name in names]
    return point_recording(
        path,
        format,
        names=[name if animals == 1 else f"{animal}_{name}" for animal, name in own],
        xyz=xyz.reshape(count, animals * points, 3),
        unit=None,
        frames=None if frames is None else frame_numbers(path, frames.ravel(), first_line=1),
        first=0 if frames is None or not frames.size else int(frames.ravel()[0]),
        animals=tuple(own) if animals > 1 else (),
        findings=tuple(findings),
        **parts,
    )


@file_format(
    "dannce",
    "predictions of DANNCE (.mat)",
    lambda head: bool({"pred", "com"} & head.mat and {"sampleID", "p_max"} & head.mat),
)
def _predictions(path: Path, _hints: Hints) -> FileContents:
    """``pred`` (frames, [animals,] 3, points), or ``com`` (frames, 3); ``p_max`` are maxima of the probability maps."""
    table = variables(path)
    xyz = _numbers(path, table["pred" if "pred" in table else "com"], "pred")
    xyz = xyz[..., None] if "pred" not in table and xyz.ndim == 2 else xyz
    xyz = xyz[:, None] if xyz.ndim == 3 else xyz
    if xyz.ndim != 4 or xyz.shape[2] != 3:
        raise FormatError(f"{path.name}: pred has shape {xyz.shape}; expected frames x (animals x) 3 x points")
    frames = _numbers(path, table["sampleID"], "sampleID") if "sampleID" in table else None
    score = _numbers(path, table["p_max"], "p_max") if "p_max" in table else None
    size = (xyz.shape[0], xyz.shape[1] * xyz.shape[3])
    names = ["com"] if "pred" not in table else None
    if score is not None:
        likely = score.size == size[0] * size[1] and bool((np.abs(score - 0.5) <= 0.5).all())
        score = score.reshape(size) if likely else None
    return _recording(path, "dannce", np.swapaxes(xyz, 2, 3), frames, names=names, score=score)


@file_format(
    "label3d",
    "labels of Label3D, also as DANNCE takes them (.mat)",
    lambda head: "data_3D" in head.mat or "labelData" in head.mat,
)
def _labels(path: Path, _hints: Hints) -> FileContents:
    """``labelData{1}.data_3d`` (frames, 3 x points) of DANNCE's label files, or ``data_3D`` of Label3D's sessions."""
    table = variables(path)
    first = np.atleast_1d(table.get("labelData", {}))[:1]
    camera = first[0] if len(first) and isinstance(first[0], dict) else {}
    values, frames = table.get("data_3D", camera.get("data_3d")), table.get("framesToLabel", camera.get("data_frame"))
    if values is None:
        raise FormatError(f"{path.name}: no data_3d of the first camera, nor data_3D: label frames and export it again")
    xyz = _numbers(path, values, "data_3d")
    if xyz.ndim == 1:  # one frame
        xyz = xyz[None]
    if xyz.ndim != 2 or xyz.shape[1] % 3:
        raise FormatError(f"{path.name}: data_3d has shape {xyz.shape}; expected frames x (3 coordinates a point)")
    skeleton = table.get("skeleton")
    words = np.atleast_1d(skeleton.get("joint_names", [])) if isinstance(skeleton, dict) else []
    numbers = None if frames is None else np.atleast_1d(_numbers(path, frames, "frame numbers")).ravel()
    if numbers is not None and (numbers.size != len(xyz) or not (np.diff(numbers) > 0).all()):
        numbers = None  # Label3D's own list may be of all frames, or of none
    shaped = xyz.reshape(len(xyz), 1, -1, 3)
    return _recording(path, "label3d", shaped, numbers, names=[str(word) for word in words] or None)


_FIELDS = {"type", "nMarkers", "freq", "markerName", "data"}


def _structures(path: Path) -> dict[str, Any]:
    found = variables(path).items()
    return {name: own for name, own in found if isinstance(own, dict) and own.keys() >= _FIELDS}


def _read_structure(path: Path) -> FileContents:
    """Positions of ``data``, frames x (x, y, z of each marker); the structure states no unit.

    Raises:
        FormatError: there are several structures, or one holds derivatives or norms, or contradicts itself.
    """
    own, *others = _structures(path).items()
    if others:
        names = ", ".join(name for name, _ in (own, *others))
        raise FormatError(f"{path.name}: has the structures {names}; expected one: save one alone")
    name, table = own
    if str(table["type"]) != "MoCap data" or np.any(table.get("timederOrder", 0)):
        raise FormatError(
            f"{path.name}: {name} is of type {str(table['type'])!r} and order {table.get('timederOrder', 0)} of "
            "derivatives; expected 'MoCap data' and 0, positions of markers"
        )
    data = np.atleast_2d(np.asarray(table["data"], dtype=np.float64))
    names = [str(name) for name in np.ravel(np.asarray(table["markerName"], dtype=object))]
    if data.ndim != 2 or data.shape[1] != 3 * len(names) or np.any(table["nMarkers"] != len(names)):
        raise FormatError(
            f"{path.name}: {name}.data has shape {data.shape}, nMarkers is {table['nMarkers']}, for {len(names)} "
            "names; expected x, y, z of each marker: save it again"
        )
    names, findings = told_apart(names)
    return point_recording(
        path,
        "mocaptoolbox",
        names=names,
        xyz=data.reshape(len(data), -1, 3),
        unit=None,
        fps=rate(path, table["freq"]),
        findings=tuple(findings),
    )


def _has_structure(head: Head) -> bool:
    return bool(head.mat) and not head.mat & {"easyWandData", "camud"} and bool(_structures(head.path))


MOCAPTOOLBOX = Format(
    name="mocaptoolbox",
    title="structure of the MoCap Toolbox (MATLAB)",
    knows=_has_structure,
    read=lambda path, _: _read_structure(path),
)
