"""What the articulated model learns from trials: segments and joints, and how joint angles move."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial

import numpy as np
from mocap.filters.anatomy import Anatomy, Limb
from mocap.filters.bones import RIGID
from mocap.filters.errors import FilterError
from mocap.filters.independent import FEWEST_FRAMES, INDEPENDENT
from mocap.filters.joint_types import Articulation, joints_of
from mocap.filters.models.base import FittedMotion, TrajectoryModel, TrialSet
from mocap.filters.models.limbs import held_together, known_poses, sides
from mocap.filters.models.pose import WEIGHT, PoseSettings, filter_s, learn_pose, recorded_motion
from mocap.filters.motion.articulated import ArticulatedMotion
from mocap.filters.motion.pose import PoseMotion
from mocap.filters.motion.potential import PosePotential
from mocap.filters.poses import (
    MarkerTrial,
    PoseTrial,
    Shapes,
    poses_of,
    radian,
    residual_memory_s,
    shapes_of,
)
from mocap.filters.subspace import PoseSubspace
from mocap.filters.tree import FittedPoses, Tree, fit_poses
from numpy.typing import NDArray

from eal.arrays import Array

ROOT = 0.01, 0.03
"""A trunk is near the body's path: to that share of the animal's extent, and in radians (``_with_riders``).
Chosen; not measured."""
TAUGHT_FRAMES = 4000
"""Of other recordings, from which joints and angles are learned. Chosen; not measured."""
FREEDOMS = {"ball": 3, "universal": 2, "hinge": 1, "fixed": 0}
ANGLES = PoseSettings(ranks=(8,), bones=0.0)
"""How joint angles move, as the pose model's settings have it of marker coordinates; their bones are segments."""


@dataclass(frozen=True, kw_only=True)
class ArticulatedSettings(TrajectoryModel):
    """Choices of the articulated model.

    Attributes:
        pose: How joint angles move, as the pose model's settings for marker coordinates; without bones, whose length
            the segments keep.
    """

    pose: PoseSettings = ANGLES

    @property
    def description(self) -> str:
        """Its name."""
        return "joint angles"

    def tuned_s(self, markers: int, frames: int) -> float:
        """As of poses."""
        return self.pose.tuned_s(markers, frames)

    def fit_s(self, markers: int, frames: int) -> float:
        """As of poses."""
        return self.pose.fit_s(markers, frames)

    def fill_s(self, markers: int, frames: int) -> float:
        """As of poses, whose markers are in one group."""
        return filter_s(markers, self.pose.ranks[0], frames)

    def applies(self, anatomy: Anatomy) -> bool:
        """Of an animal with rigid bones."""
        return bool(anatomy.bones)

    def tuned(self, trials: TrialSet) -> "ArticulatedSettings":
        """With the covariance of a regression, if there is one."""
        return replace(self, pose=self.pose.tuned(trials))

    def fit(self, trials: TrialSet) -> FittedMotion:
        """Find joints and lengths, fit the angles of each frame, learn how they move.

        Raises:
            FilterError: no bones are known by which segments could hang on each other.
        """
        model = self.learned(_taught_by(trials.trials), trials.anatomy)
        model = replace(model, regression=self.pose.regressed(trials))
        return FittedMotion(model, trials.trials[-1].t_s, trials.rigid)

    def learned(self, trials: Sequence[MarkerTrial], anatomy: Anatomy) -> ArticulatedMotion:
        """The model of trials, for tracking the last one."""
        return learn_articulated(trials, anatomy, self.pose).model


def _taught_by(trials: Sequence[MarkerTrial]) -> list[MarkerTrial]:
    """The last trial, and of the others the first ``TAUGHT_FRAMES``: fitting each frame takes time."""
    *others, last = trials
    before = np.cumsum([0, *(len(trial.t_s) for trial in others)])
    return [*(trial for trial, start in zip(others, before, strict=False) if start < TAUGHT_FRAMES), last]


@dataclass(frozen=True, eq=False)
class Build:
    """Which segment hangs where, the same in all trials.

    Attributes:
        root: Markers of the root.
        limbs: Segments that hang on it, from it outward.
        child: (J,) marker at the outer end of each segment.
        centre: (J,) marker at its joint.
        rest: (J, 3) direction of each segment at rest, in the axes of the root.
        axes: Axes (k, 3) of each joint.
        mirrored: Whether joints of one side have the mirrored axes of the other's.
    """

    root: tuple[int, ...]
    limbs: list[Limb]
    child: NDArray[np.int64]
    centre: NDArray[np.int64]
    rest: Array
    axes: list[Array]
    mirrored: bool

    @property
    def columns(self) -> NDArray[np.int64]:
        """(F,) coordinates among three a joint."""
        return np.concatenate([3 * j + np.arange(len(axes)) for j, axes in enumerate(self.axes)])


