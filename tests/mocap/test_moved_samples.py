"""A sample that the track leaves is not called measured, and how far samples were moved is told."""

import numpy as np
import pytest
from mocap.datasets import PERFECT, make_bat
from mocap.filters.observations import WHOLE
from mocap.filters.observe import Observed
from mocap.filters.records import Estimate

from mocap.cleaning.cleaning import clean
from mocap.recording import of_points
from mocap.records import Status, marker_tracks
from mocap.skeleton import Skeleton
from mocap.tracking.tracking import moved_report, seen_part, with_track

SD_M = 1e-3


@pytest.fixture(scope="module")
def prepared():
    """Positions with noise of 1 mm."""
    bat = make_bat(seed=2, n_frames=60, n_cameras=4, digitiser=PERFECT)
    noisy = bat.truth.xyz_m + SD_M * np.random.default_rng(0).standard_normal(bat.truth.xyz_m.shape)
    names = bat.truth.names
    cov = np.broadcast_to(SD_M**2 * np.eye(3), (*noisy.shape, 3))
    tracks = marker_tracks(names, bat.truth.t_s, noisy, cov_m2=cov)
    return clean(of_points(tracks, Skeleton(name="markers only", markers=names), name="bat"))


def tracked(prepared, xyz_m):
    """What a tracker makes of it that has every marker at ``xyz_m``, known to 1 mm, and believes all."""
    part = seen_part(prepared)
    cov = np.broadcast_to(SD_M**2 * np.eye(3), (*xyz_m.shape, 3))
    n = xyz_m.shape[1]
    believed = Observed(
        where=np.stack([np.full(n, WHOLE), np.arange(n)], axis=1),
        innovation=np.zeros((n, 3)),
        weight=np.ones(n),
        nis=1.0,
        n_rows=3 * n,
        log_likelihood=0.0,
    )
    observed = [believed] * len(xyz_m)
    return with_track(prepared, part, "test", Estimate(xyz_m=xyz_m, cov_m2=cov, observed=observed))


def test_a_sample_that_the_track_leaves_is_rejected(prepared):
    """5 mm off with deviations of 1 mm of both is 3.5 of their deviations; 3 mm is 2.1 and stays measured."""
    aside = prepared.xyz_m.copy()
    aside[10, 3, 0] += 5e-3
    aside[20, 4, 1] += 3e-3
    found = tracked(prepared, aside).tracks
    assert found.status[10, 3] == Status.REJECTED
    assert found.status[20, 4] == Status.MEASURED
    seen = np.isfinite(prepared.xyz_m[..., 0])
    seen[10, 3] = False
    assert (found.status[seen] == Status.MEASURED).all()


def test_how_far_samples_were_moved_is_told(prepared):
    """All by 1 mm but two: median and 90 % are 1 mm, the largest is named, that beyond three deviations is counted."""
    aside = prepared.xyz_m.copy()
    aside[..., 2] += 1e-3
    aside[10, 3, 2] += 6e-3
    aside[20, 4, 2] += 2e-3
    told = moved_report(prepared, tracked(prepared, aside).tracks)
    assert told["median_mm"] == pytest.approx(1.0)
    assert told["90%_mm"] == pytest.approx(1.0)
    assert told["largest"] == {"frame": 11, "marker": prepared.names[3], "mm": pytest.approx(7.0)}
    assert told["beyond_3_sd"] == 1
    assert told["samples"] == [told["largest"]]


def test_nothing_measured_was_moved(prepared):
    """Without a measured sample there is nothing to tell."""
    none = prepared.having(position=np.full_like(prepared.xyz_m, np.nan))
    markers = tracked(prepared, prepared.xyz_m).tracks
    assert moved_report(none, markers)["largest"] is None
