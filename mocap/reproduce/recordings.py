"""The pendulums and the lizard's wrist as recordings: filmed, converted to joint coordinates, learned, tracked."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eal.kernels import GaussianKernel
from eal.lagrangian import AnalyticPenalty, LagrangianSystem, PenalisedModel
from eal.over_time import OverTime, at_frames
from eal.potential import EmpiricalPotential, fit_potential
from eal.radius import valley_covariance
from eal.systems import GRAVITY_M_S2, free_joint, planar_pendulum, spherical_pendulum
from mocap.cleaning.cleaned import cleaned
from mocap.cleaning.cleaning import clean
from mocap.cleaning.click_noise import USUAL_DOF
from mocap.datasets.film import SyntheticRecording
from mocap.datasets.lizards import make_lizard
from mocap.datasets.pendulums import make_pendulum_film
from mocap.filters.body_axes import body_frames
from mocap.joints import joint_variables
from mocap.reading.ideal_pixels import of_pixels
from mocap.recording import Recording
from mocap.records import marker_tracks
from mocap.reproduce.fig_joints import WIDTH, joint_potential
from mocap.reproduce.joint_filter import JointSights, JointTrack, learned_noise, theorem_3, track_joint

Array = NDArray[Any]
"""Of any type of number: this file stands between libraries that name theirs."""

POWERS_W = {"planar": np.logspace(-3, 3, 7), "spherical": np.logspace(-3, 3, 7), "wrist": np.logspace(2, 6, 5)}
STRENGTHS_J = {
    "planar": np.array([300.0, 1e3, 3e3, 1e4]),
    "spherical": np.array([100.0, 300.0, 1e3, 3e3, 1e4]),
    "wrist": np.array([1e4]),
}
"""Of the wrist such that Theorem 3 says something at the energies that muscles give it; less would be likelier."""
FREE_POWER_W = {"planar": 30.0, "spherical": 30.0, "wrist": 1e5}
"""Of the force noise where V_z is still to be learned: forces of the constraint, and of muscles, are part of it."""
START_SD = {"planar": (0.02, 0.5), "spherical": (0.02, 0.5), "wrist": (0.1, 10.0)}
"""Standard deviations of coordinates and velocities in the first frame."""
STEADY_HZ = 4.0
"""Faster motion of the trunk is left in the joint coordinates."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Seen:
    """A joint in one recording: what the cameras saw, its coordinates as converted, and as they truly were.

    Attributes:
        sights: What the filter is given.
        q: (T, d) coordinates converted from triangulated markers; NaN where one of them was not seen.
        truth: (T, d) true coordinates, in the same axes.
    """

    sights: JointSights
    q: OverTime[Array]
    truth: OverTime[Array]


@dataclass(frozen=True, eq=False, kw_only=True)
class TrackedJoint:
    """A joint whose mechanics was learned in one recording and tracked it in another.

    Attributes:
        name: ``planar``, ``spherical`` or ``wrist``.
        model: L = T - U - V_z/eps^2.
        seen: The recording that was tracked.
        track: The track.
        bound: V_z that no motion released at the track's first state exceeds, Theorem 3 as corrected; of the wrist,
            which muscles drive, at the most energetic of those that were measured.
        lowest_j: Least U over what the motion can reach, in that bound.
    """

    name: str
    model: PenalisedModel
    seen: Seen
    track: JointTrack
    bound: float
    lowest_j: float

    @property
    def inside(self) -> Array:
        """(T, d) whether the true coordinate is within 1.96 standard deviations of the track."""
        return np.abs(self.track.q - self.seen.truth) <= 1.96 * self.track.sd


def planar(*, quick: bool) -> TrackedJoint:
    """The planar pendulum in (r, theta): learned from a release at 30 degrees, tracked when released at 10."""
    frames = 500 if quick else 1000
    learn, track = (
        _stand(make_pendulum_film("planar", seed=seed, n_frames=n, swing_rad=swing), polar=True)
        for seed, n, swing in ((1, 1000, np.pi / 6), (2, frames, np.pi / 18))
    )
    return _tracked("planar", planar_pendulum(), lambda q: _potential(q, beta=3.0, lam=1e-4), learn, track)


def spherical(*, quick: bool) -> TrackedJoint:
    """The spherical pendulum in (x1, x2, x3): learned from one start, tracked from one a third of a turn on."""
    frames = 500 if quick else 1000
    learn, track = (
        _stand(make_pendulum_film("spherical", seed=seed, n_frames=n, fps=fps, azimuth_rad=azimuth), polar=False)
        for seed, n, fps, azimuth in ((1, 1000, 50.0, 0.0), (2, frames, 100.0, 2.0 * np.pi / 3.0))
    )
    return _tracked("spherical", spherical_pendulum(), lambda q: _potential(q, beta=1.0, lam=1e-5), learn, track)


