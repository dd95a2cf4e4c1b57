"""Net joint forces and moments by inverse dynamics, where no unknown force acts from outside."""

from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array, cross
from eal.systems import GRAVITY_M_S2
from mocap.filters.velocities import Motion
from mocap.kinematics.angles import unit
from mocap.kinematics.cycles import Footfalls
from mocap.kinematics.delta import STEP, Naming, Points, called, central, edges, extent, neighbours, quadratic, slopes
from mocap.kinematics.points import Distal, distal_parts
from mocap.kinematics.records import Kinematics, Quantity, Rests
from mocap.measures import AXES
from mocap.skeleton import Skeleton


def moments(motion: Motion, skeleton: Skeleton, *, steps: Footfalls | None = None, recording: str = "") -> Kinematics:
    """Net force and moment that act across each joint on what is beyond it (Newton and Euler; Winter 2009).

    Segments are thin rods between two markers (or masses at one) that turn about no long axis. With the centre of mass
    r and the line d between the ends of each, and g gravity, force and moment about the joint's centre c are

        F = sum m (r'' - g),   M = sum m ((r - c) x (r'' - g) + d x d'' / 12).

    The flexion moment is that about the normal of parent, centre and child, positive where it flexes the joint.
    Standard deviations are of first order in positions and accelerations, which are taken for independent of each
    other; masses are taken for exact. There is no value where an unknown force acts from outside: on limbs that beat,
    on parts that undulate, on a foot while it stands.

    Args:
        motion: Points with velocities and joint covariances.
        skeleton: Joints, masses of segments, feet.
        steps: Which foot stands when; None: not known, limbs with feet are left out.
        recording: Its name.
    """
    found: list[Quantity] = []
    why: dict[str, list[str]] = defaultdict(list)
    for name, part in distal_parts(skeleton).items():
        reason = part
        if isinstance(part, Distal):
            reason = "" if steps is not None or not part.feet else "it has a foot, and when that stands is not known"
            if not reason:
                found += _of_joint(motion, part, skeleton, _standing(steps, part, motion))
        if reason:
            why[str(reason)].append(name)
    if not skeleton.joints:
        why["the skeleton has none"].append("joints")
    notes = [f"no moments of {', '.join(names)}: {reason}" for reason, names in why.items()]
    if any(isinstance(part, Distal) and part.feet for part in distal_parts(skeleton).values()):
        notes.append("no moments while a foot beyond the joint stands: the force of the ground is not known")
    return Kinematics(recording=recording, t_s=motion.t_s, quantities=tuple(found), notes=tuple(notes))


def _standing(steps: Footfalls | None, part: Distal, motion: Motion) -> NDArray[np.bool_]:
    """(T,) frames in which a foot beyond the joint stands, and those beside them."""
    if steps is None or not part.feet:
        return np.zeros(len(motion.t_s), dtype=bool)
    stands = steps.stance[:, [steps.feet.index(foot) for foot in part.feet]].any(axis=1)
    return np.convolve(stands, np.ones(3), mode="same") > 0


@dataclass(frozen=True, eq=False)
class _Loads:
    """Force and moment of what is beyond a joint, from (T, k, 3) positions and accelerations of its markers.

    Attributes:
        part: What is beyond the joint.
        gravity: (3,) m/s^2.
    """

    part: Distal
    gravity: Array

    def __call__(self, x: Array, a: Array) -> tuple[Array, Array]:
        """(T, 3) force in newtons and moment about the joint's centre in newton metres."""
        names, force, moment = self.part.markers, np.zeros_like(x[:, 0]), np.zeros_like(x[:, 0])
        centre = x[:, names.index(self.part.joint.centre)]
        for piece in self.part.segments:
            i, j, share, mass = names.index(piece.start), names.index(piece.end), piece.centre, 1e-3 * piece.mass_g
            lever = (1 - share) * x[:, i] + share * x[:, j] - centre
            pull = (1 - share) * a[:, i] + share * a[:, j] - self.gravity
            force += mass * pull
            # of a thin uniform rod about its centre
            moment += mass * (cross(lever, pull) + (1 / 12) * cross(x[:, j] - x[:, i], a[:, j] - a[:, i]))
        return force, moment


def _of_joint(motion: Motion, part: Distal, skeleton: Skeleton, standing: NDArray[np.bool_]) -> Iterator[Quantity]:
    """Components of force and moment, and the flexion moment."""
    points = Points.of(motion, part.markers)
    loads = _Loads(part, -GRAVITY_M_S2 * np.array(AXES[skeleton.measures.up]))
    rests = np.where(standing, Rests.MISSING, edges(points.rests)).astype(np.int8)
    joint = part.joint.name
    for which, (load, unit_, along) in enumerate((("force", "n", "along"), ("moment", "n_m", "about"))):
        for k, axis in enumerate("xyz"):
            what = f"net {load} across {joint} on what is beyond it, {along} {axis}"
            naming = Naming(f"{joint}_{load}_{axis}", unit_, what, "joint")
            yield _load(points, lambda x, a, w=which, k=k: loads(x, a)[w][:, k], naming, rests)

    def flexion(x: Array, a: Array) -> Array:
        normal = unit(cross(x[:, 0] - x[:, 1], x[:, 2] - x[:, 1]))
        return -np.sum(normal * loads(x, a)[1], axis=1)

    what = f"net moment that flexes {joint}: about the normal of {', '.join(part.markers[:3])}"
    yield _load(points, flexion, Naming(f"{joint}_flexion_moment", "n_m", what, "joint"), rests)


def _load(
    points: Points, function: Callable[[Array, Array], Array], naming: Naming, rests: NDArray[np.int8]
) -> Quantity:
    """A function of positions and accelerations, linear in the second, of (T, k, 3) each.

    With the slopes h of positions x and g of accelerations its variance is h' P h + that of the change of g' v from the
    frame before to the frame after.
    """
    t_s, x, k = points.motion.t_s, points.x, len(points.names)
    a = np.stack([central(t_s, column) for column in points.v.reshape(len(x), -1).T], axis=1).reshape(x.shape)
    order = np.arange(6 * k).reshape(k, 6)
    place, moving = order[:, :3].ravel(), order[:, 3:].ravel()

    def at(both: Array) -> Array:
        return function(both[:, :k], both[:, k:])

    with np.errstate(invalid="ignore", divide="ignore"):
        both = np.concatenate([x, a], axis=1)
        h, g = np.split(slopes(at, both, STEP * extent(x), angle=False), 2, axis=1)
        before, after = neighbours(len(x))
        speeds = points.cov[:, moving][:, :, moving]
        change = np.sqrt(points.kept) * quadratic(g, speeds[before] + speeds[after]) / (t_s[after] - t_s[before])
        sd = np.hypot(quadratic(h, points.cov[:, place][:, :, place]), change)
    return called(naming, points.names, at(both), sd, rests)
