"""One film without a calibration: markers in the plane of its picture, in pixels or with a stated scale."""

import numpy as np

from eal.arrays import Array
from mocap.findings import Finding
from mocap.pipeline import sentences
from mocap.pipeline.recording import Recording
from mocap.records import MarkerTracks, Plane, marker_tracks
from mocap.skeleton import Measures

LEAST_LIKELIHOOD = 0.6
"""Clicks below are rejected: without a second camera nothing tells what a likelihood is worth (DeepLabCut's cutoff)."""


def in_plane(source: Recording) -> tuple[MarkerTracks, Plane, tuple[Finding, ...]]:
    """The pixels of one film as positions in its picture, in the axes of the file, with third coordinates of 0."""
    pixels = source.pixels
    assert pixels is not None
    plane = Plane(mm_per_px=source.mm_per_px)
    uv, likelihood = pixels.uv_px[0], source.score
    unlikely = np.zeros(pixels.seen.shape[1:], dtype=bool)
    if likelihood is not None and likelihood.shape == pixels.seen.shape:
        unlikely = pixels.seen[0] & (likelihood[0] < LEAST_LIKELIHOOD)
        uv = np.where(unlikely[..., None], np.nan, uv)
    flat = np.where(np.isfinite(uv[..., :1]), 0.0, np.nan)
    tracks = marker_tracks(pixels.names, pixels.t_s, plane.unit_m * np.concatenate([uv, flat], axis=-1))
    known = source.skeleton
    measures = bool(known.bones or known.joints or known.measures != Measures())
    how, *unused = sentences.in_plane(plane, measures=measures)
    told = (how, *sentences.unlikely_clicks(unlikely, pixels.seen, LEAST_LIKELIHOOD), *unused)
    return tracks, plane, told


def in_units(run: Recording, plane: Plane) -> tuple[Array, Array]:
    """(T, M, 2) positions and (T, M, 2, 2) covariances in the unit of the plane."""
    markers = run.tracks
    return plane.per_m * markers.xyz_m[..., :2], plane.per_m**2 * markers.cov_m2[..., :2, :2]
