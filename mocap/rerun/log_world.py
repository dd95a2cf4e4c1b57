"""What does not move: directions of the world, names of the markers, the skeleton's bones."""

import numpy as np
import rerun as rr

from mocap.filters.anatomy import ends_among
from mocap.rerun import palette, paths
from mocap.rerun.columns import single
from mocap.rerun.scene import Scene
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
