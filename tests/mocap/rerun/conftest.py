"""Slow looks through a browser or a window are marked ``viewer``: leave them out with -m 'not viewer'."""

import pytest
from vulkan import need_vulkan

from tests.mocap.rerun.headless import Headless


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "viewer: opens a browser or a window, which takes its time")


@pytest.fixture(scope="session")
def viewer():
    """One viewer without a screen for all that is looked at in a window of any size."""
    need_vulkan()
    with Headless(size=(640, 460)) as headless:
        yield headless
