"""What ``mocap data`` lists, makes and finds."""

import json

import pytest
from mocap.datasets.catalogue import ENTRIES, make
from mocap.datasets.real import real_path
from typer.testing import CliRunner

from mocap.cli.main import app
from mocap.errors import MocapError
from mocap.io.manifest import MANIFEST

SMALL = (
    "bat_wind_tunnel",
    "lizard_imperfect",
    "pendulum_planar_noisy",
    "pendulum_spherical",
    "wand_tunnel",
    "wand_tank",
)


@pytest.mark.parametrize("name", SMALL)
def test_an_entry_is_made_from_its_seed(name, tmp_path):
    """The same seed makes the same bytes, another seed others (but where nothing is drawn); a card says which seed."""
    make(name, tmp_path / "a", seed=3)
    make(name, tmp_path / "new" / "b", seed=3)
    make(name, tmp_path / "c", seed=4)
    files = sorted(path.name for path in (tmp_path / "a").iterdir())
    assert files == sorted(path.name for path in (tmp_path / "new" / "b").iterdir())
    same = {f: (tmp_path / "a" / f).read_bytes() == (tmp_path / "new" / "b" / f).read_bytes() for f in files}
    assert all(same.values())
    (card,) = (tmp_path / "a").glob("*card.json")
    assert json.loads(card.read_text())["seed"] == 3
    changed = [f for f in files if (tmp_path / "a" / f).read_bytes() != (tmp_path / "c" / f).read_bytes()]
    assert len(changed) >= (1 if name == "pendulum_spherical" else 2)
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []
    assert json.loads((tmp_path / "a" / MANIFEST).read_text())["results"].keys() == {name}


def test_nothing_is_overwritten_and_nothing_half_made(tmp_path, monkeypatch):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("mine")
    with pytest.raises(MocapError, match="full exists and contains other files"):
        make("pendulum_planar", tmp_path / "full")
    assert [path.name for path in (tmp_path / "full").iterdir()] == ["mine.txt"]
    with pytest.raises(MocapError, match="'bats' cannot be made; what can: bat, bat_30"):
        make("bats", tmp_path / "x")

    def fail(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("mocap.datasets.catalogue.write_pendulum", fail)
    with pytest.raises(MocapError, match="cannot be written: No space left"):
        make("pendulum_planar", tmp_path / "x")
    assert [path.name for path in tmp_path.iterdir()] == ["full"]


def test_the_command_lists_makes_and_finds(tmp_path, monkeypatch):
    run = CliRunner().invoke
    listed = json.loads(run(app, ["data", "list", "--json"]).stdout)
    assert list(listed["make"]) == [entry.name for entry in ENTRIES]
    assert len(set(listed["make"])) == len(ENTRIES)
    assert run(app, ["data", "make", "pendulum_planar", "--out", str(tmp_path / "p")]).exit_code == 0
    assert (tmp_path / "p" / "samples.csv").exists()
    monkeypatch.setenv("MOCAP_REAL_DATA", str(tmp_path))
    (tmp_path / "snake_gap_vicon").mkdir()
    assert run(app, ["data", "path", "snake_gap_vicon"]).stdout.strip() == str(tmp_path / "snake_gap_vicon")
    with pytest.raises(
        MocapError,
        match=r"mouse_mocap_qtm: this recording is not there: get it from "
        r"https://github\.com/nRIM",
    ):
        real_path("mouse_mocap_qtm")
    with pytest.raises(MocapError, match="no real recording is called 'cat'"):
        real_path("cat")
