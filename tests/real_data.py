"""Real recordings, made by other people with other programs; they are not part of the project."""

import os
from pathlib import Path

import pytest

FOLDER = Path(os.environ.get("MOCAP_REAL_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
"""Where they lie: the environment variable MOCAP_REAL_DATA, or ``../shared/data`` beside the project."""


def real(*parts: str) -> Path:
    """A file or folder of a real recording; skips the test that asks for it where it is absent."""
    path = FOLDER.joinpath(*parts)
    if not path.exists():
        pytest.skip(f"no real recording {'/'.join(parts)}: set MOCAP_REAL_DATA to the folder that holds it")
    return path
