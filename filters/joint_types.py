"""The animal as segments and joints: which degrees of freedom a recording determines, and which it does not."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from mocap.filters.anatomy import Limb, anatomy_of
from mocap.filters.bones import RIGID
from mocap.filters.independent import FEWEST_FRAMES

from eal.arrays import Array

JointType = Literal["ball", "universal", "hinge", "fixed"]
MOVES_DEG = 10.0
"""A joint whose angle has a smaller range, from the 5th to the 95th percentile, does not move. Chosen, not measured."""
STRAIGHT_DEG = 15.0
"""Two segments that bend by less have no plane that shows how the first is turned about its axis.
Chosen: the plane turns by 1 / sin 15 = 4 times what a direction errs by."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Articulation:
    """A joint of the articulated animal, by which one segment hangs on another.

    Attributes:
        centre: Marker at the joint.
        child: Marker at the outer end of the segment that it moves.
        parent: Marker at the inner end of the segment before it; None: the segment hangs on the trunk.
        kind: What the samples need: ``ball``, ``universal`` (two directions), ``hinge`` or ``fixed``.
        range_deg: (2,) how far the segment moves, from the 5th to the 95th percentile, in its two principal directions.
        noise_deg: What the noise of a direction alone makes of such a range.
        axis: (3,) of a hinge, in the axes of the trunk in the mean pose; the mean of the others' first principal axis.
        length_m: Median length of the segment.
        length_sd: By which share of it the length varies, noise taken out.
        straight: Share of frames in which the next segment is within ``STRAIGHT_DEG`` of straight; NaN: there is none.
        twist: Whether a turn of the segment about its own axis shows, by the plane of the segment after it.
    """

    centre: str
    child: str
    parent: str | None
    kind: JointType
    range_deg: Array
    noise_deg: float
    axis: Array
    length_m: float
    length_sd: float
    straight: float
    twist: bool

    @property
    def freedoms(self) -> int:
        """Degrees of freedom."""
        return {"ball": 3, "universal": 2, "hinge": 1, "fixed": 0}[self.kind]

    @property
    def description(self) -> str:
        """One line."""
        first, second = self.range_deg
        return f"{self.kind}: {first:.0f} and {second:.0f} degrees in its two directions, noise {self.noise_deg:.0f}"


def articulation(
    names: Sequence[str],
    xyz_m: Array,
    sd_m: Array,
    rotation: Array,
    *,
    trunk: Sequence[str],
    bones: Sequence[tuple[str, str]],
) -> list[Articulation]:
    """The joints of all limbs, from the trunk outward.

    The direction of a first segment is taken in the axes of the trunk; of a second one as its bend alone, because a
    turn of the first about its own axis and a sideways bend of the second cannot be told apart by markers on their
    axes: the first joint is then a ball, the second a hinge. Directions of further segments are taken in axes of the
    segment before them: its own direction, and the plane of the two before.

    Args:
        names: The M markers.
        xyz_m: (T, M, 3) positions in the world; NaN where not known.
        sd_m: (T, M) their standard deviations.
        rotation: (T, 3, 3) axes of the trunk in the world.
        trunk: Markers of the trunk; none: there are no joints.
        bones: Ends of rigid bones.
    """
    if not trunk:
        return []
    body = np.einsum("tji,tmj->tmi", rotation, xyz_m)
    return joints_of(names, body, sd_m, anatomy_of(names, trunk, bones).limbs)


def joints_of(names: Sequence[str], body: Array, sd_m: Array, limbs: Sequence[Limb]) -> list[Articulation]:
    """The joints of limbs, from markers (T, M, 3) in the axes of the trunk."""
    out = []
    for limb in limbs:
        inner = dict(zip(limb.children, limb.parents, strict=True))
        for child, centre in zip(limb.children, limb.parents, strict=True):
            found = _joint(names, body, sd_m, inner, child, centre)
            if found is not None:
                out.append(found)
    return out


