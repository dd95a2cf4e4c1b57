"""Who may import whom."""

import ast
import re
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from mocap.cli.table import SATELLITES

ROOT = Path(__file__).resolve().parents[1]

ALLOWED = {
    "eal": set(),
    "eal/joint_design": {"eal"},
    "filters": {"eal"},
    "mocap": {"eal", "filters"},  # records, errors, skeleton: the files of mocap/ that lie in no room
    "mocap/cameras": {"eal", "mocap"},
    "mocap/recording": {"eal", "mocap", "mocap/cameras"},  # a file: the record, which all rooms above hand on
    "mocap/io": {"eal", "mocap", "mocap/cameras"},
    "datasets": {"eal", "mocap", "mocap/cameras", "mocap/io"},
    "mocap/audit": {"eal", "mocap", "mocap/cameras", "mocap/io"},
    "mocap/kinematics": {"eal", "filters", "mocap"},
    "mocap/reading": {"eal", "mocap", "mocap/audit", "mocap/cameras", "mocap/io", "mocap/recording"},
    "mocap/cleaning": {
        "eal",
        "filters",
        "mocap",
        "mocap/audit",
        "mocap/cameras",
        "mocap/io",
        "mocap/reading",
        "mocap/recording",
    },
    "mocap/tracking": {
        "eal",
        "filters",
        "mocap",
        "mocap/audit",
        "mocap/cameras",
        "mocap/cleaning",
        "mocap/io",
        "mocap/kinematics",
        "mocap/reading",
        "mocap/recording",
    },
    "mocap/report": {
        "datasets",
        "eal",
        "filters",
        "mocap",
        "mocap/cameras",
        "mocap/cleaning",
        "mocap/io",
        "mocap/reading",
        "mocap/recording",
        "mocap/tracking",
    },
    "mocap/proposing": {"eal", "filters", "mocap", "mocap/cleaning", "mocap/io", "mocap/recording", "mocap/tracking"},
    "mocap/calibration": {"eal", "mocap", "mocap/cameras", "mocap/io", "mocap/reading", "mocap/recording"},
    "mocap/plots": {"eal", "mocap", "mocap/kinematics", "mocap/reading", "mocap/report", "mocap/tracking"},
    "mocap/joint_design": {"eal", "eal/joint_design", "filters", "mocap", "mocap/io", "mocap/rerun", "mocap/tracking"},
    "mocap/reproduce": {"datasets", "eal", "filters", "mocap", "mocap/cleaning", "mocap/reading", "mocap/recording"},
    "mocap/rerun": {
        "eal",
        "filters",
        "mocap",
        "mocap/cameras",
        "mocap/io",
        "mocap/kinematics",
        "mocap/recording",
        "mocap/tracking",
    },
    "mocap/results": {
        "eal",
        "filters",
        "mocap",
        "mocap/cameras",
        "mocap/cleaning",
        "mocap/io",
        "mocap/kinematics",
        "mocap/plots",
        "mocap/reading",
        "mocap/recording",
        "mocap/report",
        "mocap/rerun",
        "mocap/tracking",
    },
    "mocap/web": {"eal", "mocap"},
    "mocap/digitising": {"eal", "filters", "mocap", "mocap/cameras", "mocap/io", "mocap/tracking"},
    "mocap/batches": {
        "eal",
        "mocap",
        "mocap/audit",
        "mocap/cameras",
        "mocap/cleaning",
        "mocap/io",
        "mocap/reading",
        "mocap/recording",
        "mocap/report",
        "mocap/results",
        "mocap/tracking",
    },
    "mocap/desk": {
        "eal",
        "mocap",
        "mocap/audit",
        "mocap/batches",
        "mocap/cameras",
        "mocap/cleaning",
        "mocap/digitising",
        "mocap/io",
        "mocap/kinematics",
        "mocap/proposing",
        "mocap/reading",
        "mocap/recording",
        "mocap/rerun",
        "mocap/results",
        "mocap/tracking",
        "mocap/web",
    },
    "mocap/cli": {
        "datasets",
        "mocap",
        "mocap/audit",
        "mocap/cameras",
        "mocap/cleaning",
        "mocap/io",
        "mocap/proposing",
        "mocap/reading",
        "mocap/recording",
        "mocap/report",
        "mocap/rerun",
        "mocap/results",
        "mocap/tracking",
    },
    "commands of batches": {"mocap", "mocap/batches", "mocap/cli"},
    "commands of calibration": {"mocap", "mocap/calibration", "mocap/cli", "mocap/io"},
    "commands of desk": {
        "mocap",
        "mocap/batches",
        "mocap/cli",
        "mocap/desk",
        "mocap/digitising",
        "mocap/io",
        "mocap/web",
    },
    "commands of joint design": {"eal/joint_design", "mocap", "mocap/cli", "mocap/io", "mocap/joint_design"},
    "commands of paper": {"mocap", "mocap/cli", "mocap/io", "mocap/reproduce"},
}
"""The packages and the rooms of mocap, in the direction of the flow: which others each imports, and no more."""

