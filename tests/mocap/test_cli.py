"""The command line: what scripts rely on, and what people are told when something is wrong."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from mocap.datasets import make_bat, write_recording

from mocap.cli.main import main
from mocap.io.dltdv import read_points
from mocap.io.manifest import MANIFEST
from tests.mocap.recordings import with_markers
from tests.real_data import real

FPS = 240.0
MARKERS = ("snout", "head", "ear_l", "ear_r", "sternum", "back", "pelvis", *(
    f"{joint}_{side}" for joint in ("shoulder", "elbow", "wrist", "ankle") for side in "lr"
))  # fmt: skip


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    bat = with_markers(make_bat(seed=3, n_frames=60, n_cameras=4), MARKERS)
    return write_recording(bat, tmp_path_factory.mktemp("bat"))


def track_arguments(files, out, **changed) -> list:
    given = {"dlt": files["coefficients"], "profile": files["profile"], "skeleton": files["skeleton"], "fps": FPS}
    given.update(changed)
    options = [x for key, value in given.items() if value is not None for x in (f"--{key}", value)]
    return ["track", changed.pop("tracks", files["pixels"]), *options, "--out", out]


QUICK = ("--model", "constant_velocity", "--no-validate")
"""The quickest way to a folder that is written: where the law is not how well gaps are filled."""


@pytest.fixture(scope="module")
def out(files, tmp_path_factory):
    """The folder that the command writes."""
    folder = tmp_path_factory.mktemp("tracked") / "run"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["mocap", *map(str, track_arguments(files, folder)), "--no-validate"])
        with pytest.raises(SystemExit) as stopped:
            main()
    assert not stopped.value.code
    return folder


def test_track_writes_all_that_scripts_rely_on(files, out):
    """One row a frame from 1; x, y, z, sd, origin a marker; filled samples are marked and have a finite deviation."""
    assert {p.name for p in out.iterdir()} == {
        "markers.csv", "markers.nc", "joints.csv", "recording.nc", "kinematics.csv", "kinematics.nc",
        "cycles.csv", "angles.csv", "peaks.csv", "figures", "report.html", "report.json", "report.md", "skeleton.toml",
        "recording.rrd", "potentials", "spatial_potentials", MANIFEST,
    }  # fmt: skip
    markers = pd.read_csv(out / "markers.csv")
    pixels = pd.read_csv(files["pixels"])
    names = list(dict.fromkeys(c.rsplit("_cam", 1)[0] for c in pixels.columns))
    fields = [f"{name}_{field}" for name in names for field in ("x", "y", "z", "sd", "origin")]
    assert list(markers.columns) == ["frame", "t_s", *fields]
    np.testing.assert_array_equal(markers["frame"], np.arange(1, 61))
    np.testing.assert_allclose(markers["t_s"], np.arange(60) / FPS, atol=1e-9)
    seen = np.stack(
        [pixels.filter(regex=f"^{name}_cam.*_X$").notna().sum(axis=1).to_numpy() >= 2 for name in names], axis=1
    )
    origin = np.stack([markers[f"{name}_origin"] for name in names], axis=1)
    sd = np.stack([markers[f"{name}_sd"] for name in names], axis=1)
    assert not (origin[~seen] == "measured").any()
    first, last = np.argmax(seen, axis=0), len(seen) - 1 - np.argmax(seen[::-1], axis=0)
    index = np.arange(len(seen))[:, None]
    inside = ~seen & (index > first) & (index < last)
    assert inside.sum() > 10
    assert np.isin(origin[inside], ["smoothed"]).all()
    assert np.isfinite(sd[inside]).all()
    report = json.loads((out / "report.json").read_text())
    assert {"frames", "markers", "samples", "rejected", "residual_px", "innovation", "seconds", "findings"} <= set(
        report
    )
    assert (report["filled"], report["extrapolated"]) == ((origin == "smoothed").sum(), (origin == "predicted").sum())
    joints = pd.read_csv(out / "joints.csv")
    assert {"elbow_l_world_z", "elbow_l_body_x", "elbow_l_plane_y", "elbow_l_limb_x", "elbow_l_sd"} <= set(
        joints.columns
    )


def test_elbow_coordinates_are_those_of_the_markers(out):
    """In the limb's own plane the child keeps its distance from the centre: x^2 + y^2 = |wrist - elbow|^2."""
    markers, joints = pd.read_csv(out / "markers.csv"), pd.read_csv(out / "joints.csv")
    apart = sum((markers[f"wrist_l_{k}"] - markers[f"elbow_l_{k}"]) ** 2 for k in "xyz") ** 0.5
    in_plane = np.hypot(joints["elbow_l_limb_x"], joints["elbow_l_limb_y"])
    np.testing.assert_allclose(in_plane, apart, atol=3e-7)  # seven decimals are printed


