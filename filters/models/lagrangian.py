"""What an animal's Lagrangian learns from trials: elastic joints, damping, V_z of limbs, noise of the joints."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from mocap.filters.anatomy import Anatomy
from mocap.filters.animal import Animal, Valley
from mocap.filters.bodies import Bodies, cloud, rod, rod_masses
from mocap.filters.models.articulated import ANGLES, ArticulatedSettings, learn_articulated
from mocap.filters.models.pose import PoseSettings, recorded_motion, unseen_potential
from mocap.filters.motion.articulated import ArticulatedMotion
from mocap.filters.motion.lagrangian import LagrangianMotion
from mocap.filters.motion.potential import PosePotential
from mocap.filters.motion.shape import RecordedMotion, unexplained
from mocap.filters.poses import MATERN_3_2_HALF, MATERN_HALF, MarkerTrial
from mocap.filters.subspace import PoseSubspace
from scipy.linalg import eigh, solve_continuous_lyapunov

from eal.arrays import Array
from eal.kernels import Kernel
from eal.potential import EmpiricalPotential
from eal.rotations import RotationKernel

FLESH = 0.3
"""Armature of a joint's coordinates: so much of the greatest inertia that one of them feels at rest.
Chosen on one flight of a bat (docs/experiments/joints_measured.md)."""
CHARGED = 0.1
"""An unseen pose of the same motion is charged so much of the mean kinetic energy. Of 0.03, 0.1 and 0.3
chosen on one flight of a bat (docs/experiments/joints_measured.md)."""

LAGRANGIAN = replace(ANGLES, potential="limbs", regression=0.0)
"""V_z of each limb's joint angles as a potential energy, and no regression on other markers."""


@dataclass(frozen=True, kw_only=True)
class LagrangianSettings(ArticulatedSettings):
    """Choices of the articulated model with the mechanics of the whole animal, its true mass matrix and all.

    Attributes:
        pose: Noise and potentials of the joint angles.
        trunk: Factor on the mass of the trunk. Ground and air push back at what limbs do to it: at 1 the trunk recoils
            from every muscle as if the animal were alone in space, much above it is held.
    """

    pose: PoseSettings = LAGRANGIAN
    trunk: float = 1000.0

    @property
    def description(self) -> str:
        """Its name."""
        return "Lagrangian"

    def learned(self, trials: Sequence[MarkerTrial], anatomy: Anatomy) -> LagrangianMotion:
        """The model of trials, for tracking the last one."""
        found = learn_articulated(trials, anatomy, self.pose)
        motion = recorded_motion(found.angles, found.shapes)
        return with_lagrangian(found.model, motion, self.pose, anatomy, trunk=self.trunk if anatomy.limbs else 1.0)


def bodies_of(model: ArticulatedMotion, anatomy: Anatomy, trunk: float) -> Bodies:
    """Rods of the stated masses behind the joints (``rod_masses``), balls of equal mass at the markers of the root.

    A root whose mass is not stated weighs as much as all limbs; it counts for ``trunk`` times its mass. Rods alone turn
    about their own axes as if they were nothing, and forces that are right in one pose then spin them in the next:
    ``FLESH`` turns with each joint.
    """
    tree, ends = model.tree, model.ends
    mass, centre, _ = rod_masses([(int(a), int(b)) for a, b in ends], model.length_m, anatomy.masses)
    mine = tree.segment == 0
    root_kg = sum(part.kg for part in anatomy.masses if mine[part.start] and mine[part.end]) or float(mass.sum())
    root_kg *= trunk
    parts = [cloud(root_kg, tree.place_m[mine], 0.1 * float(np.median(model.length_m)))]
    parts += [rod(m, tree.place_m[end], centre=c) for m, c, end in zip(mass, centre, ends[:, 1], strict=True)]
    bodies = Bodies(
        tree=tree,
        mass_kg=np.array([root_kg, *mass]),
        centre_m=np.array([at for at, _ in parts]),
        inertia_kg_m2=np.array([inertia for _, inertia in parts]),
    )
    felt = np.diag(inner_mass(bodies, model.subspace.mean / model.arm_m))
    return replace(bodies, armature_kg_m2=FLESH * np.array([felt[tree.joint == j].max() for j in tree.joint]))


def inner_mass(bodies: Bodies, angles: Array) -> Array:
    """(F, F) mass that the joints of a free animal feel, as its root gives way: M_qq - M_qr M_rr^-1 M_rq."""
    mass = bodies.mass(angles[None])[0]
    return mass[6:, 6:] - mass[6:, :6] @ np.linalg.solve(mass[:6, :6], mass[:6, 6:])


