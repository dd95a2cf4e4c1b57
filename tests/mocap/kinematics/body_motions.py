"""Two rigid bodies whose motion is known in closed form, and motions of measured markers."""

import numpy as np
from mocap.filters.velocities import Motion
from scipy.spatial.transform import Rotation

from mocap.skeleton import Skeleton

NAMES = [*(f"p{k}" for k in range(5)), *(f"c{k}" for k in range(5))]


def moving(xyz, t_s, names, sd_m, *, velocity_m_s=None, sd_m_s=0.0):
    """Positions (and velocities) of independent errors; velocities are differences where none are given."""
    own = np.zeros((*xyz.shape[:2], 6, 6), dtype=np.float32)
    own[..., :3, :3], own[..., 3:, 3:] = np.eye(3) * sd_m**2, np.eye(3) * sd_m_s**2
    return Motion(
        names=tuple(names),
        t_s=t_s,
        xyz_m=xyz,
        velocity_m_s=np.gradient(xyz, t_s, axis=0) if velocity_m_s is None else velocity_m_s,
        own=own,
        pairs=np.empty((0, 2), dtype=np.int64),
        cross=np.empty((len(xyz), 0, 6, 6), dtype=np.float32),
        kept=np.ones(xyz.shape),
        measured=np.ones(xyz.shape[:2], dtype=bool),
    )


def skeleton(names, parent, child, name="jaw", **more):
    bodies = {"skull": names[:parent], "jaw": names[parent : parent + child]}
    return Skeleton(markers=names, bodies=bodies, joints={name: ("skull", "jaw")}, **more)


def screw(t_s, *, places_m, turn_rad=0.5, pitch_m=0.01):
    """(T, 10, 3) markers: a tumbling parent, and a child that turns about z of it through (10, 20, 0) mm and shifts.

    Also the parent's axes and the child's angle.
    """
    parent = Rotation.from_euler("xyz", np.stack([0.3 * np.sin(3 * t_s), 0.4 * np.cos(2 * t_s), 0.5 * t_s], axis=1))
    angle = turn_rad * (1 + 0.8 * np.sin(7 * t_s))
    turn = Rotation.from_rotvec(angle[:, None] * [0, 0, 1])
    origin = np.array([0.01, 0.02, 0])
    middle = np.stack([0.1 * np.sin(t_s), 0.2 * t_s, 0.05 * np.cos(4 * t_s)], axis=1)
    child = turn.as_matrix() @ (places_m[5:] - origin).T
    child = np.swapaxes(child, 1, 2) + origin + (pitch_m * angle)[:, None, None] * [0, 0, 1]
    both = np.concatenate([np.broadcast_to(places_m[:5], child.shape), child], axis=1)
    return np.einsum("tij,tmj->tmi", parent.as_matrix(), both) + middle[:, None], parent.as_matrix(), angle
