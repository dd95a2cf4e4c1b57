"""Result folders that came from elsewhere: what their manifests say is believed of files inside them only."""

import json
import os
import sys

import pytest

from benchmarks.attack.foreign import CASES, KNOWN, SHA256, STAGE, attacked
from mocap.errors import OutputError
from mocap.io import manifest as manifests
from mocap.io.manifest import MANIFEST, current_files
from mocap.io.output import result_file, result_folder

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="links and pipes of POSIX")


REFUSED = ("hidden folder:", "staged:", "target:", "manifest:")
"""Cases of what is no manifest, or no result of ours."""


@pytest.mark.parametrize(("case", "one_file"), [(case, k % 2 == 0) for k, case in enumerate(CASES)])
def test_nothing_outside_is_touched(tmp_path, case, one_file):
    """A folder beside stays as it is to the last byte and time, whatever a manifest asks; errors are one line.

    What is no manifest or no result of ours is refused, and nothing is moved into the folder.
    """
    refused = case.startswith(REFUSED) and case != "manifest: many files"
    assert attacked(CASES[case], tmp_path, one_file=one_file) in ("refused", "written")[: 1 + (not refused)]
    assert not refused or not os.path.lexists(tmp_path / "dl" / "LICENSE")


def test_a_link_that_comes_while_files_are_moved_is_not_followed(tmp_path, monkeypatch):
    """The folder is opened once, without following links; who puts a link in its place meanwhile is too late."""
    folder, victim = tmp_path / "dl", tmp_path / "victim"
    victim.mkdir()
    real = os.replace

    def swaps(source, target, **at):
        if str(target) == "new":
            (folder / "sub").rename(folder / "moved")
            (folder / "sub").symlink_to(victim)
        real(source, target, **at)

    monkeypatch.setattr(manifests.os, "replace", swaps)
    with result_folder(folder, "track") as stage:
        (stage / "sub").mkdir()
        (stage / "sub" / "new").write_bytes(KNOWN)
    assert not list(victim.iterdir())
    assert (folder / "moved" / "new").read_bytes() == KNOWN


def test_a_pending_result_of_ours_is_still_finished(tmp_path):
    """The same manifest with the right file in the right hidden folder: it goes to its place, what it replaces goes."""
    (tmp_path / STAGE / "sub").mkdir(parents=True)
    (tmp_path / STAGE / "sub" / "a").write_bytes(KNOWN)
    (tmp_path / "old").write_bytes(KNOWN)
    new = {"files": {"sub/a": SHA256}, "folders": ["sub"]}
    pending = {"name": "x", "stage": STAGE, "new": new, "replaces": {"old": SHA256}}
    (tmp_path / MANIFEST).write_text(json.dumps({"results": {}, "pending": pending}))
    assert [p.relative_to(tmp_path).as_posix() for p in current_files(tmp_path).values()] == [f"{STAGE}/sub/a"]
    with result_file(tmp_path / "o.trc") as file:
        file.write_text("new")
    assert (tmp_path / "sub" / "a").read_bytes() == KNOWN
    assert not (tmp_path / "old").exists()


def test_a_linked_folder_of_the_user_is_fine_and_a_linked_one_below_it_is_not(tmp_path):
    """Where a result goes is the user's choice; what leads out of there is not."""
    (tmp_path / "real").mkdir()
    (tmp_path / "out").symlink_to(tmp_path / "real")
    (tmp_path / "disk").mkdir()
    (tmp_path / "real" / "figures").symlink_to(tmp_path / "disk")

    def write(file):
        with result_folder(tmp_path / "out", "track", replace=True) as stage:
            (stage / file).parent.mkdir(exist_ok=True)
            (stage / file).write_text("new")

    write("a.csv")
    with pytest.raises(OutputError, match=r"figures is a link.*put a folder in its place"):
        write("figures/a.png")
    assert (tmp_path / "real" / "a.csv").read_text() == "new"
    assert not list((tmp_path / "disk").iterdir())


@pytest.mark.parametrize("name", ["a\\b.trc", "C:a.trc", "a.trc."])
def test_no_file_is_written_that_could_not_be_found_again(tmp_path, name):
    """Names that a manifest may not have are refused when they are written."""
    with pytest.raises(OutputError, match="choose another name"), result_file(tmp_path / name) as file:
        file.write_text("new")
    assert not list(tmp_path.iterdir())
