"""One browser for all pages of a file."""

import json

import pytest

from tests.mocap.rerun.browser import chromium


@pytest.fixture(scope="module")
def _browser():
    with chromium() as driver:
        yield driver


@pytest.fixture
def driver(_browser):
    """A browser at no page, whose log of requests is empty."""
    _browser.get("about:blank")
    requests_of(_browser)
    yield _browser
    _browser.get("about:blank")


def requests_of(driver):
    """Addresses that the page and what it holds asked for since the last time."""
    log = [json.loads(entry["message"])["message"] for entry in driver.get_log("performance")]
    return [m["params"]["request"]["url"] for m in log if m["method"] == "Network.requestWillBeSent"]
