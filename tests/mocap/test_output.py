"""Results on disk: whole or as before, whatever comes between, and no file of anybody else touched."""

import errno
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from mocap.errors import OutputError
from mocap.io import output
from mocap.io.manifest import MANIFEST, PARTIAL, current, current_files
from mocap.io.output import result_file, result_folder


def write(folder: Path, files: dict[str, str], **options) -> None:
    """A result of these files."""
    with result_folder(folder, "track", **options) as stage:
        for name, text in files.items():
            (stage / name).parent.mkdir(parents=True, exist_ok=True)
            (stage / name).write_text(text)


def texts(folder: Path) -> dict[str, str]:
    """All files below a folder but the manifest."""
    found = (p for p in sorted(folder.rglob("*")) if p.is_file() and p.name != MANIFEST)
    return {p.relative_to(folder).as_posix(): p.read_text() for p in found}


def test_a_result_appears_and_the_next_replaces_it_and_nothing_else(tmp_path):
    """Files of the earlier result that the new one lacks go, with the folders made for them; foreign files stay."""
    out = tmp_path / "a" / "b"
    write(out, {"x.csv": "1", "potentials/l.npz": "2", "potentials/r.npz": "3"})
    assert texts(out) == {"x.csv": "1", "potentials/l.npz": "2", "potentials/r.npz": "3"}
    (out / "notes.txt").write_text("mine")
    (out / "sub").mkdir()
    (out / "sub" / "more.txt").write_text("mine too")
    with pytest.raises(OutputError, match="`overwrite` to replace the earlier result"):
        write(out, {"x.csv": "9"})
    write(out, {"x.csv": "4", "y.csv": "5"}, replace=True)
    assert texts(out) == {"x.csv": "4", "y.csv": "5", "notes.txt": "mine", "sub/more.txt": "mine too"}
    assert not (out / "potentials").exists()
    assert sorted(path.name for path in out.iterdir()) == [MANIFEST, "notes.txt", "sub", "x.csv", "y.csv"]


def test_a_folder_with_other_files_is_written_beside_only_when_asked(tmp_path):
    """An empty one is free."""
    other = tmp_path / "thesis"
    other.mkdir()
    write(tmp_path / "empty", {"x": "1"})
    (other / "thesis.tex").write_text("years")
    with pytest.raises(OutputError, match="contains other files"):
        write(other, {"x": "1"})
    write(other, {"x": "1"}, replace=True)
    write(other, {"x": "2"}, replace=True, beside=True)
    assert texts(other) == {"thesis.tex": "years", "x": "2"}


@pytest.mark.parametrize("change", ["foreign", "edited", "link", "folder"])
def test_a_file_that_is_not_ours_is_never_replaced(tmp_path, change):
    """Neither one that was there, nor one of ours that somebody edited, nor a link or folder; the rest stays too."""
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    elsewhere.write_text("far")
    write(out, {"x": "1", "y": "1"})
    if change == "edited":
        (out / "y").write_text("corrected by hand")
    else:
        (out / "y").unlink()
        manifest = json.loads((out / MANIFEST).read_text())
        del manifest["results"]["track"]["files"]["y"]
        (out / MANIFEST).write_text(json.dumps(manifest))
        if change == "foreign":
            (out / "y").write_text("1")
        elif change == "link":
            (out / "y").symlink_to(elsewhere)
        else:
            (out / "y").mkdir()
    before = texts(out)
    with pytest.raises(OutputError, match=r"out/y was (not written by mocap|changed after mocap wrote it)"):
        write(out, {"x": "2", "y": "2"}, replace=True)
    assert texts(out) == before
    assert elsewhere.read_text() == "far"
    assert not list(out.glob(f"{PARTIAL}*"))


def test_a_file_edited_by_hand_stays_when_the_new_result_has_none_of_that_name(tmp_path):
    """It is not ours any more."""
    write(tmp_path / "o", {"x": "1", "y": "1"})
    (tmp_path / "o" / "y").write_text("corrected")
    write(tmp_path / "o", {"x": "2"}, replace=True)
    assert texts(tmp_path / "o") == {"x": "2", "y": "corrected"}


