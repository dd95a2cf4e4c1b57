"""How the desk's page looks and is used: a season in one table, by keys alone, read by a person of weak sight."""

import os
from hashlib import sha256
from importlib.resources import files
from pathlib import Path

import pytest
from selenium.webdriver.common.keys import Keys

from mocap.batches.trial import Options, Trial
from mocap.desk.desk import Desk
from mocap.desk.page import desk_page
from mocap.web.server import served
from tests.mocap.desk.conftest import until

SCREEN = (1280, 800)
HASHES = {
    "uPlot.iife.min.js": "19c8d4c6ad88929a79f4ae49d6f7161566dfd0ba3d15cc495e974f787eb78f1f",
    "uPlot.min.css": "df630c6a8d6f8eeaff264b50f73ce5b114f646ffd9a0bb74f049b0a00135fa04",
    "uPlot-LICENSE.md": "8f989229699b4fe2f1a0432d0e9edc338a8a911e250e2d1b01ecd770a5f5b1bd",
}
"""Of uPlot 1.6.32, as its authors publish it."""
NAMELESS = """
const named = e => e.getAttribute("aria-label") || e.title || (e.labels && e.labels.length)
  || (e.tagName !== "SELECT" && e.textContent.trim());
const all = [...document.querySelectorAll("button, input, select, progress, iframe")];
return all.filter(e => !named(e)).map(e => e.outerHTML.slice(0, 80));
"""
CONTRAST = """
const channel = v => { v /= 255; return v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4; };
const numbers = c => c.match(/[\\d.]+/g).map(Number);
const light = c => { const [r, g, b] = numbers(c).map(channel); return 0.2126 * r + 0.7152 * g + 0.0722 * b; };
const opaque = c => numbers(c).length < 4 || numbers(c)[3] > 0;
const grounds = e => e ? [getComputedStyle(e).backgroundColor, ...grounds(e.parentElement)] : [];
const written = e => !e.disabled && [...e.childNodes].some(n => n.nodeType === 3 && n.textContent.trim());
const ratio = e => {
  const two = [getComputedStyle(e).color, grounds(e).find(opaque)].map(light), [a, b] = two.sort((x, y) => y - x);
  return (a + 0.05) / (b + 0.05);
};
const texts = [...document.querySelectorAll("main.now *, header *, footer *")].filter(written);
return texts.filter(e => ratio(e) < 4.5).map(e => [ratio(e), e.outerHTML.slice(0, 90)]);
"""
ROOM = "document.querySelectorAll('main').forEach(m => m.classList.toggle('now', m.id === arguments[0]))"


@pytest.fixture(scope="module")
def season(tmp_path_factory):
    """A desk of sixty trials whose names begin alike, and its page."""
    folder = tmp_path_factory.mktemp("season")
    names = [f"carollia_2April2021_078A3m_high_speed_trial{n:02d}" for n in range(60)]
    trials = {name: Trial(name=name, paths=(folder / f"{name}_xypts.csv",)) for name in names}
    trials[names[7]] = Trial(
        name=names[7], paths=trials[names[7]].paths, skip="two calibrations would do: state one of them"
    )
    desk = Desk(out=folder / "out", trials=trials, options=Options(model="constant_velocity"))
    with served(desk_page(desk)) as site:
        yield desk, site.address


@pytest.fixture
def page(season, driver):
    """Its page on a small screen."""
    screen = {"width": SCREEN[0], "height": SCREEN[1], "deviceScaleFactor": 1, "mobile": False}
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", screen)
    driver.get(season[1])
    until(driver, "document.body.dataset.ready === '1'", 60)
    yield driver
    driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})
    driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def in_colours(page, scheme):
    """As a person has it who chose light or dark."""
    page.execute_cdp_cmd(
        "Emulation.setEmulatedMedia", {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
    )


def test_what_is_not_ours_is_as_its_authors_publish_it():
    """A library in the page is byte for byte that of its release, with its licence."""
    room = files("mocap.desk")
    assert {name: sha256(room.joinpath(name).read_bytes()).hexdigest() for name in HASHES} == HASHES


def test_sixty_trials_stand_in_one_table_beside_their_details(page):
    """No line is higher than 36 px, nothing scrolls across, details lie right of the table, worst first by a click."""
    rows = page.find_elements("css selector", "#rows tr")
    assert len(rows) == 60
    assert max(row.size["height"] for row in rows) <= 36
    wide = "return [document.documentElement, $('table'), $('details')].map(e => e.scrollWidth - e.clientWidth)"
    assert max(page.execute_script(wide)) <= 0
    left, right = page.find_element("id", "table").rect, page.find_element("id", "details").rect
    assert right["x"] >= left["x"] + left["width"]
    assert right["y"] < left["y"] + left["height"] / 2
    page.find_elements("css selector", "#titles button")[2].click()
    assert "two calibrations" in page.find_element("css selector", "#rows tr").text
    page.find_element("id", "filter").send_keys("trial07")
    assert len(page.find_elements("css selector", "#rows tr")) == 1
    assert page.find_element("id", "howmany").text == "1 of 60"


def test_a_trial_is_chosen_and_taken_in_by_keys_alone(page, season):
    """Down from the first row, then on to the buttons of its details: the focus is seen, and Enter works."""
    page.execute_script("document.querySelector('#rows .name').focus()")
    for _ in range(7):
        page.switch_to.active_element.send_keys(Keys.ARROW_DOWN)
    assert page.find_element("id", "whose").text.endswith("trial07")
    assert page.execute_script("return getComputedStyle(document.activeElement).outlineStyle") == "solid"
    for _ in range(80):
        page.switch_to.active_element.send_keys(Keys.TAB)
        if page.switch_to.active_element.get_attribute("class") == "skip":
            break
    page.switch_to.active_element.send_keys(Keys.ENTER)
    until(page, "document.querySelector('.skip').textContent === 'Leave out'", 60)
    assert not season[0].trials["carollia_2April2021_078A3m_high_speed_trial07"].skip


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_every_control_has_a_name_and_every_text_its_contrast(page, scheme):
    """In all rooms, light and dark: no control without a name, 4.5 to 1 between text and ground (WCAG 2.2, 1.4.3)."""
    in_colours(page, scheme)
    assert page.execute_script(NAMELESS) == []
    for room in ("trials", "skeleton", "proof", "angles"):
        page.execute_script(ROOM, room)
        assert page.execute_script(CONTRAST) == []


@pytest.mark.skipif("MOCAP_AXE" not in os.environ, reason="MOCAP_AXE names no axe.min.js of the npm package axe-core")
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing_serious(page, scheme):
    """In all rooms, by the rules of axe-core."""
    in_colours(page, scheme)
    page.execute_script(Path(os.environ["MOCAP_AXE"]).read_text(encoding="utf-8"))
    for room in ("trials", "skeleton", "proof", "angles"):
        page.execute_script(ROOM, room)
        found = page.execute_async_script("axe.run().then(r => arguments[arguments.length - 1](r.violations))")
        assert [one["id"] for one in found if one["impact"] in ("serious", "critical")] == []
