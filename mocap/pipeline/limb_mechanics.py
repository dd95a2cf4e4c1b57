"""Limbs as the paper's models of motion: rods, a true mass matrix, V_z of the bones' directions.

This is a Lagrangian, L = v^T M(q) v / 2 - V_z(q)/eps^2, and its implicit midpoint step is the prediction of an
unscented Kalman filter. The pose model that fills gaps is none (``mocap.filters.motion.enforce``).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eal import EmpiricalPotential, GaussianKernel, fit_potential
from eal.bounds import theorem3
from eal.integrators import IntegrationError
from eal.lagrangian import PenalisedModel
from eal.over_time import at_frames
from eal.rods import DirectionPenalty, RodLimb
from mocap.cameras.camera import stacked
from mocap.cleaning.click_noise import USUAL_DOF
from mocap.errors import MocapError
from mocap.filters.anatomy import Limb, anatomy_of, masses_of
from mocap.filters.bodies import rod_masses
from mocap.filters.body_axes import body_frames
from mocap.filters.lagrangian import JointSights, JointTrack, learned_noise, track_joint
from mocap.pipeline.run import Run
from mocap.records import MarkerTracks, Status
from mocap.skeleton import Skeleton

Array = NDArray[Any]
"""Of any type of number: this file stands between libraries that name theirs."""

BETA = 1.0
"""Kernel width: over the median squared distance of the samples, as in ``mocap.filters.models.pose``."""
LAMBDA = 1e-3
MOST_SAMPLES = 150
LEAST_SAMPLES = 30
LEAST_BONES = 2
JOINT_HZ = 30.0
"""Body axes follow the trunk up to this frequency."""
TRIED = 80
"""Frames by which 1/eps^2 and the power of the noise are chosen."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LimbMechanics:
    """A limb tracked by its own mechanics.

    Attributes:
        root: Marker that it hangs on.
        markers: (J,) outer end of each bone.
        limb: Its rods.
        stated: Whether masses are from the skeleton; else uniform rods make up ``UNKNOWN_KG``.
        model: L = v^T M(q) v / 2 - V_z(q)/eps^2, in the axes of the body, which are taken to be at rest.
        noise: Factor on the white accelerations of each joint, whose density follows from the recorded motion: they
            stand for muscles, air and what the body's own motion adds.
        first: Frame of the recording at which the track begins: the first that shows the whole limb.
        track: Coordinates, velocities, energy and V_z.
        kinetic_j: (T,) v^T M(q) v / 2 at the means.
        bound: (T,) V_z that no motion released in that frame exceeds: Theorem 3, with U = 0.
        length_sd: (J,) by which share of its length each bone varies, noise included.
        xyz_m: (T, J, 3) markers in the world.
        cov_m2: (T, J, 3, 3) their covariance.
    """

    root: str
    markers: tuple[str, ...]
    limb: RodLimb
    stated: bool
    model: PenalisedModel
    noise: float
    first: int
    track: JointTrack
    kinetic_j: Array
    bound: Array
    length_sd: Array
    xyz_m: Array
    cov_m2: Array

    @property
    def name(self) -> str:
        """That of its root and its first joint."""
        return f"{self.root} to {self.markers[0]}"

    @property
    def strength_j(self) -> float:
        """1/eps^2."""
        return float(self.model.strength)


@dataclass(frozen=True, eq=False, kw_only=True)
class Filmed:
    """A recording that was tracked, and the rays that were believed.

    Attributes:
        name: Of the recording.
        skeleton: Rigid bones, trunk, masses.
        markers: What the tracker made of it.
        seen: (T, M) samples that were measured.
        matrices: (C, 3, 4) projections.
        uv_px: (C, T, M, 2) ideal pixels; NaN where not seen or not believed.
        sd_px: (C, T, M) scale of Student's t of a coordinate.
        dof: (C,) its degrees of freedom.
    """

    name: str
    skeleton: Skeleton
    markers: MarkerTracks
    seen: Array
    matrices: Array
    uv_px: Array
    sd_px: Array
    dof: Array


def filmed_run(run: Run) -> Filmed:
    """A run: its believed rays, each camera's scale by how its rays miss the track.

    Raises:
        MocapError: positions without cameras.
    """
    if run.ideal_px is None or not run.cameras:
        raise MocapError(f"{run.name}: mechanics of limbs need pixels and cameras, not positions alone")
    uv = np.where(run.tracked.used[..., None], run.ideal_px.uv_px, np.nan)
    away = np.abs(uv - run.tracked.reprojected_px)
    sd = np.array([1.4826 * np.nanmedian(one) if np.isfinite(one).any() else 1.0 for one in away])
    return Filmed(
        name=run.name,
        skeleton=run.skeleton,
        markers=run.tracked.markers,
        seen=run.tracked.markers.status == Status.MEASURED,
        matrices=stacked(run.cameras),
        uv_px=uv,
        sd_px=np.broadcast_to(np.maximum(sd, 0.05)[:, None, None], uv.shape[:3]),
        dof=np.full(len(uv), USUAL_DOF),
    )


