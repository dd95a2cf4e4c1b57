"""Names that a result cannot write and read back: refused where a person or a program gives them, changed in files."""

import numpy as np
import pytest

import mocap
from mocap.cli.main import explain
from mocap.errors import FormatError, SkeletonError
from mocap.io.registry import read
from mocap.skeleton import read_skeleton
from mocap.text import unfit
from tests.mocap.rigs import ring

ODD = ["", "a\0b", "a\x1bb", "a\ud800", "a\udc80b", "a\nb", "a\rb", "a\u2028b", "a\u202eb", "a\x85"]
FINE = ["a", " ", "a b", "a\tb", "a,b", '"', "=1+1", "'a", "NaN", "frame", "x_x", "é", "é", "\ufeffa", "\U0001f987"]
XYZ = np.random.default_rng(0).normal(size=(5, 2, 3)).cumsum(axis=0)


@pytest.mark.parametrize("name", ODD)
def test_in_memory_such_a_name_is_refused(name):
    """Of a marker, a camera, the recording, a skeleton and its parts: at once, in one line that shows it."""
    skeleton = {"markers": ["a", "b"]}
    takes = {
        "marker": lambda: mocap.from_arrays(XYZ, fps=100, unit="m", names=["b", name]),
        "marker of pixels": lambda: mocap.from_pixels(XYZ[None, ..., :2], ring(1), fps=100, names=["b", name]),
        "recording": lambda: mocap.from_arrays(XYZ, fps=100, unit="m", name=name),
        "skeleton": lambda: mocap.Skeleton(markers=["b", name]),
        "trunk": lambda: mocap.Skeleton(**skeleton, trunk=[name]),
        "alias": lambda: mocap.Skeleton(**skeleton, aliases={"pt1": name}),
        "joint": lambda: mocap.Skeleton(markers=["a", "b", "c"], joints={name: ("a", "b", "c")}),
    }
    for what, take in takes.items():
        with pytest.raises((FormatError, SkeletonError)) as refused:
            take()
        assert repr(name) in str(refused.value), what
        assert "rename it" in str(refused.value) or "give it another" in str(refused.value), what
        assert explain(refused.value) == 1


@pytest.mark.parametrize("name", FINE)
def test_other_names_are_kept(name):
    """Letters of any script, blanks, tabs and what tables quote are names: nothing changes them."""
    assert unfit(name) is None
    assert mocap.from_arrays(XYZ, fps=100, unit="m", names=["b", name]).names == ("b", name)
    assert mocap.Skeleton(markers=["b", name]).markers == ("b", name)


@pytest.mark.parametrize("name", ["a\x1bb", "a\u202eb"])
def test_files_with_such_a_name_are_read_and_told(name, tmp_path):
    """The name is changed into one that can be, a finding says so, and no two markers become one."""
    changed = {"a\x1bb": r"a\x1bb", "a\u202eb": r"a\u202eb"}[name]
    titles = ",".join(f'"{n}_{axis}"' for n in (name, changed) for axis in "xyz")
    rows = "".join(f"{i},{i / 7},0.2,0.3,0.4,{i / 9},0.6\n" for i in range(5))
    path = tmp_path / "a.csv"
    path.write_text(f"frame,{titles}\n{rows}", encoding="utf-8")
    found = read(path)
    assert len(set(found.names)) == 2
    assert all(unfit(one) is None for one in found.names)
    assert any("renamed" in finding for finding in found.findings)


def test_a_skeleton_file_with_such_an_alias_is_refused(tmp_path):
    """Aliases name markers of the result, as ``markers`` do."""
    path = tmp_path / "s.toml"
    for name in (r"\u0000", r"\u001b", ""):
        path.write_text(f'markers = ["a", "b"]\n[aliases]\npt1 = "{name}"\n', encoding="utf-8")
        with pytest.raises(SkeletonError, match=r"s\.toml"):
            read_skeleton(path)