def rooted(anatomy: Anatomy) -> Anatomy:
    """An animal without a trunk, a chain, hangs on the marker in its middle: nearest to the farthest along the bones.

    Raises:
        FilterError: there are no bones.
    """
    if anatomy.limbs:
        return anatomy
    if not anatomy.bones:
        raise FilterError(
            "the articulated model needs rigid bones attached to the trunk, and the skeleton states none: add them, "
            "or let `mocap skeleton` propose them"
        )
    ends = sorted({end for bone in anatomy.bones for end in bone})
    chains = [replace(anatomy, trunk=(end,)).limbs for end in ends]
    reached = [sum(len(limb.children) for limb in limbs) for limbs in chains]
    deepest = [max(_depths(limbs)) if limbs else 0 for limbs in chains]
    middle = min(range(len(ends)), key=lambda i: (-reached[i], deepest[i]))
    return replace(anatomy, trunk=(ends[middle],))


def _depths(limbs: Sequence[Limb]) -> list[int]:
    out = [0]
    for limb in limbs:
        depth: dict[int, int] = {}
        for child, parent in zip(limb.children, limb.parents, strict=True):
            depth[child] = depth.get(parent, 0) + 1
        out += depth.values()
    return out


def find_build(body: Array, sd_m: Array, anatomy: Anatomy, chain: bool) -> Build:
    """Joints and their axes, from markers (N, M, 3) of all trials in axes of the body."""
    limbs = anatomy.limbs
    child = np.array([c for limb in limbs for c in limb.children])
    centre = np.array([p for limb in limbs for p in limb.parents])
    bones = body[:, child] - body[:, centre]
    size = np.linalg.norm(bones, axis=-1, keepdims=True)
    unit = np.where(np.isfinite(size) & (size > 0), bones / np.where(size > 0, size, 1.0), np.nan)
    count = np.isfinite(unit[..., 0]).sum(axis=0)
    rest = np.nansum(unit, axis=0)
    rest[count == 0] = (1.0, 0.0, 0.0)
    rest /= np.maximum(np.linalg.norm(rest, axis=1, keepdims=True), 1e-9)
    names = [str(m) for m in range(body.shape[1])]
    found = {int(joint.child): joint for joint in joints_of(names, body, sd_m, limbs)}
    plain = set(child.tolist()) if chain else _not_rigid(limbs, found, anatomy)
    kinds = {int(c): "universal" if int(c) in plain or int(c) not in found else found[int(c)].kind for c in child}
    index = {int(c): j for j, c in enumerate(child)}
    mirror = _mirror(body, anatomy)
    other = {c: index[anatomy.mirror[c]] for c in index if mirror is not None and anatomy.mirror[c] in index}
    axes: list[Array] = [np.zeros((0, 3))] * len(child)
    for c, j in index.items():
        twin = other.get(c, j)
        if twin < j and mirror is not None:
            rest[j], axes[j] = mirror @ rest[twin], -axes[twin] @ mirror.T
            continue
        kind = kinds[c]
        if twin != j and mirror is not None:
            rest[j] += mirror @ rest[twin]
            rest[j] /= np.linalg.norm(rest[j])
            kind = max(kind, kinds[int(child[twin])], key=FREEDOMS.__getitem__)
        axes[j] = _axes(kind, rest[j], rest[index[int(centre[j])]] if int(centre[j]) in index else None, found.get(c))
    return Build(anatomy.trunk, limbs, child, centre, rest, axes, mirror is not None)


def _not_rigid(limbs: Sequence[Limb], found: Mapping[int, Articulation], anatomy: Anatomy) -> set[int]:
    """Segments of limbs with a bone whose length is doubted, and of their other side.

    A bend to the side of a hinge there is an error of a marker as well as a turn of the segment before it.
    """
    doubted = {
        c
        for limb in limbs
        if any(c in found and found[c].length_sd > RIGID for c in limb.children)
        for c in limb.children
    }
    return doubted | {anatomy.mirror[c] for c in doubted if anatomy.mirror}


