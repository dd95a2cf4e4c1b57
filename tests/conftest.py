"""What all tests share: the root on the path, property tests of one verdict, and who runs what in parallel."""

import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))  # `tests.reference` and `tests.real_data`, however pytest was started

settings.register_profile(
    "project", deadline=None, derandomize=True, max_examples=40, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("project")


def pytest_collection_modifyitems(items: Sequence[pytest.Item]) -> None:
    """A file runs on one worker, as its fixtures are made once; so do all that show something on a screen."""
    for item in items:
        group = "view" if item.path.parent.name == "view" else str(item.path)
        item.add_marker(pytest.mark.xdist_group(group))
