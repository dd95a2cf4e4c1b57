"""``mocap mobility``: what share of all rotations a joint between bodies visits over tracked runs."""

import json

import numpy as np
import pytest

import mocap as package
from mocap.measures import JointAxes, Measures
from tests.filters.bodies_trials import two_bodies
from tests.mocap.kinematics.body_motions import NAMES, skeleton

LINES = JointAxes(parent=(("p0", "p1"), ("p0", "p2")), child=(("c0", "c1"), ("c0", "c2")), sequence="zyx")


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Four runs of one pair of bodies, half of whose child's markers are hidden for ten frames."""
    folder = tmp_path_factory.mktemp("runs")
    places = two_bodies(seed=0, n_frames=10).places_m
    stated = skeleton(NAMES, 5, 5, measures=Measures(axes={"jaw": LINES}))
    on = np.repeat([0, 1], 5)
    for seed in range(4):
        made = two_bodies(seed=seed, n_frames=80)
        xyz = np.einsum("tmij,tmj->tmi", made.rotation[:, on], np.broadcast_to(places, (80, 10, 3)))
        xyz = xyz + made.joint_m[:, None] + 1e-4 * np.random.default_rng(seed).normal(size=xyz.shape)
        xyz[30:40, 7:] = np.nan
        recording = package.from_arrays(xyz, names=NAMES, fps=100.0, unit="m", skeleton=stated, name=f"trial {seed}")
        package.track(recording, validate=False).save(folder / f"trial_{seed}")
    return folder


def test_a_joint_between_bodies(runs, mocap, tmp_path):
    """Angles of 20 degrees about each axis are a few thousandths of all rotations; files and library agree."""
    out = tmp_path / "out"
    code, told, err = mocap("mobility", runs, "--joint", "jaw", "--out", out, "--json")
    assert code == 0, err
    found = json.loads(told)
    assert found == json.loads((out / "mobility.json").read_text(encoding="utf-8"))
    assert 1e-4 < found["share_low"] < found["share"] < min(found["share_high"], 0.05)
    assert found["trials"] == 4
    assert 10 / 80 <= found["hidden"] <= 0.2  # what the tracker refuses counts as hidden, too
    assert [one["angle"] for one in found["ranges"]] == ["rotation_z", "rotation_y", "rotation_x"]
    assert not found["note"]
    assert (out / "mobility.png").stat().st_size > 10_000
    assert (out / "recording.rrd").stat().st_size > 5_000
    again = package.mobility([package.load(run) for run in sorted(runs.iterdir())], joint="jaw")
    assert again.found.share == pytest.approx(found["share"])
    code, told, _ = mocap("mobility", runs, "--joint", "jaw", "--within-mm", "30")
    assert code == 0
    assert told.startswith("jaw: visits ")
    assert "% of all rotations and translations within 30 (" in told


def test_what_has_no_mobility_is_refused_in_one_line(runs, mocap, tmp_path):
    for command, message in (
        ((tmp_path, "--joint", "jaw"), "holds no run"),
        ((runs, "--joint", "knee"), "has no three angles: name a joint between two bodies"),
        ((runs / "trial_0", "--joint", "jaw"), "needs 4 trials at least, but there are 1"),
    ):
        code, _, err = mocap("mobility", *command)
        assert code == 1
        assert message in " ".join(err.split())