def _mirror(body: Array, anatomy: Anatomy) -> Array | None:
    """(3, 3) reflection of the root's axes that takes one side to the other; None: not known, or sides not alike."""
    seen = np.isfinite(body[..., 0]).any(axis=0)
    if not anatomy.mirror or not seen.all():
        return None
    turn = sides(np.nanmean(body, axis=0).ravel(), anatomy)
    return None if turn is None else turn.T


def _axes(kind: str, rest: Array, before: Array | None, found: Articulation | None) -> Array:
    """(k, 3) axes of a joint: across the segment at rest, of a ball along it as well, of a hinge across both."""
    if kind == "hinge" and found is not None:
        normal = found.axis if before is None else np.cross(before, rest)
        if np.linalg.norm(normal) < 0.1:
            normal = found.axis
        normal = normal - (normal @ rest) * rest
        return (normal / np.linalg.norm(normal))[None]
    first = np.cross(rest, np.eye(3)[np.argmin(np.abs(rest))])
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(rest, first), rest])[: FREEDOMS[kind]]


def tree_of(build: Build, body: Array, sd_m: Array, usual: Array) -> Tree:
    """The animal of one trial, with its own lengths and places of the root's markers.

    A length is the root of the mean squared distance less what the noise of both ends adds to that.

    Args:
        build: Its joints.
        body: (T, M, 3) markers in axes of the body.
        sd_m: (T, M) their noise.
        usual: (J,) lengths for segments that are hardly seen.
    """
    length, _ = lengths(build, body, sd_m)
    length = np.where(np.isfinite(length), length, usual)
    place = np.zeros((body.shape[1], 3))
    seen = np.isfinite(body[..., 0]).any(axis=0)
    place[seen] = np.nanmean(body[:, seen], axis=0)
    segment = np.zeros(body.shape[1], dtype=np.int64)
    segment[build.child] = np.arange(len(build.child)) + 1
    place[build.child] = length[:, None] * build.rest
    joint = np.concatenate([np.full(len(axes), j) for j, axes in enumerate(build.axes)]).astype(np.int64)
    return Tree(
        parent=segment[build.centre],
        joint_m=place[build.centre],
        axes=np.concatenate(build.axes),
        joint=joint,
        segment=segment,
        place_m=place,
    )


def lengths(build: Build, body: Array, sd_m: Array) -> tuple[Array, Array]:
    """(J,) lengths of the segments, NaN where hardly seen, and standard errors: neighbouring frames err alike."""
    away = body[:, build.child] - body[:, build.centre]
    squared = np.sum(away**2, axis=-1) - 3 * (sd_m[:, build.child] ** 2 + sd_m[:, build.centre] ** 2)
    count = np.isfinite(squared).sum(axis=0)
    mean = np.where(count > 0, np.nansum(squared, axis=0) / np.maximum(count, 1), np.nan)
    spread = np.sqrt(np.nansum((squared - mean) ** 2, axis=0) / np.maximum(INDEPENDENT * count**2, 1))
    length = np.sqrt(np.where((count >= FEWEST_FRAMES) & (mean > 0), mean, np.nan))
    return length, spread / (2 * length)


@dataclass(frozen=True, eq=False)
class Articulated:
    """What trials taught.

    Attributes:
        model: Joints and how their angles move, for tracking the last trial.
        angles: Joint angles of the trials in arc length, three columns a joint.
        shapes: Their subspace.
    """

    model: ArticulatedMotion
    angles: Sequence[PoseTrial]
    shapes: Shapes


