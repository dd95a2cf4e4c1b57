"""Films that are digitised in the desk: real clicks in a real browser, each on the disk at once."""

import asyncio
import errno
import json
import os
import subprocess
import sys
from contextlib import contextmanager

import httpx2
import numpy as np
import pytest
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.keys import Keys
from starlette.responses import HTMLResponse
from starlette.routing import Route

from mocap.batches.trial import Options
from mocap.desk.desk import Desk
from mocap.desk.page import desk_page
from mocap.desk.pictures import moving_box
from mocap.desk.session import SAVED, WHAT_TO_DO, open_session
from mocap.digitising.clicks import Click, read_clicks
from mocap.digitising.videos import open_videos
from mocap.errors import MocapError
from mocap.io.manifest import occupied
from mocap.web.server import served
from mocap.web.tasks import page
from tests.mocap.desk.conftest import client, requests_of, until
from tests.mocap.digitising.filmed import NAMES, SIZE, video


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return video(tmp_path_factory.mktemp("page"), 12)


# where each press of the mouse arrived, from the middle of its canvas, in pixels of the screen
PRESSES = """
window.presses = [];
document.addEventListener("mousedown", e => {
  const r = e.target.getBoundingClientRect();
  window.presses.push([e.clientX - r.left - r.width / 2, e.clientY - r.top - r.height / 2]);
}, true);
"""
# corners of what a camera's pane shows, in pixels as files count them
CORNERS = """
const v = views[arguments[0]], s = scale(v), half = [v.canvas.width / s / 2, v.canvas.height / s / 2];
return [-1, 1].map(side => [0, 1].map(k => v.at[k] + side * half[k] + 0.5));
"""
MOVES = [NAMES.index(name) for name in ("nose", "hand", "left")]
SNAP_PX = 3.0
AIM_PX = 3.0  # of the screen: the driver rounds an aim, and cuts off parts of a pixel, more than once


def session_of(scene, folder, start=None):
    where = scene.folder
    return open_session(
        [where / "films"],
        calibration=where / "calibration.toml",
        skeleton=where / "skeleton.toml",
        folder=folder,
        start=start,
        fps=100.0,
    )


@contextmanager
def shown(session):
    """The address of its page."""
    desk = Desk(out=session.folder, trials={}, options=Options(), proof=session)
    with served(desk_page(desk)) as site:
        yield site.address


