"""What the gap benchmark measures of ours is what a user gets."""

import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from mocap.datasets import make_bat

from benchmarks.gaps.hide import hide
from benchmarks.gaps.method import Trial
from benchmarks.gaps.ours import Ours, without_holes
from benchmarks.gaps.prepared import recording, tracks_of
from mocap.cli.main import main
from mocap.io.dltdv import write_points
from mocap.io.unstated_unit import length

NAMES = ("sternum", "back", "shoulder_l", "shoulder_r", "elbow_l", "wrist_l")
LIMBS = (("elbow_l", "wrist_l"),)
SD_M = 3e-4


def flight(seed, n_frames=48):
    """Some markers of a twin with noise, in whole micrometres, which the file keeps to the last bit."""
    truth = make_bat(seed=seed, n_frames=n_frames, n_cameras=2).truth
    xyz = truth.xyz_m[:, [truth.names.index(name) for name in NAMES]]
    xyz = np.round(xyz + np.random.default_rng(seed).normal(0, SD_M, xyz.shape), 6)
    t_s = np.arange(n_frames) / 240
    return Trial(
        name=f"f{seed}",
        names=NAMES,
        t_s=t_s,
        xyz_m=xyz,
        sd_m=np.full(len(NAMES), SD_M),
        trunk=NAMES[:4],
        limbs=LIMBS,
    )


@pytest.fixture
def mocap(monkeypatch, capsys):
    """Runs a command; it must succeed."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["mocap", *map(str, arguments)])
        with pytest.raises(SystemExit) as stopped:
            main()
        assert not stopped.value.code, capsys.readouterr().err

    return run


@pytest.mark.rare
def test_what_is_measured_is_what_a_user_gets(mocap, tmp_path):
    """Hidden recordings as files, learned from and tracked by the commands: every sample is that of the benchmark.

    The command writes seven decimals of a metre: to half of the last one, which is a ten thousandth of the noise.
    """
    training = [flight(0)]
    copy = hide(flight(2), [("limb", 10)], np.random.default_rng(0))[0]
    found = Ours("EAL").learn(training)(copy.shown)
    skeleton = tmp_path / "bat.toml"
    quoted = ", ".join(f'"{name}"' for name in NAMES)
    trunk = ", ".join(f'"{name}"' for name in NAMES[:4])
    skeleton.write_text(f'name = "markers and trunk"\nmarkers = [{quoted}]\ntrunk = [{trunk}]\n')
    files = []
    for trial in (*training, copy.shown):
        files.append(tmp_path / f"{trial.name}_xyzpts.csv")
        write_points(files[-1], tracks_of(trial), sd=True)
    options = ("--fps", 240, "--skeleton", skeleton)
    mocap("learn", files[0], *options, "--out", tmp_path / "bat.npz")
    out = tmp_path / "run"
    mocap("track", files[1], *options, "--model", tmp_path / "bat.npz", "--no-validate", "--out", out)
    markers = pd.read_csv(out / "markers.csv")
    for m, name in enumerate(NAMES):
        xyz = markers[[f"{name}_{axis}" for axis in "xyz"]].to_numpy()
        np.testing.assert_allclose(xyz, found.xyz_m[:, m], rtol=0, atol=5.1e-8)
    hidden = np.isnan(copy.shown.xyz_m[..., 0])
    assert hidden.sum() >= 20
    assert (markers[[f"{name}_origin" for name in NAMES]].to_numpy()[hidden] == "smoothed").all()


def test_cleaning_does_not_touch_clean_positions():
    """Positions that hold no jump and no duplicate are prepared as they are, with the noise that is stated."""
    trial = flight(0)
    prepared = recording(trial)
    np.testing.assert_array_equal(prepared.xyz_m, trial.xyz_m)
    np.testing.assert_allclose(np.trace(prepared.cov_m2, axis1=-2, axis2=-1) / 3, SD_M**2)
    assert prepared.skeleton.trunk == trial.trunk


def test_what_a_run_leaves_empty_lies_on_lines():
    """With the covariance of anywhere in the animal; all else is the run's own."""
    trial = flight(2)
    tracks, unknown = tracks_of(trial), np.zeros(trial.xyz_m.shape[:2], dtype=bool)
    run = SimpleNamespace(data={"unknown": SimpleNamespace(values=unknown)}, tracks=tracks)
    assert without_holes(run, trial) is tracks
    unknown[10:20, 1] = True
    shown = replace(trial, xyz_m=np.where(unknown[..., None], np.nan, trial.xyz_m))
    run.xyz_m, run.cov_m2 = shown.xyz_m, tracks.cov_m2
    filled = without_holes(run, shown)
    ends = trial.xyz_m[[9, 20], 1]
    np.testing.assert_allclose(filled.xyz_m[12, 1], ends[0] + 3 / 11 * (ends[1] - ends[0]))
    assert np.sqrt(filled.cov_m2[12, 1, 0, 0]) == pytest.approx(length(shown.xyz_m))
    np.testing.assert_array_equal(filled.xyz_m[~unknown], trial.xyz_m[~unknown])
