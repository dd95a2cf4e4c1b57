"""Simulated rigid bodies: two that are joined, each with markers that slip, are measured with noise, and go missing."""

from dataclasses import dataclass

import numpy as np
from mocap.filters.poses import MarkerTrial
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation


@dataclass
class Simulated:
    """Two bodies, the second on the first.

    Attributes:
        trial: As measured.
        xyz_m: (T, M, 3) where the markers truly are, slip included.
        rotation: (T, 2, 3, 3) axes of both bodies in the world.
        joint_m: (T, 3) where they are joined.
        places_m: (M, 3) of the markers in the axes of their bodies, from the joint.
    """

    trial: MarkerTrial
    xyz_m: np.ndarray
    rotation: np.ndarray
    joint_m: np.ndarray
    places_m: np.ndarray


def smooth(rng, n_frames, count, width):
    """(T, count) paths of unit deviation that change over so many frames."""
    paths = gaussian_filter1d(rng.normal(size=(n_frames + 8 * width, count)), width, axis=0)[4 * width : -4 * width]
    return paths / paths.std(axis=0)


def two_bodies(count=(5, 5), *, noise_m=1e-4, slip_m=0.0, n_frames=500, seed=0):
    """Bodies of so many markers about 40 mm wide that turn by 20 degrees against each other; slip lasts 15 frames."""
    rng = np.random.default_rng(seed)
    places = rng.normal(size=(sum(count), 3)) * 0.02 + np.repeat([[0.03, 0, 0], [-0.03, 0, 0]], count, axis=0)
    whole = Rotation.from_rotvec(0.4 * smooth(rng, n_frames, 3, 20))
    bent = whole * Rotation.from_rotvec(0.35 * smooth(rng, n_frames, 3, 12) * [1, 0.5, 0.3])
    rotation = np.stack([whole.as_matrix(), bent.as_matrix()], axis=1)
    joint = 0.05 * smooth(rng, n_frames, 3, 25)
    slip = slip_m * smooth(rng, n_frames, 3 * sum(count), 15).reshape(n_frames, -1, 3)
    on = np.repeat([0, 1], count)
    xyz = np.einsum("tmij,tmj->tmi", rotation[:, on], places + slip) + joint[:, None]
    seen = xyz + noise_m * rng.normal(size=xyz.shape)
    trial = MarkerTrial(
        name="two", t_s=np.arange(n_frames) / 100, xyz_m=seen, sd_m=np.full(xyz.shape[:2], max(noise_m, 1e-9))
    )
    return Simulated(trial, xyz, rotation, joint, places)