def _joint(
    names: Sequence[str], body: Array, sd_m: Array, inner: dict[int, int], child: int, centre: int
) -> Articulation | None:
    segment = body[:, child] - body[:, centre]
    length = np.linalg.norm(segment, axis=-1)
    ok = np.isfinite(length) & (length > 0)
    if ok.sum() < FEWEST_FRAMES:
        return None
    noise_m = np.hypot(sd_m[:, child], sd_m[:, centre])
    noise_m = float(np.nanmedian(noise_m)) if np.isfinite(noise_m).any() else 0.0
    length_m = float(np.median(length[ok]))
    noise_deg = float(np.degrees(3.3 * noise_m / length_m))
    before = inner.get(centre)  # inner end of the segment before
    nxt = [c for c, p in inner.items() if p == child]
    bends = [b[np.isfinite(b)] for b in (_bend_deg(segment, body[:, c] - body[:, child]) for c in nxt)]
    bends = [b for b in bends if len(b)]
    straight = float(min(np.mean(b < STRAIGHT_DEG) for b in bends)) if bends else np.nan
    twist = bool(bends and straight < 0.5)
    if before is None:
        local = segment
    else:
        along = body[:, centre] - body[:, before]
        second = inner.get(before)
        if second is None:
            bend = _bend_deg(along, segment)
            local = np.stack([np.cos(np.radians(bend)), np.sin(np.radians(bend)), np.zeros_like(bend)], axis=-1)
        else:
            local = _local(along, body[:, before] - body[:, second], segment)
    spread, principal = _ranges_deg(local)
    moves = spread >= max(
        MOVES_DEG, 4.0 * noise_deg / 3.3
    )  # 4 SD: a normal law has 3.3 from the 5th to the 95th percentile
    kind: JointType = ("fixed", "hinge", "universal")[int(moves.sum())]
    if before is None and kind == "universal" and twist:
        kind = "ball"
    if before is None:
        axis = principal
    else:
        normal = np.cross(body[:, centre] - body[:, before], segment)
        normal = normal[np.isfinite(normal[:, 0])]
        normal = (normal / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)).sum(axis=0) / len(ok)
        size = float(np.linalg.norm(normal))
        axis = normal / size if size > 1e-6 else principal
    noise = 2.0 * noise_m**2  # of a length: of both ends along the segment
    varies = np.sqrt(max(float(np.var(length[ok])) - noise / 2.0, 0.0)) / length_m
    return Articulation(
        centre=names[centre],
        child=names[child],
        parent=None if before is None else names[before],
        kind=kind,
        range_deg=spread,
        noise_deg=noise_deg,
        axis=axis,
        length_m=length_m,
        length_sd=float(varies),
        straight=straight,
        twist=twist,
    )


def undetermined(joints: Sequence[Articulation]) -> list[str]:
    """Sentences on degrees of freedom that the samples do not determine, and on bones that do not fit.

    A turn about an axis that all markers lie on moves none of them: no covariance of angles is given for it.
    """
    out = []
    alone = [f"{j.centre} to {j.child}" for j in joints if not j.twist and np.isnan(j.straight)]
    if alone:
        out.append(
            "not determined: axial rotation of these segments, because all their markers lie on it: " + ", ".join(alone)
        )
    vague = [j for j in joints if np.isfinite(j.straight) and j.straight > 0.05]
    if vague:
        out.append(
            "poorly determined: axial rotation of these segments, because the next segment is within "
            f"{STRAIGHT_DEG:.0f} degrees of straight in a part of the frames: "
            + ", ".join(f"{j.centre} to {j.child} ({j.straight:.0%})" for j in vague)
        )
    out += [
        f"the bone {j.centre}-{j.child} is stated as rigid, but its length ({1e3 * j.length_m:.3g} mm) varies by "
        f"{j.length_sd:.1%}: a marker on the wrong segment, soft-tissue artefact, or a bone to state as soft"
        for j in joints
        if j.length_sd > RIGID
    ]
    return out


def _local(along: Array, before: Array, segment: Array) -> Array:
    """(T, 3) a segment in axes of the one before it: along that, and in the plane of that and the one before."""
    with np.errstate(invalid="ignore"):
        first = along / np.linalg.norm(along, axis=-1, keepdims=True)  # NaN where both are in one place
    second = before - np.sum(before * first, axis=-1, keepdims=True) * first
    size = np.linalg.norm(second, axis=-1, keepdims=True)
    least = np.sin(np.radians(STRAIGHT_DEG)) * np.linalg.norm(before, axis=-1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        second = np.where(size > least, second / size, np.nan)
    third = np.cross(first, second)
    return np.stack([np.sum(segment * axis, axis=-1) for axis in (first, second, third)], axis=-1)


def _bend_deg(a: Array, b: Array) -> Array:
    """(T,) angle between two directions, 0 straight."""
    with np.errstate(invalid="ignore", divide="ignore"):
        cosine = np.sum(a * b, axis=-1) / (np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1))
    return np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))


def _ranges_deg(segment: Array) -> tuple[Array, Array]:
    """Ranges (2,) of a direction about its mean in its principal directions, and the axis (3,) of the larger turn."""
    size = np.linalg.norm(segment, axis=-1)
    nonzero = size > 0
    unit = segment[nonzero] / size[nonzero, None]
    if len(unit) < FEWEST_FRAMES:
        return np.zeros(2), np.array([0.0, 0.0, 1.0])
    mean = unit.mean(axis=0)
    mean /= max(float(np.linalg.norm(mean)), 1e-12)
    angle = np.arccos(np.clip(unit @ mean, -1.0, 1.0))
    aside = unit - (unit @ mean)[:, None] * mean
    aside *= (angle / np.maximum(np.linalg.norm(aside, axis=-1), 1e-12))[:, None]
    _, _, vt = np.linalg.svd(aside - aside.mean(axis=0), full_matrices=False)
    along = aside @ vt[:2].T
    low, high = np.quantile(along, [0.05, 0.95], axis=0)
    return np.degrees(high - low), np.cross(mean, vt[0])