def test_clicks_in_a_browser_become_tracks(scene, tmp_path, driver):
    """All markers are clicked in two films with the mouse and their keys, named, undone; no other host."""
    session = session_of(scene, tmp_path / "out")
    with shown(session) as address:
        driver.get(address)
        until(driver, "document.body.dataset.ready === '1'")
        driver.execute_script(PRESSES)
        assert driver.execute_script("return $('said').textContent") == WHAT_TO_DO
        for camera in range(3):  # the first look is at what moves, all of it, before anything is clicked
            corners = driver.execute_script(CORNERS, camera)
            assert (corners[0] < scene.uv_px[camera, 0, MOVES]).all()
            assert (corners[1] > scene.uv_px[camera, 0, MOVES]).all()
        count, aimed = 0, []
        for marker in range(len(NAMES)):
            driver.find_element("tag name", "body").send_keys("/")
            driver.switch_to.active_element.send_keys(driver.execute_script(f"return codes[{marker}]"))
            for camera in (0, 1):
                canvas = driver.find_element("id", f"film{camera}")
                zoom, at = driver.execute_script(f"const v = views[{camera}]; return [scale(v), v.at]")
                # pixels of the screen from the middle of the canvas, the mouse 1.5 px of the image beside the dot
                u, v = (scene.uv_px[camera, 0, marker] - 0.5 - at + (1.5, 0)) * zoom
                ActionChains(driver).move_to_element_with_offset(canvas, round(u), round(v)).click().perform()
                count += 1
                aimed.append((camera, marker))
                until(driver, f"Number(document.body.dataset.settled) === {count + 1}")
                assert driver.execute_script("return $('said').textContent") == WHAT_TO_DO
        saved = read_clicks(tmp_path / "out" / SAVED, scene.skeleton, n_cameras=3, n_frames=12)
        assert len(saved) == 14
        presses = dict(zip(aimed, driver.execute_script("return window.presses"), strict=True))
        for click in saved:
            zoom, at = driver.execute_script(f"const v = views[{click.camera}]; return [scale(v), v.at]")
            arrived = np.array(presses[click.camera, click.marker]) / zoom + np.array(at) + 0.5
            truth = scene.uv_px[click.camera, 0, click.marker]
            assert np.linalg.norm(arrived - truth) < SNAP_PX
            assert np.linalg.norm(np.subtract(click.uv_px, truth)) < 0.3  # a careful hand misses by as much
        body = driver.find_element("tag name", "body")
        body.send_keys(Keys.ENTER)
        until(driver, "document.body.dataset.found === '1'")
        found = session.found
        assert found is not None
        away = np.linalg.norm(found.pixels.uv_px - scene.uv_px, axis=-1)
        assert np.nanmedian(away[:, 1:]) < 0.3
        assert np.isfinite(away).mean() > 0.85
        body.send_keys(Keys.ARROW_RIGHT)
        until(driver, "document.body.dataset.frame === '1'")
        for text, said in (("1.200", "frame 12 is the last one"), ("12,5", '"12,5" is not the number of a frame')):
            driver.execute_script("$('frame').value = arguments[0]; $('frame').onchange({ target: $('frame') })", text)
            until(driver, f"$('said').textContent === {json.dumps(said)}")
            assert driver.execute_script("return frame") == 11
        body.send_keys(Keys.BACKSPACE)
        until(driver, f"document.body.dataset.settled === '{count + 2}'")
        assert len(session.clicks) == 13
        asked = set(requests_of(driver))
        assert all(url.startswith((address, "data:")) for url in asked)
        assert len([url for url in asked if "/picture" in url]) >= 6


def test_a_track_is_corrected_in_a_browser(scene, tmp_path, driver):
    """A mark that is dragged is a click where it is let go; names are swapped, a range deleted, each is one undo."""
    session = session_of(scene, tmp_path / "out")
    session.clicks += scene.clicks()
    session.run()
    nose, tail = NAMES.index("nose"), NAMES.index("tail")
    before = session.found.pixels.uv_px.copy()

    with shown(session) as address:
        driver.get(address)
        until(driver, "document.body.dataset.ready === '1'")
        body = driver.find_element("tag name", "body")
        body.send_keys(Keys.ARROW_RIGHT)
        until(driver, "document.body.dataset.frame === '1'")
        canvas = driver.find_element("id", "film0")
        scale, at = driver.execute_script("return [scale(views[0]), views[0].at]")
        u, v = ((before[0, 1, tail] - 0.5 - at) * scale).round().astype(int).tolist()
        drag = ActionChains(driver).move_to_element_with_offset(canvas, u, v).click_and_hold()
        drag.move_by_offset(40, 24).release().perform()
        until(driver, "document.body.dataset.settled === '2'")
        dragged = session.clicks[-1]
        assert (dragged.camera, dragged.frame, dragged.marker) == (0, 1, tail)
        off = np.subtract(dragged.uv_px, before[0, 1, tail]) - np.array([40, 24]) / scale
        assert np.abs(off).max() < AIM_PX / scale
        body.send_keys(Keys.BACKSPACE)
        until(driver, "document.body.dataset.settled === '3'")
        driver.find_elements("css selector", "#codes button")[nose].click()
        for name, value in (("first", "4"), ("last", "6")):
            driver.find_element("id", name).send_keys(value)
        driver.execute_script(f"document.getElementById('other').value = '{tail}'")
        driver.find_element("id", "exchange").click()
        until(driver, "document.body.dataset.settled === '4'")
        np.testing.assert_allclose(session.found.pixels.uv_px[:, 3:6, nose], before[:, 3:6, tail], atol=1e-4)
        driver.find_element("id", "delete").click()
        until(driver, "document.body.dataset.settled === '5'")
        assert np.isnan(session.found.pixels.uv_px[:, 3:6, nose]).all()
        again = session_of(scene, tmp_path / "out")
        gone = {(c.camera, c.frame) for c in again.clicks if c.marker == nose and c.uv_px is None}
        assert gone == {(camera, frame) for camera in range(3) for frame in (3, 4, 5)}
        for _ in range(2):
            driver.find_element("id", "undo").click()
        until(driver, "document.body.dataset.settled === '7'")
    assert session.clicks == scene.clicks()
    assert np.nanmax(np.linalg.norm(session.found.pixels.uv_px - before, axis=-1)) < 0.1


