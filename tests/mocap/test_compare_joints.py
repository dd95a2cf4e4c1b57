"""``mocap compare-joints``: joints of tracked runs compared, in degrees, whatever size and side the animal has."""

import json

import numpy as np
import pandas as pd
import pytest
import rerun as rr

from eal import fit_potential
from mocap.sides import without_side
from tests.swings import draw


@pytest.fixture
def rng():
    return np.random.default_rng(20240607)


def write_runs(folder, rng, *, count=5, posture=80.0, joints=("elbow_l", "elbow_r"), length_m=0.03, animals=None):
    """Runs as ``mocap track`` writes their potentials: the child in the plane of the limb, in units of its spread."""
    for i, trial in enumerate(draw(rng, count, posture=(posture, 3.0), reach=(40.0, 3.0), frames=120)):
        run = folder / (animals[i] if animals else "") / f"trial_{i}"
        (run / "potentials").mkdir(parents=True)
        for joint in joints:
            angle = np.radians(trial[:, 0])
            samples = length_m * np.column_stack([np.cos(angle), np.sin(angle)])
            scale = float(np.sqrt(samples.var(axis=0).sum()))
            fit_potential(samples / scale, units=(f"{scale:.6g} m",) * 2).save(run / "potentials" / f"{joint}.npz")
    return folder


def test_a_shift_in_degrees_is_found_whatever_the_size(mocap, rng, tmp_path):
    """Posture 80 and 100 degrees, forearms of 30 and 11 mm: the shift is 20 degrees, and all files are written."""
    a = write_runs(tmp_path / "a", rng)
    b = write_runs(tmp_path / "b", rng, posture=100.0, length_m=0.011)
    code, out, err = mocap("compare-joints", a, b, "--joint", "elbow", "--out", tmp_path / "out", "--json")
    assert code == 0, err
    found = json.loads(out)
    assert found["shift"][0] == pytest.approx(20.0, abs=6.0)
    assert found["shift_interval"][0][0] < 20.0 < found["shift_interval"][0][1]
    assert found["p_value"] == found["least_p"] == pytest.approx(2 / 252)
    assert found == json.loads((tmp_path / "out" / "report.json").read_text(encoding="utf-8"))
    _, told, _ = mocap("compare-joints", a, b, "--joint", "elbow")
    starts = [line.split(":")[0] for line in told.strip().splitlines()]
    assert starts == [
        "within these animals (their trials are permuted; to permute animals name them)",
        "within these animals, whose trials were permuted",
        "elbow angle",
        "for the methods section",
    ]  # each on a line of its own, none broken
    table = pd.read_csv(tmp_path / "out" / "difference.csv")
    assert set(table["differs"]) == {True, False}
    assert (np.sign(table.time_a - table.time_b)[table.differs & (table.angle_deg > 125)] == -1).all()
    assert (tmp_path / "out" / "comparison.png").stat().st_size > 10_000
    recording = rr.dataframe.load_recording(tmp_path / "out" / "recording.rrd") if hasattr(rr, "dataframe") else None
    assert recording is None or {"/groups", "/difference"} <= {c.entity_path for c in recording.schema()}
    assert (tmp_path / "out" / "recording.rrd").stat().st_size > 5_000


def test_angles_through_half_a_turn_do_not_jump(mocap, rng, tmp_path):
    """A joint about 180 degrees, where the arc tangent changes its sign."""
    a, b = write_runs(tmp_path / "a", rng, posture=170.0), write_runs(tmp_path / "b", rng, posture=185.0)
    code, out, err = mocap("compare-joints", a, b, "--joint", "elbow_l", "--json")
    assert code == 0, err
    assert json.loads(out)["shift"][0] == pytest.approx(15.0, abs=6.0)


def test_left_and_right_of_the_same_trials_are_pairs(mocap, rng, tmp_path):
    """Equal sides: their exchange changes nothing, so that p is 1."""
    a = write_runs(tmp_path / "a", rng, count=6)
    code, out, err = mocap("compare-joints", a, a, "--joint", "elbow_l,elbow_r")
    assert code == 0, err
    assert "no difference shown: p = 1 (64 splits of 6 and 6 sides of animals" in " ".join(out.split())


def test_what_cannot_be_judged_is_refused_in_one_line(mocap, rng, tmp_path):
    """Too few trials, animals that are too few, a joint that is not there, a folder without runs."""
    a, b = write_runs(tmp_path / "a", rng, animals=["x"] * 5), write_runs(tmp_path / "b", rng, animals=["y"] * 5)
    few = write_runs(tmp_path / "few", rng, count=2)
    for command, message in (
        ([few, few.parent / "few", "--joint", "elbow"], "2 and 2 sides of animals are too few to judge"),
        ([a, b, "--joint", "elbow", "--animals"], "1 and 1 animals are too few to judge"),
        ([a, b, "--joint", "knee"], "has no joint knee: `joint` is one of elbow_l, elbow_r"),
        ([a, tmp_path / "none", "--joint", "elbow"], "there is no such folder"),
        ([a, b, "--joint", "a,b,c"], "give one joint, or one for each group"),
    ):
        code, _, err = mocap("compare-joints", *command)
        assert code == 1
        assert message.replace("`joint`", "--joint") in err
        assert len(err.strip().splitlines()) == 1


def test_animals_are_told_by_folders(mocap, rng, tmp_path):
    """Two animals of four trials a side are two units: refused, and by trial called within these animals."""
    a = write_runs(tmp_path / "a", rng, count=8, animals=[*"xxxxyyyy"])
    b = write_runs(tmp_path / "b", rng, count=8, animals=[*"vvvvwwww"])
    code, _, err = mocap("compare-joints", a, b, "--joint", "elbow")
    assert code == 1
    assert "2 and 2 animals are too few to judge" in err
    assert "within these animals" in err
    code, out, err = mocap("compare-joints", a, b, "--joint", "elbow", "--trials")
    assert code == 0, err
    assert "within these animals, whose trials were permuted: " in " ".join(out.split())


def test_several_joints_are_one_table(mocap, rng, tmp_path):
    """``all`` is each joint of the runs; p of all is never below p alone."""
    a, b = write_runs(tmp_path / "a", rng), write_runs(tmp_path / "b", rng, posture=100.0)
    code, out, err = mocap("compare-joints", a, b, "--joint", "all", "--out", tmp_path / "out", "--json")
    assert code == 0, err
    assert set(json.loads(out)) == {"elbow_l", "elbow_r"}
    table = pd.read_csv(tmp_path / "out" / "joints.csv")
    assert (table.p_of_all >= table.p).all()
    assert (tmp_path / "out" / "elbow_l" / "comparison.png").is_file()


def test_sides_are_taken_out_of_names():
    assert [without_side(name) for name in ("elbow_l", "right_elbow", "leftKnee", "tail")] == [
        "elbow", "elbow", "Knee", "tail",
    ]  # fmt: skip
