"""A recording in figures: what ``mocap info`` prints."""

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
    tracks = seen if seen.ndim == 3 else seen[None]
    sampled = seen.size > 0 and (recording.pixels is not None or recording.points is not None or bool(recording.tables))
    in_frames, of_markers = np.any(tracks, axis=(0, 2)), np.any(tracks, axis=(0, 1))
    lost = [name for name, any_seen in zip(recording.names, of_markers, strict=True) if sampled and not any_seen]
    px = recording.pixels is not None or (recording.lenses and not recording.cameras)
    there = {
        "pixels": recording.pixels is not None,
        "points": recording.points is not None,
        "cameras": bool(recording.cameras),
        "lenses": bool(recording.lenses),
        "score": recording.score is not None,
        **{name: True for name, table in recording.tables.items() if np.isfinite(table).any()},
    }
    found: dict[str, Any] = {
        "format": recording.format,
        "points": len(recording.names),
        "cameras": len(recording.camera_names),
        "frames": len(recording.frames),
        "fps": recording.fps,
        "units": "px" if px or set(recording.tables) == {"residual_px"} else recording.unit,
        "missing": _missing(tracks) if sampled else None,
        "findings": list(recording.remarks),
        "names": list(recording.names),
        "camera_names": list(recording.camera_names),
        "first_frame": int(recording.frames[0]) if len(recording.frames) else None,
        "undigitised": {"frames": int((~in_frames).sum()) if sampled else 0, "markers": lost},
        "gaps": gaps(tracks) if sampled else None,
        "pixel_origin": recording.pixel_origin,
        "holds": [name for name, has in there.items() if has],
    }
    if recording.pixels is not None and recording.points is not None:
        found["missing_points"] = _missing(recording.points.seen[None])
    if recording.points is not None:
        codes, counts = np.unique(recording.points.status, return_counts=True)
        found["samples"] = {Status(code).name.lower(): int(n) for code, n in zip(codes, counts, strict=True)}
    animals = list(dict.fromkeys(animal for animal, _ in recording.animals))
    return found | ({"individuals": animals} if animals else {})


def _missing(tracks: NDArray[np.bool_]) -> float:
    """Share of (K, T, M) samples without a value, of the frames and the markers that have any."""
    kept = tracks[:, np.any(tracks, axis=(0, 2))][:, :, np.any(tracks, axis=(0, 1))]
    return round(float(1 - kept.mean()), 6) if kept.size else 1.0


def gaps(seen: NDArray[np.bool_]) -> dict[str, int | float]:
    """Runs of missing frames between two sightings in (K, T, M) samples of each view, frame and marker.

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
