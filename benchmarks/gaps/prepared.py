"""A trial of the benchmark as the product prepares it: what our tracker, and peers that read rays, are given."""

from functools import lru_cache

import numpy as np

from benchmarks.gaps.method import Film, Trial
from mocap.cameras.origin import PixelOptions
from mocap.cleaning.cleaning import clean
from mocap.reading.ideal_pixels import of_pixels
from mocap.recording import Recording, of_points
from mocap.records import MarkerTracks, Status
from mocap.skeleton import Bone, Skeleton

LEAST_SD_M = 5e-5
"""Recordings that were smoothed before show less noise than their markers have."""


def tracks_of(trial: Trial) -> MarkerTracks:
    """A trial as a file of positions would hold it, each with the noise that the set's markers have."""
    sd = np.maximum(trial.sd_m, LEAST_SD_M)
    seen = np.isfinite(trial.xyz_m[..., 0])
    cov = np.where(seen[..., None, None], (sd**2)[:, None, None] * np.eye(3), np.nan)
    origin = np.where(seen, Status.MEASURED, Status.MISSING)
    return MarkerTracks(names=trial.names, t_s=trial.t_s, xyz_m=trial.xyz_m, cov_m2=cov, status=origin)


def prepared_film(film: Film, skeleton: Skeleton, *, name: str) -> Recording:
    """Pixels as the product prepares them where the user states the corner that rows are counted from."""
    options = PixelOptions(origin=film.pixel_origin, calibration_origin=film.calibration_origin)
    return clean(of_pixels(film.pixels, film.cameras, skeleton, name=name, options=options))


@lru_cache(maxsize=64)
def recording(trial: Trial) -> Recording:
    """A trial as the product prepares it: from pixels if it has a film, cleaned, with trunk and bones."""
    bones = tuple(Bone(a=a, b=b) for a, b in trial.bones)
    skeleton = Skeleton(name="markers, trunk, bones", markers=trial.names, trunk=trial.trunk, bones=bones)
    if trial.film is not None:
        return prepared_film(trial.film, skeleton, name=trial.name)
    return clean(of_points(tracks_of(trial), skeleton, name=trial.name))
