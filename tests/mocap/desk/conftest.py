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


def client(address):
    """What asks as the page does."""
    origin = "http://" + urlsplit(address).netloc
    return httpx2.Client(base_url=address, headers={"Origin": origin}, timeout=600)


def until(driver, script):
    """Wait for a condition of the page."""
    while not driver.execute_script(f"return {script}"):
        time.sleep(0.05)
