"""A recording in figures: what ``mocap info`` prints."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocap.io.contents import FileContents
from mocap.records import Status


def summary(recording: FileContents) -> dict[str, Any]:
    """Figures of a recording, ready for JSON.

    ``points`` and ``cameras`` are numbers, ``missing`` the share of samples (marker x frame x camera) without a value,
    of the frames and markers that have any at all, None where the file holds no samples; ``undigitised`` are the frames
    (their number) and markers without any; ``gaps`` are runs of missing frames between two sightings.
    """
    seen = recording.seen
    sampled = seen.size > 0 and (recording.pixels is not None or recording.points is not None or bool(recording.tables))
    found: dict[str, Any] = {
        "format": recording.format,
        "points": len(recording.names),
        "cameras": len(recording.camera_names),
        "frames": len(recording.frames),
        "fps": recording.fps,
        "units": _units(recording),
        "missing": _missing(seen) if sampled else None,
        "findings": list(recording.remarks),
        "names": list(recording.names),
        "camera_names": list(recording.camera_names),
        "first_frame": int(recording.frames[0]) if len(recording.frames) else None,
        "undigitised": _undigitised(recording.names, seen) if sampled else {"frames": 0, "markers": []},
        "gaps": gaps(seen.reshape(-1, *seen.shape[-2:])) if sampled else None,
        "pixel_origin": recording.pixel_origin,
        "holds": _holds(recording),
    }
    if recording.pixels is not None and recording.points is not None:
        found["missing_points"] = _missing(recording.points.seen)
    if recording.points is not None:
        codes, counts = np.unique(recording.points.status, return_counts=True)
        found["samples"] = {Status(code).name.lower(): int(n) for code, n in zip(codes, counts, strict=True)}
    animals = list(dict.fromkeys(animal for animal, _ in recording.animals))
    return found | ({"individuals": animals} if animals else {})


def _missing(seen: NDArray[np.bool_]) -> float:
    """Share of samples without a value, of the frames and the markers that have any."""
    tracks = seen.reshape(-1, *seen.shape[-2:])
    kept = tracks[:, np.any(tracks, axis=(0, 2))][:, :, np.any(tracks, axis=(0, 1))]
    return round(float(1 - kept.mean()), 6) if kept.size else 1.0


def _undigitised(names: Sequence[str], seen: NDArray[np.bool_]) -> dict[str, Any]:
    """Frames and markers without a single sample."""
    tracks = seen.reshape(-1, *seen.shape[-2:])
    lost = [name for name, any_seen in zip(names, np.any(tracks, axis=(0, 1)), strict=True) if not any_seen]
    return {"frames": int((~np.any(tracks, axis=(0, 2))).sum()), "markers": lost}


def _units(recording: FileContents) -> str | None:
    """Unit of what the file holds first: pixels, or lengths as stated."""
    if recording.pixels is not None or (recording.lenses and not recording.cameras):
        return "px"
    return "px" if set(recording.tables) == {"residual_px"} else recording.unit


def _holds(recording: FileContents) -> list[str]:
    """The parts that are there."""
    there = {
        "pixels": recording.pixels is not None,
        "points": recording.points is not None,
        "cameras": bool(recording.cameras),
        "lenses": bool(recording.lenses),
        "score": recording.score is not None,
    }
    tables = [name for name, table in recording.tables.items() if np.isfinite(table).any()]
    return [name for name, has in there.items() if has] + tables


def gaps(seen: NDArray[np.bool_]) -> dict[str, int | float]:
    """Runs of missing frames between two sightings.

    Args:
        seen: (K, T, M) whether each of K views (or the one world) has each of M markers in each of T frames.

    Returns:
        Their number, and the median and largest length in frames.
    """
    lengths = []
    for track in np.moveaxis(seen, 1, -1).reshape(-1, seen.shape[1]):
        at = np.flatnonzero(track)
        steps = np.diff(at) - 1
        lengths.append(steps[steps > 0])
    runs = np.concatenate(lengths) if lengths else np.zeros(0)
    return {
        "count": len(runs),
        "median_frames": float(np.median(runs)) if len(runs) else 0,
        "longest_frames": int(runs.max(initial=0)),
    }
