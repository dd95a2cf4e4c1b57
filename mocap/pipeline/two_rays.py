"""Points of two rays, which no third ray confirms: checked by the filter before anything is learned from them.

Where markers are dense a click on the wrong one lies near the epipolar line of the right one in a third of the frames:
the two rays meet, and nothing but the motion tells that they are of two markers.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from filters.model import LearnedModel, trials_for
from filters.models.base import FittedMotion
from filters.models.pose import PoseSettings
from mocap.arrays import Array
from mocap.cleaning.clean import REASONS
from mocap.pipeline.prepare import Prepared
from mocap.pipeline.tracking import Part, learn_motion, marker_trial, part_names, track, why_no_pose

FAR = 6.0
"""Points at a larger Mahalanobis distance from what the filter expects are contradicted: its deviations are small."""
LEAST = 0.05
"""Points of two rays are looked at if they are more than this share: that costs a pass of the filter."""
LEFT = 1.5
"""A marker is looked at if it has so many times as many points in all: the filter learns from the others alone."""

Mask = NDArray[np.bool_]


def unconfirmed(prepared: Prepared) -> Mask:
    """(T, M) points of two rays, in recordings of three cameras or more."""
    rays = np.isfinite(prepared.uv_px[..., 0])
    return np.isfinite(prepared.xyz_m[..., 0]) & (rays.sum(axis=0) == 2) & (len(rays) > 2)


def worth_checking(prepared: Prepared) -> bool:
    """Whether enough points are of two rays."""
    return bool(unconfirmed(prepared).sum() > LEAST * np.isfinite(prepared.xyz_m[..., 0]).sum())


def without_contradicted(
    prepared: Prepared, part: Part, settings: PoseSettings, learned: LearnedModel | None = None
) -> Prepared:
    """The recording without points of two rays that the pose filter contradicts; one of their rays may be right.

    The filter has not learned from such points, and is given at most one ray of each, the one that is nearer to its
    prediction, so that no wrong point drags it along; it then says where the markers are, and how sure it is. It has no
    regression, which would take the points themselves for true.

    Args:
        prepared: The recording.
        part: Its seen part.
        settings: Of the pose model, where there is no learned one.
        learned: A model of other trials.
    """
    asked = unconfirmed(prepared)
    asked &= np.isfinite(prepared.xyz_m[..., 0]).sum(axis=0) >= LEFT * asked.sum(axis=0)
    doubted = replace(prepared, xyz_m=np.where(asked[..., None], np.nan, prepared.xyz_m))
    if why_no_pose(doubted, part) is not None:
        return prepared
    smoothed = track(doubted, part, _pose_filter(doubted, part, settings, learned))
    inside = np.ix_(np.arange(len(asked))[part.frames], part.markers)
    away = np.zeros(asked.shape)
    cov = smoothed.cov_m2 + prepared.cov_m2[inside]
    away[inside] = _distance(smoothed.xyz_m - prepared.xyz_m[inside], cov, where=asked[inside])
    far = asked & (away > FAR)
    if not far.any():
        return prepared
    said = f"{far.sum()} {'sample' if far.sum() == 1 else 'samples'} rejected ({REASONS['contradicted']})"
    return replace(
        prepared,
        xyz_m=np.where(far[..., None], np.nan, prepared.xyz_m),
        cov_m2=np.where(far[..., None, None], np.nan, prepared.cov_m2),
        rejected={**prepared.rejected, "contradicted": far},
        findings=(*prepared.findings, said),
    )


def _pose_filter(prepared: Prepared, part: Part, settings: PoseSettings, learned: LearnedModel | None) -> FittedMotion:
    """The pose model alone, without a regression."""
    pose = settings if learned is None else learned.models[-1]
    alone = replace(pose if isinstance(pose, PoseSettings) else settings, regression=0.0)
    if learned is None:
        return learn_motion(prepared, part, "eal", settings=alone)
    return alone.fit(trials_for(learned, part_names(prepared, part), marker_trial(prepared, part)))


def _distance(miss: Array, cov: Array, *, where: Mask) -> Array:
    """(T, M) Mahalanobis distances of (T, M, 3) in (T, M, 3, 3), where asked for and known; 0 elsewhere."""
    known = where & np.isfinite(miss[..., 0])
    out = np.zeros(where.shape)
    solved = np.linalg.solve(cov[known], miss[known][..., None])[..., 0]
    out[known] = np.sqrt(np.einsum("ki,ki->k", miss[known], solved))
    return out