def test_results_of_two_commands_in_one_folder(tmp_path):
    """Each is replaced alone; files that the other has are refused, or one of the two would be a mixture."""
    with result_folder(tmp_path, "calibration") as stage:
        (stage / "report.md").write_text("cameras")
    with pytest.raises(OutputError, match="belongs to the result of another command"):
        write(tmp_path, {"report.md": "tracks"}, replace=True)
    write(tmp_path, {"markers.csv": "1"}, beside=True)
    write(tmp_path, {"markers.csv": "2"}, replace=True)
    assert texts(tmp_path) == {"report.md": "cameras", "markers.csv": "2"}


def test_links_to_folders_and_files_are_followed_and_stay(tmp_path):
    """A result goes where the link leads."""
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "real")
    for text in "12":
        write(tmp_path / "link", {"x": text}, replace=True)
    assert (tmp_path / "link").is_symlink()
    assert texts(tmp_path / "real") == {"x": "2"}
    (tmp_path / "m.npz").symlink_to(tmp_path / "real" / "m.npz")
    for text in "12":
        with result_file(tmp_path / "m.npz", replace=True) as file:
            file.write_text(text)
    assert (tmp_path / "m.npz").is_symlink()
    assert (tmp_path / "real" / "m.npz").read_text() == "2"


def test_a_file_replaces_its_own_earlier_one_only(tmp_path):
    """A foreign one stays whatever is asked; a set of files appears as one."""
    path = tmp_path / "new" / "a_xypts.csv"
    with result_file(path) as file:
        file.write_text("1")
        file.with_name("a_offsets.csv").write_text("0")
    with pytest.raises(OutputError, match="give `overwrite` to replace it"), result_file(path):
        pass
    with result_file(path, replace=True) as file:
        file.write_text("2")
    assert texts(path.parent) == {"a_xypts.csv": "2"}
    raw = path.with_name("raw.csv")
    raw.write_text("months of clicks")
    with pytest.raises(OutputError, match="was not written by mocap"), result_file(raw, replace=True):
        pass
    assert raw.read_text() == "months of clicks"


def test_what_is_read_is_never_written(tmp_path):
    """Not by its own name, and not by that of a further file of a set."""
    path = tmp_path / "a_xypts.csv"
    with result_file(path) as file:
        file.write_text("1")
    with pytest.raises(OutputError, match="read from"), result_file(path, replace=True, inputs=[path]):
        pass

    def set_over_input():
        with result_file(tmp_path / "b", replace=True, inputs=[path, None]) as file:
            file.with_name(path.name).write_text("2")

    with pytest.raises(OutputError, match="read from"):
        set_over_input()
    assert path.read_text() == "1"


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError, OSError(errno.ENOSPC, "No space left on device")])
def test_an_error_leaves_the_earlier_result_and_no_trace(tmp_path, error):
    """A folder that was made for it goes, too; an error of the system becomes one line that says what was kept."""
    write(tmp_path / "old", {"x": "1"})

    def fail(folder):
        with result_folder(folder, "track", replace=True) as stage:
            (stage / "x").write_text("half")
            raise error

    expected = OutputError if isinstance(error, OSError) else error
    for folder in (tmp_path / "old", tmp_path / "new" / "deep"):
        with pytest.raises(expected) as caught:
            fail(folder)
        if error is KeyboardInterrupt:
            assert "is as it was before" in caught.value.kept
    assert texts(tmp_path) == {"old/x": "1"}
    assert sorted(path.name for path in tmp_path.rglob("*")) == [MANIFEST, "old", "x"]


def test_two_runs_into_one_folder(tmp_path):
    """The second one is told; the lock ends with its holder, whatever becomes of it."""
    code = (
        "import sys; from pathlib import Path; from mocap.io.output import result_folder\n"
        "with result_folder(Path(sys.argv[1]), 'track', replace=True) as stage:\n"
        "    (stage / 'x').write_text('half'); print('in', flush=True); sys.stdin.read()\n"
    )
    out = tmp_path / "out"
    write(out, {"x": "1"})
    pipe = subprocess.PIPE
    other = subprocess.Popen([sys.executable, "-c", code, str(out)], stdin=pipe, stdout=pipe, text=True)
    try:
        assert other.stdout.readline() == "in\n"
        with pytest.raises(OutputError, match="another mocap is writing there"):
            write(out, {"x": "2"}, replace=True)
    finally:
        other.send_signal(signal.SIGKILL)
        other.communicate()
    assert current(out, "x").read_text() == "1"
    said = []
    write(out, {"x": "3"}, replace=True, tell=said.append)
    assert texts(out) == {"x": "3"}
    assert ["interrupted while writing" in line for line in said] == [True]
    assert not list(out.glob(f"{PARTIAL}*"))


