"""Each satellite's folders are deleted in a copy of the tree: the rest is imported, lists its commands and works."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from mocap.cli.table import ENTRIES, SATELLITES

ROOT = Path(__file__).resolve().parents[1]
TESTS = ("eal/test_kernels.py", "filters/test_sights.py", "mocap/test_progress_lines.py", "mocap/test_first_lines.py")
"""Files of tests of the rest that run in the copy: quick ones, of each package."""
ROWS = "a_x,a_y,a_z\n" + "\n".join(f"{0.01 * i},{0.02 * i},{0.01 * i}" for i in range(40)) + "\n"
ALL = """
import sys, importlib, json, pathlib
root = pathlib.Path.cwd()
for path in sorted(p for top in ("eal", "mocap") for p in (root / top).rglob("*.py")):
    importlib.import_module(".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__"))
for name in ("mocap", "mocap.filters", "mocap.io.registry", "eal"):
    assert sys.modules[name].__file__.startswith(str(root)), sys.modules[name].__file__

from typer.testing import CliRunner
from mocap.cli.main import app

def said(*words):
    done = CliRunner().invoke(app, words)
    return done.exit_code, done.output

names = sys.argv[1:]
track = said("track", "a_xyzpts.csv", "--fps", "100", "--no-validate", "--out", "out")
print(json.dumps([said("--help"), {name: said(name) for name in names}, track]))
"""
"""Imports every file that is there, and runs commands: prints what they say."""
PLACES = {"tests": "tests", "eal": "eal", "mocap": "mocap", "filters": "mocap/filters", "datasets": "mocap/datasets"}
"""Where each folder of the repository is installed."""
ALONE = """
import sys
sys.meta_path[:] = [one for one in sys.meta_path if not getattr(one, "__module__", "").startswith("__editable__")]
"""
"""An editable installation would find what was deleted in the repository."""


def missing_without(name: str) -> set[str]:
    """A satellite, and those that need it."""
    return {name} | {other for other, one in SATELLITES.items() if name in one.needs}


@pytest.fixture(params=SATELLITES)
def left(request, tmp_path):
    """The name of a satellite, and a copy of the tree, as it is installed, without it and those that need it."""
    gone = missing_without(request.param)
    for top, place in PLACES.items():
        shutil.copytree(ROOT / top, tmp_path / place)  # with what is compiled
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    (tmp_path / "sitecustomize.py").write_text(ALONE)
    for satellite in gone:
        for package in SATELLITES[satellite].packages:
            shutil.rmtree(tmp_path / package.replace(".", "/"))
        for file in SATELLITES[satellite].commands:
            (tmp_path / "mocap" / "cli" / f"{file}.py").unlink()
    return gone, tmp_path


def run(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Python in the copy, which stands first on the path."""
    environment = {**os.environ, "PYTHONPATH": str(folder), "OMP_NUM_THREADS": "1"}
    environment.pop("PYTEST_XDIST_WORKER", None)
    return subprocess.run(
        [sys.executable, *words], cwd=folder, env=environment, capture_output=True, text=True, check=False, timeout=300
    )


def test_the_rest_works_without(left):
    """Every other file is imported, the other commands are listed alone, one tracks, and quick tests pass."""
    gone, folder = left
    theirs = [name for name, entry in ENTRIES.items() if entry.satellite in gone]
    (folder / "a_xyzpts.csv").write_text(ROWS)
    done = run(folder, "-c", ALL, *theirs)
    assert done.returncode == 0, done.stderr
    (code, text), refused, track = json.loads(done.stdout.splitlines()[-1])
    assert code == 0, text
    listed = {words[0] for line in text.splitlines() if (words := line.strip("\u2502 ").split())}
    assert {name for name in ENTRIES if name in listed} == ENTRIES.keys() - set(theirs)
    for name, (code, text) in refused.items():
        assert code == 2
        assert f"No such command '{name}'" in text
    assert track[0] == 0, track[1]
    assert (folder / "out" / "markers.csv").is_file()
    done = run(folder, "-m", "pytest", "-q", "-n", "0", *(f"tests/{name}" for name in TESTS))
    assert done.returncode == 0, done.stdout + done.stderr
