"""The empirical potential of each joint, in the plane of its limb."""

import numpy as np

from eal import fit_potential, usual_kernel
from eal.arrays import Array
from mocap.pipeline.run import JointPotential
from mocap.records import JointTracks, MarkerTracks, Status
from mocap.skeleton import Skeleton

FRAME = "limb"
"""Frame of reference in which joints have two coordinates."""
SPACE = "body"
"""Frame of reference in which joints have three coordinates."""
NAMES = ("along", "across", "third")
FEWEST, MOST = 30, 500
"""Samples below which a potential says more about their number than about the joint; of more, evenly spaced ones."""
BETA, LAMBDA = 4.0, 1e-3
"""Kernel width in units of the median squared distance, and the parameter of spectral filtering."""


def joint_potentials(tracks: JointTracks, markers: MarkerTracks, skeleton: Skeleton) -> dict[str, JointPotential]:
    """Learn V_z of every joint from the frames in which its three markers were measured.

    Coordinates keep the joint's centre as their origin and are divided by their standard deviation; the kernel is
    exp(-BETA |x - y|^2 / m), m the median squared distance of the samples. The paper's Figs 7 and 8 show such ones.

    Args:
        tracks: Joints in one frame of reference, in two or three dimensions.
        markers: Tracked markers; filled samples are not learned from.
        skeleton: Joints.

    Returns:
        Potentials by joint; joints with fewer than ``FEWEST`` samples are left out.
    """
    out = {}
    for joint, samples in joint_samples(tracks, markers, skeleton).items():
        if len(samples) >= FEWEST:
            some = samples[np.linspace(0, len(samples) - 1, min(len(samples), MOST)).astype(int)]
            out[joint] = _potential(joint, tracks.frame, some)
    return out


def joint_samples(tracks: JointTracks, markers: MarkerTracks, skeleton: Skeleton) -> dict[str, Array]:
    """(N, d) samples of each joint in metres: frames in which its three markers were measured."""
    measured = dict(zip(markers.names, (markers.status == Status.MEASURED).T, strict=True))
    out = {}
    for joint in (j for j in skeleton.joints if j.name in tracks.names):
        i = tracks.names.index(joint.name)
        ok = measured[joint.parent] & measured[joint.centre] & measured[joint.child]
        out[joint.name] = tracks.q_m[ok & np.isfinite(tracks.q_m[:, i, 0]), i]
    return out


def _potential(joint: str, frame: str, samples_m: Array) -> JointPotential:
    scale = max(float(np.sqrt(samples_m.var(axis=0).sum())), 1e-9)
    scaled = samples_m / scale
    names, units = NAMES[: scaled.shape[1]], (f"{scale:.6g} m",) * scaled.shape[1]
    potential = fit_potential(scaled, kernel=usual_kernel(scaled, width=BETA), lam=LAMBDA, names=names, units=units)
    return JointPotential(joint=joint, frame=frame, samples_m=samples_m, potential=potential, scale_m=scale)
