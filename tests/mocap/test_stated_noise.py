"""What a user states of the pixel noise is used, and what contradicts the pixels is said."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from mocap.datasets import make_bat, write_recording

from mocap.cleaning.cleaned import Cleaned
from mocap.cleaning.cleaning import clean
from mocap.cleaning.triangulate_file import triangulate_file
from mocap.findings import Kind
from mocap.io.dltdv import read_points
from mocap.reading.reading import read
from mocap.tracking.tracking import marker_trial, seen_part

SAME = 1e-12
"""Products and roots of a few numbers in double precision."""


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    files = write_recording(make_bat(seed=3, n_frames=40, n_cameras=4), tmp_path_factory.mktemp("bat"))
    return read(
        files["pixels"],
        fps=240.0,
        calibration=files["coefficients"],
        profile=files["profile"],
        skeleton=files["skeleton"],
    )


def stating_it(source, pixel_sd):
    return replace(source, source=replace(source.source, pixel_sd=pixel_sd))


@pytest.fixture(scope="module")
def plain(source):
    return clean(source)


@pytest.fixture(scope="module")
def stating(source):
    """The recording cleaned with a stated noise, once for each."""
    return cache(lambda stated: clean(stating_it(source, stated)))


@pytest.mark.parametrize("stated", [0.01, 0.9])
def test_intervals_follow_what_is_stated_and_nothing_else_does(stating, plain, stated):
    """Below what the rays show: the same points, samples and names; every deviation times stated over shown."""
    found = stating(stated)
    ratio = stated / plain[Cleaned].jitter_px
    np.testing.assert_array_equal(found.xyz_m, plain.xyz_m)
    np.testing.assert_array_equal(found.rays_rejected, plain.rays_rejected)
    for reason, mask in plain.rejected.items():
        np.testing.assert_array_equal(found.rejected[reason], mask)
    assert [(s.a, s.b, s.camera) for s in found[Cleaned].swaps] == [(s.a, s.b, s.camera) for s in plain[Cleaned].swaps]
    assert found[Cleaned].jitter_px == stated
    np.testing.assert_allclose(found.cov_m2, ratio**2 * plain.cov_m2, rtol=SAME)
    np.testing.assert_allclose(found.ray_sd_px, ratio * plain.ray_sd_px, rtol=SAME)
    np.testing.assert_allclose(found.ray_scale_px, ratio * plain.ray_scale_px, rtol=SAME)


def test_more_noise_than_rays_show(stating, plain):
    """Intervals grow with it, points hardly move, fewer rays are refused; motion is learned with the noise shown."""
    found = {stated: stating(stated) for stated in (5.0, 50.0)}
    for stated, one in found.items():
        both = np.isfinite(one.xyz_m[..., 0]) & np.isfinite(plain.xyz_m[..., 0])
        grown = np.sqrt(np.trace(one.cov_m2, axis1=-2, axis2=-1) / np.trace(plain.cov_m2, axis1=-2, axis2=-1))[both]
        assert (
            abs(np.median(grown) / (stated / plain[Cleaned].jitter_px) - 1) < 0.1
        )  # other rays are believed, by a few per cent
        assert one.rays_rejected.sum() < plain.rays_rejected.sum()
        learned, usual = (marker_trial(seen_part(p)).sd_m for p in (one, plain))
        assert abs(np.nanmedian(learned) / np.nanmedian(usual) - 1) < 0.1


@pytest.mark.parametrize(("stated", "said"), [(0.01, "times too narrow"), (50.0, "times as wide"), (0.9, None)])
def test_what_contradicts_the_pixels_is_said_first(source, stating, plain, tmp_path, stated, said):
    """By how much, and what is done; nothing is said of a number that agrees."""
    given = stating_it(source, stated)
    summary = triangulate_file(given, tmp_path / "xyzpts.csv", refine=True)
    for findings in (stating(stated).findings, summary.findings):
        contradicted = [f for f in findings if f.kind == "pixel noise"]
        told = [f"`pixel_sd` {stated:g}" in f.text and said in f.text for f in contradicted]
        assert told == [True] * (said is not None)
        others = [f for f in findings if f.kind != Kind.ASSUMED_UNIT]  # which is said before all else
        assert not contradicted or others[0] == contradicted[0]
    assert not any(f.kind == "pixel noise" for f in plain.findings)


def test_triangulate_refine_uses_it_too(source, tmp_path):
    """The same points with deviations in the ratio of what is stated, below what rays show."""
    found = {}
    for stated in (0.05, 0.5):
        path = tmp_path / f"{stated}_xyzpts.csv"
        triangulate_file(stating_it(source, stated), path, refine=True)
        found[stated] = read_points(path, fps=240.0)
    np.testing.assert_array_equal(found[0.05].seen, found[0.5].seen)
    ratio = (found[0.5].sd_m / found[0.05].sd_m)[found[0.5].seen]
    np.testing.assert_allclose(ratio, 10, rtol=1e-3)  # nine decimals of a metre are written
