"""A first skeleton from a recording alone: which markers keep their distance, and where the chains of them bend."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import takewhile
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.cleaning.cleaning import clean
from mocap.errors import MocapError
from mocap.filters.body_axes import body_frames
from mocap.filters.bones import RIGID, learn_bones
from mocap.filters.joint_types import MOVES_DEG, Articulation, articulation, undetermined
from mocap.filters.models.constant_velocity import marker_motion
from mocap.filters.poses import MarkerTrial
from mocap.filters.rigid import WOBBLES_DEG, find_bodies, residual_m, wobble_deg
from mocap.io.together import point_names
from mocap.measures import JointAxes, Places
from mocap.proposing.propose_measures import proposed_measures
from mocap.recording import Recording, as_recording
from mocap.skeleton import BodyJoint, Bone, Joint, Skeleton, quoted, skeleton_text
from mocap.text import file_names, number_of
from mocap.tracking.tracking import marker_trial, seen_part

SOFT = 2 * RIGID
"""Bones that vary by no more are proposed as soft ones."""

Pair = tuple[int, int]


@dataclass(frozen=True, eq=False, kw_only=True)
class Kept:
    """How far each two of M markers keep their distance.

    Attributes:
        length_m: (M, M) distances; NaN where the two are hardly seen together.
        varies: (M, M) by which share of its length each varies, the noise taken out.
    """

    length_m: Array
    varies: Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Proposal:
    """A skeleton to correct.

    Attributes:
        skeleton: As ``text`` holds it.
        text: A skeleton file with what was found said in comments.
    """

    skeleton: Skeleton
    text: str


def propose_skeleton(recording: Recording, *, names: str | PathLike[str] | Sequence[str] | None = None) -> Proposal:
    """Propose bones, bodies, trunk and joints of all markers that a recording shows.

    Bones are the shortest connections among markers that keep their distance (a minimum spanning forest, in which a
    varying distance counts as a longer one). Bodies are those that the files state, with the axes of their joints, and
    other markers that all keep their distances (``find_bodies``), with a joint of their own where such a connection
    leads from one to another. The trunk grows from the most central marker
    by its nearest ones, as long as all keep their distances. Other joints are where two bones meet and bend, the parent
    on the side of the trunk. Limbs that beat are strokes, those whose tips stand still in each cycle feet. Write its
    ``text`` to a file, correct it, and read the recording with it.

    Args:
        recording: As ``mocap.read`` gives it; distances, angles and cycles, which decide, do not depend on the frame
            rate.
        names: What the points are called, in their order: a list of them; or a file, with a name a line (DLTdv's
            ``pointnames.txt``), or a table of any known format that has them.

    Raises:
        MocapError: it shows too little, or there are not as many names as points.
    """
    prepared = clean(as_recording(recording, "propose_skeleton")).in_space("a skeleton")
    part = seen_part(prepared)
    given, renamed = part.names, {}
    if names is not None:
        called = point_names(Path(names) if isinstance(names, str | PathLike) else names, len(prepared.names))
        renamed = dict(zip(prepared.names, called, strict=True))
    new = [renamed.get(name, name) for name in given]
    aliases = {a: b for a, b in zip(given, new, strict=True) if a != b}
    bodies = {
        body: {aliases.get(name, name): at for name, at in own.items() if name in given}
        for body, own in recording.source.bodies.items()
    }
    return _proposal(new, marker_trial(part), aliases, bodies)


def _proposal(
    names: Sequence[str],
    trial: MarkerTrial,
    aliases: Mapping[str, str],
    bodies_: Mapping[str, Mapping[str, Array]],
) -> Proposal:
    if len(names) < 2:
        shown = number_of(len(names), "marker")
        raise MocapError(f"{trial.name}: shows {shown}; a skeleton needs at least two, and joints three")
    kept = kept_distances(trial)
    bodies_ = {name: own for name, own in bodies_.items() if len(own) >= 3}
    places: dict[str, Places] = {
        body: {name: (float(at[0]), float(at[1]), float(at[2])) for name, at in own.items()}
        for body, own in bodies_.items()
        if np.isfinite(np.array(list(own.values()))).all()
    }
    taken = {marker for own in bodies_.values() for marker in own}
    found = [[names.index(marker) for marker in own] for own in bodies_.values()]
    more = [members for members in find_bodies(trial) if not any(names[m] in taken for m in members)]
    bodies = [*bodies_, *(f"{name}_2" if name in bodies_ else name for name in body_names(names, more))]
    found += more
    body = np.full(len(names), -1)
    for number, members in enumerate(found):
        body[members] = number
    spanning = spanning_bones(kept)
    trunk = trunk_of(trial, kept, spanning)
    joints, stiff = _joints(names, trial, kept, spanning, trunk, body)
    between = body_joints(spanning, body, trunk)
    called = file_names([f"{bodies[a]}_{bodies[b]}" for a, b in between])
    joined = [BodyJoint(name=n, parent=bodies[a], child=bodies[b]) for n, (a, b) in zip(called, between, strict=True)]
    placed = {
        one.name: JointAxes(parent=places[one.parent], child=places[one.child])
        for one in joined
        if one.parent in places and one.child in places
    }
    bones = [(a, b) for a, b in spanning if body[a] == body[b] or min(body[a], body[b]) < 0]
    skeleton = Skeleton(
        name=trial.name,
        markers=tuple(names),
        bones=tuple(Bone(a=names[a], b=names[b], rigid=bool(kept.varies[a, b] <= RIGID)) for a, b in bones),
        joints=(*joined, *(joint for joint, _ in joints if joint.name not in called)),
        bodies={name: [names[m] for m in members] for name, members in zip(bodies, found, strict=True)},
        trunk=tuple(names[m] for m in trunk),
        aliases=dict(aliases),
        measures=replace(proposed_measures(names, trial, bones, trunk), axes=placed),
    )
    jointed = _articulated(names, trial, skeleton)
    alone = [names[m] for m in range(len(names)) if not any(m in bone for bone in bones)]
    comments = {
        "": _PREFACE.format(name=quoted(trial.name), frames=len(trial.t_s), markers=len(names)).splitlines(),
        "bones": [
            *_BONES.splitlines(),
            *([f"Markers without a bone: {', '.join(map(quoted, alone))}"] if alone else []),
        ],
        "trunk": _TRUNK.splitlines() if trunk else [*_NO_TRUNK.splitlines(), *_calmest(names, trial)],
        "bodies": _BODIES.splitlines(),
        "joints": [*_JOINTS.splitlines(), *(stiff or ()), *_model_lines(jointed)],
        "aliases": _ALIASES.format(old=quoted(names[0])).splitlines(),
        **{
            f"bone {names[a]} {names[b]}": [
                f"{1e3 * kept.length_m[a, b]:.3g} mm, varies by {100 * kept.varies[a, b]:.1f} %"
            ]
            for a, b in bones
        },
        **{f"body {name}": [_keeps(trial, members)] for name, members in zip(bodies, found, strict=True)},
        **{f"joint {joint.name}": [f"bends from {low:.0f} to {high:.0f} degrees"] for joint, (low, high) in joints},
    }
    return Proposal(skeleton=skeleton, text=skeleton_text(skeleton, comments=comments))


def _keeps(trial: MarkerTrial, members: Sequence[int]) -> str:
    """How well the markers of a body keep their places, in words."""
    left_mm, noise_mm = 1e3 * residual_m(trial.xyz_m[:, members])[0], 1e3 * np.nanmedian(trial.sd_m[:, members])
    return f"keep their places to {left_mm:.2g} mm, noise {noise_mm:.2g} mm"


def body_names(names: Sequence[str], bodies: Sequence[Sequence[int]]) -> list[str]:
    """What the names of each body's markers begin with, whatever the case; ``body_1`` where that is nothing."""
    called = []
    for number, members in enumerate(bodies, start=1):
        first = names[members[0]]
        letters = zip(*(names[m].casefold() for m in members), strict=False)
        same = sum(1 for _ in takewhile(lambda some: len(set(some)) == 1, letters))
        called.append(first[:same].rstrip("0123456789_-:. ") or f"body_{number}")
    return file_names(called)