@pytest.mark.quick
def test_triangulate_writes_what_dltdv_would(mocap, files, tmp_path):
    """Header of xyzpts, a row a frame, six decimals; --refine adds deviations; --json is one object."""
    out = tmp_path / "a_xyzpts.csv"
    base = ["triangulate", files["pixels"], "--dlt", files["coefficients"], "--profile", files["profile"]]
    code, stdout, _ = mocap(*base, "--out", out, "--json")
    assert code == 0
    summary = json.loads(stdout)
    tracks = read_points(out, fps=FPS)
    assert summary["points"] == tracks.seen.sum()
    assert out.read_text().splitlines()[0].startswith("snout_X,snout_Y,snout_Z,head_X")
    code, _, _ = mocap(*base, "--out", tmp_path / "b.csv", "--refine")
    assert code == 0
    refined = read_points(tmp_path / "b.csv", fps=FPS)
    assert np.isfinite(refined.sd_m[refined.seen]).all()


def test_positions_alone_can_be_tracked(mocap, files, tmp_path):
    """Without cameras the tracker takes the points; gaps are filled and marked all the same."""
    xyz = tmp_path / "bat_xyzpts.csv"
    base = ["triangulate", files["pixels"], "--dlt", files["coefficients"], "--profile", files["profile"]]
    assert mocap(*base, "--out", xyz)[0] == 0
    out = tmp_path / "run"
    code, _, err = mocap("track", xyz, "--fps", FPS, "--skeleton", files["skeleton"], "--out", out, *QUICK)
    assert code == 0, err
    report = json.loads((out / "report.json").read_text())
    assert report["cameras"] == []
    assert report["filled"] > 0


def edited(path: Path, folder: Path, change) -> Path:
    """A copy of a text file with its lines changed."""
    copy = folder / path.name
    copy.write_text("\n".join(change(path.read_text().splitlines())) + "\n")
    return copy


def without_last_column(lines):
    return [line.rsplit(",", 1)[0] for line in lines]


def with_word(lines):
    return [*lines[:5], lines[5].replace(lines[5].split(",")[3], "twelve", 1), *lines[6:]]


def nothing_seen(lines):
    return [lines[0], *(",".join(["NaN"] * (line.count(",") + 1)) for line in lines[1:])]


def twice_the_same_name(lines):
    return [lines[0].replace("head_cam", "snout_cam"), *lines[1:]]


