"""The scene: the world, the body, its samples by where they come from, uncertainty, trails, and when each was seen."""

from collections.abc import Mapping

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from eal.arrays import Array
from mocap.filters.anatomy import ends_among
from mocap.records import MarkerTracks, Status
from mocap.rerun import palette, paths
from mocap.rerun.columns import log_over_time, segments, single, ui
from mocap.rerun.row_map import columns_of, log_row_map, row_map_view
from mocap.rerun.scene import Scene
from mocap.sides import side_of
from mocap.skeleton import Skeleton

BODY_CLASS = 1
"""Class of points that are joined by the skeleton's bones."""
SAMPLE_CLASS = 2
"""Class of points that have the same names and no bones."""

_UP = {
    (0, 1): rr.ViewCoordinates.RIGHT_HAND_X_UP,
    (0, -1): rr.ViewCoordinates.RIGHT_HAND_X_DOWN,
    (1, 1): rr.ViewCoordinates.RIGHT_HAND_Y_UP,
    (1, -1): rr.ViewCoordinates.RIGHT_HAND_Y_DOWN,
    (2, 1): rr.ViewCoordinates.RIGHT_HAND_Z_UP,
    (2, -1): rr.ViewCoordinates.RIGHT_HAND_Z_DOWN,
}


def log_world(rec: rr.RecordingStream, scene: Scene, *, names: tuple[str, ...], skeleton: Skeleton) -> None:
    """Directions, marker names and bones."""
    axis = int(np.argmax(np.abs(scene.up)))
    rec.log(paths.WORLD, _UP[axis, int(scene.up[axis])], static=True)
    points = [rr.AnnotationInfo(id=i, label=name) for i, name in enumerate(names)]
    body = rr.ClassDescription(
        info=rr.AnnotationInfo(id=BODY_CLASS, label=skeleton.name, color=palette.GREY),
        keypoint_annotations=points,
        keypoint_connections=ends_among(names, [(bone.a, bone.b) for bone in skeleton.bones]),
    )
    sample = rr.AnnotationInfo(id=SAMPLE_CLASS, label="sample")
    samples = rr.ClassDescription(info=sample, keypoint_annotations=points)
    rec.log("/", rr.AnnotationContext([body, samples]), static=True)


def log_axes(rec: rr.RecordingStream, scene: Scene) -> None:
    """Arrows along the world's axes on the ground under the motion, as long as their labels say: the scale."""
    length_m = grid_spacing_m(2 * scene.radius_m)
    foot = scene.centre_m + (scene.ground_m - scene.centre_m @ scene.up) * scene.up
    unit, per_m = next((unit, n) for unit, n in (("m", 1), ("cm", 100), ("mm", 1000)) if n * length_m >= 1 or n == 1000)
    size = f"{per_m * length_m:g} {unit}"
    arrows = rr.Arrows3D(
        origins=single(np.tile(foot, (3, 1))),
        vectors=single(length_m * np.diag(scene.signs)),
        labels=[f"x, {size}", "y", "z"],
        colors=[palette.VERMILLION, palette.GREEN, palette.SKY_BLUE],
        radii=rr.components.Radius.ui_points(1.5),
        show_labels=True,
    )
    rec.log(paths.AXES, arrows, static=True)


def grid_spacing_m(radius_m: float) -> float:
    """A round number of which some ten make the diameter: 1, 2 or 5 times a power of ten."""
    rough = radius_m / 5
    power = 10.0 ** np.floor(np.log10(rough))
    return float(power * max(f for f in (1, 2, 5) if f * power <= rough * (1 + 1e-9)))


ELLIPSOID_SD = 2.0
"""Half axes of ellipsoids and ellipses, in standard deviations."""

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
    finite = np.isfinite(markers.cov_m2).all(axis=(-2, -1))
    for name, mask in classes(markers).items():
        path, mask = paths.child(paths.UNCERTAINTY, name), mask & finite
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


_STATES = np.array(["", *paths.ORIGINS])


def log_gap_map(rec: rr.RecordingStream, markers: MarkerTracks) -> None:
    """An image of the class of every sample, a row a marker.

    Where there are more frames than columns, a column shows the last class of ``paths.ORIGINS`` among its frames: one
    rejected sample or a short gap is not lost.
    """
    colors = np.array([palette.GROUND, *(palette.DIM_ORIGIN[name] for name in paths.ORIGINS)], dtype=np.uint8)
    starts = columns_of(len(markers.t_s))
    picture = colors[np.maximum.reduceat(class_codes(markers), starts, axis=0).T]
    log_row_map(rec, paths.GAP_MAP, picture, names=markers.names, t_s=markers.t_s)


def log_gaps(rec: rr.RecordingStream, markers: MarkerTracks) -> None:
    """The lanes: an entry where a marker's class changes; empty where it has no position."""
    look = rr.StateConfiguration(
        values=list(paths.ORIGINS),
        labels=[" ", *paths.ORIGINS[1:]],
        colors=[palette.DIM_ORIGIN[name] for name in paths.ORIGINS],
    )
    states = _STATES[class_codes(markers)]
    for m, name in enumerate(markers.names):
        path = paths.child(paths.GAPS, name)
        at = np.flatnonzero(np.append(True, states[1:, m] != states[:-1, m]))
        log_over_time(rec, path, markers.t_s, rr.StateChange.columns(state=states[at, m].tolist()), look, at=at)


def class_codes(markers: MarkerTracks) -> NDArray[np.int8]:
    """(T, M) class of each sample: 1 + its index in ``paths.ORIGINS``; 0 where there is no position."""
    masks = classes(markers)
    codes = np.zeros(markers.status.shape, dtype=np.int8)
    for i, name in enumerate(paths.ORIGINS):
        codes[masks[name]] = i + 1
    return codes


def gap_map_view() -> rrb.View:
    """Who was seen when, at a glance."""
    return row_map_view(paths.GAP_MAP, "Gaps over frames: measured blue, filled or extrapolated yellow, rejected red")


def gap_lanes_view() -> rrb.View:
    """When each marker was seen, a lane each."""
    return rrb.StateTimelineView(
        origin=paths.GAPS,
        name="Gaps of each marker (frames)",
        time_view=rrb.TimeAxis(link=rrb.components.LinkAxis.LinkToGlobal),
    )
