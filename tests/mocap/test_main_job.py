"""The main job on recordings of other people, and on one without noise; ``tests/test_installed.py`` has the demo."""

import json
import sys
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from mocap.datasets import PERFECT, make_bat
from mocap.filters.track import forgotten
from rerun.chunk import RrdReader

from mocap.cleaning.cleaning import clean
from mocap.cli.main import main
from mocap.plots.figures import pictures
from mocap.reading.ideal_pixels import of_pixels
from mocap.report.job import run_job
from mocap.rerun.record import write_recording
from mocap.skeleton import Skeleton
from tests.mocap.recordings import with_markers
from tests.mocap.test_two_rays import MARKERS
from tests.real_data import real

BAT = "bat_windtunnel_dltdv8/derived_csv"
CAVE = "bat_cave_dltdv7"


def recordings():
    """Name, options, and the number of stored points that do not follow from their pixels (PROVENANCE.md)."""
    f5, fe = (f"{BAT}/{name}/{name}_" for name in ("078A3_F5", "FE404_F2"))
    bats = f"{CAVE}/P000_15000_bats/DLTdv7_data_20180817-P000-15000xypts.csv"
    speaker = f"{CAVE}/P03_1000_speaker/DLTdv7_data_2018-08-17_P03_1000TMCxypts.csv"
    dlt = f"{CAVE}/P03_1000_speaker/2018-08-17_wand_dltCoefs_round4.csv"
    # eight edited points, and one that is stored though a single camera sees it
    # the longest: which model fills its gaps is told by the others
    options = ["--dlt", real_path(f"{f5}dltCoefs.csv"), "--fps", 700, "--no-validate", "--model", "constant_velocity"]
    yield pytest.param(f"{f5}xypts.csv", options, 9, id="078A3_F5")
    options = ["--dlt", real_path(f"{fe}dltCoefs.csv"), "--profile", real_path(f"{fe}camera_profile.txt"), "--fps", 700]
    yield pytest.param(f"{fe}xypts.csv", options, 0, id="FE404_F2", marks=pytest.mark.rare)
    options = ["--dlt", real_path(dlt), "--fps", 25, "--origin", "lower-left"]
    yield pytest.param(bats, options, 0, id="cave")
    yield pytest.param(speaker, options, 0, id="speaker", marks=pytest.mark.rare)


def real_path(path: str):
    """Resolved when the test runs, so that it can skip there."""
    return lambda: real(*path.split("/"))


@pytest.mark.parametrize(("tracks", "options", "n_stale"), [*recordings()])
def test_real_recordings_run_through(monkeypatch, capsys, tmp_path, tracks, options, n_stale):
    """Interior gaps are filled with finite covariance and marked, stale points are listed, the recording opens.

    But where nothing at all was seen for hundreds of frames, as of the loudspeaker for 820: there is nothing.
    """
    monkeypatch.setattr("mocap.rerun.record.write_recording", write_recording)
    monkeypatch.setattr("mocap.plots.figures.pictures", pictures)
    options = [o() if callable(o) else o for o in options]
    path = real(*tracks.split("/"))
    out = tmp_path / "run"
    monkeypatch.setattr(sys, "argv", ["mocap", "track", str(path), "--out", str(out), *map(str, options)])
    with pytest.raises(SystemExit) as stopped:
        main()
    assert stopped.value.code == 0, capsys.readouterr().err
    report = json.loads((out / "report.json").read_text())
    assert len(report["stale_points"]) == n_stale
    left_handed = any("left-handed" in finding for finding in report["findings"])
    assert left_handed == ("bat_windtunnel" in tracks)  # PROVENANCE.md; the cave is right-handed from the lower left
    markers, pixels = pd.read_csv(out / "markers.csv"), pd.read_csv(path)
    assert len(markers) == len(pixels)
    shown = np.any([markers[f"{name}_origin"] == "measured" for name in report["markers"]], axis=0)
    for name in report["markers"]:
        seen = pixels.filter(regex=f"^{name}_cam.*_X$").notna().sum(axis=1).to_numpy() >= 2
        origin, sd = markers[f"{name}_origin"].to_numpy(), markers[f"{name}_sd"].to_numpy()
        measured = np.flatnonzero(origin == "measured")
        assert seen[measured].all()
        if len(measured):
            inside = ~forgotten(shown)
            inside[: measured[0]] = inside[measured[-1] + 1 :] = False
            assert np.isfinite(sd[inside]).all()
            assert np.isin(origin[inside & ~seen], ["smoothed"]).all()
            assert np.isin(origin[forgotten(shown)], ["missing"]).all()
    assert [r.application_id for r in RrdReader(str(out / "recording.rrd")).recordings()] == ["mocap"]


@pytest.mark.rare
def test_pixels_without_any_noise_are_tracked():
    """Simulated cameras: a wrist that no camera shows for 16 frames is found to 3 mm, and is nowhere known exactly."""
    bat = with_markers(make_bat(seed=4, n_frames=60, n_cameras=4, digitiser=PERFECT), MARKERS)
    wrist, hidden = bat.truth.names.index("wrist_l"), slice(22, 38)
    uv = np.array(bat.pixels.uv_px)
    uv[:, hidden, wrist] = np.nan
    pixels = replace(bat.pixels, uv_px=uv)
    prepared = clean(of_pixels(pixels, bat.cameras, Skeleton(name="bat", markers=pixels.names), name="bat"))
    run, _ = run_job(prepared, validated=False)
    assert run.model == "mixture"
    markers = run.tracks
    miss = np.linalg.norm(markers.xyz_m[hidden, wrist] - bat.truth.xyz_m[hidden, wrist], axis=1)
    assert miss.max() < 0.003
    assert np.nanmin(markers.sd_m) > 1e-7
