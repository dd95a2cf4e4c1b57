"""Potentials of limbs, learned from trials."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from mocap.filters.anatomy import Anatomy, reflection
from mocap.filters.motion.potential import PosePotential, Pull
from mocap.filters.poses import Shapes, known_shapes
from mocap.filters.subspace import PoseSubspace

from eal.arrays import Array
from eal.rotations import RotationKernel

Learn = Callable[..., Callable[[Array], Array]]


def limb_potentials(
    shapes: Shapes,
    own: PoseSubspace,
    anatomy: Anatomy,
    *,
    velocities: bool,
    tau_s: float,
    learn: Learn,
) -> tuple[PosePotential, ...]:
    """A potential for each limb, of its relative joint coordinates q (``Limb``), or of [q, tau qdot].

    What is learned from are the poses of all trials that are well known, and those of the same limb of the other side,
    reflected. V_z of q alone is a potential energy; of [q, tau qdot] it is an empirical density in phase space, and no
    potential of a Lagrangian.

    Args:
        shapes: Of all trials.
        own: Subspace of the trial that is to be tracked.
        anatomy: Its limbs.
        velocities: Whether velocities are part of it.
        tau_s: Makes velocities as large as positions.
        learn: (N, d) samples of unit size to the gradient of their potential, a second (``PoseSettings.pull``).
    """
    pose, rate = known_poses(shapes)
    turn = sides(shapes.subspace.mean, anatomy)
    out = []
    for limb in anatomy.limbs:
        maps = [limb.map(len(own.mean) // 3)]
        other = anatomy.mirrored(limb)
        if turn is not None and other is not None:
            maps.append(other.map(len(own.mean) // 3, turn))
        found = held_together(maps, pose, rate, own, tau_s=tau_s if velocities else None, learn=learn)
        out.append(replace(found, root=limb.parents[0], children=limb.children))
    return tuple(out)


def known_poses(shapes: Shapes) -> tuple[Array, Array]:
    """(N, D) poses of all trials that are known well, and their velocities."""
    poses, rates = [], []
    for z, rate, offset, residual, keep in zip(
        shapes.z,
        shapes.rate,
        shapes.offset,
        shapes.residual,
        known_shapes(shapes),
        strict=True,
    ):
        pose = shapes.subspace.mean + offset + z @ shapes.subspace.basis.T + np.nan_to_num(residual)
        poses.append(pose[keep])
        rates.append(rate[keep] @ shapes.subspace.basis.T)
    return np.concatenate(poses), np.concatenate(rates)


def held_together(
    maps: Sequence[Array],
    pose: Array,
    rate: Array,
    own: PoseSubspace,
    *,
    tau_s: float | None,
    learn: Learn,
    joints: Sequence[tuple[int, float]] = (),
) -> PosePotential:
    """The potential of linear coordinates q of a pose, or of [q, tau qdot].

    Args:
        maps: (d, D) from a pose to q; of further ones the same samples are another side's.
        pose: (N, D) poses.
        rate: (N, D) their velocities.
        own: Subspace of the trial that is to be tracked.
        tau_s: Makes velocities as large as positions; None: q alone.
        learn: As ``limb_potentials``.
        joints: Where q are joint angles in arc length, the number of coordinates of each joint and its arm: V_z is then
            one on rotations (``eal.RotationKernel``).
    """
    q = np.concatenate([pose @ each.T for each in maps])
    unit = max(float(np.sqrt(q.var(axis=0).mean())), 1e-9)
    samples, mean, on_residual = q / unit, maps[0] @ own.mean / unit, maps[0] / unit
    of_shape = on_residual @ own.basis
    on_shape = np.hstack([of_shape, np.zeros_like(of_shape)])
    if tau_s is not None:  # of the directions in which the subspace moves the limb
        along = _range(of_shape)
        moving = np.concatenate([rate @ each.T for each in maps]) @ along * (tau_s / unit)
        samples = np.hstack([samples, moving])
        mean = np.concatenate([mean, np.zeros(along.shape[1])])
        on_residual = np.vstack([on_residual, np.zeros((along.shape[1], on_residual.shape[1]))])
        turning = tau_s * along.T @ of_shape
        on_shape = np.vstack([on_shape, np.hstack([np.zeros_like(turning), turning])])
    if joints:
        lines = samples.shape[1] - q.shape[1]
        freedoms = (*(k for k, _ in joints), *[0] * lines)
        scales = (*(arm / unit for _, arm in joints), *[1.0] * lines)
        learn = partial(learn, over=partial(RotationKernel, freedoms=freedoms, scales=scales))
    gradient = learn(samples)
    return PosePotential(
        mean=mean,
        on_shape=on_shape,
        on_residual=on_residual,
        samples=samples,
        gradient=gradient,
        potential=gradient.potential if isinstance(gradient, Pull) else None,
    )


def _range(a: Array) -> Array:
    """(d, p) orthonormal directions that a matrix (d, r) maps to."""
    u, s, _ = np.linalg.svd(a, full_matrices=False)
    return u[:, s > 1e-6 * s[0]]


def sides(mean_pose: Array, anatomy: Anatomy) -> Array | None:
    """The reflection that takes one side to the other; None where sides are not known, or not alike."""
    if not anatomy.mirror or all(i == m for i, m in enumerate(anatomy.mirror)):
        return None
    turn, missed = reflection(mean_pose.reshape(-1, 3), anatomy.mirror)
    return turn if missed < 0.3 else None
