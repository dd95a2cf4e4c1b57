"""The empirical potential of each joint, in the plane of its limb."""

from collections.abc import Mapping

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
FEWEST = 30
"""Samples below which a potential says more about their number than about the joint."""


def joint_potentials(
    joints: Mapping[str, JointTracks],
    markers: MarkerTracks,
    skeleton: Skeleton,
    *,
    frame: str = FRAME,
    beta: float = 4.0,
    lam: float = 1e-3,
    most: int = 500,
) -> dict[str, JointPotential]:
    """Learn V_z of every joint from the frames in which its three markers were measured.

    Coordinates keep the joint's centre as their origin and are divided by their standard deviation; the kernel is
    exp(-beta |x - y|^2 / m), m the median squared distance of the samples. The paper's Figs 7 and 8 show such ones.

    Args:
        joints: Joint tracks by frame of reference.
        markers: Tracked markers; filled samples are not learned from.
        skeleton: Joints.
        frame: Frame of reference of the coordinates, in two or three dimensions.
        beta: Kernel width in units of the median squared distance.
        lam: Spectral filtering parameter.
        most: Most samples; evenly spaced ones are taken.

    Returns:
        Potentials by joint; joints with fewer than ``FEWEST`` samples are left out.
    """
    tracks = joints[frame]
    measured = dict(zip(markers.names, (markers.status == Status.MEASURED).T, strict=True))
    out = {}
    for joint in (j for j in skeleton.joints if j.name in tracks.names):
        i = tracks.names.index(joint.name)
        ok = measured[joint.parent] & measured[joint.centre] & measured[joint.child]
        samples = tracks.q_m[ok & np.isfinite(tracks.q_m[:, i, 0]), i]
        if len(samples) < FEWEST:
            continue
        samples = samples[np.linspace(0, len(samples) - 1, min(len(samples), most)).astype(int)]
        out[joint.name] = _potential(joint.name, frame, samples, beta=beta, lam=lam)
    return out


def _potential(joint: str, frame: str, samples_m: Array, *, beta: float, lam: float) -> JointPotential:
    scale = max(float(np.sqrt(samples_m.var(axis=0).sum())), 1e-9)
    scaled = samples_m / scale
    names, units = NAMES[: scaled.shape[1]], (f"{scale:.6g} m",) * scaled.shape[1]
    potential = fit_potential(scaled, kernel=usual_kernel(scaled, width=beta), lam=lam, names=names, units=units)
    return JointPotential(joint=joint, frame=frame, samples_m=samples_m, potential=potential, scale_m=scale)