def limb_mechanics(filmed: Filmed) -> list[LimbMechanics]:
    """The longest chain of every limb of the skeleton, tracked by its own mechanics.

    The root of a limb and the axes of the body are those of the track; the limb's own markers are tracked from pixels.
    V_z is learned from the directions of all its bones together, in the frames in which all were seen; 1/eps^2 and the
    noise are the most likely ones of a stretch that a first V_z was not learned from.

    Args:
        filmed: The recording.

    Raises:
        MocapError: no limb of the skeleton is seen whole often enough.
    """
    names = filmed.markers.names
    anatomy = anatomy_of(names, filmed.skeleton.trunk, filmed.skeleton.rigid)
    chains = [longest_chain(limb) for limb in anatomy.limbs]
    limbs = [limb for limb in chains if len(limb.children) >= LEAST_BONES and filmed.skeleton.trunk]
    if not limbs:
        raise MocapError(
            f"{filmed.name}: its skeleton has no limb of {LEAST_BONES} rigid bones on a trunk: state bones and trunk"
        )
    found = [_tracked(filmed, limb) for limb in limbs]
    known = [one for one in found if one is not None]
    if not known:
        raise MocapError(
            f"{filmed.name}: no limb could be followed: each needs {LEAST_SAMPLES} frames that show it whole, to learn "
            "V_z from, and no gap so long that its bones turn over"
        )
    return known


def _tracked(filmed: Filmed, limb: Limb) -> LimbMechanics | None:
    markers, outer = filmed.markers, list(limb.children)
    names, t_s = markers.names, markers.t_s
    order = {child: i for i, child in enumerate(outer)}
    parents = tuple(order.get(parent, -1) for parent in limb.parents)
    root = limb.parents[0]
    trunk = [names.index(m) for m in filmed.skeleton.trunk]
    there = np.flatnonzero(np.isfinite(markers.xyz_m[:, [root, *outer], 0]).all(axis=1))
    if len(there) < LEAST_SAMPLES:
        return None
    body = body_frames(markers.xyz_m[:, trunk], dt_s=float(np.diff(t_s).mean()), cutoff_hz=JOINT_HZ)
    bones_m = np.einsum("tji,tkj->tki", body.rotation, markers.xyz_m[:, outer] - markers.xyz_m[:, list(limb.parents)])
    ends = [[child, parent] for child, parent in zip(outer, limb.parents, strict=True)]
    whole = np.asarray(np.all([filmed.seen[:, pair].all(axis=1) for pair in ends], axis=0))
    if whole.sum() < LEAST_SAMPLES:
        return None
    samples = np.flatnonzero(whole)
    frames = slice(int(samples[0]), int(samples[-1]) + 1)
    length = np.linalg.norm(bones_m, axis=-1)
    length_m = np.median(length[whole], axis=0)
    unit = bones_m / length[..., None]
    mean = unit[whole].mean(axis=0)
    mean /= np.linalg.norm(mean, axis=-1, keepdims=True)
    masses = masses_of(names, filmed.skeleton.measures.masses)
    mass, centre, stated = rod_masses([(p, c) for c, p in ends], length_m, masses)
    rods = RodLimb(parents=parents, length_m=length_m, mass_kg=mass, centre=centre, mean=mean)
    q = rods.coordinates(np.where(np.isfinite(unit), unit, rods.mean))
    v = np.gradient(q, t_s, axis=0)
    system = rods.system()
    scale = float(np.median(system.kinetic(q[there], v[there])))
    acceleration = np.gradient(v, t_s, axis=0)
    density = np.diag(2.0 * np.nanstd(v[whole], axis=0) * np.nanstd(acceleration[whole], axis=0))
    sights = _sights(filmed, rods, body.rotation, root, outer)
    start_sd = (0.1, 0.1 * float(np.sqrt(np.mean(v[there] ** 2))) + 1e-6)

    def model(samples: Array) -> PenalisedModel:
        flat = unit[samples].reshape(len(samples), -1)
        return PenalisedModel(
            system=system,
            penalty=DirectionPenalty(limb=rods, potential=_potential(flat)),
            strength=10.0 * scale,
        )

    begun = samples[samples >= frames.stop - TRIED]
    tried = slice(int(begun[0]) if len(begun) else frames.start, frames.stop)
    aside = samples[samples < tried.start]
    first = model(aside if len(aside) >= LEAST_SAMPLES else samples)
    chosen, power = learned_noise(
        first,
        at_frames(sights, tried),
        q[tried.start],
        v[tried.start],
        powers_w=np.array([0.03, 0.3, 3.0]),
        strengths_j=scale * np.array([1.0, 3.0, 10.0]),
        start_sd=start_sd,
        density=density,
    )
    last = PenalisedModel(system=system, penalty=model(samples).penalty, strength=chosen.strength)
    try:
        track = track_joint(
            last,
            at_frames(sights, frames),
            q[frames.start],
            v[frames.start],
            power_w=power,
            start_sd=start_sd,
            density=density,
        )
    except IntegrationError:  # nothing holds it in a gap, and its bones turn over
        return None
    kinetic = system.kinetic(track.q, track.v)
    eps2 = float(last.strength)
    bound = np.full(len(kinetic), np.inf)
    if eps2 > 0:  # 0: a limb at rest has no energy to scale it by
        released = zip(track.value.tolist(), kinetic.tolist(), strict=True)
        bound = np.array([theorem3(eps2, value0=a, kinetic0=k, potential0=0.0, potential_min=0.0) for a, k in released])
    xyz, cov = _world(track, rods, at_frames(sights, frames))
    spread = 1.4826 * np.median(np.abs(length[whole] - length_m), axis=0) / length_m
    return LimbMechanics(
        root=names[root],
        markers=tuple(names[m] for m in outer),
        limb=rods,
        stated=stated,
        model=last,
        noise=power,
        first=frames.start,
        track=track,
        kinetic_j=kinetic,
        bound=bound,
        length_sd=spread,
        xyz_m=xyz,
        cov_m2=cov,
    )


