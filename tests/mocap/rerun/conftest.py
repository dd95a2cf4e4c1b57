"""Slow looks through a browser or a window are marked ``viewer``: leave them out with -m 'not viewer'."""

import pytest


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "viewer: opens a browser or a window, which takes its time")