def test_swaps_and_deletions_are_asked_for_by_the_page(scene, tmp_path):
    """Refused before anything is named, and of markers and frames that there are not; saved, and one undo each."""
    session = session_of(scene, tmp_path / "out")
    session.clicks += scene.clicks()

    with shown(session) as address, client(address) as browser:

        def asked(path, **given):
            return browser.told(path, given, trial="out")

        span = {"first": 3, "last": 5}
        early = asked("delete", marker=0, **span)
        assert early.status_code == 409
        assert "nothing is named yet" in early.json()["said"]
        session.run()
        before = session.found.pixels.uv_px.copy()
        asked("exchange", marker=0, other=6, **span)
        assert asked("settle").json()["said"] == "frames 4 to 6 were named again"
        np.testing.assert_allclose(session.found.pixels.uv_px[:, 3:6, 0], before[:, 3:6, 6], atol=1e-4)
        asked("delete", marker=0, **span)
        asked("settle")
        assert np.isnan(session.found.pixels.uv_px[:, 3:6, 0]).all()
        again = session_of(scene, tmp_path / "out")
        gone = {(c.camera, c.frame) for c in again.clicks if c.marker == 0 and c.uv_px is None}
        assert gone == {(camera, frame) for camera in range(3) for frame in (3, 4, 5)}
        for wrong in ({"marker": -1, **span}, {"marker": 99, **span}, {"marker": 0}):
            assert asked("delete", **wrong).status_code == 400
        assert asked("delete", marker=0, first=5, last=99).status_code == 400
        assert "not a range" in asked("delete", marker=0, first=5, last=4).json()["said"]
        asked("undo")
        assert asked("undo").json()["said"] == "14 clicks"
        asked("settle")
    assert session.clicks == scene.clicks()
    assert np.nanmax(np.linalg.norm(session.found.pixels.uv_px - before, axis=-1)) < 0.1


def test_a_killed_session_goes_on(scene, tmp_path):
    """Another session on the same folder has all clicks; one that is not to be seen is no click of DLTdv."""
    first = session_of(scene, tmp_path / "out")
    for click in scene.clicks()[:5]:
        first.click(click)
    again = session_of(scene, tmp_path / "out")
    assert [(c.camera, c.frame, c.marker) for c in again.clicks] == sorted(
        (c.camera, c.frame, c.marker) for c in first.clicks
    )


def test_clicks_saved_earlier_are_not_replaced_by_others(scene, tmp_path):
    """First clicks and a folder that holds those of an earlier time: which is meant is asked, nothing is touched."""
    folder = tmp_path / "out"
    session = session_of(scene, folder)
    session.click(Click(camera=0, frame=0, marker=1, uv_px=(10.0, 20.0)))
    before = (folder / SAVED).read_bytes()
    other = tmp_path / "first_xypts.csv"
    other.write_bytes(before)
    with pytest.raises(MocapError, match="clicks that were made earlier"):
        session_of(scene, folder, start=other)
    assert (folder / SAVED).read_bytes() == before
    assert len(session_of(scene, folder, start=folder / SAVED).clicks) == 1


def test_what_cannot_be_saved_is_not_gone_on_with(scene, tmp_path, monkeypatch):
    """A click and an undo on a full disk: refused, and the next are saved without the one, with the other."""
    session = session_of(scene, tmp_path / "out")
    first, second, third = scene.clicks()[:3]
    session.click(first, second)

    def full(*_, **__):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    for refused in (lambda: session.click(third), session.undo):
        with monkeypatch.context() as patch:
            patch.setattr("mocap.desk.session.write_clicks", full)
            with pytest.raises(MocapError, match="No space left"):
                refused()
        assert (session.clicks, session.steps, session.changes) == ([first, second], [2], 1)
    session.undo()
    session.click(third)
    assert len(session_of(scene, tmp_path / "out").clicks) == 1


