"""The desk in the hands of who uses no mouse, or reads at one and a half times the size."""

import os
import shutil
from contextlib import contextmanager
from pathlib import Path

import pytest
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.keys import Keys

from mocap.batches.one import track_trial
from mocap.desk.page import desk_page
from mocap.reading.edits import read_edits
from mocap.web.server import served
from tests.mocap.desk.conftest import until
from tests.mocap.desk.filmed_trial import trial
from tests.mocap.desk.test_desk import OPTIONS, desk_of

ROOMS = ("trials", "skeleton", "proof", "angles")
CUT = """
const seen = [...document.querySelectorAll("header *, footer *, main.now *")].filter(e => e.checkVisibility());
const boxes = [document.documentElement, ...document.querySelectorAll("main.now section, main.now .side, #table")];
const wide = Math.max(...boxes.map(e => e.scrollWidth - e.clientWidth));
const reached = e => {
  e.scrollIntoView({ block: "nearest", inline: "nearest" });
  const r = e.getBoundingClientRect(), at = document.elementFromPoint(r.x + r.width / 2, r.y + r.height / 2);
  return at && (e.contains(at) || at.contains(e));
};
const lost = seen.filter(e => ["BUTTON", "INPUT", "SELECT"].includes(e.tagName) && !e.disabled && !reached(e));
return [...(wide > 0 ? [`${wide} px to the right`] : []), ...lost.map(e => e.outerHTML.slice(0, 90))];
"""
"""What a person cannot get at: a page that is scrolled across, controls that are cut off or covered."""


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return trial(tmp_path_factory.mktemp("access"))


@pytest.fixture(scope="module")
def tracked(scene, tmp_path_factory):
    """The result of its trial."""
    out = tmp_path_factory.mktemp("tracked") / "out"
    with desk_of(scene, out) as desk:
        assert track_trial(desk.trials["flight"], OPTIONS, out).status == "done"
    return out


@contextmanager
def at_size(driver, width, height, scale):
    """As a screen shows it that has ``scale`` dots for a pixel of the page."""
    screen = {"width": width, "height": height, "deviceScaleFactor": scale, "mobile": False}
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", screen)
    try:
        yield
    finally:
        driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def pictured(driver, name):
    """Keep a screenshot where ``MOCAP_SCREENS`` names a folder."""
    if (folder := os.environ.get("MOCAP_SCREENS")) is not None:
        driver.save_screenshot(str(Path(folder) / f"{name}.png"))


def keyed(driver, *keys):
    """Keys to whatever has the focus."""
    does = ActionChains(driver)  # as a keyboard does, which asks no element whether it is seen
    for key in keys:
        if key == Keys.CONTROL:
            does.key_down(key)
        elif key == Keys.NULL:
            does.key_up(Keys.CONTROL)
        else:
            does.send_keys(key)
    does.perform()


def tab_to(driver, wanted, most=120):
    """The Tab key until a control has the focus: a condition on ``e``."""
    for _ in range(most):
        keyed(driver, Keys.TAB)
        if driver.execute_script(f"const e = document.activeElement; return Boolean({wanted})"):
            outline = driver.execute_script("return getComputedStyle(document.activeElement).outlineStyle")
            assert outline == "solid", f"the focus is not seen: {wanted}"
            return
    raise AssertionError(f"the Tab key does not lead to it: {wanted}")


def opened_rooms(driver, address):
    """A page with all rooms of a trial open."""
    driver.get(address)
    until(driver, "document.body.dataset.ready === '1'")
    driver.find_element("class name", "bones").click()
    until(driver, "document.body.dataset.sketched === '1'")
    driver.execute_script("room('trials'); queued(() => document.querySelector('.read').click())")
    until(driver, "document.body.dataset.opened === '1'")


@pytest.mark.parametrize(("width", "height", "scale"), [(853, 533, 1.5), (1280, 800, 1.0), (1920, 1080, 1.0)])
def test_nothing_is_cut_off(scene, tracked, driver, width, height, scale):
    """On 1280 x 800 at 150 %, as it is, and on a large screen: all controls of all rooms can be got at."""
    with desk_of(scene, tracked) as desk, served(desk_page(desk)) as site, at_size(driver, width, height, scale):
        opened_rooms(driver, site.address)
        for room in ROOMS:
            driver.find_element("css selector", f"[data-room={room}]").click()
            if room == "angles":
                until(driver, "document.body.dataset.curve !== undefined")
            assert driver.execute_script(CUT) == [], room
            pictured(driver, f"{room}_{width}")


def test_a_trial_is_corrected_by_keys_alone(scene, tracked, tmp_path, driver):
    """From the table to a range that is deleted and taken back, an angle and its joint's map, and a bone: no mouse."""
    out = tmp_path / "out"
    shutil.copytree(tracked, out)
    with desk_of(scene, out) as desk, served(desk_page(desk)) as site:
        driver.get(site.address)
        until(driver, "document.body.dataset.ready === '1'")
        tab_to(driver, "e.className === 'read'")
        keyed(driver, Keys.ENTER)
        until(driver, "document.body.dataset.opened === '1'")
        keyed(driver, "f")
        keyed(driver, "41", Keys.ENTER)
        until(driver, "document.body.dataset.frame === '40'")
        tab_to(driver, "e.id === 'first'")
        keyed(driver, Keys.CONTROL, "a", Keys.NULL, "41")
        tab_to(driver, "e.id === 'last'")
        keyed(driver, Keys.CONTROL, "a", Keys.NULL, "43")
        tab_to(driver, "e.id === 'delete'")
        keyed(driver, Keys.ENTER)
        until(driver, "document.body.dataset.changed === '1'")
        until(driver, "Number(document.body.dataset.settled) >= 1")
        log = out / "edits" / "flight" / "edits.jsonl"
        assert [(edit.what, edit.frame, edit.last) for edit in read_edits(log)] == [("delete", 41, 43)]
        tab_to(driver, "e.id === 'undo'")
        keyed(driver, Keys.ENTER)
        until(driver, "document.body.dataset.changed === '2'")
        assert read_edits(log)[-1].what == "undo"
        tab_to(driver, "e.dataset.room === 'angles'")
        keyed(driver, Keys.ENTER)
        until(driver, "document.body.dataset.curve !== undefined")
        tab_to(driver, "e.id === 'joint'")
        keyed(driver, Keys.ARROW_DOWN)
        until(driver, "document.body.dataset.mapped === '1'")
        tab_to(driver, "e.id === 'plots'")
        keyed(driver, Keys.ARROW_RIGHT)
        until(driver, "Number(document.body.dataset.frame) >= 1")
        tab_to(driver, "e.dataset.room === 'trials'")
        keyed(driver, Keys.ENTER)
        tab_to(driver, "e.className === 'bones'")
        keyed(driver, Keys.ENTER)
        until(driver, "document.body.dataset.sketched === '1'")
        bones = driver.execute_script("return drawn.bones.length")
        keyed(driver, Keys.ENTER)
        keyed(driver, Keys.ARROW_DOWN, Keys.ARROW_DOWN, Keys.ARROW_DOWN)
        keyed(driver, Keys.ENTER)
        until(driver, f"drawn.bones.length !== {bones}")
