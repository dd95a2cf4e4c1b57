"""What to type for an extra: where this program came from decides it."""

import json
from importlib.metadata import PackageNotFoundError
from types import SimpleNamespace

import pytest

from eal import needs


@pytest.fixture
def told(monkeypatch):
    """State what pip noted where it installed this program; None: nothing."""

    def state(noted):
        needs.installing.cache_clear()
        monkeypatch.setattr(needs, "distribution", lambda name: SimpleNamespace(read_text=lambda file: noted))  # noqa: ARG005

    yield state
    needs.installing.cache_clear()


def test_a_clone_names_its_folder(told, tmp_path):
    """An index does not have what was installed of a folder, or not the same."""
    told(json.dumps({"url": tmp_path.as_uri(), "dir_info": {"editable": True}}))
    assert needs.installing("web") == f"pip install --editable '{tmp_path}[web]'"


def test_a_wheel_names_itself(told, tmp_path):
    """As long as it is there."""
    wheel = tmp_path / "eal mocap.whl"
    told(json.dumps({"url": wheel.as_uri(), "archive_info": {}}))
    assert needs.installing("film") == "pip install 'eal-mocap[film]'"
    wheel.touch()
    needs.installing.cache_clear()
    assert needs.installing("film") == f"pip install '{wheel}[film]'"


@pytest.mark.parametrize("noted", [None, "{", json.dumps({"url": "https://example.org/a.zip"})])
def test_an_index_is_asked_by_name(told, noted):
    """Also where the note is damaged."""
    told(noted)
    assert needs.installing("excel") == "pip install 'eal-mocap[excel]'"


def test_of_a_search_path_nothing_is_known(told, monkeypatch):
    """The name is what can be said."""
    told(None)

    def absent(name):
        raise PackageNotFoundError(name)

    monkeypatch.setattr(needs, "distribution", absent)
    assert needs.installing("web") == "pip install 'eal-mocap[web]'"