@pytest.mark.parametrize("renames", [0, 1, 2, 3])
def test_a_kill_between_renames_leaves_the_new_result_whole(tmp_path, monkeypatch, renames):
    """From the moment that it is listed readers find it, wherever its files are; the next run ends the renaming.

    What is listed is replaced even where the old file is still at its place, and a foreign file stays.
    """
    out = tmp_path / "out"
    write(out, {"x": "1", "y": "1", "gone/z": "1"})
    (out / "mine").write_text("mine")
    real, done = os.replace, []

    def dies(source, target, **at):
        if Path(target).name != MANIFEST:
            if len(done) == renames:
                raise SystemExit("killed")
            done.append(target)
        real(source, target, **at)

    monkeypatch.setattr(output.os, "replace", dies)
    monkeypatch.setattr(output.shutil, "rmtree", lambda *_, **__: None)
    new = {"x": "2", "y": "2", "p/w": "2"}
    if renames < len(new):
        with pytest.raises(SystemExit):
            write(out, new, replace=True)
    else:
        write(out, new, replace=True)
    monkeypatch.undo()
    assert {name: path.read_text() for name, path in current_files(out).items()} == new
    said = []
    write(out, {"x": "3"}, replace=True, tell=said.append)
    assert texts(out) == {"x": "3", "mine": "mine"}
    assert bool(said) or renames == len(new)


def test_a_change_between_a_kill_and_the_next_run_is_not_lost(tmp_path, monkeypatch):
    """Somebody who corrects an old file that waits to be replaced is asked to move it."""
    out = tmp_path / "out"
    write(out, {"x": "1"})
    monkeypatch.setattr(output, "_finish", lambda *_: (_ for _ in ()).throw(SystemExit("killed")))
    with pytest.raises(SystemExit):
        write(out, {"x": "2"}, replace=True)
    monkeypatch.undo()
    (out / "x").write_text("corrected")
    with pytest.raises(OutputError, match="was changed while mocap wrote: move it away"):
        write(out, {"x": "3"}, replace=True)
    assert (out / "x").read_text() == "corrected"
    (out / "x").rename(tmp_path / "kept")
    write(out, {"x": "3"}, replace=True)
    assert texts(out) == {"x": "3"}


@pytest.mark.parametrize(
    "content",
    [
        "{}",
        "[1]",
        "not json",
        '{"results": {"track": {"files": {"../x": "0"}}}}',
        '{"results": {}, "pending": {"name": "t", "stage": "..", "new": {"files": {}}}}',
    ],
)
def test_a_manifest_that_is_none_is_left_alone(tmp_path, content):
    """A foreign file of that name, or one that leads out of the folder, is refused and not believed."""
    (tmp_path / MANIFEST).write_text(content)
    (tmp_path / "x").write_text("1")
    with pytest.raises(OutputError, match="is not a manifest"):
        write(tmp_path, {"y": "1"}, replace=True)
    assert current(tmp_path, "x") == tmp_path / "x"
    assert (tmp_path / MANIFEST).read_text() == content


def test_places_that_cannot_be_written_are_named(tmp_path):
    """A file in the way, a folder in place of a file; nothing is made on the way there."""
    (tmp_path / "f").write_text("1")
    for path in (tmp_path / "f", tmp_path / "f" / "below"):
        with pytest.raises(OutputError, match="another place"):
            write(path, {"x": "1"})
    with pytest.raises(OutputError, match="is a folder"), result_file(tmp_path):
        pass
    assert texts(tmp_path) == {"f": "1"}


@pytest.mark.rare
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="calls are interrupted by a preloaded library: Linux")
def test_every_call_that_changes_the_disk_may_be_interrupted():
    """Kill, Ctrl-C and five kinds of error at every ninth call of ``mocap convert``: ``benchmarks/attack/disk.py``."""
    command = [sys.executable, "-m", "benchmarks.attack.disk", "--quick", "--only", "convert .csv", "--kinds", "plain"]
    done = subprocess.run([*command, "--step", "9"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    points = int(done.stdout.strip().splitlines()[-1].split()[0])
    assert points >= 10, done.stdout
