"""Likelihoods of a network's clicks: what they are worth is learned from how rays meet, and weighs them."""

from dataclasses import replace

import numpy as np
import pytest
from mocap.datasets import PERFECT, make_bat

import mocap
from mocap.cameras.camera import project, stacked
from mocap.cleaning.cleaned import Cleaned
from mocap.cleaning.cleaning import clean
from mocap.cleaning.likelihoods import likelihood_noise
from mocap.io.anipose import write_calibration

SD_PX = 1.0
WORTHLESS = 0.3
"""Clicks of lower likelihood lie anywhere in half of the cases."""


@pytest.fixture(scope="module")
def clicked():
    """True points; clicks of four cameras with likelihoods: from 0.8 down errors grow to four times at 0.3."""
    bat = make_bat(seed=3, n_frames=120, n_cameras=4, digitiser=PERFECT)
    rng = np.random.default_rng(4)
    exact = project(stacked(bat.cameras), bat.truth.xyz_m)
    likelihood = np.where(
        rng.random(exact.shape[:3]) < 0.6, rng.uniform(0.8, 1, exact.shape[:3]), rng.random(exact.shape[:3])
    )
    grown = true_factor(likelihood)
    uv = exact + SD_PX * grown[..., None] * rng.standard_normal(exact.shape)
    lost = (likelihood < WORTHLESS) & (rng.random(likelihood.shape) < 0.5)
    uv[lost] += rng.uniform(-150, 150, uv[lost].shape)
    return bat, uv, likelihood


def true_factor(likelihood):
    """1 above 0.8, and log-linear to 4 at 0.3."""
    return 4 ** np.clip((0.8 - likelihood) / 0.5, 0, 1)


def test_what_likelihoods_are_worth_is_found(clicked):
    """Deviations within 20 % of the truth at all believed likelihoods, and those at which half are lost are refused.

    A range of 40 clicks or more gives a deviation to 1 / sqrt(2 x 40) x 1.2 (of a median) = 13 %, pooled ones better;
    in a range of likelihoods the factor itself varies by up to 15 %.
    """
    bat, uv, likelihood = clicked
    found = likelihood_noise(stacked(bat.cameras), uv, likelihood)
    assert found is not None
    assert found.scale_px == pytest.approx(SD_PX, rel=0.05)
    asked = np.array([0.4, 0.5, 0.6, 0.7, 0.85, 0.95])
    assert found.factors(asked) == pytest.approx(true_factor(asked), rel=0.25)
    assert found.least == pytest.approx(WORTHLESS, abs=0.05)


def test_likelihoods_that_say_nothing_change_nothing(clicked):
    """The same clicks with shuffled likelihoods: all are worth the same, and none is refused."""
    bat, uv, likelihood = clicked
    shuffled = np.random.default_rng(5).permutation(likelihood.ravel()).reshape(likelihood.shape)
    found = likelihood_noise(stacked(bat.cameras), uv, shuffled)
    assert found is not None
    assert found.least == 0
    assert found.factors(np.linspace(0, 1, 9)).max() < 1.5


def test_too_few_clicks_teach_nothing(clicked):
    """Two cameras predict nothing of a third; constant likelihoods teach nothing."""
    bat, uv, likelihood = clicked
    matrices = stacked(bat.cameras)
    assert likelihood_noise(matrices[:2], uv[:2], likelihood[:2]) is None
    assert likelihood_noise(matrices, uv, np.full(uv.shape[:3], 1.0)) is None
    assert likelihood_noise(matrices, uv[:, :1], likelihood[:, :1]) is None


