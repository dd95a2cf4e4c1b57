"""What digitising does to pixels, against the shares and distances that were asked for."""

import numpy as np
import pytest
from mocap.datasets import PERFECT, Digitiser, make_bat, make_lizard
from mocap.datasets.observe import click_noise, lasting_errors, lost, misplace

from mocap.cameras.camera import record


def test_noise_has_the_core_and_twice_its_width_in_all():
    """A scale mixture: variance 0.9 0.6^2 + 0.1 3.34^2 = 1.2^2; of small errors only the core remains."""
    digitiser = Digitiser()
    noise = click_noise(np.random.default_rng(0), (400_000,), digitiser)
    # kurtosis 3 (0.9 0.6^4 + 0.1 3.34^4) / 1.2^4 = 18: the SD's standard error is sqrt(17 / 4 / 8e5) = 0.23 %
    assert abs(noise.std() / digitiser.sd_px - 1) < 0.01
    assert abs(digitiser.sd_px / (2 * digitiser.core_px) - 1) < 0.001
    # share within one core SD: 0.9 x 0.6827 + 0.1 x 0.1426; standard error 0.0005
    assert abs(np.mean(np.abs(noise) < digitiser.core_px) - 0.6287) < 0.003


@pytest.mark.parametrize("make", [make_bat, make_lizard])
def test_perfect_digitiser_shows_geometry_alone(make):
    """Every marker that is not hidden is where the cameras record it, exactly; no other is seen."""
    recording = make(seed=3, n_frames=30, digitiser=PERFECT)
    exact = record(recording.cameras, recording.truth.xyz_m)
    np.testing.assert_array_equal(recording.pixels.seen, ~recording.occluded)
    np.testing.assert_array_equal(recording.pixels.uv_px[~recording.occluded], exact[~recording.occluded])
    assert not recording.lost.any()
    assert not recording.outlier.any()


@pytest.mark.parametrize("make", [make_bat, make_lizard])
def test_faults_are_marked(make):
    """Seen is neither hidden nor lost, to the sample; what is not marked an outlier is within the noise."""
    recording = make(seed=1)
    np.testing.assert_array_equal(recording.pixels.seen, ~(recording.occluded | recording.lost))
    error = np.linalg.norm(recording.pixels.uv_px - record(recording.cameras, recording.truth.xyz_m), axis=-1)
    plain = recording.pixels.seen & ~recording.outlier
    # the tail's Rayleigh: P(r > 20) = exp(-(20 / 3.34)^2 / 2) = 2e-8 a sample, of 2e5 samples
    assert error[plain].max() < 20
    share = recording.outlier.sum() / recording.pixels.seen.sum()
    assert 0.002 < share < 0.004
    assert np.median(error[recording.outlier]) > 20


def test_misclicks_land_at_the_distances_asked_for():
    uv_px = np.zeros((2, 500, 10, 2))
    digitiser = Digitiser(misclick_share=0.1, swap_share=0)
    moved, outlier = misplace(np.random.default_rng(2), uv_px, digitiser)
    away = np.linalg.norm(moved, axis=-1)
    assert (away[~outlier] == 0).all()
    assert away[outlier].min() >= 20
    assert away[outlier].max() <= 80
    # binomial, 10,000 samples: standard error 0.003
    assert abs(outlier.mean() - 0.1) < 0.015


def test_swaps_exchange_nearest_markers_and_lose_none():
    rng = np.random.default_rng(4)
    uv_px = rng.uniform(0, 1000, (2, 300, 6, 2))
    uv_px[:, :, 5] = np.nan
    moved, outlier = misplace(rng, uv_px, Digitiser(misclick_share=0, swap_share=0.05))
    assert outlier.any()
    assert not outlier[:, :, 5].any()
    np.testing.assert_array_equal(np.sort(moved, axis=2), np.sort(uv_px, axis=2))
    changed = (moved != uv_px).any(axis=-1) & ~np.isnan(uv_px[..., 0])
    np.testing.assert_array_equal(changed, outlier)


def test_bursts_take_single_markers_pairs_and_clusters():
    """Without single misses every loss is a run of at least 5 frames, and clusters are lost together."""
    digitiser = Digitiser(miss_share=0, bursts_per_s=0.3)
    clusters = [(6, 7, 8, 9)]
    rng = np.random.default_rng(6)
    missing = lost(rng, (3, 40_000, 10), digitiser, fps=240, neighbours=[(0, 1)], clusters=clusters)
    everywhere = missing.all(axis=0)
    edges = np.diff(everywhere[:, 2].astype(int))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    assert len(starts) > 10
    assert (ends[ends > starts[0]][: len(starts) - 1] - starts[:-1]).min() >= 5
    assert everywhere[:, clusters[0]].all(axis=1).any()
    # mean length (60 - 5) / ln(60 / 5) = 22.1 frames; all 3 cameras with 2 / 3 + 1 / 3 x 0.75^3 = 0.81:
    # 0.3 / 240 x 22.1 x 0.81 = 2.2 % lost from all, of some 300 bursts: 6 % + their spread of lengths
    assert abs(everywhere.mean() / 0.0224 - 1) < 0.3


def test_bursts_of_one_camera_leave_the_others_alone():
    """Poisson in number, log-uniform in length: mean (60 - 2) / ln 30 = 17.1 frames; two cameras at once by chance."""
    digitiser = Digitiser(miss_share=0, bursts_per_s=0, camera_bursts_per_s=1.0)
    missing = lost(np.random.default_rng(1), (3, 60_000, 4), digitiser, fps=700, neighbours=[(0, 1)], clusters=[(0,)])
    share = 1 - np.exp(-17.1 / 700)
    # 1030 bursts: 3 %, and lengths with a spread of 0.9 of their mean: 4 % in all
    assert abs(missing.mean() / share - 1) < 0.12
    together = (missing[0] & missing[1]).mean()
    assert together < 3 * share**2


def test_errors_last_as_stated():
    """Of 8 px and 20 frames: 400 series of 400 frames, which are 20 times 400 independent values or more."""
    digitiser = Digitiser(lasting_px=8.0, lasting_frames=(20.0, 20.0))
    errors = lasting_errors(np.random.default_rng(0), (20, 400, 20), digitiser)
    assert np.std(errors) == pytest.approx(8.0, rel=0.03)
    assert np.std(errors[:, 0]) == pytest.approx(8.0, rel=0.1)
    assert np.mean(errors[:, 20:] * errors[:, :-20]) / 64 == pytest.approx(np.exp(-1), abs=0.03)
