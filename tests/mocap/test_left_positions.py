"""Positions without cameras whose noise is guessed too small: the deviation is enlarged, and no sample refused."""

from dataclasses import replace

import numpy as np
import pytest
from mocap.datasets import make_bat

import mocap
from mocap.errors import MocapError
from mocap.findings import Kind
from mocap.records import Status
from mocap.skeleton import Skeleton
from mocap.tracking.lasting_errors import beyond, departures
from tests.real_data import real

SD_M = 2e-5
FRAMES, MARKERS = 400, 3


def white(rng, sd_m=SD_M):
    """Residuals of a track that knows its noise, and the covariance that they have."""
    off = sd_m * rng.standard_normal((FRAMES, MARKERS, 3))
    return off, np.broadcast_to(sd_m**2 * np.eye(3), (FRAMES, MARKERS, 3, 3)).copy()


def waves(rng, size_m):
    """Smooth errors of soft tissue: sums of sines of 20 to 60 frames, of this root mean square a coordinate."""
    t = np.arange(FRAMES)[:, None, None]
    period, phase = rng.uniform(20, 60, (2, MARKERS, 3)), rng.uniform(0, 2 * np.pi, (2, MARKERS, 3))
    return size_m * np.sin(2 * np.pi * t / period[0] + phase[0]) + size_m * np.sin(2 * np.pi * t / period[1] + phase[1])


@pytest.mark.parametrize("seed", range(3))
def test_lasting_errors_widen_the_deviation_and_refuse_nothing(seed):
    """Errors of 0.2 mm that last, beside 20 um of noise: hardly a sample is beyond, and z is 0.7 to 1.4.

    Before nearly all are beyond. The median of the neighbours misses the error by what noise and curvature leave.
    """
    rng = np.random.default_rng(seed)
    off, cov = white(rng)
    off += waves(rng, 2e-4)
    assert beyond(off, cov).mean() > 0.8
    added, kept = departures(off, cov)
    assert kept.mean() > 0.99
    assert beyond(off, cov + added).mean() < 0.01
    sd = np.sqrt(np.einsum("tmii->tmi", cov + added))
    assert 0.7 < np.sqrt(np.mean((off / sd) ** 2)) < 1.4


@pytest.mark.parametrize("seed", range(3))
def test_sound_noise_is_not_inflated(seed):
    """Residuals of the stated size: of normal ones 2.9 % are longer than three deviations of a coordinate.

    A filter's residuals are smaller than the covariance of both together, R - P for R + P: with P = R / 5, 0.8 of it.
    """
    off, cov = white(np.random.default_rng(seed))
    assert not departures(off * np.sqrt(0.8 / 1.2), cov)[0].any()


