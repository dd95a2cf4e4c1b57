"""Anipose's 3D filter and the multi-camera ensemble Kalman smoother on a network's clicks, written anew.

Both are given the clicks that the authors of the flights believe (``methods.LEAST``), counted as the calibration counts
them. Settings are those of the programs' examples, nothing is tuned on these flights.
"""

import numpy as np

from benchmarks.arena.flights import Flight
from benchmarks.arena.methods import Outcome, believed
from benchmarks.gaps.peers.anipose_3d import STEPS, lengths, reprojection, smoothness, step, straight
from benchmarks.gaps.peers.kalman import likeliest_density, smooth_series, transition, wide_prior
from benchmarks.gaps.peers.rays import Rays, filter_rays
from mocap.cameras.triangulate import robust

BONES = ((1, 3), (3, 4), (12, 11), (11, 9), (7, 8))
"""Forearms, humeri and the trunk, in the order of ``flights.PAIRS``' landmarks."""
SMOOTH = 4.0


def rays_of(flight: Flight) -> Rays:
    """The believed clicks, and where those that agree meet."""
    uv = believed(flight)
    found = robust(flight.recording.matrices, uv)
    return Rays(
        matrices=flight.recording.matrices,
        uv_px=uv,
        sd_px=np.full(uv.shape[:3], found.sd_px),
        xyz_m=found.xyz_m,
        cov_m2=found.cov_m2,
    )


def anipose(flight: Flight) -> Outcome:
    """Anipose's optimisation of all points of a flight (Karashchuk et al. 2021): reprojection, smoothness, bones."""
    rays = rays_of(flight)
    xyz = straight(rays.xyz_m)
    scale = SMOOTH / float(np.mean(np.abs(np.diff(xyz, axis=0))))
    width = 6 * xyz.shape[1] + 2
    for _ in range(STEPS):
        known = np.array([np.median(np.linalg.norm(xyz[:, a] - xyz[:, b], axis=1)) for a, b in BONES])
        rows = [*reprojection(rays, xyz), smoothness(xyz, scale), *lengths(xyz, BONES, known)]
        change = step(rows, xyz.size, width).reshape(xyz.shape)
        xyz = xyz + change
        if np.abs(change).max() < 1e-6:
            break
    return Outcome(xyz_m=xyz)


def kalman_smoother(flight: Flight) -> Outcome:
    """A random walk of each marker through all cameras' rays (Biderman et al. 2024, multi-camera form).

    There is one network in place of an ensemble: the deviation of a click is that which the rays show, and rays that
    disagree are left out instead of being given a larger variance. The random walk's density is the most likely one.
    """
    rays = rays_of(flight)
    sd_m = np.sqrt(np.nanmedian(np.trace(rays.cov_m2, axis1=-2, axis2=-1) / 3, axis=0))
    density = likeliest_density([rays.xyz_m], sd_m, 1)
    walk, unit = (np.kron(part, np.eye(3)) for part in transition(1))
    mean, cov = wide_prior(rays.xyz_m, 1)
    run = filter_rays(
        rays,
        walk,
        density[:, None, None] * unit,
        mean=mean.reshape(len(mean), -1),
        cov=np.kron(cov, np.eye(3)),
    )
    smoothed, spread = smooth_series(run, walk)
    return Outcome(xyz_m=smoothed[:, :, :3, 0], cov_m2=spread[:, :, :3, :3])
