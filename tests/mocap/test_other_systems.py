"""What Windows and macOS do differently, as far as it can be tried on another system."""

import ctypes
import errno
import os
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from mocap import documents
from mocap.cli.track import again
from mocap.errors import FormatError, OutputError
from mocap.io import output
from mocap.io.apart import limit_windows_memory
from mocap.io.format import head
from mocap.io.manifest import MANIFEST, current
from mocap.io.output import result_folder
from mocap.results import stored
from mocap.text import file_names
from mocap.tracking.potentials import JointPotential, Potentials
from tests.mocap.rerun.flapping import make_run


@pytest.mark.parametrize(
    ("names", "files"),
    [
        (["elbow_l", "knee", "Flügel 1", "a.b"], ["elbow_l", "knee", "Flügel 1", "a.b"]),
        (["elbow_l", "Elbow_l", "ELBOW_L"], ["elbow_l", "Elbow_l_2", "ELBOW_L_3"]),
        (["a_2", "a", "A"], ["a_2", "a", "A_3"]),
        (
            ["Fl\u00fcgel", "Flu\u0308gel", "stra\u00dfe", "STRASSE"],
            ["Fl\u00fcgel", "Flu\u0308gel_2", "stra\u00dfe", "STRASSE_2"],
        ),
        (
            ["a/b", "a\\b", "a:b", 'say "hi"?', "x. ", "..", ""],
            ["a_b", "a_b_2", "a_b_3", "say _hi__", "x_", "_", "__2"],
        ),
        (["con", "Aux.left", "COM1", "contact"], ["con_", "Aux_.left", "COM1_", "contact"]),
    ],
)
def test_files_are_apart_where_case_is_ignored(names, files):
    """And have names that every system takes; a plain name stays as it is."""
    assert file_names(names) == files


def test_potentials_of_joints_that_differ_in_case_are_kept_apart(tmp_path):
    """Both are written, to files that a disk that ignores case keeps apart, and the result says which is whose."""

    class Saved:
        def save(self, path: Path) -> None:
            path.write_bytes(b"")

    one = JointPotential(joint="j", frame="plane", scale_m=1.0, samples_m=np.zeros((2, 2)), potential=Saved())  # type: ignore[arg-type]
    stored.write_arrays(make_run(n_frames=5).with_part(Potentials(planar={"elbow_l": one, "Elbow_l": one})), tmp_path)
    assert sorted(p.name for p in (tmp_path / "potentials").iterdir()) == ["Elbow_l_2.npz", "elbow_l.npz"]


def test_the_command_that_repeats_a_run_has_the_quotes_of_its_system(monkeypatch):
    """``'my file.csv'`` is two words to Windows."""
    monkeypatch.setattr(sys, "argv", ["mocap", "track", "my file.csv"])
    monkeypatch.setattr(sys, "platform", "win32")
    assert again().startswith('mocap track "my file.csv"    # version')
    monkeypatch.setattr(sys, "platform", "linux")
    assert again().startswith("mocap track 'my file.csv'    # version")


def test_memory_of_damaged_files_has_a_limit_on_windows():
    """The structure has the layout of winnt.h on 64 bits: 144 bytes, the flags at 16, the limit at 112."""
    said = []

    def states(_job, kind, limits, size):
        raw = ctypes.string_at(limits, size)
        said.append((kind, size, int.from_bytes(raw[16:20], "little"), int.from_bytes(raw[112:120], "little")))
        return 1

    class Call:
        def __init__(self, found: int) -> None:
            self.found = found

        def __call__(self, *_) -> int:
            return self.found

    kernel = SimpleNamespace(CreateJobObjectW=Call(7), GetCurrentProcess=Call(2**64 - 1))
    kernel.SetInformationJobObject, kernel.AssignProcessToJobObject = states, lambda job, own: bool(job and own)
    assert limit_windows_memory(3 << 30, kernel)
    assert said == [(9, 144, 0x100, 3 << 30)]
    kernel.AssignProcessToJobObject = lambda *_: 0
    assert not limit_windows_memory(3 << 30, kernel)


def test_a_file_that_excel_has_open_is_named(tmp_path, monkeypatch):
    """One line says to close it; the new result is whole, and the next command moves it to its place."""
    out = tmp_path / "out"

    def write(text: str) -> None:
        with result_folder(out, "track", replace=True) as stage:
            (stage / "cycles.csv").write_text(text)

    write("1")
    real = os.replace

    def held(source, target, **where):
        if Path(target).name != MANIFEST:
            raise PermissionError(errno.EACCES, "Permission denied", str(source), None, str(target))
        real(source, target, **where)

    monkeypatch.setattr(output.os, "replace", held)
    with pytest.raises(
        OutputError, match=r"close cycles\.csv in the program that has it open, such as Excel; mocap view"
    ):
        write("2")
    assert current(out, "cycles.csv").read_text() == "2"
    monkeypatch.undo()
    write("3")
    assert (out / "cycles.csv").read_text() == "3"


def test_an_input_that_excel_has_open_is_named(tmp_path, monkeypatch):
    """When it cannot be read."""
    path = tmp_path / "a.xlsx"
    path.write_text("x")

    def held(path, *_, **__):
        raise PermissionError(errno.EACCES, "Permission denied", str(path))

    monkeypatch.setattr(documents.os, "open", held)
    with pytest.raises(FormatError, match=r"close a\.xlsx in the program that has it open"):
        head(path)
