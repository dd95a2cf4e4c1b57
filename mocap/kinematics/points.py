"""Which points and pairs of points a smoother is asked for, so that every quantity has its standard deviation."""

from collections.abc import Sequence
from itertools import combinations

from mocap.filters.velocities import RatePoints
from mocap.kinematics.distal import Distal, distal_parts
from mocap.measures import Segment
from mocap.skeleton import Skeleton

BODY, MASS = "body", "centre_of_mass"
"""Means of the markers of the trunk, and of all segments by their masses."""


def rate_points_for(names: Sequence[str], skeleton: Skeleton, *, n_frames: int) -> RatePoints:
    """All that the quantities of a skeleton need."""
    body = skeleton.trunk or names
    weights = [tuple(1 / len(body) if name in body else 0.0 for name in names)]
    means = [BODY]
    if skeleton.measures.segments:
        weights.append(mass_weights(names, list(skeleton.measures.segments.values())))
        means.append(MASS)
    index = {name: i for i, name in enumerate((*names, *means))}
    joints = [(j.parent, j.centre, j.child) for j in skeleton.joints]
    joints += [(*skeleton.bodies[j.parent], *skeleton.bodies[j.child]) for j in skeleton.body_joints]
    moments = [part.markers for part in distal_parts(skeleton).values() if isinstance(part, Distal)]
    needed = [joints, measured_sets(skeleton), moments]
    pairs: list[tuple[int, int]] = []
    for sets in needed:
        found = {
            (min(index[a], index[b]), max(index[a], index[b]))
            for points in sets
            for a, b in combinations(dict.fromkeys(points), 2)
            if a in index and b in index
        }
        more = [*pairs, *sorted(found - set(pairs))]
        if 4 * 36 * len(more) * n_frames <= 4e8:  # of longer recordings covariances of joints alone
            pairs = more
    return RatePoints(names=(*names, *means), weights=tuple(weights), pairs=tuple(pairs))


def measured_sets(skeleton: Skeleton) -> list[tuple[str, ...]]:
    """Points that enter one quantity together, beyond joints."""
    measures = skeleton.measures
    sets: list[tuple[str, ...]] = [(bone.a, bone.b) for bone in skeleton.bones]
    sets += list(measures.distances.values()) + list(measures.areas.values())
    trunk_lines = [line for line in (measures.forward, measures.left) if line]
    body = tuple(marker for line in trunk_lines for marker in line)
    sets += [body] + [(*body, *line) for line in measures.strokes.values()]
    for axes in measures.axes.values():
        sets.append(tuple(marker for line in axes.lines for marker in line))
    return sets


def mass_weights(names: Sequence[str], segments: Sequence[Segment]) -> tuple[float, ...]:
    """Weights of the centre of mass of segments, whose own lie on the line between their ends."""
    total = sum(part.mass_g for part in segments)
    weights = dict.fromkeys(names, 0.0)
    for part in segments:
        weights[part.start] += (1 - part.centre) * part.mass_g / total
        weights[part.end] += part.centre * part.mass_g / total
    return tuple(weights.values())
