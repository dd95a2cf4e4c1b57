"""What pages, benchmarks and tests import of our packages is there, also where nothing runs them."""

import ast
import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
OURS = ("mocap", "eal", "filters", "datasets", "benchmarks", "docs", "tests")
NEEDED = {"jax", "rerun", "selenium", "playwright", "matplotlib", "cv2", "mujoco"}
"""Of extras; without one of them a module that needs it is not looked at."""


def imported(folder):
    """(file, line, module, name) of each name that is imported of ours."""
    for path in sorted((ROOT / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.level == 0 and (node.module or "").split(".")[0] in OURS:
                for one in node.names:
                    yield path.relative_to(ROOT), node.lineno, node.module, one.name


def is_there(module, name):
    """Whether a module has a name, or a module below it."""
    try:
        found = importlib.import_module(module)
    except ModuleNotFoundError as error:
        return error.name in NEEDED
    if hasattr(found, name):
        return True
    try:
        importlib.import_module(f"{module}.{name}")
    except ModuleNotFoundError as error:
        return error.name in NEEDED
    return True


@pytest.mark.parametrize("folder", ["docs", "benchmarks", "tests"])
def test_what_is_imported_is_there(folder):
    """A name that was taken out is named with the file and the line that still want it."""
    wanted = {}
    for path, line, module, name in imported(folder):
        wanted.setdefault((module, name), f"{path}:{line}: from {module} import {name}")
    assert wanted
    assert not is_there("docs.tools.view_pictures", "comparison_blueprint")
    assert [where for (module, name), where in wanted.items() if not is_there(module, name)] == []
