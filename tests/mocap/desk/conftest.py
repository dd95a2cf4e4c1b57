"""One browser for all pages, and what asks and waits as a person does."""

import json
import time
from urllib.parse import urlsplit

import httpx2
import pytest

from tests.mocap.rerun.browser import chromium


@pytest.fixture(scope="session")
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


class Page(httpx2.Client):
    """What asks as the page does."""

    def told(self, path, what=None, *, trial="flight", **seen):
        """The answer to what a page changes that has seen all edits, unless ``edits`` says otherwise."""
        known = self.get("overview").json()["seen"]
        return self.post(path, json={**(what or {}), "trial": trial, "edits": known.get(trial, known[""]), **seen})


def client(address):
    """What asks as the page does."""
    origin = "http://" + urlsplit(address).netloc
    return Page(base_url=address, headers={"Origin": origin}, timeout=600)


def until(driver, script, seconds=300):
    """Wait for a condition of the page; what it says last is told where that does not come."""
    end = time.monotonic() + seconds
    while not driver.execute_script(f"return {script}"):
        assert time.monotonic() < end, (
            script,
            driver.execute_script("return document.getElementById('said').textContent"),
        )
        time.sleep(0.05)