def test_two_programs_on_one_folder(scene, tmp_path):
    """The second ``mocap digitise --web`` says so and ends; a folder in which nothing was clicked is gone after it."""
    out = tmp_path / "new" / "out"
    words = ["digitise", scene.folder / "films", "--calibration", scene.folder / "calibration.toml", "--skeleton"]
    words += [scene.folder / "skeleton.toml", "--fps", "100", "--web", "--out", out]
    run = [sys.executable, "-c", "from mocap.cli.main import main; main()", *map(str, words)]
    with occupied(out, "mocap digitise --web"):
        second = subprocess.run(run, capture_output=True, text=True, timeout=180, check=False)
    assert second.returncode == 1
    (line,) = second.stderr.splitlines()
    assert "mocap digitise --web is open there already" in line
    assert not out.exists()


GOOD = {"camera": 0, "frame": 0, "marker": 0, "uv_px": [5, 5]}
NOT_CLICKS = [
    *({"camera": x} for x in (-1, 3, 0.9, 1.0, True, "0", None, [0], 10**30)),
    *({"frame": x} for x in (-1, 12, 0.5, False, "0", 2**31, 2**63)),
    *({"marker": x} for x in (-1, 7, 1e300, True, {})),
    *({"uv_px": x} for x in ([float("nan"), 5], [5, float("inf")], [1e300, 5], [-1, 5], [5, 241], [321, 5], [0, 5])),
    *(
        {"uv_px": x}
        for x in ([5], [5, 5, 5], [], ["5", "5"], [True, 5], {"u": 5, "v": 5}, "55", 5, [[5], [5]], [None, 5])
    ),
    {"more": 1},
]


@pytest.fixture(scope="module")
def open_page(scene, tmp_path_factory):
    """A session, and a browser at its page."""
    session = session_of(scene, tmp_path_factory.mktemp("attacked") / "out")
    with shown(session) as address, client(address) as browser:
        yield session, browser


@pytest.mark.parametrize("wrong", NOT_CLICKS, ids=repr)
def test_what_is_no_click_is_not_saved(open_page, wrong):
    """Of no camera, frame or marker, outside of the picture, not finite, of another type: refused, in one line."""
    session, browser = open_page
    answer = browser.post("place", content=json.dumps({**GOOD, "trial": "out", "edits": 0, **wrong}))
    assert answer.status_code == 400
    assert len(answer.json()["said"].splitlines()) == 1
    assert not session.clicks
    assert not session.folder.exists()


@pytest.mark.parametrize(
    "path",
    [
        *("frame?frame=%C2%B2&marker=0", "frame?frame=12&marker=0", "frame?frame=0&marker=7", "frame?frame=0"),
        *("picture?camera=3&frame=0", "picture?camera=0&frame=-1", "picture?camera=0&frame=1e400"),
        "picture?camera=0.9&frame=0",
        *(
            "places?after=252",
            "places?after=" + "9" * 9000,
            "open?trial=x&more=1",
            "scene/?url=http://x/",
        ),
    ],
)
def test_what_the_films_do_not_show_is_refused(open_page, path):
    """Numbers of other scripts, too large, negative; what is asked for beside."""
    assert open_page[1].get(path).status_code == 400


@pytest.mark.parametrize(
    "path", ["elsewhere", "scene/elsewhere", "%2e%2e/%2e%2e/etc/passwd", "scene/%2e%2e%2f%2e%2e%2fetc/passwd", "/etc"]
)
def test_there_are_no_other_files(open_page, path):
    """Paths lead to what is listed, not to files."""
    answer = open_page[1].get(path)
    assert answer.status_code == 404
    assert answer.json()["said"] == "Not Found"