def wrist(*, quick: bool) -> TrackedJoint:
    """The lizard's left wrist about its elbow, in body axes and units of the median distance; m = 1 kg, no U."""
    learn, track = (_limb(make_lizard(seed=seed, n_frames=n)) for seed, n in ((1, 480), (2, 240 if quick else 480)))
    samples = learn.q[np.isfinite(learn.q).all(axis=1)]
    _, scale = joint_potential(samples)
    scaled = [_scaled(one, scale) for one in (learn, track)]
    return _tracked("wrist", free_joint(3), lambda q: _potential(q, beta=WIDTH, lam=1e-3), *scaled)


def _potential(q: Array, *, beta: float, lam: float) -> EmpiricalPotential:
    return fit_potential(q[np.isfinite(q).all(axis=1)], kernel=GaussianKernel(beta), lam=lam, accuracy=1e-3)


def _tracked(
    name: str, system: LagrangianSystem, learned: Callable[[Array], EmpiricalPotential], learn: Seen, seen: Seen
) -> TrackedJoint:
    """V_z of the whole first recording; 1/eps^2 and the noise from its last third, with V_z of the first two."""
    start_sd = START_SD[name]
    learn = _cut(learn, len(learn.q))
    free = _free(name, system, learn)
    learn = replace(learn, q=np.where(free.measured[:, None] > 0, free.q, np.nan))
    most = len(learn.q)
    aside = most - min(most // 3, 150)
    kept = at_frames(learn, slice(aside, None))
    model, power = learned_noise(
        PenalisedModel(system=system, penalty=learned(learn.q[: 2 * most // 3]), strength=1.0),
        kept.sights,
        free.q[aside],
        free.v[aside],
        powers_w=POWERS_W[name],
        strengths_j=STRENGTHS_J[name],
        start_sd=start_sd,
    )
    potential = learned(learn.q)
    model = replace(model, penalty=potential)
    seen = _cut(seen, len(seen.q))
    begun = _free(name, system, _cut(seen, 40))
    track = track_joint(
        model,
        seen.sights,
        begun.q[0],
        begun.v[0],
        power_w=power,
        start_sd=start_sd,
        valley=lambda q: valley_covariance(potential, q, rng=np.random.default_rng(0)),
    )
    lowest, released = -GRAVITY_M_S2 * (1.0 + 0.05), 0
    if name == "wrist":  # muscles do work: the bound is that of the most energetic frame, not of the first
        lowest = 0.0
        released = int(np.argmax(np.where(track.measured > 0, track.energy_j, -np.inf)))
    bound = theorem_3(model, track.q[released], track.v[released], potential_min_j=lowest)
    return TrackedJoint(name=name, model=model, seen=seen, track=track, bound=bound, lowest_j=lowest)


def _free(name: str, system: LagrangianSystem, seen: Seen) -> JointTrack:
    """The joint tracked by the system without V_z: what V_z is learned from, and where tracks start."""
    nothing = AnalyticPenalty(
        value=lambda q: np.zeros(q.shape[:-1]), gradient=lambda q: np.zeros_like(q), curvature_limit=0.0
    )
    free = PenalisedModel(system=system, penalty=nothing, strength=0.0)
    return track_joint(free, seen.sights, *_start(seen), power_w=FREE_POWER_W[name], start_sd=START_SD[name])


def _cut(seen: Seen, most: int) -> Seen:
    """From the first frame in which the joint was seen, at most so many frames."""
    first = int(np.argmax(np.isfinite(seen.q).all(axis=1)))
    return at_frames(seen, slice(first, first + most))


def _start(seen: Seen) -> tuple[Array, Array]:
    """Coordinates and velocities at the first frame: a parabola through the first samples."""
    t = seen.sights.t_s[:12] - seen.sights.t_s[0]
    q = seen.q[:12]
    finite = np.isfinite(q).all(axis=1)
    if finite.sum() < 4:
        return q[0], np.zeros(q.shape[1])
    powers = np.polynomial.polynomial.polyfit(t[finite], q[finite], 2)
    return powers[0], powers[1]


def _prepared(recording: SyntheticRecording) -> Recording:
    return clean(of_pixels(recording.pixels, recording.cameras, recording.skeleton, name=recording.name))


def _sights(
    prepared: Recording, child: str, centre_m: Array, centre_cov_m2: Array, axes: Array, chart: Callable[[Array], Array]
) -> JointSights:
    if not prepared.cameras:
        raise ValueError(f"{prepared.name}: has no cameras: give pixels")
    m, noise = prepared.names.index(child), cleaned(prepared).noise
    return JointSights(
        t_s=prepared.t_s,
        matrices=prepared.matrices,
        uv_px=prepared.uv_px[:, :, [m]],
        sd_px=prepared.ray_scale_px[:, :, [m]],
        dof=np.full(len(prepared.uv_px), USUAL_DOF) if noise is None else noise.dof,
        centre_m=centre_m,
        centre_cov_m2=centre_cov_m2,
        axes=axes,
        chart=chart,
    )


def _stand(recording: SyntheticRecording, *, polar: bool) -> Seen:
    """A pendulum on a stand that does not move: the stand's markers give axes and centre once for all frames."""
    prepared = _prepared(recording)
    names, n_frames = prepared.names, len(prepared.t_s)
    trunk = [names.index(m) for m in recording.skeleton.trunk]
    frames = body_frames(prepared.xyz_m[:, trunk], dt_s=prepared.dt_s, cutoff_hz=STEADY_HZ, turns=False)
    tracks = marker_tracks(names, prepared.t_s, prepared.xyz_m, cov_m2=prepared.cov_m2)
    found = joint_variables(tracks, recording.skeleton, frames)
    body, plane = found["joint_body"][:, 0], found["joint_plane"][:, 0]
    pivot = names.index("pivot")
    seen = np.isfinite(prepared.xyz_m[:, pivot, 0])
    centre = np.broadcast_to(np.mean(prepared.xyz_m[seen, pivot], axis=0), (n_frames, 3))
    cov = np.broadcast_to(np.mean(prepared.cov_m2[seen, pivot], axis=0) / seen.sum(), (n_frames, 3, 3))
    truth = np.asarray(recording.truth.xyz_m[:, names.index("bob")] - recording.truth.xyz_m[:, pivot])
    if not polar:
        q = np.einsum("tji,tj->ti", frames.rotation, prepared.xyz_m[:, names.index("bob")] - centre)
        sights = _sights(prepared, "bob", centre, cov, frames.rotation, lambda at: at[:, None])
        return Seen(sights=sights, q=q, truth=np.einsum("tji,tj->ti", frames.rotation, truth))
    finite = np.isfinite(plane).all(axis=1)
    u, _, vt = np.linalg.svd(body[finite].T @ plane[finite], full_matrices=False)
    in_body = u @ vt  # (3, 2) axes of the limb's mean plane: down, and across
    axes = frames.rotation @ in_body
    q = np.einsum("tik,ti->tk", axes, prepared.xyz_m[:, names.index("bob")] - centre)
    sights = _sights(prepared, "bob", centre, cov, axes, _from_polar)
    return Seen(sights=sights, q=_to_polar(q), truth=_to_polar(np.einsum("tik,ti->tk", axes, truth)))


def _from_polar(q: Array) -> Array:
    """(r, theta), theta from the horizontal, to metres down and across: (n, 1, 2)."""
    return (q[:, :1] * np.stack([-np.sin(q[:, 1]), np.cos(q[:, 1])], axis=1))[:, None]


def _to_polar(x: Array) -> Array:
    """Metres down and across (n, 2) to (r, theta), theta from -3 pi/2 to pi/2."""
    return np.stack([np.hypot(x[:, 0], x[:, 1]), np.arctan2(x[:, 1], x[:, 0]) - 0.5 * np.pi], axis=1)


def _limb(recording: SyntheticRecording) -> Seen:
    """The left wrist about its elbow in the axes of the trunk, both as they move."""
    prepared = _prepared(recording)
    names = prepared.names
    trunk = [names.index(m) for m in recording.skeleton.trunk]
    frames = body_frames(prepared.xyz_m[:, trunk], dt_s=prepared.dt_s, cutoff_hz=STEADY_HZ)
    tracks = marker_tracks(names, prepared.t_s, prepared.xyz_m, cov_m2=prepared.cov_m2)
    q_m = joint_variables(tracks, recording.skeleton, frames)["joint_body"]
    joint = next(i for i, j in enumerate(recording.skeleton.joints) if j.centre == "elbow_l")
    elbow, hand = names.index("elbow_l"), names.index("wrist_l")
    truth = recording.truth.xyz_m[:, hand] - recording.truth.xyz_m[:, elbow]
    sights = _sights(
        prepared,
        "wrist_l",
        prepared.xyz_m[:, elbow],
        np.where(np.isfinite(prepared.cov_m2[:, elbow]), prepared.cov_m2[:, elbow], 0.0),
        frames.rotation,
        lambda at: at[:, None],
    )
    return Seen(sights=sights, q=q_m[:, joint], truth=np.einsum("tji,tj->ti", frames.rotation, truth))


def _scaled(seen: Seen, scale_m: float) -> Seen:
    sights = replace(seen.sights, chart=lambda at: scale_m * at[:, None])
    return Seen(sights=sights, q=seen.q / scale_m, truth=seen.truth / scale_m)
