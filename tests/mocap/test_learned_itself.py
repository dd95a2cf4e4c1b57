"""Tracking a recording with a model that was learned from it, and what the report says of that."""

import json
import sys
from dataclasses import replace

import numpy as np
import pytest

from mocap.cleaning.cleaning import clean
from mocap.cli.main import main
from mocap.io.dltdv import write_points
from mocap.reading.reading import read
from mocap.recording import of_points
from mocap.records import MarkerTracks, Status
from mocap.report.job import run_job
from mocap.skeleton import Skeleton
from mocap.tracking.model_file import save_model
from mocap.tracking.tracking import marker_trial, seen_part
from tests.filters.small_model import small_model


def test_the_report_says_that_it_was_left_out(tmp_path, monkeypatch, capsys):
    walk = small_model().trials[0]
    path, model, out = tmp_path / "walk_xyzpts.csv", tmp_path / "m.npz", tmp_path / "run"
    cov = np.broadcast_to(1e-6 * np.eye(3), (40, 5, 3, 3))
    origin = np.full((40, 5), Status.MEASURED)
    names = small_model().names
    write_points(path, MarkerTracks(names=names, t_s=walk.t_s, xyz_m=walk.xyz_m, cov_m2=cov, status=origin))
    prepared = clean(read(path, fps=100.0))
    other = replace(walk, name="other", xyz_m=walk.xyz_m[::-1] + 0.1)
    save_model(replace(small_model(), trials=(marker_trial(seen_part(prepared)), other)), model)
    monkeypatch.setattr(sys, "argv", ["mocap", "track", str(path), "--fps", "100", "--model", str(model), "--out"])
    sys.argv += [str(out), "--no-validate", "--json"]
    with pytest.raises(SystemExit) as stopped:
        main()
    assert not stopped.value.code
    report = json.loads(capsys.readouterr().out)
    assert report["model"]["why"] == "learned from other; walk is this recording itself and was left out"


def test_the_report_says_how_trials_were_scaled():
    """A trial of an animal that is 1.4 times as large: the why of the model names the factor."""
    walk = small_model().trials[0]
    names = small_model().names
    cov = np.broadcast_to(1e-6 * np.eye(3), (40, 5, 3, 3))
    tracks = MarkerTracks(
        names=names, t_s=walk.t_s, xyz_m=walk.xyz_m, cov_m2=cov, status=np.full((40, 5), Status.MEASURED)
    )
    prepared = clean(of_points(tracks, Skeleton(name="walk", markers=names), name="mine"))
    large = replace(walk, name="large", xyz_m=1.4 * walk.xyz_m[::-1] + 0.1)
    learned = replace(small_model(), trials=(large,))
    run, _ = run_job(prepared, learned=learned, validated=False)
    assert run.report["model"]["why"] == "learned from large (x 0.714); scaled to this animal's size"
