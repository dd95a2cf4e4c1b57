"""Rigid bodies as XMALab writes them, 16 numbers of a transform per body and frame; a skeleton with their axes."""

from contextlib import suppress
from pathlib import Path

import numpy as np

from mocap.errors import MocapError
from mocap.filters.velocities import Motion
from mocap.io.xmalab import BODY_ENTRIES
from mocap.kinematics.bodies import with_places
from mocap.kinematics.functional import pose_of
from mocap.skeleton import Skeleton, write_skeleton

AXES_FILE = "axes.toml"


def write_axes(motion: Motion, skeleton: Skeleton, folder: Path) -> None:
    """Write the skeleton with the axes of joints between bodies as places of markers, if it has such joints.

    It serves other recordings of the same markers: axes of a functional trial, of a mean pose. Where a functional
    joint does not show its axes there is none; ``Kinematics.notes`` says so.
    """
    if skeleton.body_joints:
        with suppress(MocapError):
            write_skeleton(folder / AXES_FILE, with_places(motion, skeleton))


def write_rigid_bodies(motion: Motion, skeleton: Skeleton, path: Path) -> None:
    """Write where each body of the skeleton is: world from body, column by column of a 4 x 4 matrix, in metres.

    A body's axes are those of the world as it lies on average, its origin is the centre of its markers.

    Raises:
        MocapError: the skeleton states no bodies.
    """
    bodies = skeleton.bodies
    if not bodies:
        raise MocapError("the skeleton states no rigid bodies: name their markers under [bodies]")
    matrices = np.zeros((len(motion.t_s), len(bodies), 4, 4))
    matrices[..., 3, 3] = 1.0
    for n, members in enumerate(bodies.values()):
        pose = pose_of(motion, members)
        matrices[:, n, :3, :3], matrices[:, n, :3, 3] = pose.rotation, pose.position_m
    matrices[np.isnan(matrices).any(axis=(2, 3))] = np.nan
    rows = np.swapaxes(matrices, 2, 3).reshape(len(matrices), -1).tolist()
    header = ",".join(f"{name}_{entry}" for name in bodies for entry in BODY_ENTRIES)
    lines = (",".join("NaN" if np.isnan(v) else f"{v:.12g}" for v in row) for row in rows)
    path.write_text("\n".join([header, *lines]) + "\n", encoding="utf-8", newline="")