def with_lagrangian(
    model: ArticulatedMotion, motion: RecordedMotion, settings: PoseSettings, anatomy: Anatomy, *, trunk: float
) -> LagrangianMotion:
    """The articulated model with a Lagrangian of all its joint angles in place of the mechanics of a subspace.

    Of angles y in coordinates in which the mass at rest is 1, S their covariance and R that of their rates:

    - K S + S K = 2 R: the symmetric stiffness that explains accelerations best (least squares, as -E y'' y^T = R in a
      stationary motion). It is positive, because S and R are (Lyapunov); that of ``linear_shape`` need not be.
    - W is the density of the accelerations that K leaves unexplained: the noise.
    - D R + R D = W: the damping that takes out what this noise feeds in. It dissipates, because W is positive.

    For an angle by itself that is a Matern-3/2 process of the same memory as that of ``ArticulatedMotion``: K = a^2,
    D = 2a, W = 4 a^3 S.

    Args:
        model: Joints, subspace and process of the angles.
        motion: What was recorded in the subspace.
        settings: Noise and potentials: with ``limbs`` V_z of each limb's joint angles is a potential energy, with
            ``limb motion`` a density of angles and velocities updates the prediction, and is no part of the Lagrangian.
        anatomy: Masses.
        trunk: Factor on the mass of the root (``LagrangianSettings.trunk``).
    """
    bodies = bodies_of(model, anatomy, trunk)
    arm, basis, own = model.arm_m, model.subspace.basis, model.subspace.residual_sd
    rate = MATERN_3_2_HALF / MATERN_HALF * model.residual_rate_hz  # at which a Matern-3/2 process is as correlated
    count = len(arm)
    rest = model.subspace.mean / arm
    root = np.linalg.cholesky(inner_mass(bodies, rest)).T
    bring = root / arm  # y of angles in arc length
    spread = _whole(np.cov(motion.z.T), basis, own**2)
    speed = _whole(np.cov(motion.rate.T), basis, rate**2 * own**2)
    rates = bring @ speed @ bring.T
    stiffness = solve_continuous_lyapunov(bring @ spread @ bring.T, 2 * rates)
    felt = np.linalg.pinv(basis) @ np.linalg.solve(bring, stiffness @ bring @ basis)
    left = motion.acceleration + (motion.z - motion.z.mean(axis=0)) @ felt.T
    factor = unexplained(left, motion)
    white = _whole(factor @ factor.T, basis, 4 * rate**3 * own**2)
    damping = solve_continuous_lyapunov(rates, bring @ white @ bring.T)
    found, strength = _valleys(model, 0.5 * float(np.trace(rates)), settings)
    curved = sum((v.potential.curvature_limit * v.scale.T @ v.scale for v in found), np.zeros((count, count)))
    fastest = float(eigh(curved, root.T @ root, eigvals_only=True)[-1])  # of V_z alone, squared, for 1/eps^2 = 1 J
    # omega h <= 1: a stiffer V_z would throw a limb out of it
    strength = min(strength, (1.0 / motion.dt_s) ** 2 / max(fastest, 1e-30))
    animal = Animal(
        bodies=bodies,
        rest_rad=rest,
        stiffness=_symmetric(root.T @ stiffness @ root),
        damping=_symmetric(root.T @ damping @ root),
        valleys=found,
        strength_j=strength,
    )
    values = {f.name: getattr(model, f.name) for f in fields(ArticulatedMotion) if f.init}
    potentials = () if settings.potential == "limbs" else model.potentials
    return LagrangianMotion(
        **values
        | {
            "name": "lagrangian",
            "subspace": PoseSubspace(mean=model.subspace.mean, basis=np.eye(count), residual_sd=np.zeros(count)),
            "shape_sd": 2 * np.sqrt(np.concatenate([np.diag(spread), np.diag(speed)])),
            "usual": None,
            "potentials": tuple(_of_angles(one, basis) for one in potentials),
        },
        animal=animal,
        white=np.linalg.cholesky(_symmetric(white)),
    )


def _valleys(model: ArticulatedMotion, kinetic_j: float, settings: PoseSettings) -> tuple[tuple[Valley, ...], float]:
    """V_z of the angles of limbs as potential energies, and 1/eps^2 = ``CHARGED`` T / V, before steps limit it.

    V is the sum over limbs of V_z of poses that it was not learned from (``unseen_potential``), T the mean kinetic
    energy.
    """
    limbs = [(one, one.potential) for one in model.potentials if isinstance(one.potential, EmpiricalPotential)]
    if settings.potential != "limbs" or not limbs:
        return (), 0.0
    unseen = sum(float(np.mean(-np.expm1(-_unseen(one.samples, v.kernel)))) for one, v in limbs)
    found = tuple(Valley(potential=v, scale=one.on_residual * model.arm_m) for one, v in limbs)
    return found, CHARGED * kinetic_j / max(unseen, 1e-9)


def _unseen(samples: Array, kernel: Kernel) -> Array:
    """-log(1 - V_z) of poses that it was not learned from, with its own kernel on rotations."""
    if not isinstance(kernel, RotationKernel):
        return unseen_potential(samples)
    return unseen_potential(samples, over=lambda inner: replace(kernel, kernel=inner))


def _of_angles(limb: PosePotential, basis: Array) -> PosePotential:
    """A potential of what a subspace and residuals do together, as a function of all angles and their rates."""
    moving = limb.on_shape[:, basis.shape[1] :] @ np.linalg.pinv(basis)
    on_shape, on_residual = np.hstack([limb.on_residual, moving]), limb.on_residual[:, :0]
    return replace(limb, on_shape=on_shape, on_residual=on_residual, children=())


def _whole(cov: Array, basis: Array, own: Array) -> Array:
    """Covariance of all angles in arc length: of what they do together, and of each by itself."""
    return basis @ np.atleast_2d(cov) @ basis.T + np.diag(own)


def _symmetric(a: Array) -> Array:
    return 0.5 * (a + a.T)
