"""Markers in the scene: the body, its samples by where they come from, their uncertainty, their trails."""

from collections.abc import Mapping

import numpy as np
import rerun as rr
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from eal.arrays import Array
from mocap.records import MarkerTracks, Status
from mocap.rerun import palette, paths
from mocap.rerun.columns import log_over_time, segments, single, ui
from mocap.rerun.log_world import BODY_CLASS, SAMPLE_CLASS
from mocap.rerun.scene import Scene
from mocap.sides import side_of

ELLIPSOID_SD = 2.0
"""Half axes of the ellipsoids, in standard deviations."""

_RADII = {"measured": 3.5, "filled": 5.0, "rejected": 6.0}
_FILL_ALPHA = {"measured": 70, "filled": 90, "rejected": 90}


def classes(markers: MarkerTracks) -> Mapping[str, NDArray[np.bool_]]:
    """(T, M) masks of the samples of each class of ``paths.ORIGINS``; samples without a position are in none."""
    codes = {
        "measured": (Status.MEASURED,),
        "filled": (Status.INTERPOLATED, Status.PREDICTED, Status.SMOOTHED),
        "rejected": (Status.REJECTED,),
    }
    return {name: np.isin(markers.status, codes[name]) & markers.seen for name in paths.ORIGINS}


def log_looks(rec: rr.RecordingStream, n_markers: int) -> None:
    """How the body, samples of each class, their uncertainty and trails look; none of it changes."""
    body = rr.Points3D.from_fields(
        radii=ui(1.5),
        class_ids=BODY_CLASS,
        keypoint_ids=np.arange(n_markers),
        show_labels=n_markers <= 12,
    )
    rec.log(paths.SKELETON, body, static=True)
    for name in paths.ORIGINS:
        color = palette.ORIGIN[name]
        points = rr.Points3D.from_fields(
            colors=color, radii=ui(_RADII[name]), class_ids=SAMPLE_CLASS, show_labels=False
        )
        rec.log(paths.child(paths.MARKERS, name), points, static=True)
        wires = rr.Ellipsoids3D.from_fields(
            colors=(*color, _FILL_ALPHA[name]),
            fill_mode=rr.components.FillMode.TransparentFillMajorWireframe,
            line_radii=ui(0.5),
            show_labels=False,
        )
        rec.log(paths.child(paths.UNCERTAINTY, name), wires, static=True)
    rec.log(paths.TRAILS, rr.LineStrips3D.from_fields(radii=ui(0.75)), static=True)


def log_markers(rec: rr.RecordingStream, scene: Scene, markers: MarkerTracks) -> None:
    """The body (all markers and bones, whatever their origin), and over it the samples of each class."""
    xyz = single(scene.points(markers.xyz_m))
    log_over_time(rec, paths.SKELETON, markers.t_s, rr.Points3D.columns(positions=xyz))
    for name, mask in classes(markers).items():
        path, columns = (
            paths.child(paths.MARKERS, name),
            rr.Points3D.columns(positions=xyz[mask], keypoint_ids=np.nonzero(mask)[1]),
        )
        log_over_time(rec, path, markers.t_s, columns, counts=mask.sum(axis=1), rare=True)


def log_uncertainty(rec: rr.RecordingStream, scene: Scene, markers: MarkerTracks) -> None:
    """An ellipsoid of ``ELLIPSOID_SD`` standard deviations round each sample whose covariance is known."""
    known = np.isfinite(markers.cov_m2).all(axis=(-2, -1))
    for name, mask in classes(markers).items():
        path, mask = paths.child(paths.UNCERTAINTY, name), mask & known
        half_sizes, quaternions = ellipsoids(markers.cov_m2[mask] * np.outer(scene.signs, scene.signs))
        columns = rr.Ellipsoids3D.columns(
            centers=single(scene.points(markers.xyz_m[mask])),
            half_sizes=single(half_sizes),
            quaternions=single(quaternions),
        )
        log_over_time(rec, path, markers.t_s, columns, counts=mask.sum(axis=1), rare=True)


def ellipsoids(cov_m2: Array) -> tuple[Array, Array]:
    """Half axes and orientations of covariance ellipsoids.

    Args:
        cov_m2: (N, 3, 3) covariances.

    Returns:
        (N, 3) half axes in metres, ``ELLIPSOID_SD`` standard deviations long, and (N, 4) quaternions (x, y, z, w) of a
        right-handed basis along them.
    """
    values, axes = np.linalg.eigh(cov_m2)
    axes[:, :, 0] *= np.sign(np.linalg.det(axes))[:, None]
    turned = Rotation.from_matrix(axes).as_quat() if len(axes) else np.empty((0, 4))  # SciPy 1.15 takes one or more
    return ELLIPSOID_SD * np.sqrt(np.maximum(values, 0.0)), turned


def log_trails(rec: rr.RecordingStream, scene: Scene, markers: MarkerTracks, *, trunk: tuple[str, ...]) -> None:
    """The step of each marker since the frame before, of which a view shows the last ones, and the path of the trunk.

    Args:
        rec: Where to.
        scene: The scene.
        markers: The markers.
        trunk: Markers whose mean is the path, where all of them that ever have a position have one; empty: all markers.
    """
    xyz = scene.points(markers.xyz_m)
    ever = np.asarray(markers.seen.any(axis=0))
    body = [m for m, name in enumerate(markers.names) if ever[m] and (name in trunk or not trunk)]
    whole = np.flatnonzero(markers.seen[:, body].all(axis=1) & bool(body))
    path = xyz[whole][:, body].mean(axis=1) if len(whole) else np.empty((0, 3))
    line = rr.LineStrips3D([single(path)], colors=palette.WHITE, radii=ui(0.5))
    rec.log(paths.PATH, line, static=True)
    # what an eye follows: its viewer keeps as far away as the size of that asks for, and a wing's beat would shake it
    corners = np.array([-1.0, 1.0])[:, None] * scene.body_m / np.sqrt(3)
    look = rr.Points3D.from_fields(colors=(0, 0, 0, 0), radii=ui(0.0), show_labels=False)
    boxes = rr.Points3D.columns(positions=single((path[:, None] + corners).reshape(-1, 3)))
    log_over_time(rec, paths.FRAMED, markers.t_s, boxes, look, counts=np.full(len(whole), 2), at=whole)
    if len(xyz) < 2:
        return
    there = markers.seen[1:] & markers.seen[:-1]
    colors = np.array([palette.TRAIL[side_of(name)] for name in markers.names], dtype=np.uint8)
    strips = segments(xyz[:-1][there], xyz[1:][there])
    columns = rr.LineStrips3D.columns(strips=strips, colors=colors[np.nonzero(there)[1]])
    log_over_time(rec, paths.TRAILS, markers.t_s, columns, counts=there.sum(axis=1), at=np.arange(1, len(xyz)))
