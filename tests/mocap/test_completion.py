"""What a shell offers after Tab, asked as bash asks: the words typed so far, and which of them is being typed."""

import shlex
from pathlib import Path

import numpy as np
import pytest
from openpyxl import Workbook

from mocap.cli.main import main
from mocap.tracking.track_part import MODELS

pytestmark = pytest.mark.quick


@pytest.fixture
def offered(monkeypatch, capsys):
    """What is offered for a line whose last word is being typed; a space at the end begins a new one."""

    def ask(line: str) -> list[str]:
        words = shlex.split(line)
        monkeypatch.setenv("_MOCAP_COMPLETE", "complete_bash")
        monkeypatch.setenv("COMP_WORDS", line)
        monkeypatch.setenv("COMP_CWORD", str(len(words) if line.endswith(" ") else len(words) - 1))
        monkeypatch.setattr("sys.argv", ["mocap"])
        with pytest.raises(SystemExit) as stopped:
            main()
        assert stopped.value.code == 0
        return capsys.readouterr().out.split()

    return ask


def test_commands_options_and_animals(offered):
    """Those that begin as what is typed; the animals of the demo and of simulated recordings."""
    assert set(offered("mocap tr")) == {"track", "triangulate"}
    assert offered("mocap track a.csv --pixel") == ["--pixel-sd"]
    assert offered("mocap demo ") == ["bat", "lizard"]
    assert {"bat", "lizard", "wand_tank"} <= set(offered("mocap data make "))
    assert offered("mocap help insta") == ["installing"]
    assert {"xlsx", "osim"} <= set(offered("mocap kinematics out --export "))
    assert offered("mocap track a.csv --format deeplabcut") == ["deeplabcut-csv", "deeplabcut-h5"]


def test_models_by_name_and_files_of_them(offered, tmp_path, monkeypatch):
    """Names that the program knows, then files of this folder."""
    monkeypatch.chdir(tmp_path)
    Path("bats.npz").touch()
    assert offered("mocap track a.csv --model ") == [*MODELS, "bats.npz"]
    assert offered("mocap track a.csv --model ba") == ["bats.npz"]


def test_joints_of_results_at_any_depth_and_of_a_stated_skeleton(offered, tmp_path, monkeypatch):
    """A group of runs is a folder of folders; after a comma comes the joint of the other group."""
    monkeypatch.chdir(tmp_path)
    run = Path("before/trial_1")
    run.mkdir(parents=True)
    run.joinpath("skeleton.toml").write_text('[joints]\nelbow_l = "a"\nelbow_r = "b"\nwrist_l = "c"\n')
    assert offered("mocap compare-joints before after --joint elbow") == ["elbow_l", "elbow_r"]
    assert offered("mocap compare-joints before after --joint elbow_l,elbow") == ["elbow_l,elbow_l", "elbow_l,elbow_r"]
    assert offered("mocap design-joint before/trial_1 --joint w") == ["wrist_l"]
    Path("other.toml").write_text('[joints]\nknee = "a"\n')
    assert offered("mocap design-joint before/trial_1 --skeleton other.toml --joint ") == ["knee"]


def test_markers_of_a_model(offered, tmp_path, monkeypatch):
    """A model has no joints but markers, of which three are named, each once."""
    monkeypatch.chdir(tmp_path)
    np.savez("bats.npz", names=np.array(["shoulder", "elbow", "wrist"]))
    assert offered("mocap design-joint bats.npz --joint shoulder,") == ["shoulder,elbow", "shoulder,wrist"]


def test_tabs_of_a_workbook(offered, tmp_path, monkeypatch):
    """By their names."""
    monkeypatch.chdir(tmp_path)
    book = Workbook()
    book.create_sheet("flight_2")
    book.save("points.xlsx")
    assert offered("mocap track points.xlsx --sheet ") == ["Sheet", "flight_2"]


def test_what_cannot_be_read_offers_nothing(offered, tmp_path, monkeypatch):
    """No error appears at the prompt, whatever lies there."""
    monkeypatch.chdir(tmp_path)
    for name in ("broken.npz", "broken.xlsx", "broken.toml"):
        Path(name).write_bytes(b"\xff\x00 = [")
    assert offered("mocap design-joint broken.npz --joint ") == []
    assert offered("mocap track broken.xlsx --sheet ") == []
    assert offered("mocap design-joint nowhere --skeleton broken.toml --joint ") == []
