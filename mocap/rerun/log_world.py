"""What does not move: directions of the world, names of the markers, the skeleton's bones."""

import numpy as np
import rerun as rr

from mocap.rerun import palette, paths
from mocap.rerun.columns import names_of
from mocap.rerun.scene import Scene
from mocap.skeleton import Skeleton, ends_among

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
    """Directions, marker names and bones.

    Args:
        rec: Where to.
        scene: The scene.
        names: The M marker names; keypoint m of every entity is ``names[m]``.
        skeleton: Bones whose markers the recording lacks are left out.
    """
    axis = int(np.argmax(np.abs(scene.up)))
    rec.log(paths.WORLD, _UP[axis, int(scene.up[axis])], static=True)
    body = rr.ClassDescription(
        info=rr.AnnotationInfo(id=BODY_CLASS, label=skeleton.name, color=palette.GREY),
        keypoint_annotations=names_of(names),
        keypoint_connections=ends_among(names, [(bone.a, bone.b) for bone in skeleton.bones]),
    )
    samples = rr.ClassDescription(
        info=rr.AnnotationInfo(id=SAMPLE_CLASS, label="sample"), keypoint_annotations=names_of(names)
    )
    rec.log("/", rr.AnnotationContext([body, samples]), static=True)