def body_joints(bones: Sequence[tuple[int, int]], body: NDArray[np.int64], trunk: Sequence[int]) -> list[Pair]:
    """Parent and child, by number, of bodies that the spanning bones join, from that of the trunk outward.

    Args:
        bones: Pairs of markers.
        body: (M,) number of each marker's body; -1: none.
        trunk: Markers of the trunk.
    """
    beside: dict[int, list[int]] = {}
    for a, b in bones:
        if body[a] != body[b] and min(body[a], body[b]) >= 0:
            beside.setdefault(int(body[a]), []).append(int(body[b]))
            beside.setdefault(int(body[b]), []).append(int(body[a]))
    weight = np.bincount(body[np.array(trunk, dtype=int)] + 1, minlength=int(body.max(initial=-1)) + 2)[1:]
    walked: set[int] = set()
    out: list[Pair] = []
    for start in np.argsort(-weight, kind="stable").tolist():
        queue = [] if start in walked else [start]
        walked.add(start)
        while queue:
            parent = queue.pop(0)
            for child in dict.fromkeys(beside.get(parent, [])):
                if child not in walked:
                    walked.add(child)
                    queue.append(child)
                    out.append((parent, child))
    return out


def _calmest(names: Sequence[str], trial: MarkerTrial) -> list[str]:
    """A line with the three markers that accelerate least, of four or more: of a flying bat mostly its trunk's."""
    acceleration = _accelerations(trial)
    if np.isfinite(acceleration).sum() < 4:
        return []
    first, second, third = (quoted(names[m]) for m in np.argsort(acceleration, kind="stable")[:3])
    return [f"{first}, {second} and {third} accelerate least of all."]


