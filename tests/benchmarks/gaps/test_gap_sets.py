"""The sets of the gap benchmark hold what they say."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.gaps import sets, twins
from benchmarks.gaps.cells import trained_on
from benchmarks.gaps.method import Trial
from benchmarks.gaps.sets import load, teachers
from benchmarks.gaps.takes import noise_sd
from tests.real_data import FOLDER

REAL = {
    "bat": ("bat_windtunnel_dltdv8", 4, 15, 700),
    "mouse": ("mouse_mocap_qtm", 7, 11, 300),
    "snake_glide": ("snake_glide_qualisys", 8, 10, 179),
    "snake_gap": ("snake_gap_vicon", 7, 10, 150),
    "gait": ("c3d_samples", 3, 26, 50),
}


@pytest.mark.rare
@pytest.mark.parametrize(("name", "facts"), REAL.items(), ids=REAL)
def test_real_sets(name, facts):
    """Trials of equal markers, evenly timed, more than 95 frames each; trunk and limbs are of them and apart."""
    folder, n_trials, n_markers, fps = facts
    if not (FOLDER / folder).exists():
        pytest.skip(f"no real recording {folder}: set MOCAP_REAL_DATA to the folder that holds it")
    trials = load(name)
    assert len(trials) == n_trials
    for trial in trials:
        assert trial.names == trials[0].names
        assert len(trial.names) == n_markers
        assert len(trial.t_s) > 95
        np.testing.assert_allclose(np.diff(trial.t_s), 1 / fps, rtol=1e-6)
        seen = np.isfinite(trial.xyz_m[..., 0])
        assert seen[[0, -1]].any(axis=1).all()
        np.testing.assert_array_equal(trial.sd_m, trials[0].sd_m)
        assert ((trial.sd_m >= 1e-5) & (trial.sd_m < 1e-3)).all()
        limbs = [name for limb in trial.limbs for name in limb]
        assert set(limbs) | set(trial.trunk) <= set(trial.names)
        assert len(set(limbs)) == len(limbs)
        assert not set(limbs) & set(trial.trunk)


def test_noise_is_found_under_motion():
    """White noise of 0.3 mm on a smooth motion, with holes and over several recordings; 1800 differences: 5 %."""
    rng = np.random.default_rng(0)
    t_s = np.arange(300) / 200
    smooth = 0.05 * np.sin(2 * np.pi * 2 * t_s)[:, None, None] * np.ones((1, 2, 3))
    parts = [(t_s, smooth + 3e-4 * rng.standard_normal(smooth.shape)) for _ in range(2)]
    parts[0][1][50:60] = np.nan
    np.testing.assert_allclose(noise_sd(parts, ("a", "b")), 3e-4, rtol=0.1)


def test_other_animals_are_learned_from_others():
    """In such a set no trial is learned from its own animal; elsewhere from all others."""
    trials = [make_trial(animal) for animal in ("a", "a", "b")]
    assert [teachers("twin_scaled", trials, k) for k in range(3)] == [[2], [2], [0, 1]]
    assert [teachers("twin_bat", trials, k) for k in range(3)] == [[1, 2], [0, 2], [0, 1]]
    assert trained_on([trials[0], trials[2]]) == "other animal"
    assert trained_on([trials[0], trials[1]]) == "same"
    assert trained_on([trials[0], replace(trials[1], gait="fast")]) == "several gaits"


def make_trial(animal):
    """Nothing but an animal."""
    return Trial(
        name=animal, names=(), t_s=np.zeros(0), xyz_m=np.zeros((0, 0, 3)), sd_m=np.zeros(0), trunk=(), limbs=(),
        animal=animal,
    )  # fmt: skip


def test_only_as_many_twins_are_made_as_wanted(monkeypatch):
    """Two of the five lizards: what the quick run needs; their pixels are cut to the frames of their positions."""
    monkeypatch.setattr(twins, "FRAMES", 50)
    trials = sets.twin_trials("twin_lizard", 2)
    assert [trial.name for trial in trials] == ["lizard_11", "lizard_12"]
    for trial in trials:
        assert trial.film is not None
        assert trial.film.pixels.uv_px.shape[1:3] == trial.xyz_m.shape[:2]
        seen_twice = trial.film.pixels.seen.sum(axis=0) >= 2
        assert (seen_twice | np.isnan(trial.xyz_m[..., 0])).all()
