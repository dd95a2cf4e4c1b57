"""A package beside this one offers a format, a model, a view and a kernel; a broken one breaks nothing."""

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
from mocap.pipeline.job import MODELS as NAMES
from mocap.pipeline.summary import method
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