def learn_articulated(trials: Sequence[MarkerTrial], anatomy: Anatomy, pose: PoseSettings = ANGLES) -> Articulated:
    """Learn the model from trials, for tracking the last one.

    Args:
        trials: The trials.
        anatomy: The animal.
        pose: How joint angles move (``ArticulatedSettings.pose``).
    """
    tree_anatomy = rooted(anatomy)
    poses = poses_of(trials, anatomy.trunk)
    body = [trial.y.reshape(len(trial.y), -1, 3) for trial in poses]
    noise = [trial.sd_m for trial in trials]
    build = find_build(np.concatenate(body), np.concatenate(noise), tree_anatomy, chain=not anatomy.limbs)
    usual, _ = lengths(build, np.concatenate(body), np.concatenate(noise))
    usual = np.where(np.isfinite(usual), usual, np.nanmedian(usual))
    skin = 0.03 * float(np.median(usual))  # a usual slip, before it is known
    build, trees, found = _with_riders(build, usual, body, noise, skin, chain=not anatomy.limbs)
    slipped = [_slip(*parts) for parts in zip(trees, found, body, strict=True)]
    places = [_mean(one) for one in slipped]
    tree = replace(trees[-1], place_m=trees[-1].place_m + places[-1])
    left = [one - place for one, place in zip(slipped, places, strict=True)]
    arms, columns = _arms(tree), build.columns
    turned = [
        replace(
            trial,
            y=_samples(fitted, arms, columns, 3 * len(build.child)),
            sd_m=np.zeros((len(trial.t_s), len(build.child))),
        )
        for trial, fitted in zip(poses, found, strict=True)
    ]
    shapes = shapes_of(turned, ranks=pose.ranks)
    wide = learn_pose(turned, replace(pose, potential="none"), shapes=shapes)
    potentials = _potentials(build, arms, tree_anatomy, wide, turned, shapes, pose)
    sd, own = _skin(left, noise, tree), wide.subspace
    counts = np.repeat([len(axes) for axes in build.axes], [len(axes) for axes in build.axes])
    subspace = PoseSubspace(
        mean=own.mean[columns],
        basis=own.basis[columns],
        residual_sd=own.residual_sd[columns] * np.sqrt(3 / counts),  # of three columns a joint some are empty
    )
    values = {f.name: getattr(wide, f.name) for f in fields(PoseMotion) if f.init}
    model = ArticulatedMotion(
        **values
        | {
            "name": "articulated",
            "farthest": ArticulatedMotion.farthest,
            "subspace": subspace,
            "residual_rate_hz": wide.residual_rate_hz[columns],
            "potentials": tuple(replace(one, on_residual=one.on_residual[:, columns]) for one in potentials),
            "tree": tree,
            "arm_m": arms,
            "ends": np.stack([build.centre, build.child], axis=1),
            "length_m": np.linalg.norm(trees[-1].place_m[build.child], axis=1),
            "length_sd_m": lengths(build, body[-1], noise[-1])[1],
            "slip_sd": sd,
            "slip_rate_hz": np.log(2)
            / residual_memory_s([one.reshape(len(one), -1) for one in left], poses[-1].dt_s, radian(shapes)),
        }
    )
    return Articulated(model, turned, shapes)


def _with_riders(
    build: Build, usual: Array, body: Sequence[Array], noise: Sequence[Array], skin_m: float, *, chain: bool
) -> tuple[Build, list[Tree], list[FittedPoses]]:
    """Trees with all markers, and the poses that fit; those that no bone joins ride on the segment they keep place on.

    A segment that carries one turns about its own axis as well. A trunk stays near the body's path: the markers that a
    frame shows would place it by their slips, and the limbs' angles would have to make up for that.
    """

    def fit(tree: Tree, y: Array, sd: Array) -> FittedPoses:
        return fit_poses(tree, y, np.hypot(sd, skin_m), root=(1.0, 1.0) if chain else ROOT)

    trees = [tree_of(build, y, sd, usual) for y, sd in zip(body, noise, strict=True)]
    riders = np.setdiff1d(np.arange(body[0].shape[1]), [*build.root, *build.child])
    shown = [np.where(np.isin(np.arange(y.shape[1]), riders)[:, None], np.nan, y) for y in body]
    found = [fit(*parts) for parts in zip(trees, shown, noise, strict=True)]
    if not len(riders):
        return build, trees, found
    local = [_carried(*parts, riders) for parts in zip(trees, found, body, strict=True)]
    spread = np.nansum([np.nansum((one - _mean(one)) ** 2, axis=(0, 3)) for one in local], axis=0)  # (riders, J + 1)
    on = np.argmin(spread, axis=1)
    axes = [np.vstack([of, build.rest[j]]) if len(of) == 2 and j + 1 in on else of for j, of in enumerate(build.axes)]
    build = replace(build, axes=axes)
    trees = [tree_of(build, y, sd, usual) for y, sd in zip(body, noise, strict=True)]
    every = np.arange(len(riders))
    usually = _mean(np.concatenate(local))[every, on]
    for tree, one in zip(trees, local, strict=True):
        seen = np.asarray(np.isfinite(one[:, every, on, 0]).any(axis=0))
        tree.segment[riders], tree.place_m[riders] = on, np.where(seen[:, None], _mean(one)[every, on], usually)
    return build, trees, [fit(*parts) for parts in zip(trees, body, noise, strict=True)]