TRIES = """
const [address, done] = arguments, tries = [];
for (const how of [{ mode: "no-cors", method: "POST", body: "{}" }, { mode: "cors", method: "POST", body: "{}" }, {}])
  tries.push(fetch(address + "undo", how).then(r => r.type, e => "refused"));
for (const [kind, path] of [["img", "picture?camera=0&frame=0"], ["script", "overview"]])
  tries.push(new Promise(then => {
    const part = document.createElement(kind);
    part.onload = () => then("seen"); part.onerror = () => then("refused"); part.src = address + path;
    document.body.append(part);
  }));
Promise.all(tries).then(done);
"""


def test_another_page_in_the_browser_can_do_nothing(scene, tmp_path, driver):
    """A page of another port that has got the token all the same: nothing is undone, no picture is shown there."""
    session = session_of(scene, tmp_path / "out")
    session.click(Click(camera=0, frame=0, marker=1, uv_px=(10.0, 20.0)))
    free = {"Content-Security-Policy": "default-src * 'unsafe-inline'"}
    other = page([Route("/", lambda _: HTMLResponse("<title>other</title><body></body>", headers=free))])
    with shown(session) as address, served(other) as site:
        driver.get(site.address)
        driver.set_script_timeout(60)
        found = driver.execute_async_script(TRIES, address)
        assert found == ["refused"] * 5
        asked = requests_of(driver)
        assert sum(url == f"{address}undo" for url in asked) >= 2  # they were sent
    assert len(session.clicks) == 1


def test_two_hundred_at_once_are_answered(open_page):
    """Pictures and frames, each on a connection of its own; the page works as before."""
    session, browser = open_page

    async def all_of_them():
        limits = httpx2.Limits(max_connections=200)
        async with httpx2.AsyncClient(base_url=browser.base_url, limits=limits, timeout=600) as many:
            places = [(i % 3, i % 12) for i in range(100)]
            paths = [f"picture?camera={camera}&frame={frame}" for camera, frame in places]
            paths += [f"frame?frame={frame}&marker={camera}" for camera, frame in places]
            return await asyncio.gather(*(many.get(path) for path in paths))

    assert {answer.status_code for answer in asyncio.run(all_of_them())} == {200}
    assert browser.told("place", GOOD, trial="out").json()["said"] == "1 click"
    assert browser.told("place", {**GOOD, "uv_px": [320.5, 240.5]}, trial="out").json()["said"] == "2 clicks"
    assert "two cameras" in browser.told("find", trial="out").json()["said"]
    for _ in range(2):
        browser.told("undo", trial="out")
    assert not session.clicks


def test_lines_pass_through_the_marker(scene, tmp_path):
    """A click in one film puts a line into the others on which the marker lies: epipolar geometry with lenses."""
    session = session_of(scene, tmp_path / "out")
    click = scene.clicks(sd_px=0.0)[0]
    session.click(click)
    for camera, shown in enumerate(session.frame(0, click.marker)["cameras"]):
        if camera == click.camera:
            assert not shown["lines"]
            continue
        line = np.array(shown["lines"][0])
        a, b = line[:-1], line[1:]
        along = b - a
        share = np.clip(
            np.sum((scene.uv_px[camera, 0, click.marker] - a) * along, axis=1) / np.sum(along**2, axis=1), 0, 1
        )
        near = a + share[:, None] * along
        away = np.linalg.norm(near - scene.uv_px[camera, 0, click.marker], axis=1)
        assert away.min() < 0.2


def test_what_moves_is_found(scene):
    """All that changed its place is inside, still images and those of which most changes have none."""
    videos = open_videos([scene.folder / "films"], scene.cameras)
    for camera in range(3):
        images = [videos.picture(camera, frame) for frame in (0, 4, 8)]
        box = moving_box(images)
        assert box is not None
        uv = scene.uv_px[camera, 0, MOVES] - 1
        assert (uv > box[:2]).all()
        assert (uv < box[2:]).all()
        assert (box[2] - box[0]) * (box[3] - box[1]) < 0.7 * SIZE[0] * SIZE[1]
    assert moving_box([images[0]] * 3) is None
    assert moving_box([images[0], images[0] // 2, images[0] // 2]) is None
    assert moving_box([images[0], None, images[1]]) is None