COMMANDS = {f"mocap/cli/{file}": f"commands of {name}" for name, one in SATELLITES.items() for file in one.commands}
"""Files of commands that are of a satellite, and no part of the command line."""
ROOMS_OF = {
    name: {package.replace(".", "/") for package in one.packages} | {f"commands of {name}"}
    for name, one in SATELLITES.items()
}
"""The rooms of each satellite."""

PLACES = {
    "rerun": ("mocap/rerun/", "mocap/joint_design/log_truss.py"),
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


@cache
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


ALONE = {"recording"}
"""Files of mocap/ that are rooms of their own."""
FACE = "mocap/__init__.py"
FACED = {
    "mocap",
    "mocap/recording",
    "mocap/batches",
    "mocap/cleaning",
    "mocap/digitising",
    "mocap/io",
    "mocap/proposing",
    "mocap/reading",
    "mocap/results",
    "mocap/tracking",
}
"""The file of the public names, which are imported when first used, and the rooms that they are of."""


def room(parts: list[str]) -> str:
    """The package or room that a file or a dotted name belongs to; files of mocap/ in no room are "mocap"."""
    if "/".join(parts[:3]) in COMMANDS:
        return COMMANDS["/".join(parts[:3])]
    below = "/".join(parts[:2])
    if below in ALLOWED:
        return below
    return parts[1] if below in {f"mocap/{one}" for one in INSTALLED_BELOW} else parts[0]


def rooms(source: str, path: str) -> dict[str, str]:
    """The modules of other packages and rooms that a source file imports, and which room each is of."""
    here = room(path.removesuffix(".py").split("/"))
    found = {name: room(name.split(".")) for name in sorted(imports(source, path))}
    return {name: there for name, there in found.items() if there in ALLOWED and there != here}


def circle(table: dict[str, set[str]]) -> list[str]:
    """Rooms that import each other in a circle, the first of them again at the end; empty: there is none."""
    try:
        TopologicalSorter(table).prepare()
    except CycleError as error:
        return error.args[1]
    return []


def trouble(source: str, path: str) -> list[str]:
    """What is wrong with the imports of one file of a package."""
    here = room(path.removesuffix(".py").split("/"))
    allowed = FACED if path == FACE else ALLOWED[here]
    found = [
        f"{path} imports {name}: {here} may import only {sorted(allowed) or 'nothing'}"
        for name, there in rooms(source, path).items()
        if there not in allowed and name.split(".")[0] not in INSTALLED_BELOW
    ]
    for name in sorted(imports(source, path)):
        top = name.split(".")[0]
        if top in INSTALLED_BELOW:
            found.append(f"{path} imports {name}: it is installed as mocap.{name}")
        elif top in OUTSIDE:
            found.append(f"{path} imports {name}: packages import no scripts")
        if top in PLACES and not path.startswith(PLACES[top]):
            found.append(f"{path} imports {name}: only {', '.join(PLACES[top])} may")
    return found


def sources(package: str) -> dict[str, str]:
    """Source files of a package or room by their path."""
    top = "mocap" if package.startswith("commands") else package.split("/")[0]
    paths = {f.relative_to(ROOT).as_posix(): f for f in sorted((ROOT / top).rglob("*.py"))}
    mine = {path: f for path, f in paths.items() if room(path.removesuffix(".py").split("/")) == package}
    return {path: f.read_text(encoding="utf-8") for path, f in mine.items()}


@pytest.mark.parametrize("package", ALLOWED)
def test_imports_go_one_way(package):
    """Every import of every file keeps the directions of the table, and heavy libraries stay in their rooms."""
    files = sources(package)
    assert files, f"{package}/ has no source files: the table of this test is out of date"
    found = [line for path, source in files.items() for line in trouble(source, path)]
    assert not found, "\n".join(found)


@pytest.mark.parametrize("package", ALLOWED)
def test_the_table_allows_no_more_than_is_imported(package):
    """A direction that no file takes is none that the next one may take unseen."""
    files = {path: source for path, source in sources(package).items() if path != FACE}
    taken = {there for path, source in files.items() for there in rooms(source, path).values()}
    assert not ALLOWED[package] - taken, f"take these out of the table of {package}"


FACES_OF_USERS = {"eal"}
"""Packages whose public names are for users; in the tree a name is taken from the file that owns it: who needs one
potential does not stand on all of eal."""
STILL = {"mocap/results/stored.py"}
"""Files that take one from a face all the same; none is added."""


def from_faces(source: str) -> list[str]:
    """The names that a source file takes from a face instead of the file that owns them."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom) and not node.level and node.module in FACES_OF_USERS:
            below = {path.stem for path in (ROOT / node.module).iterdir()}
            found += [f"{node.module}.{alias.name}" for alias in node.names if alias.name not in below]
    return found


@pytest.mark.parametrize("package", ALLOWED)
def test_names_are_taken_from_the_file_that_owns_them(package):
    """A face imports everything that its package offers, and so does who imports it."""
    found = {path: from_faces(source) for path, source in sources(package).items() if path not in STILL}
    assert not {path: names for path, names in found.items() if names}


def test_a_name_from_a_face_is_seen():
    """Of two imports that look alike one is a name, the other a file."""
    assert from_faces("from eal import compare, npz") == ["eal.compare"]
    assert not from_faces("from eal.comparison import compare\nfrom eal import archive")


def test_no_rooms_import_each_other():
    """Two rooms that import each other, by whatever others, are one room in two places."""
    assert not circle(ALLOWED)


def test_a_circle_is_seen():
    """One that passes through a third room, beside rooms that are in none."""
    found = circle({"a": {"b", "d"}, "b": {"c"}, "c": {"a"}, "d": set(), "e": {"a"}})
    assert found[0] == found[-1]
    assert set(found) == {"a", "b", "c"}
    assert circle({**ALLOWED, "eal": {"mocap/tracking"}})


def test_every_package_is_in_the_table():
    """A package that the table does not name would be free to import anything."""
    packages = {p.parent.name for p in ROOT.glob("*/__init__.py")}
    packages |= {f"mocap/{p.parent.name}" for p in ROOT.glob("mocap/*/__init__.py")} | {"eal/joint_design"}
    alone = {f"mocap/{name}" for name in ALONE}
    assert packages - set(OUTSIDE) | set(COMMANDS.values()) == set(ALLOWED) - alone


@pytest.mark.parametrize("name", SATELLITES)
def test_the_rest_does_without_a_satellite(name):
    """No room but its own, and those of satellites that say so, may import it: and none does (the tests above)."""
    assert ROOMS_OF[name] <= set(ALLOWED)
    theirs = set().union(ROOMS_OF[name], *(ROOMS_OF[other] for other, one in SATELLITES.items() if name in one.needs))
    assert [room for room, may in ALLOWED.items() if may & ROOMS_OF[name] and room not in theirs] == []


@pytest.mark.parametrize(
    "package", sorted(ALLOWED.keys() - {"mocap", *(f"mocap/{name}" for name in ALONE)} - set(COMMANDS.values()))
)
def test_every_package_says_what_it_takes_gives_and_touches(package):
    """And where it says that it touches no file, nothing of it opens or writes one."""
    text = ast.get_docstring(ast.parse((ROOT / package / "__init__.py").read_text(encoding="utf-8")))
    for said in (r"\bcomes?\s+in\b", r"\bgo(es)?\s+out\b", r"\bIt\s+touches\b"):
        assert re.search(said, text), said
    if re.search(r"touches\s+no\s+file", text):
        for path in (ROOT / package).rglob("*.py"):
            used = re.search(r"\bopen\(|\.(write|read)_(text|bytes)\(|import (os|shutil|tempfile)\b", path.read_text())
            assert used is None, f"{path}: {used}"


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("eal/a.py", "import mocap"),
        ("filters/a.py", "from mocap.errors import FormatError"),
        ("mocap/__init__.py", "from mocap.cli.main import main"),
        ("mocap/io/a.py", "from mocap.filters.track import smooth"),
        ("mocap/tracking/a.py", "from filters.track import smooth"),
        ("eal/a.py", "def f():\n    from mocap.records import Status"),
        ("eal/integrators/a.py", "from ... import mocap"),
        ("datasets/a.py", "import numpy, mocap.filters.track as k"),
        ("filters/a.py", "import mocap.recording"),
        ("filters/a.py", "import importlib\nimportlib.import_module('mocap.datasets.bats')"),
        ("filters/a.py", "import cv2"),
        ("mocap/cli/a.py", "import rerun as rr"),
        ("mocap/cli/main.py", "from mocap.cli.batch import batch"),
        ("mocap/cli/track.py", "def f():\n    from mocap.desk.desk import Desk"),
        ("mocap/tracking/a.py", "from mocap.calibration.wand import calibrate_wand"),
        ("eal/a.py", "from eal.joint_design import Law"),
        ("mocap/a.py", "from filterpy.kalman import KalmanFilter"),
        ("mocap/cli/a.py", "from tests.real_data import real"),
        ("mocap/a.py", "from mocap.io.csv_table import read"),
        ("mocap/io/a.py", "from mocap.report.job import run_job"),
        ("mocap/kinematics/a.py", "import mocap.io.c3d"),
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
        ("mocap/reproduce/deep/a.py", "from mocap.datasets import make_bat"),
        ("filters/motion/a.py", "from .base import MotionModel\nfrom eal import fit_potential\nimport filterpy"),
        ("datasets/a.py", "import cv2\nfrom mocap.cameras.camera import Camera"),
        ("mocap/io/a.py", "from ..errors import FormatError\nfrom . import csv_table"),
    ],
)
def test_a_right_direction_passes(path, source):
    """What the table allows is no finding, relative imports of the own package included."""
    assert not trouble(source, path)
