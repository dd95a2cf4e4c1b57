"""Points hidden from what one camera sees, through Python, ``mocap track`` and ``mocap batch``."""

import json
import sys

import pandas as pd
import pytest

import mocap
from mocap.cli.main import main
from mocap.errors import MocapError
from mocap.results.long_result import write_in_blocks
from tests.filters.flapping_trials import FPS, flapping
from tests.mocap.test_track_one_camera import files_of, model_of


@pytest.mark.rare
def test_hidden_points_are_filled_and_scored_alike_in_every_entrance(tmp_path, monkeypatch):
    """Points of 10 frames, as its own gap is: nearer than curves through pixels, and in intervals.

    The same seed hides the same points: the file of a command, a row of a batch and Python have one error.
    """
    model = tmp_path / "model.npz"
    model_of(flapping(1, frames=60), flapping(2, frames=60)).save(model)
    pixels, calibration = files_of(flapping(9, frames=60), slice(25, 35), tmp_path)
    stated = {"calibration": calibration, "fps": FPS, "unit": "m"}
    found = mocap.track(mocap.read(pixels, **stated), model=model).report["validation"]
    own, cubic = found["methods"]["one camera"], found["methods"]["cubic"]
    assert found["hidden_samples"] >= 10
    assert own["rmse_mm"] < 0.5 * cubic["rmse_mm"]
    assert own["coverage95"] > 90
    words = [word for name, value in stated.items() for word in (f"--{name}", str(value))]
    words = ["mocap", "track", str(pixels), *words, "--model", str(model), "--out", str(tmp_path / "one")]
    monkeypatch.setattr(sys, "argv", words)
    with pytest.raises(SystemExit) as end:
        main()
    assert not end.value.code
    written = json.loads((tmp_path / "one" / "report.json").read_text())
    assert written["validation"]["methods"]["one camera"]["rmse_mm"] == pytest.approx(own["rmse_mm"], rel=1e-6)
    assert "across the line of sight" in (tmp_path / "one" / "report.md").read_text()
    mocap.batch(pixels, tmp_path / "many", jobs=1, model=model, **stated)
    row = pd.read_csv(tmp_path / "many" / "summary.csv").iloc[0]
    assert row["hidden_samples"] == found["hidden_samples"]
    assert row["rmse_mm"] == pytest.approx(own["rmse_mm"], rel=1e-4)


def test_blocks_are_refused_with_the_reason(tmp_path):
    """Not as a recording in which no marker is ever seen, which it was called: blocks look for two rays."""
    pixels, calibration = files_of(flapping(9, frames=60), slice(25, 35), tmp_path)
    recording = mocap.read(pixels, calibration=calibration, fps=FPS, unit="m")
    with pytest.raises(MocapError, match=r"at once, not in blocks, as the whole decides .*: give `blocks` 0"):
        write_in_blocks(recording, tmp_path / "out")
