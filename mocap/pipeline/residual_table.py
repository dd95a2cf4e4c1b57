"""Reprojection errors by camera and by marker: which camera, and which marker in it, misses most."""

from collections.abc import Mapping

import numpy as np

from mocap.cameras.camera import project
from mocap.markdown import plain
from mocap.pipeline.recording import Recording

MOST_ROWS = 60


def residuals_by_camera(prepared: Recording) -> dict[str, dict[str, float | None]]:
    """Median distance in pixels from clicks to where their triangulated points project, by camera and by marker.

    Args:
        prepared: A recording; without cameras the result is empty.

    Returns:
        For each camera its markers, and under ``all`` all of them; None where no believed point is seen.
    """
    if not prepared.cameras:
        return {}
    seen_at = project(prepared.matrices, prepared.xyz_m)
    off = np.linalg.norm(seen_at - prepared.ideal_px, axis=-1)
    found = {}
    for camera, errors in zip(prepared.cameras, off, strict=True):
        columns = {name: errors[:, m] for m, name in enumerate(prepared.names)}
        found[camera.name] = {
            name: float(np.median(values[np.isfinite(values)])) if np.isfinite(values).any() else None
            for name, values in {"all": errors.ravel(), **columns}.items()
        }
    return found


def residual_lines(residuals: Mapping[str, Mapping[str, float | None]]) -> list[str]:
    """The table as markdown: a row a marker, a column a camera; of many markers those that miss most."""
    if not residuals:
        return []
    cameras = list(residuals)
    markers = [name for name in residuals[cameras[0]] if name != "all"]
    largest = {m: max((residuals[c][m] or 0.0) for c in cameras) for m in markers}
    markers = sorted(markers, key=lambda m: -largest[m])[:MOST_ROWS]

    def row(title: str, name: str) -> str:
        cells = ("-" if (v := residuals[c][name]) is None else f"{v:.2f}" for c in cameras)
        return f"| {title} | " + " | ".join(cells) + " |"

    return [
        "## Reprojection errors by camera and marker",
        "",
        "Median distance in px from the clicks to where their point projects; markers with the largest first.",
        "",
        "| marker | " + " | ".join(map(plain, cameras)) + " |",
        "|---" * (len(cameras) + 1) + "|",
        row("**all**", "all"),
        *(row(plain(m), m) for m in markers),
        "",
    ]
