"""Disturbances of films: each does what its size says, and the truth knows what the film does not show."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from mocap.datasets.disturbances import ALL, CLEAN, SINGLE, Disturbances
from mocap.datasets.lizards import SLOPE_RAD, lizard_motion
from mocap.datasets.movie import pictures, shown_pixels
from mocap.datasets.rig import tank_cameras

MOTION, CAMERA = lizard_motion(1), tank_cameras(2, slope_rad=SLOPE_RAD)[0]
T_S = 0.3 + np.arange(4) / 250


def drawn(disturbances, seed=3, t_s=T_S):
    """(T, H, W) of one camera."""
    return np.stack([*pictures(MOTION, t_s, CAMERA, fps=250, disturbances=disturbances, seed=(seed, 0))]).astype(float)


@cache
def film(disturbances, seed=3, frames=None):
    """As ``drawn``, once; the first frames of ``T_S``, or all."""
    return drawn(disturbances, seed, T_S[:frames])


QUIET = replace(CLEAN, noise=0.0)


def test_a_seed_is_a_film():
    """The same seed gives the same film with all disturbances, another one another."""
    first = film(ALL)
    np.testing.assert_array_equal(drawn(ALL), first)
    assert np.abs(film(ALL, seed=4) - first).mean() > 3


def test_noise_has_its_size():
    """In the dark 30 of 255: variance noise^2 + shot^2 30 / 255, and 1/12 of whole grey levels."""
    got = film(replace(CLEAN, noise=4.0, shot=6.0), frames=1)[0][film(QUIET, frames=1)[0] == 30]
    assert got.std() == pytest.approx(np.sqrt(16 + 36 * 30 / 255 + 1 / 12), rel=0.03)
    assert got.mean() == pytest.approx(30, abs=0.1)


def test_flicker_changes_the_light_by_its_size():
    """The picture's mean follows the lamps, up to the amplitude and no more."""
    t_s = 0.3 + np.arange(12) / 250
    mean = drawn(replace(QUIET, flicker=0.3), t_s=t_s).mean(axis=(1, 2)) / drawn(QUIET, t_s=t_s).mean(axis=(1, 2))
    assert np.ptp(mean) > 0.1
    assert np.abs(mean - 1).max() < 0.31


def test_texture_has_its_amplitude():
    """Of the background alone, where nothing was drawn."""
    got = film(replace(QUIET, background=10.0), frames=1)[0, :100, :300]
    assert got.std() == pytest.approx(10, rel=0.3)


@pytest.mark.parametrize("name", ["blur", "defocus", "merging"])
def test_dots_grow(name):
    """A blurred, defocused or large dot covers more pixels than a clean one; blur keeps the light of the picture."""
    sharp, spoilt = film(QUIET), film(replace(SINGLE[name], noise=0.0, exposure=1.0 if name == "blur" else 0.0))
    if name == "merging":
        assert (spoilt > 185).sum() > 2 * (sharp > 185).sum()
        return
    steep = [(np.diff(picture, axis=-1) ** 2).sum() for picture in (spoilt, sharp)]
    assert steep[0] < 0.95 * steep[1]
    assert spoilt.mean() == pytest.approx(sharp.mean(), rel=0.01)


def test_reflections_are_spots_where_no_marker_is():
    """So many more bright spots, at most, as there are reflections."""
    difference = film(replace(QUIET, reflections=20), frames=1) - film(QUIET, frames=1)
    area = (difference[0] > 60).sum() / (np.pi * 9)
    assert 4 < area < 20


def test_what_the_film_hides_the_truth_hides():
    """Markers behind a bar are NaN in the truth and dark in the picture; the others are bright."""
    sizes = replace(QUIET, bars=40)
    shown = shown_pixels(MOTION, T_S, [CAMERA], start_s=np.zeros(1), disturbances=sizes, seed=3)
    free = shown_pixels(MOTION, T_S, [CAMERA], start_s=np.zeros(1), seed=3)
    picture, uv = film(sizes, frames=1)[0], np.rint(np.nan_to_num(free.uv_px[0, 0]) - 1).astype(int)
    behind = free.seen[0, 0] & ~shown.seen[0, 0]
    assert behind.sum() >= 2
    grey = picture[uv[free.seen[0, 0], 1], uv[free.seen[0, 0], 0]]
    assert grey[behind[free.seen[0, 0]]].max() < 130 < np.median(grey[shown.seen[0, 0][free.seen[0, 0]]])


def test_bodies_may_be_transparent():
    """With occlusion 0 every marker in the picture is shown."""
    all_shown = shown_pixels(MOTION, T_S, [CAMERA], start_s=np.zeros(1), disturbances=Disturbances(occlusion=0.0))
    usual = shown_pixels(MOTION, T_S, [CAMERA], start_s=np.zeros(1))
    assert all_shown.seen.all()
    assert not usual.seen.all()


@pytest.mark.parametrize("wrong", [{"noise": -1.0}, {"exposure": 1.5}, {"radius_px": 0.0}, {"contrast": float("nan")}])
def test_impossible_sizes_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        Disturbances(**wrong)
