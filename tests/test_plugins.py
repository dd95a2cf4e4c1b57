"""A package beside this one offers a format, a model, a view and a kernel; a broken one breaks nothing."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PYPROJECT = """
[build-system]
requires = ["setuptools"]
build-backend = "setuptools.build_meta"
[project]
name = "birdlab"
version = "1.0"
[tool.setuptools]
py-modules = ["birdlab", "wind"]
[project.entry-points."mocap.formats"]
birdlab = "birdlab:read_birdlab"
broken = "no_such_module:FORMAT"
[project.entry-points."mocap.models"]
resting = "birdlab:RESTING"
wrong = "birdlab:read_birdlab"
[project.entry-points."mocap.views"]
wind = "wind"
[project.entry-points."eal.kernels"]
rational = "birdlab:RationalKernel"
"""
WIND = """
import rerun.blueprint as rrb


def log(rec, run, layout):
    pass


def tab(layout):
    return rrb.TextDocumentView(name="Wind")
"""
ASKED = """
from pathlib import Path
import numpy as np
import mocap, eal
from mocap.filters.models.registry import MODELS, NAMED
from mocap.io.registry import read
from mocap.tracking.track_part import MODELS as NAMES
from mocap.report.summary import method
from mocap.rerun.tabs.registry import TABS
from birdlab import RationalKernel