@pytest.mark.parametrize(("share", "run"), [(0.02, 1), (0.06, 1), (0.05, 10)])
def test_mistakes_stay_rejected(share, run):
    """2 % of lone mistakes of 30 mm, 6 % of them, or runs of ten frames: each is beyond, and nothing else is widened.

    Of the runs' neighbours the median may be a mistake, too: they, at most, are widened by it.
    """
    rng = np.random.default_rng(5)
    off, cov = white(rng)
    off *= 0.5
    starts = rng.random((FRAMES // run, MARKERS)) < share
    wrong = np.repeat(starts, run, axis=0)
    way = np.repeat(rng.standard_normal((*starts.shape, 3)), run, axis=0)
    off[wrong] += (0.03 * way / np.linalg.norm(way, axis=-1, keepdims=True))[wrong]
    added, kept = departures(off, cov)
    refused = beyond(off, cov + added) & ~kept
    assert refused[wrong].mean() > 0.97
    assert not refused[~wrong].any()
    assert np.sqrt(np.trace(added, axis1=-2, axis2=-1)).max() < 3e-4, "100 times less than a mistake"


def test_mistakes_among_lasting_errors_stay_rejected():
    """Lasting errors of 0.2 mm and 2 % of mistakes of 30 mm: the one are measured, the other are not."""
    rng = np.random.default_rng(6)
    off, cov = white(rng)
    off += waves(rng, 2e-4)
    wrong = rng.random(off.shape[:2]) < 0.02
    off[wrong] += 0.03
    added, kept = departures(off, cov)
    far = beyond(off, cov + added) & ~kept
    assert far[wrong].all()
    assert far[~wrong].mean() < 0.01


@pytest.mark.parametrize("seed", range(3))
def test_noise_with_heavy_tails_has_a_wider_deviation(seed):
    """Student's t with three degrees of freedom, stated by its middle: its variance is three times that of its scale.

    Optical systems have such tails. What is farther than five times all the rest is refused, below half a per cent.
    """
    rng = np.random.default_rng(seed)
    off, cov = white(rng)
    off = 0.8 * SD_M * rng.standard_t(3, off.shape)
    added, kept = departures(off, cov)
    assert (beyond(off, cov + added) & ~kept).mean() < 0.01
    sd = np.sqrt(np.einsum("tmii->tmi", cov + added))
    assert 0.7 < np.sqrt(np.mean((off[kept] / sd[kept]) ** 2)) < 1.4


def beads(rng):
    """Three beads that move smoothly, seen to 4 um."""
    t = np.arange(300)[:, None, None] / 250
    places = np.array([[0, 0, 0], [0.03, 0, 0], [0, 0.02, 0.01]])
    truth = places + 0.02 * np.sin(2 * np.pi * 1.1 * t) * np.array([1.0, 0.4, -0.3])
    return truth, truth + 4e-6 * rng.standard_normal(truth.shape)


def test_intervals_of_sound_positions_stay():
    """Noise of 4 um alone: nothing is renamed, nothing widened, and the track errs by what it states."""
    truth, seen = beads(np.random.default_rng(1))
    found = mocap.track(mocap.from_arrays(seen, fps=250, unit="m"), model="constant_velocity", validate=False)
    assert (found.tracks.status == Status.MEASURED).all()
    assert not found.data["departure"].values.any()
    z = (found.tracks.xyz_m - truth) / np.sqrt(np.einsum("tmii->tmi", found.tracks.cov_m2))
    assert 0.7 < np.sqrt(np.mean(z**2)) < 1.4


@pytest.mark.rare
def test_an_x_rayed_jaw_stays_measured():
    """A pig's ten beads, none missing, noise of 4 um: a pose model is off by 20 to 50 um in quick bites.

    That is 7 % of the samples beyond three deviations, which were called rejected before; the report tells it.
    """
    jaw = ("lowerIncisor", "lowerJawAnt", "LowerRtCanine", "LowerLeftJaw", "LowerLeftMolar")
    skull = ("SkullIncisor", "SkullLeftNasal", "SkullRtNasal", "SkullLeftCanine", "SkullRtCanine")
    skeleton = Skeleton(name="pig", markers=(*jaw, *skull), trunk=skull, bodies={"Jaw": jaw, "Skull": skull})
    pig = mocap.read(real("xmalab_pig", "3dpts.csv"), fps=250, unit="cm", skeleton=skeleton)
    found = mocap.track(pig, model="eal", validate=False)
    assert (found.tracks.status == Status.MEASURED).all()
    assert np.all((found.data["departure"].values > 5e-6) & (found.data["departure"].values < 3e-5))
    assert any(one.kind is Kind.WIDER_INTERVALS and "`point_sd_mm`" in one.text for one in found.findings)


def test_a_stated_deviation_is_that_of_every_sample():
    """In millimetres, in place of the estimate; it makes no sense of pixels."""
    _, seen = beads(np.random.default_rng(2))
    cleaned = mocap.clean(mocap.from_arrays(seen, fps=250, unit="m", point_sd_mm=0.05))
    assert np.allclose(np.sqrt(cleaned.cov_m2[..., 0, 0]), 5e-5)
    with pytest.raises(MocapError, match="`point_sd_mm` must be a number above 0"):
        mocap.from_arrays(seen, fps=250, unit="m", point_sd_mm=-1.0)
    film = make_bat(seed=0, n_frames=20, n_cameras=3)
    uv = film.pixels.uv_px
    pixels = mocap.from_pixels(uv, film.cameras, names=film.pixels.names, fps=film.fps, unit="m")
    with pytest.raises(MocapError, match="`point_sd_mm` is the noise of 3D positions"):
        replace(pixels, source=replace(pixels.source, point_sd_mm=0.05))
