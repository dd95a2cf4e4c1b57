"""Who may import whom."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

_GROUND = {"mocap", "mocap/cameras", "mocap/io"}
_MATH = {"eal", "filters"}
_FLOW = _GROUND | _MATH | {"datasets", "mocap/audit", "mocap/calibration", "mocap/cleaning", "mocap/kinematics"}
_FLOW |= {"mocap/pipeline"}
_SHOWN = _FLOW | {
    "mocap/results",
    "mocap/plots",
    "mocap/joint_design",
    "mocap/reproduce",
    "mocap/rerun",
    "mocap/digitising",
    "mocap/web",
}

ALLOWED = {
    "eal": set(),
    "mocap": set(),  # records, errors, arrays: the files of mocap/ that lie in no room
    "filters": {"mocap", "eal"},
    "mocap/cameras": {"mocap"},
    "mocap/io": {"mocap", "mocap/cameras"},
    "datasets": _GROUND,
    "mocap/audit": _GROUND,
    "mocap/calibration": {"mocap", "mocap/cameras"},
    "mocap/cleaning": {"mocap", "mocap/cameras"},
    "mocap/kinematics": {"mocap"},
    "mocap/pipeline": _FLOW,
    "mocap/results": _FLOW,
    "mocap/plots": _FLOW,
    "mocap/digitising": _FLOW,
    "mocap/joint_design": _FLOW,
    "mocap/reproduce": _FLOW,
    "mocap/rerun": _FLOW | {"mocap/joint_design", "mocap/results"},
    "mocap/web": {"mocap", "eal"},
    "mocap/library": _SHOWN,
    "mocap/batches": _SHOWN | {"mocap/library"},
    "mocap/cli": _SHOWN | {"mocap/library", "mocap/batches"},
}
"""The packages and the rooms of mocap, in the direction of the flow, and which others each may import."""

PLACES = {
    "rerun": ("mocap/rerun/",),
    "cv2": ("mocap/", "datasets/"),
    "filterpy": ("filters/",),
    "dask": ("mocap/batches/",),
    "distributed": ("mocap/batches/",),
}
"""Libraries that only some folders may import (tests may import all of them)."""

INSTALLED_BELOW = ("filters", "datasets")
"""Folders at the top that are installed as packages of mocap; under their own names they are not imported."""

OUTSIDE = ("tests", "benchmarks")
"""Folders of scripts; no package imports them."""


def imports(source: str, path: str) -> set[str]:
    """Full names of all modules that a source file imports, also inside functions, relative ones resolved."""
    package = path.removesuffix(".py").removesuffix("/__init__").split("/")
    package = ["mocap", *package] if package[0] in INSTALLED_BELOW else package
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


FACE = "mocap/__init__.py"
"""The public names, imported when first used: it may name all rooms but the command line."""


def room(parts: list[str]) -> str:
    """The package or room that a file or a dotted name belongs to; files of mocap/ in no room are "mocap"."""
    if parts[0] == "mocap" and len(parts) > 1:
        below = f"mocap/{parts[1]}"
        return below if below in ALLOWED else parts[1] if parts[1] in INSTALLED_BELOW else "mocap"
    return parts[0]


def trouble(source: str, path: str) -> list[str]:
    """What is wrong with the imports of one file of a package."""
    here = room(path.removesuffix(".py").split("/"))
    found = []
    for name in sorted(imports(source, path)):
        top, there = name.split(".")[0], room(name.split("."))
        allowed = ALLOWED["mocap/cli"] if path == FACE else ALLOWED[here]
        if there in ALLOWED and there != here and there not in allowed and top not in INSTALLED_BELOW:
            found.append(f"{path} imports {name}: {here} may import only {sorted(allowed) or 'nothing'}")
        if top in INSTALLED_BELOW:
            found.append(f"{path} imports {name}: it is installed as mocap.{name}")
        elif top in OUTSIDE:
            found.append(f"{path} imports {name}: packages import no scripts")
        if top in PLACES and not path.startswith(PLACES[top]):
            found.append(f"{path} imports {name}: only {', '.join(PLACES[top])} may")
    return found


@pytest.mark.parametrize("package", ALLOWED)
def test_imports_go_one_way(package):
    """Every import of every file keeps the directions of the table, and heavy libraries stay in their rooms."""
    files = sorted((ROOT / package).glob("*.py") if package == "mocap" else (ROOT / package).rglob("*.py"))
    assert files, f"{package}/ has no source files: the table of this test is out of date"
    found = [line for f in files for line in trouble(f.read_text(encoding="utf-8"), f.relative_to(ROOT).as_posix())]
    assert not found, "\n".join(found)


def test_every_package_is_in_the_table():
    """A package that the table does not name would be free to import anything."""
    packages = {p.parent.name for p in ROOT.glob("*/__init__.py")}
    packages |= {f"mocap/{p.parent.name}" for p in ROOT.glob("mocap/*/__init__.py")}
    assert packages - set(OUTSIDE) == set(ALLOWED)


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("mocap/a.py", "import eal"),
        ("mocap/io/a.py", "from mocap.filters.track import smooth"),
        ("mocap/pipeline/a.py", "from filters.track import smooth"),
        ("eal/a.py", "def f():\n    from mocap.arrays import Array"),
        ("eal/integrators/a.py", "from ... import mocap"),
        ("datasets/a.py", "import numpy, eal.kernels as k"),
        ("filters/a.py", "import mocap.pipeline.run"),
        ("filters/a.py", "import importlib\nimportlib.import_module('mocap.datasets.bats')"),
        ("filters/a.py", "import cv2"),
        ("mocap/cli/a.py", "import rerun as rr"),
        ("mocap/a.py", "from filterpy.kalman import KalmanFilter"),
        ("mocap/cli/a.py", "from tests.real_data import real"),
        ("mocap/a.py", "from mocap.io.csv_table import read"),
        ("mocap/io/a.py", "from mocap.pipeline.job import run_job"),
        ("mocap/cleaning/a.py", "import mocap.io.c3d"),
        ("mocap/rerun/a.py", "def f():\n    from mocap.cli.main import main"),
        ("mocap/a.py", "try:\n    import rerun\nexcept ImportError:\n    pass"),
    ],
)
def test_a_wrong_direction_is_seen(path, source):
    """Each kind of forbidden import, wherever it hides, is one finding."""
    assert len(trouble(source, path)) == 1


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("mocap/rerun/deep/a.py", "import rerun\nfrom mocap.datasets import make_bat"),
        ("filters/motion/a.py", "from .base import MotionModel\nfrom eal import fit_potential\nimport filterpy"),
        ("datasets/a.py", "import cv2\nfrom mocap.cameras.camera import Camera"),
        ("mocap/io/a.py", "from ..errors import FormatError\nfrom . import csv_table"),
    ],
)
def test_a_right_direction_passes(path, source):
    """What the table allows is no finding, relative imports of the own package included."""
    assert not trouble(source, path)
