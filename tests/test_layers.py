"""Who may import whom."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

ALLOWED = {
    "mocap": set(),
    "eal": set(),
    "filters": {"mocap", "eal"},
    "datasets": {"mocap"},
    "app": {"mocap", "eal", "filters", "datasets"},
}
"""The packages, and which others each may import."""

PLACES = {
    "rerun": ("app/view/",),
    "cv2": ("mocap/", "datasets/"),
    "filterpy": ("filters/",),
}
"""Libraries that only some folders may import (tests may import all of them)."""

OUTSIDE = ("tests", "benchmarks", "design")
"""Folders of scripts; no package imports them."""


def imports(source: str, path: str) -> set[str]:
    """Full names of all modules that a source file imports, also inside functions, relative ones resolved."""
    package = path.removesuffix(".py").removesuffix("/__init__").split("/")
    if not path.endswith("__init__.py"):
        package = package[:-1]
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            base += node.module.split(".") if node.module else []
            found |= {".".join([*base, alias.name]) for alias in node.names}
        elif isinstance(node, ast.Call) and node.args and isinstance(node.args[0], ast.Constant):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            if name in ("import_module", "__import__"):
                found.add(str(node.args[0].value))
    return found


def trouble(source: str, path: str) -> list[str]:
    """What is wrong with the imports of one file of a package."""
    package = path.split("/")[0]
    found = []
    for name in sorted(imports(source, path)):
        top = name.split(".")[0]
        if top in ALLOWED and top != package and top not in ALLOWED[package]:
            found.append(f"{path} imports {name}: {package} may import only {sorted(ALLOWED[package]) or 'nothing'}")
        if top in OUTSIDE:
            found.append(f"{path} imports {name}: packages import no scripts")
        if top in PLACES and not path.startswith(PLACES[top]):
            found.append(f"{path} imports {name}: only {', '.join(PLACES[top])} may")
    return found


@pytest.mark.parametrize("package", ALLOWED)
def test_imports_go_one_way(package):
    """Every import of every file keeps the directions of the table, and heavy libraries stay in their rooms."""
    files = sorted((ROOT / package).rglob("*.py"))
    assert files, f"{package}/ has no source files: the table of this test is out of date"
    found = [line for f in files for line in trouble(f.read_text(encoding="utf-8"), f.relative_to(ROOT).as_posix())]
    assert not found, "\n".join(found)


def test_every_package_is_in_the_table():
    """A package that the table does not name would be free to import anything."""
    packages = {p.parent.name for p in ROOT.glob("*/__init__.py")}
    assert packages - set(OUTSIDE) == set(ALLOWED)


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("mocap/a.py", "import eal"),
        ("mocap/formats/a.py", "from filters.track import smooth"),
        ("eal/a.py", "def f():\n    from mocap.arrays import Array"),
        ("eal/integrators/a.py", "from ... import mocap"),
        ("datasets/a.py", "import numpy, eal.kernels as k"),
        ("filters/a.py", "import app.run"),
        ("filters/a.py", "import importlib\nimportlib.import_module('datasets.bat')"),
        ("filters/a.py", "import cv2"),
        ("app/a.py", "import rerun as rr"),
        ("mocap/a.py", "from filterpy.kalman import KalmanFilter"),
        ("app/a.py", "from tests.real_data import real"),
        ("mocap/a.py", "try:\n    import rerun\nexcept ImportError:\n    pass"),
    ],
)
def test_a_wrong_direction_is_seen(path, source):
    """Each kind of forbidden import, wherever it hides, is one finding."""
    assert len(trouble(source, path)) == 1


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("app/view/deep/a.py", "import rerun\nfrom datasets import make_bat"),
        ("filters/motion/a.py", "from .base import MotionModel\nfrom eal import fit_potential\nimport filterpy"),
        ("datasets/a.py", "import cv2\nfrom mocap.cameras import Camera"),
        ("mocap/formats/a.py", "from ..errors import FormatError\nfrom . import csv_table"),
    ],
)
def test_a_right_direction_passes(path, source):
    """What the table allows is no finding, relative imports of the own package included."""
    assert not trouble(source, path)