@pytest.mark.quick
@pytest.mark.parametrize(
    ("change", "said"),
    [
        (without_last_column, "ankle_r"),
        (with_word, "'twelve' is not a number"),
        (nothing_seen, "no marker is ever seen"),
        (twice_the_same_name, "appears twice"),
        (lambda _: [], "empty"),
        (lambda lines: [*lines[:40], lines[40][: len(lines[40]) // 2]], "cut"),
    ],
)  # fmt: skip
def test_a_broken_pixel_file_is_named_in_one_line(mocap, files, tmp_path, change, said):
    """Exit code 1, one line on stderr that names the file and the trouble; no output, input untouched."""
    broken = edited(files["pixels"], tmp_path, change)
    before = broken.read_bytes()
    out = tmp_path / "run"
    code, stdout, err = mocap(*track_arguments({**files, "pixels": broken}, out))
    assert code == 1
    assert stdout == ""
    assert len(err.strip().splitlines()) == 1
    assert said in err
    assert broken.name in err
    assert {p.name for p in tmp_path.iterdir()} == {broken.name}
    assert broken.read_bytes() == before


@pytest.mark.parametrize("command", ["track", "triangulate"])
def test_coefficients_of_another_rig(mocap, files, tmp_path, command):
    """The two numbers of cameras are named."""
    other = edited(files["coefficients"], tmp_path, without_last_column)
    code, _, err = mocap(command, files["pixels"], "--dlt", other, "--out", tmp_path / "x", *_fps(command))
    assert code == 1
    assert "4 cameras" in err
    assert "3" in err


def _fps(command: str) -> list:
    return ["--fps", FPS] if command == "track" else []


def test_unknown_marker_in_the_skeleton(mocap, files, tmp_path):
    """The marker is named, and what to do."""
    wrong = tmp_path / "bat.toml"
    wrong.write_text(files["skeleton"].read_text().replace('"snout"', '"nose"'))
    code, _, err = mocap(*track_arguments(files, tmp_path / "run", skeleton=wrong))
    assert code == 1
    assert "'nose'" in err
    assert "[aliases]" in err


def test_one_marker_never_seen_is_a_finding(mocap, files, tmp_path):
    """It stays empty and is reported; the others are tracked."""
    table = pd.read_csv(files["pixels"])
    table[[c for c in table.columns if c.startswith("ear_l_")]] = np.nan
    pixels = tmp_path / "bat_xypts.csv"
    table.to_csv(pixels, index=False, na_rep="NaN", float_format="%.6f")
    out = tmp_path / "run"
    code, _, err = mocap(*track_arguments({**files, "pixels": pixels}, out), *QUICK)
    assert code == 0, err
    assert any("never seen" in f and "ear_l" in f for f in json.loads((out / "report.json").read_text())["findings"])
    markers = pd.read_csv(out / "markers.csv")
    assert markers["ear_l_x"].isna().all()
    assert (markers["ear_l_origin"] == "missing").all()
    assert markers["ear_r_x"].notna().any()


@pytest.mark.quick
def test_what_exists_is_not_replaced_unasked(mocap, files, tmp_path):
    """A folder that exists stops the command before any work; --force replaces a run and loses nothing else."""
    out = tmp_path / "run"
    out.mkdir()
    (out / "mine.txt").write_text("precious")
    code, _, err = mocap(*track_arguments(files, out))
    assert code == 1
    assert "--force" in err
    assert (out / "mine.txt").read_text() == "precious"
    assert mocap(*track_arguments(files, out), *QUICK, "--force")[0] == 0
    assert (out / "markers.csv").exists()
    assert (out / "mine.txt").read_text() == "precious"
    assert {p.name for p in tmp_path.iterdir()} == {"run"}


def test_the_input_is_never_written_over(mocap, files, tmp_path):
    """Not even with --force: neither a file that is read, nor a folder that holds one."""
    copies = {key: tmp_path / path.name for key, path in files.items()}
    for key, path in files.items():
        copies[key].write_bytes(path.read_bytes())
    before = {path: path.read_bytes() for path in copies.values()}
    for out in (copies["pixels"], copies["coefficients"], tmp_path):
        code, _, err = mocap(*track_arguments(copies, out), "--no-validate", "--force")
        assert code == 1
        assert "read from" in err
        code, _, err = mocap("triangulate", copies["pixels"], "--dlt", copies["coefficients"], "--out", out, "--force")
        assert code == 1
    assert {path: path.read_bytes() for path in copies.values()} == before
    assert set(tmp_path.iterdir()) == set(before)


def test_our_own_refined_points_are_not_audited(mocap, files, tmp_path):
    """Points beside the pixels that have deviations are ours, and rightly differ from DLTdv's."""
    pixels = tmp_path / "a_xypts.csv"
    pixels.write_bytes(files["pixels"].read_bytes())
    base = ["triangulate", pixels, "--dlt", files["coefficients"], "--profile", files["profile"]]
    for _ in range(2):
        code, _, err = mocap(*base, "--refine", "--out", tmp_path / "a_xyzpts.csv", "--force")
        assert code == 0, err
        assert "stored points" not in err


def test_a_recording_in_which_nothing_moves(mocap, files, tmp_path):
    """A frame held still has no motion to learn: it is tracked with constant velocity, and the report says why."""
    table = pd.read_csv(files["pixels"])
    still = tmp_path / "still_xypts.csv"
    pd.concat([table.iloc[[40]]] * 60).to_csv(still, index=False, na_rep="NaN", float_format="%.6f")
    out = tmp_path / "run"
    code, _, err = mocap(*track_arguments({**files, "pixels": still}, out))
    assert code == 0, err
    model = json.loads((out / "report.json").read_text())["model"]
    assert model["name"] == "constant_velocity"
    assert "no marker moves" in model["why"]


def test_a_failure_while_writing_leaves_nothing(mocap, files, tmp_path, monkeypatch):
    """The files are written to a hidden folder, which goes away with the failure; one line says why."""

    def fail(*_):
        raise OSError("the disk is full")

    monkeypatch.setattr("mocap.results.tables.write_joints", fail)
    code, _, err = mocap(*track_arguments(files, tmp_path / "run"), *QUICK)
    assert code == 1
    assert "the disk is full; nothing there was changed" in err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.quick
def test_view_of_nothing(mocap, tmp_path):
    """It says what a run is."""
    code, _, err = mocap("view", tmp_path)
    assert code == 1
    assert "mocap track" in err


@pytest.mark.quick
def test_wrong_usage_is_exit_code_2(mocap):
    """As everywhere."""
    assert mocap("track")[0] == 2
    assert mocap("fly")[0] == 2


def test_it_is_a_program():
    """The installed command answers."""
    done = subprocess.run(
        [Path(sys.executable).with_name("mocap"), "--help"], capture_output=True, text=True, check=True
    )
    assert all(command in done.stdout for command in ("triangulate", "track", "demo", "view"))


def test_figures_of_the_paper(mocap, tmp_path, monkeypatch):
    """A picture, a table and verdicts for each figure that is asked for; others are named."""
    monkeypatch.delenv("MOCAP_REAL_DATA", raising=False)
    code, _, err = mocap("reproduce", "7", "--quick", "--out", tmp_path / "figures")
    assert code == 0, err
    assert {p.name for p in (tmp_path / "figures").iterdir()} == {
        "fig7.png", "fig7.csv", "figures.md", "verdicts.json", MANIFEST,
    }  # fmt: skip
    assert list(pd.read_csv(tmp_path / "figures" / "fig7.csv").columns) == ["q2", "q1", "value"]
    assert "the samples are a valley" in err
    code, _, err = mocap("reproduce", "99", "--out", tmp_path / "none")
    assert code == 1
    assert "14a" in err


@pytest.mark.rare
def test_figure_7_is_drawn_for_a_real_bat_too(mocap, tmp_path):
    """Where the recording lies, its elbow gives a potential of its own."""
    folder = real("bat_windtunnel_dltdv8").parent
    code, _, err = mocap("reproduce", "7", "--quick", "--real", folder, "--out", tmp_path / "figures")
    assert code == 0, err
    verdicts = json.loads((tmp_path / "figures" / "verdicts.json").read_text())
    assert {v["figure"] for v in verdicts} == {"7", "7_real"}
    assert all(v["holds"] for v in verdicts)