def _accelerations(trial: MarkerTrial) -> Array:
    """(M,) standard deviation of each marker's acceleration; NaN where it is seen too seldom."""
    dt_s = float(np.diff(trial.t_s).mean()) if len(trial.t_s) > 1 else 1.0
    return marker_motion(trial.xyz_m, dt_s=dt_s)[:, 1]


def _articulated(names: Sequence[str], trial: MarkerTrial, skeleton: Skeleton) -> list[Articulation]:
    trunk = [names.index(m) for m in skeleton.trunk]
    if not trunk or not np.isfinite(trial.xyz_m[:, trunk]).any():
        return []
    dt_s = float(np.diff(trial.t_s).mean()) if len(trial.t_s) > 1 else 1.0
    axes = body_frames(trial.xyz_m[:, trunk], dt_s=dt_s).rotation
    return articulation(names, trial.xyz_m, trial.sd_m, axes, trunk=skeleton.trunk, bones=skeleton.rigid)


def _model_lines(joints: Sequence[Articulation]) -> list[str]:
    """The articulated model in comments: each segment's joint, and what the samples do not determine."""
    if not joints:
        return []
    lines = ["", "The animal as segments and joints, as far as the samples show them (docs/explanation/joints.md):"]
    lines += [f"  {quoted(j.centre)} moves {quoted(j.child)}: {j.description}" for j in joints]
    return [*lines, *undetermined(joints)]


_PREFACE = """\
A proposal from the recording {name} ({frames} frames, {markers} markers): read it, correct it, then
  mocap track FILE --skeleton THIS_FILE
Distances and angles were measured; names and anatomy were not:
which marker is left or right, a wrist or a toe, only you know."""
_BONES = """\
Pairs of markers at a constant distance: the shortest connections between markers that keep their distance.
"soft": their distance changes by 5 to 10 %; delete what is not a bone, add the bones that you know."""
_TRUNK = (
    "Markers that move together as one rigid body and define its axes: central ones that move little relative "
    "to each other."
)
_NO_TRUNK = """\
No three markers move together as one rigid body: without a trunk all markers define the axes of the body.
List those that move together, if there are any."""
_JOINTS = """\
name = [parent, centre, child]: the shoulder, the elbow and the wrist describe the elbow. Each joint has its column
in joints.csv and its potential. Proposed are places where two bones meet and the angle between them changes.
name = [parent, child] is a joint between two bodies, with six coordinates in kinematics.csv."""
_BODIES = """\
Markers that all keep their distances: three that are seen show where the others are. A body is called what their names
begin with."""
_ALIASES = """\
Other names for the markers: name in the file = name here, for instance {old} = "shoulder_l".
Then write the new name in all lists above."""


