"""The empirical potential of each joint, in the plane of its limb."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from eal import Choice, choose, fit_potential
from eal.arrays import Array
from mocap.pipeline.parts import JointPotential
from mocap.records import JointTracks, MarkerTracks, Status
from mocap.skeleton import Skeleton

FRAME = "limb"
"""Frame of reference in which joints have two coordinates."""
SPACE = "body"
"""Frame of reference in which joints have three coordinates."""
NAMES = ("along", "across", "third")
FEWEST, MOST = 30, 500
"""Samples below which a potential says more about their number than about the joint; of more, evenly spaced ones."""


def joint_potentials(
    tracks: JointTracks, markers: MarkerTracks, skeleton: Skeleton, *, trials: Sequence[int] | None = None
) -> dict[str, JointPotential]:
    """Learn V_z of every joint from the frames in which its three markers were measured.

    Coordinates keep the joint's centre as their origin and are divided by their standard deviation. Metric, kernel and
    lambda are those under which the part of the recording that is left out is likeliest (``eal.choose``). Samples are
    what a smoother estimates: their standard deviations are no noise that could be taken out (``eal.fit_potential``).

    Args:
        tracks: Joints in one frame of reference, in two or three dimensions.
        markers: Tracked markers; filled samples are not learned from.
        skeleton: Joints.
        trials: (T,) trial of each frame, where there are several; they are left out one at a time.

    Returns:
        Potentials by joint; joints with fewer than ``FEWEST`` samples are left out.
    """
    out = {}
    for name, ok, q_m in _measured(tracks, markers, skeleton):
        if ok.sum() >= FEWEST:
            some = np.flatnonzero(ok)[np.linspace(0, ok.sum() - 1, min(ok.sum(), MOST)).astype(int)]
            out[name] = _potential(name, tracks.frame, q_m[some], [] if trials is None else [trials[i] for i in some])
    return out


def joint_samples(tracks: JointTracks, markers: MarkerTracks, skeleton: Skeleton) -> dict[str, Array]:
    """(N, d) samples of each joint in metres: frames in which its three markers were measured."""
    return {name: q_m[ok] for name, ok, q_m in _measured(tracks, markers, skeleton)}


def _measured(
    tracks: JointTracks, markers: MarkerTracks, skeleton: Skeleton
) -> Iterator[tuple[str, NDArray[np.bool_], Array]]:
    """Of each joint: its name, in which frames its markers were measured, and its (T, d) coordinates."""
    measured = dict(zip(markers.names, (markers.status == Status.MEASURED).T, strict=True))
    for joint in (j for j in skeleton.joints if j.name in tracks.names):
        i = tracks.names.index(joint.name)
        ok = measured[joint.parent] & measured[joint.centre] & measured[joint.child]
        yield joint.name, ok & np.isfinite(tracks.q_m[:, i, 0]), tracks.q_m[:, i]


def settings(samples_m: Array, trials: Sequence[str | int]) -> tuple[float, Choice]:
    """Metres a unit of a joint's coordinates, and the kernel and lambda of its potential, however many trials it is of.

    Args:
        samples_m: (N, d) coordinates.
        trials: (N,) trial of each; none, or one alone: parts of the recording are left out in turn.
    """
    scale = max(float(np.sqrt(samples_m.var(axis=0).sum())), 1e-9)
    return scale, choose(samples_m / scale, trials=trials if len(set(trials)) > 1 else None)


def _potential(joint: str, frame: str, samples_m: Array, trials: Sequence[int]) -> JointPotential:
    scale, chosen = settings(samples_m, trials)
    scaled = samples_m / scale
    names, units = NAMES[: scaled.shape[1]], (f"{scale:.6g} m",) * scaled.shape[1]
    potential = fit_potential(scaled, kernel=chosen.kernel, lam=chosen.lam, names=names, units=units)
    return JointPotential(
        joint=joint, frame=frame, samples_m=samples_m, potential=potential, scale_m=scale, choice=chosen
    )