def longest_chain(limb: Limb) -> Limb:
    """The bones from a limb's root to the outer end with most bones before it; of equals the first."""
    inner = dict(zip(limb.children, limb.parents, strict=True))
    ways = []
    for child in limb.children:
        way = [child]
        while inner[way[-1]] in inner:
            way.append(inner[way[-1]])
        ways.append(way[::-1])
    best = max(ways, key=len)
    return Limb(tuple(best), tuple(inner[child] for child in best))


def _potential(samples: Array) -> EmpiricalPotential:
    chosen = samples[np.linspace(0, len(samples) - 1, min(len(samples), MOST_SAMPLES)).astype(int)]
    apart = np.sum((chosen[:, None] - chosen[None]) ** 2, axis=-1)
    width = float(np.median(apart[np.triu_indices(len(chosen), 1)]))
    return fit_potential(chosen, kernel=GaussianKernel(BETA / max(width, 1e-9)), lam=LAMBDA, accuracy=1e-3)


def _sights(filmed: Filmed, rods: RodLimb, rotation: Array, root: int, outer: Sequence[int]) -> JointSights:
    return JointSights(
        t_s=filmed.markers.t_s,
        matrices=filmed.matrices,
        uv_px=filmed.uv_px[:, :, outer],
        sd_px=filmed.sd_px[:, :, outer],
        dof=filmed.dof,
        centre_m=filmed.markers.xyz_m[:, root],
        centre_cov_m2=np.nan_to_num(filmed.markers.cov_m2[:, root]),
        axes=rotation,
        chart=rods.joints_m,
    )


def _world(track: JointTrack, rods: RodLimb, sights: JointSights) -> tuple[Array, Array]:
    """(T, J, 3) markers and their covariances (T, J, 3, 3), to first order, that of the root included."""
    d = rods.dimension
    xyz = sights.centre_m[:, None] + np.einsum("tik,tjk->tji", sights.axes, rods.joints_m(track.q))
    slope = np.zeros((len(track.q), len(rods.parents), 3, d))
    for i, one in enumerate(np.moveaxis(rods.slopes(track.q), 1, 0)):  # (T, 3, 2) of bone i
        slope[:, :, :, 2 * i : 2 * i + 2] = rods.paths[:, i, None, None] * rods.length_m[i] * one[:, None]
    slope = np.einsum("tik,tjkd->tjid", sights.axes, slope)
    cov = np.einsum("tjad,tde,tjbe->tjab", slope, track.cov[:, :d, :d], slope, optimize=True)
    return xyz, cov + sights.centre_cov_m2[:, None]
