"""What is drawn over pictures of cameras: digitised places, predicted ellipses, epipolar lines."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from eal.arrays import Array
from mocap.digitising.naming import seen_from

Shown = Callable[[int, Array], Array]
"""(N, 2) ideal pixels of a camera as its picture shows them."""


def ellipses(matrices: Array, xyz_m: Array, cov_m2: Array, shown: Shown, *, y_up: bool = False) -> Array:
    """(C, M, 5) centre, half axes and angle of the 95 % ellipses of where pictures show markers.

    Args:
        matrices: (C, 3, 4) projections.
        xyz_m: (M, 3) positions.
        cov_m2: (M, 3, 3) their covariances.
        shown: Ideal pixels as pictures show them.
        y_up: Whether ideal pixels are counted from the lower left.
    """
    uv, jacobian = seen_from(matrices, xyz_m)
    jacobian = jacobian * np.array([1.0, -1.0 if y_up else 1.0])[:, None]
    s = jacobian @ cov_m2 @ np.swapaxes(jacobian, -1, -2)
    out = np.full((*uv.shape[:2], 5), np.nan)
    known = np.isfinite(s).all(axis=(-1, -2))
    values, vectors = np.linalg.eigh(s[known])
    turn = np.arctan2(vectors[:, 1, 1], vectors[:, 0, 1])
    # root of the chi-square of two degrees of freedom that 95 % stay below
    out[known, 2:] = np.c_[2.4477 * np.sqrt(np.maximum(values[:, ::-1], 0)), turn]
    for c in range(len(matrices)):
        out[c, :, :2] = shown(c, uv[c])
    return out


def epipolar_lines(
    matrices: Array, ideal_px: Array, sizes_px: Sequence[Sequence[float]], shown: Shown
) -> list[list[list[list[float]]]]:
    """For each camera the lines on which a marker lies by its place in each of the others, as pictures bend them.

    Args:
        matrices: (C, 3, 4) projections.
        ideal_px: (C, 2) ideal pixels of the marker; NaN where it was not digitised.
        sizes_px: Width and height of each picture.
        shown: Ideal pixels as pictures show them.
    """
    out: list[list[list[list[float]]]] = [[] for _ in matrices]
    for a in np.flatnonzero(np.isfinite(ideal_px[:, 0])).tolist():
        inverse = np.linalg.inv(matrices[a, :, :3])
        eye, along = -inverse @ matrices[a, :, 3], inverse @ np.append(ideal_px[a], 1.0)
        # depths of one camera's ray from near to far
        reach = max(float(np.linalg.norm(eye)), 1e-3)
        points = eye + np.geomspace(0.05, 20, 200)[:, None] * reach * along / np.linalg.norm(along)
        uv, _ = seen_from(matrices, points)
        for b, (width, height) in enumerate(sizes_px):
            near = (np.abs(uv[b] - (width / 2, height / 2)) < (width, height)).all(axis=1)
            line = shown(b, uv[b][near])
            if b != a and len(line) > 1:
                out[b].append(np.round(line, 2).tolist())
    return out


def listed(values: Array) -> Any:
    """Numbers for a script; None: there are none."""
    return np.round(values, 3).tolist() if np.isfinite(values).all() else None


def drawn(marks: Mapping[str, Array], lines: Sequence[Any]) -> list[dict[str, Any]]:
    """What the page draws over the picture of each of C cameras.

    Args:
        marks: (C, M, ...) of each marker by what it is: ``click``, ``dot``, ``ellipse``, ``edited``.
        lines: Of each camera those of one marker.
    """
    each = [
        [{name: listed(values[c, m]) for name, values in marks.items()} for m in range(len(marks["click"][c]))]
        for c in range(len(lines))
    ]
    return [{"markers": own, "lines": line} for own, line in zip(each, lines, strict=True)]