@pytest.fixture(scope="module")
def surer():
    """Of a share of the clicks of low likelihood by how many of their deviations they are wrong; then what is found."""
    bat = make_bat(seed=3, n_frames=120, n_cameras=4, digitiser=PERFECT)
    matrices = stacked(bat.cameras)
    exact = project(matrices, bat.truth.xyz_m)

    def found(share, off, some=slice(None)):
        rng = np.random.default_rng(2)
        uv = exact[:, some] + 0.5 * rng.standard_normal(exact[:, some].shape)
        low = rng.random(uv.shape[:3]) < 0.15
        likelihood = np.where(low, rng.uniform(0.2, 0.21, low.shape), 1.0)
        wrong = low & (rng.random(low.shape) < share)
        angle = rng.uniform(0, 2 * np.pi, wrong.sum())
        uv[wrong] += 0.5 * off * np.column_stack([np.cos(angle), np.sin(angle)])
        return lambda markers: likelihood_noise(matrices, uv[:, :, :markers], likelihood[:, :, :markers])

    return found


@pytest.mark.parametrize(("share", "off", "refused"), [(0.3, 50, 0), (0.38, 50, 1), (0.8, 7, 0), (0.8, 8, 1)])
def test_likelihoods_at_which_a_third_is_wrong_are_refused(surer, share, off, refused):
    """By six deviations or more, a seventh of which is in the prediction from the other cameras."""
    assert (surer(share, off)(None).least > 0) == refused


def test_eighty_clicks_teach_something(surer):
    """One frame, four clicks a marker, some of which two surer ones do not predict."""
    assert surer(0.1, 50, slice(0, 1))(19) is None
    assert surer(0.1, 50, slice(0, 1))(25) is not None


def write_network(folder, bat, uv, likelihood):
    """A file of DeepLabCut a camera, and the calibration."""
    names = bat.skeleton.markers
    paths = []
    for camera, tracks, sure in zip(bat.cameras, uv, likelihood, strict=True):
        path = folder / f"{camera.name}.csv"
        rows = [
            f"{t}," + ",".join(f"{x:.6f},{y:.6f},{p:.6f}" for (x, y), p in zip(row, ps, strict=True))
            for t, (row, ps) in enumerate(zip(tracks, sure, strict=True))
        ]
        heads = [
            ["scorer", *["net"] * (3 * len(names))],
            ["bodyparts", *[name for name in names for _ in range(3)]],
            ["coords", *["x", "y", "likelihood"] * len(names)],
        ]
        path.write_text("\n".join([*map(",".join, heads), *rows]) + "\n")
        paths.append(path)
    write_calibration(folder / "calibration.toml", [replace(camera, lens=None) for camera in bat.cameras])
    return paths


@pytest.mark.rare
def test_a_recording_is_better_for_its_likelihoods(clicked, tmp_path):
    """Points are nearer to the truth by a tenth or more (90 %), and their stated intervals hold.

    Student's t finds bad clicks by itself where there are four; their likelihoods tell more.
    """
    bat, uv, likelihood = clicked
    for name in "ab":
        (tmp_path / name).mkdir()
    told = {}
    for name, sure in (("a", likelihood), ("b", np.ones_like(likelihood))):
        views = write_network(tmp_path / name, bat, uv, sure)
        told[name] = clean(mocap.read(views, calibration=tmp_path / name / "calibration.toml", fps=240))
    order = [bat.truth.names.index(n) for n in told["a"].names]
    truth = bat.truth.xyz_m[:, order]
    off = {name: np.linalg.norm(p.xyz_m - truth, axis=-1) for name, p in told.items()}
    both = np.isfinite(off["a"]) & np.isfinite(off["b"])
    assert np.quantile(off["a"][both], 0.9) < 0.9 * np.quantile(off["b"][both], 0.9)
    assert told["a"][Cleaned].jitter_px == pytest.approx(SD_PX, rel=0.15)  # of usual clicks; 1.8 px over all
    sd = np.sqrt(np.diagonal(told["a"].cov_m2, axis1=-2, axis2=-1))
    known = np.isfinite(sd)
    inside = np.abs(told["a"].xyz_m - truth)[known] <= 1.959964 * sd[known]
    assert 0.92 < inside.mean() < 0.98
    assert any("points are weighted by likelihood" in said.text for said in told["a"].findings)
    assert any("likelihoods were not used" in said.text for said in told["b"].findings)