found = read(Path("flight.txt"))
rec = mocap.from_arrays(found.points.xyz_m, fps=200, unit="m", names=found.names)
res = mocap.track(rec, model="resting", validate=False)
v = eal.fit_potential(np.random.default_rng(0).normal(size=(40, 2)), kernel=RationalKernel(beta=2.0), lam=1e-2)
v.save("v.npz")
print(found.format, res.model, method("resting"), "resting" in NAMES, "resting" in MODELS, "wrong" in NAMED)
print(len(TABS), type(eal.load_potential("v.npz").kernel).__name__)
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """The folder that a package of the examples in the manual is installed into, by pip."""
    source, target = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("installed")
    page = (ROOT / "docs" / "howto" / "extend.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    code = [next(b for b in blocks if word in b) for word in ("birdlab", "class RestingSettings", "RationalKernel")]
    named = "from mocap.filters.models.registry import NamedModel\n"
    named += 'RESTING = NamedModel(RestingSettings(), "resting", "accelerates little", posed=False)\n'
    (source / "birdlab.py").write_text("\n".join([*code, named]), encoding="utf-8")
    (source / "wind.py").write_text(WIND, encoding="utf-8")
    (source / "pyproject.toml").write_text(PYPROJECT, encoding="utf-8")
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-deps"]
    subprocess.run([*pip, "--no-build-isolation", "--target", target, source], check=True, timeout=300)
    return target


@pytest.mark.main
def test_what_another_package_offers_is_used(installed, tmp_path):
    """Read, tracked, named in tables, stored and loaded; what cannot be used is told, by its package, and left out."""
    rows = [f"{i},0,0,{i},5,{i % 7}" for i in range(60)]
    (tmp_path / "flight.txt").write_text("\n".join(["# BIRDLAB 200 Hz", "beak,tail", *rows]) + "\n", encoding="utf-8")
    env = {**os.environ, "PYTHONPATH": os.fspath(installed), "MOCAP_JOBS": "1"}
    done = subprocess.run(
        [sys.executable, "-c", ASKED], cwd=tmp_path, env=env, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    first, second = done.stdout.splitlines()
    assert first == "birdlab resting resting True True False"
    assert second == "8 RationalKernel"
    assert "the package 'birdlab' offers 'broken' to mocap.formats, which cannot be imported" in done.stderr
    assert "offers 'wrong' to mocap.models, but it is Format, expected NamedModel" in done.stderr


TABLE = "time,a_x,a_y,a_z,b_x,b_y,b_z\n" + "".join(f"{i / 100},{i / 99},0.2,0.3,0.4,{i / 98},0.6\n" for i in range(12))
SEES_ALL = """
from mocap.io.format import file_format
@file_format("theirs", "takes all", lambda head: True)
def read(path, _hints): {}
"""
FAILING = {
    "exits at import": ("import sys; sys.exit(3)", "which cannot be imported: SystemExit: 3"),
    "no Exception at import": ("raise BaseException('down')", "which cannot be imported: BaseException: down"),
    "is no format": ("read = lambda path: None", "but it is function, expected Format"),
    "recogniser raises": (
        "from mocap.io.format import Format\n"
        "def sees(head): raise ValueError('boom')\n"
        "read = Format(name='theirs', title='x', knows=sees, read=print)",
        "but it fails on a.csv: ValueError: boom",
    ),
    "recogniser exits": (
        "from mocap.io.format import Format\nread = Format(name='theirs', title='x', knows=exit, read=print)",
        "but it fails on a.csv: SystemExit",
    ),
    "recogniser is none": (
        "from mocap.io.format import Format\nread = Format(name='theirs', title='x', knows=None, read=None)",
        "but it fails on a.csv: TypeError",
    ),
}


def offering(folder: Path, group: str, code: str) -> Path:
    """A folder as pip leaves one, whose package ``theirpackage`` offers ``theirs``, the name ``read`` of its code."""
    info = folder / "theirpackage-1.0.dist-info"
    info.mkdir(parents=True)
    (folder / "theirpackage.py").write_text(code, encoding="utf-8")
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: theirpackage\nVersion: 1.0\n", encoding="utf-8")
    (info / "entry_points.txt").write_text(f"[{group}]\ntheirs = theirpackage:read\n", encoding="utf-8")
    return folder


def command(*words: object, beside: Path, folder: Path) -> subprocess.CompletedProcess[str]:
    """What ``mocap`` makes of a command where that folder is on the path of Python."""
    line = [sys.executable, "-c", "from mocap.cli.main import main; main()", *map(str, words)]
    env = {**os.environ, "PYTHONPATH": os.fspath(beside), "MOCAP_JOBS": "1"}
    return subprocess.run(line, cwd=folder, env=env, capture_output=True, text=True, timeout=300)


@pytest.mark.parametrize("case", FAILING)
def test_a_format_that_fails_is_named_and_left_out(case, tmp_path):
    """Whatever the package raises: the command reads two files, and says of the package one line, once."""
    code, why = FAILING[case]
    beside = offering(tmp_path / "packages", "mocap.formats", code)
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).write_text(TABLE, encoding="utf-8")
    done = command("info", "a.csv", "b.csv", "--json", beside=beside, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert [one["points"] for one in json.loads(done.stdout)] == [2, 2]
    lines = done.stderr.splitlines()
    assert len(lines) == 1
    assert f"the package 'theirpackage' offers 'theirs' to mocap.formats, {why}" in lines[0]


@pytest.mark.parametrize("trouble", ["raise KeyError('taken')", "return 5", "raise SystemExit"])
def test_a_reader_that_fails_is_named(trouble, tmp_path):
    """What its recogniser takes is refused in the package's name and not in ours, and read as the format stated."""
    beside = offering(tmp_path / "packages", "mocap.formats", SEES_ALL.format(trouble))
    (tmp_path / "a.csv").write_text(TABLE, encoding="utf-8")
    refused = command("convert", "a.csv", "b.trc", "--unit", "m", beside=beside, folder=tmp_path)
    assert refused.returncode == 1
    assert "the reader of the format 'theirs', which another installed package offers, failed (" in refused.stderr
    assert "--format" in refused.stderr
    assert "report this" not in refused.stderr
    line = ["convert", "a.csv", "b.trc", "--unit", "m", "--format", "csv"]
    assert command(*line, beside=beside, folder=tmp_path).returncode == 0
    assert (tmp_path / "b.trc").is_file()


def test_a_view_that_fails_is_named_and_left_out(tmp_path):
    """Tracking goes on, and the recording for the viewer has every other tab."""
    code = "class read:\n    @staticmethod\n    def log(rec, run, layout): raise SystemExit(4)\n"
    code += "    @staticmethod\n    def tab(layout): raise KeyError('no tab')\n"
    beside = offering(tmp_path / "packages", "mocap.views", code)
    (tmp_path / "a.csv").write_text(TABLE, encoding="utf-8")
    done = command("track", "a.csv", "--unit", "m", "--no-validate", "--out", "o", beside=beside, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "o" / "recording.rrd").stat().st_size > 0
    for why in ("SystemExit: 4", "KeyError: 'no tab'"):
        assert f"offers 'theirs' to mocap.views, but it fails: {why}" in done.stderr
