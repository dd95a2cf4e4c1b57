"""The sets of the gap benchmark hold what they say."""

import numpy as np
import pytest

from benchmarks.gaps.sets import SETS, load, stations
from benchmarks.gaps.takes import noise_sd
from tests.real_data import FOLDER

REAL = {
    "bat": ("bat_windtunnel_dltdv8", 4, 15, 700),
    "mouse": ("mouse_mocap_qtm", 7, 11, 300),
    "snake_glide": ("snake_glide_qualisys", 8, 10, 179),
    "snake_gap": ("snake_gap_vicon", 7, 10, 150),
    "gait": ("c3d_samples", 3, 26, 50),
}


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


def test_stations_are_the_nearest_markers():
    """Of markers along a straight body at known places, those nearest to 0, 1/2 and 1 are taken, in order."""
    along = np.array([0.0, 0.1, 0.45, 0.52, 0.8, 1.0])
    xyz = np.zeros((5, len(along), 3))
    xyz[..., 0] = along
    np.testing.assert_array_equal(stations(xyz, 3), [0, 3, 5])
    np.testing.assert_array_equal(stations(xyz, 6), np.arange(6))


def test_noise_is_found_under_motion():
    """White noise of 0.3 mm on a smooth motion, with holes and over several recordings; 1800 differences: 5 %."""
    rng = np.random.default_rng(0)
    t_s = np.arange(300) / 200
    smooth = 0.05 * np.sin(2 * np.pi * 2 * t_s)[:, None, None] * np.ones((1, 2, 3))
    parts = [(t_s, smooth + 3e-4 * rng.standard_normal(smooth.shape)) for _ in range(2)]
    parts[0][1][50:60] = np.nan
    np.testing.assert_allclose(noise_sd(parts, ("a", "b")), 3e-4, rtol=0.1)


def test_every_set_is_described():
    """The module's table has a line for each set."""
    from benchmarks.gaps import sets

    assert all(f"| ``{name}`` |" in (sets.__doc__ or "") for name in SETS)