def _mean(values: Array) -> Array:
    """Over frames, the first axis; 0 where nothing is seen."""
    seen = np.isfinite(values)
    return np.where(seen, values, 0.0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)


def _inside(fitted: FittedPoses, body: Array) -> Array:
    """(T, M, 3) markers in axes of the root."""
    return (body - fitted.shift_m[:, None]) @ fitted.rotation


def _carried(tree: Tree, fitted: FittedPoses, body: Array, markers: NDArray[np.int64]) -> Array:
    """(T, m, J + 1, 3) where on each segment some markers are."""
    posed = tree.pose(fitted.angles)
    away = _inside(fitted, body)[:, markers, None] - posed.origin[:, None]
    return np.einsum("tsji,tmsj->tmsi", posed.rotation, away)


def _slip(tree: Tree, fitted: FittedPoses, body: Array) -> Array:
    """(T, M, 3) how far each marker is from its place, in axes of its segment."""
    posed = tree.pose(fitted.angles)
    away = _inside(fitted, body) - tree.markers(posed)
    return np.einsum("tmji,tmj->tmi", posed.rotation[:, tree.segment], away)


def _skin(left: Sequence[Array], noise: Sequence[Array], tree: Tree) -> Array:
    """(M,) standard deviation of a marker's slip: what fits leave, with the freedoms that they took, less the noise.

    Half of it is what most markers leave: fits through few markers leave little of each.
    """
    squares = _mean(np.concatenate(left) ** 2).mean(axis=1)
    taken = 3 * len(squares) / max(3 * len(squares) - len(tree.axes) - 6, len(squares))
    variance = taken * 0.5 * (squares + np.median(squares))
    measured = np.nan_to_num(np.nanmedian(np.concatenate(noise))) ** 2
    return np.sqrt(np.maximum(variance - measured, 0.05 * variance) + 1e-14)


def _arms(tree: Tree) -> Array:
    """(F,) root mean square distance of the markers that a coordinate carries from its joint."""
    posed = tree.pose(np.zeros((1, len(tree.axes))))
    away = tree.markers(posed)[0] - posed.origin[0, tree.joint + 1][:, None]
    squares = np.sum(away**2, axis=-1) * tree.carries
    return np.sqrt(np.maximum(squares.sum(axis=1) / np.maximum(tree.carries.sum(axis=1), 1), 1e-12))


def _samples(fitted: FittedPoses, arms: Array, columns: NDArray[np.int64], width: int) -> Array:
    """(T, 3J) angles in arc length, NaN where not known; three columns a joint, of which it may leave some at 0."""
    out = np.zeros((len(fitted.angles), width))
    # a sample where the frame leaves 3 % of the variance of a radian: 10 degrees
    out[:, columns] = np.where(fitted.certainty[:, 6:] > 0.97, fitted.angles * arms, np.nan)
    return out


def _potentials(
    build: Build,
    arms: Array,
    anatomy: Anatomy,
    model: PoseMotion,
    trials: Sequence[PoseTrial],
    shapes: Shapes,
    settings: PoseSettings,
) -> list[PosePotential]:
    """A potential of the joint angles of each limb, or of these and their velocities; of both sides alike."""
    if settings.potential == "none":
        return []
    motion = recorded_motion(trials, shapes)
    pose, rate = known_poses(shapes)
    joint = {int(c): j for j, c in enumerate(build.child)}
    arm = np.zeros(len(build.child))
    arm[np.repeat(np.arange(len(build.axes)), [len(axes) for axes in build.axes])] = arms

    def chosen(limb: Limb) -> Array:
        columns = [3 * joint[c] + k for c in limb.children for k in range(len(build.axes[joint[c]]))]
        return np.eye(pose.shape[1])[columns]

    out = []
    for limb in build.limbs:
        maps, other = [chosen(limb)], anatomy.mirrored(limb) if build.mirrored else None
        if not len(maps[0]):
            continue
        if other is not None and all(c in joint for c in other.children) and len(chosen(other)) == len(maps[0]):
            maps.append(chosen(other))
        tau_s = motion.tau_s if "motion" in settings.potential else None
        learn = partial(settings.pull, rate=WEIGHT / motion.tau_s)
        joints = [(len(build.axes[joint[c]]), float(arm[joint[c]])) for c in limb.children if len(build.axes[joint[c]])]
        found = held_together(maps, pose, rate, model.subspace, tau_s=tau_s, learn=learn, joints=joints)
        out.append(replace(found, root=limb.parents[0], children=limb.children))
    return out