def kept_distances(trial: MarkerTrial) -> Kept:
    """How far markers keep their distances in a trial; of many markers and frames, in some of the frames."""
    count = trial.xyz_m.shape[1]
    step = max(1, int(len(trial.t_s) * count**2 / 2e7))
    some = MarkerTrial(name=trial.name, t_s=trial.t_s[::step], xyz_m=trial.xyz_m[::step], sd_m=trial.sd_m[::step])
    found = learn_bones([some], np.array(np.triu_indices(count, 1)).T)
    length, varies = np.full((2, count, count), np.nan)
    a, b = found.ends.T
    length[a, b] = length[b, a] = found.length_m
    with np.errstate(divide="ignore", invalid="ignore"):
        varies[a, b] = varies[b, a] = found.sd_m / found.length_m
    return Kept(length_m=length, varies=varies)


def spanning_bones(kept: Kept) -> list[tuple[int, int]]:
    """The minimum spanning forest of pairs that vary by no more than ``SOFT`` (Kruskal 1956).

    A pair weighs its length times 1 + (v / SOFT)^2, v being the share by which it varies: in a quarter of that too many
    short bones of noisy markers are given up for long ones, with four times it ankles hang on tails.
    """
    a, b = np.triu_indices(len(kept.varies), 1)
    varies = kept.varies[a, b]
    weight = kept.length_m[a, b] * (1 + (varies / SOFT) ** 2)
    tree, bones = np.arange(len(kept.varies)), []
    for i in np.argsort(weight, kind="stable"):
        if varies[i] <= SOFT and tree[a[i]] != tree[b[i]]:
            tree[tree == tree[b[i]]] = tree[a[i]]
            bones.append((int(a[i]), int(b[i])))
    return sorted(bones)


def trunk_of(trial: MarkerTrial, kept: Kept, bones: Sequence[tuple[int, int]]) -> list[int]:
    """Three to five markers that move as one body in the middle of the animal; none where no three do.

    From each marker a body grows by the nearest ones that keep their distances. Of the bodies that wobble by less than
    ``WOBBLES_DEG`` and accelerate no more than the other markers (a wing's blade keeps its distances, too) it is the
    one without which the bones fall apart into the smallest pieces; then the steadiest.
    """
    best: tuple[int, int, float, list[int]] | None = None
    quickness = _accelerations(trial)
    for start, length in enumerate(kept.length_m):
        body = [start]
        for marker in np.argsort(np.where(np.isnan(length), np.inf, length), kind="stable").tolist():
            if len(body) == 5:  # three fix its frame, two may be hidden, more bring in what moves
                break
            if marker == start or not (kept.varies[marker, body] <= RIGID).all():
                continue
            body.append(marker)
            wobbles = wobble_deg(trial.xyz_m[:, body]) if len(body) >= 3 else np.inf
            if wobbles > WOBBLES_DEG:
                if len(body) > 3:
                    body.pop()
                continue
            others = np.delete(quickness, body)
            if len(body) >= 3 and np.isfinite(others).any() and np.median(quickness[body]) > np.nanmedian(others):
                continue
            found = (_largest_piece(len(kept.length_m), bones, body), -len(body), wobbles, sorted(body))
            best = found if best is None else min(best, found)
    return [] if best is None else best[3]


def _largest_piece(count: int, bones: Sequence[tuple[int, int]], without: Sequence[int]) -> int:
    """Markers of the largest of the pieces that bones make of the others."""
    piece = np.arange(count)
    for a, b in bones:
        if a not in without and b not in without:
            piece[piece == piece[b]] = piece[a]
    return int(np.bincount(np.delete(piece, list(without)), minlength=1).max(initial=0))


def _joints(
    names: Sequence[str],
    trial: MarkerTrial,
    kept: Kept,
    bones: Sequence[tuple[int, int]],
    trunk: Sequence[int],
    body: NDArray[np.int64],
) -> tuple[list[tuple[Joint, tuple[float, float]]], list[str]]:
    """Joints with the angles that they bend from and to, and comments on where bones meet that do not bend.

    Where a bone goes from one body to another these have a joint of their own, and within a body nothing bends.
    """
    triples = [
        three
        for three in joint_triples(kept, bones, trunk)
        for parent, centre, child in [body[np.array(three)]]
        if not any(a != b and min(a, b) >= 0 for a, b in ((parent, centre), (centre, child)))
        and not parent == centre == child >= 0
    ]
    children = np.bincount([centre for _, centre, _ in triples], minlength=len(names)) if triples else []
    joints, called, stiff = [], [], []
    for parent, centre, child in triples:
        angle, noise = bend(trial, parent, centre, child)
        if len(angle) < 2:
            continue
        low, high = np.quantile(angle, [0.05, 0.95])
        if high - low < max(MOVES_DEG, 4 * noise):
            shown = ", ".join(quoted(names[m]) for m in (parent, centre, child))
            stiff.append(
                f"Not proposed, because the angle changes by {max(high - low, noise):.0f} degrees or less: {shown}"
            )
            continue
        called.append(names[centre] if children[centre] == 1 else f"{names[centre]}_{names[child]}")
        joint = Joint(name=called[-1], parent=names[parent], centre=names[centre], child=names[child])
        joints.append((joint, (float(low), float(high))))
    return [
        (replace(joint, name=name), bent) for (joint, bent), name in zip(joints, file_names(called), strict=True)
    ], stiff


def joint_triples(kept: Kept, bones: Sequence[tuple[int, int]], trunk: Sequence[int]) -> list[tuple[int, int, int]]:
    """Parent, centre and child wherever two bones meet, walking outward from the trunk; none of the trunk's own.

    The parent of a marker of the trunk is the nearest other one of it. Chains that do not reach the trunk start at
    their marker that is nearest to it (without a trunk, to all markers); there
    the first of the markers that it is joined to is the parent.
    """
    beside: dict[int, list[int]] = {}
    for a, b in bones:
        beside.setdefault(a, []).append(b)
        beside.setdefault(b, []).append(a)
    length = np.where(np.isnan(kept.length_m), np.inf, kept.length_m)
    np.fill_diagonal(length, np.inf)
    near = np.median(length[:, list(trunk)] if trunk else length, axis=1)
    starts = [*trunk, *(m for m in np.argsort(near, kind="stable").tolist() if m not in trunk)]
    parents: dict[int, int | None] = {}
    if trunk:
        parents |= {m: min((t for t in trunk if t != m), key=lambda t: float(length[m, t])) for m in trunk}
    triples, queue, walked = [], list(trunk), set(trunk)
    for start in starts:
        if start not in walked and start in beside:
            parents[start] = None
            walked.add(start)
            queue.append(start)
        while queue:
            centre = queue.pop(0)
            parent = parents[centre]
            for child in beside.get(centre, []) if parent is not None else sorted(beside.get(centre, [])):
                if child in walked:
                    continue
                walked.add(child)
                parents[child] = centre
                queue.append(child)
                if parent is None:
                    parent = child  # a chain may begin at its middle: there, too, two bones meet
                else:
                    triples.append((parent, centre, child))
    return triples


def bend(trial: MarkerTrial, parent: int, centre: int, child: int) -> tuple[Array, float]:
    """(N,) angles at a joint in degrees, 180 straight, and what the noise alone makes of their 5 to 95 % range."""
    along = trial.xyz_m[:, centre] - trial.xyz_m[:, parent]
    out = trial.xyz_m[:, child] - trial.xyz_m[:, centre]
    lengths = np.linalg.norm(along, axis=-1), np.linalg.norm(out, axis=-1)
    ok: NDArray[np.bool_] = np.isfinite(lengths[0] * lengths[1]) & (lengths[0] * lengths[1] > 0)
    cosine = (along * out).sum(axis=-1)[ok] / (lengths[0] * lengths[1])[ok]
    angle = 180 - np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    if not len(angle):
        return angle, 0.0
    short = min(float(np.median(size[ok])) for size in lengths)
    sd = float(np.median(trial.sd_m[ok][:, [parent, centre, child]]))
    return angle, float(np.degrees(2 * sd / short)) if np.isfinite(sd) else 0.0
