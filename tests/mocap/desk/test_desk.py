"""The desk as a person uses it: a folder is opened, tracked, corrected and passed on, in a real browser."""

import json
import os
import shutil
import signal
import subprocess
import sys
import textwrap
import time
from contextlib import contextmanager, suppress

import httpx2
import numpy as np
import pandas as pd
import psutil
import pytest
from PIL import Image
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.keys import Keys

import mocap
from docs.tools.desk_pictures import rooms, save
from mocap.batches.one import track_trial
from mocap.batches.trial import Options, Trial, read_manifest, write_manifest
from mocap.desk.desk import opened_desk
from mocap.desk.page import desk_page
from mocap.errors import MocapError
from mocap.io.manifest import current
from mocap.io.output import result_file
from mocap.reading.edits import read_edits
from mocap.records import Status
from mocap.rerun import share
from mocap.skeleton_files import read_skeleton
from mocap.web.server import served
from tests.mocap.batches.trap import second_held
from tests.mocap.desk.conftest import client, until
from tests.mocap.desk.filmed_trial import FPS, GAP, SWAPPED, trial
from tests.mocap.digitising.filmed import NAMES, SIZE

HAND, TAIL = NAMES.index("hand"), NAMES.index("tail")
OPTIONS = Options(model="constant_velocity", validate=False)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return trial(tmp_path_factory.mktemp("desk"))


@contextmanager
def desk_of(scene, out):
    where = scene.folder
    stated = {"calibration": where / "calibration.toml", "skeleton": where / "skeleton.toml", "fps": FPS}
    sources = [str(where / "flight_xypts.csv")]
    with opened_desk(sources, out, options=OPTIONS, jobs=1, arguments=stated) as desk:
        yield desk


def tracked(desk):
    desk.track()
    while desk.progress()["running"]:
        time.sleep(0.1)
    return desk.progress()


@pytest.fixture(scope="module")
def worked(scene, tmp_path_factory):
    """A desk whose trial was tracked, and a browser's client at its page."""
    with desk_of(scene, tmp_path_factory.mktemp("worked") / "out") as desk:
        assert track_trial(desk.trials["flight"], OPTIONS, desk.out).status == "done"
        with served(desk_page(desk)) as site, client(site.address) as browser:
            yield desk, browser


@pytest.mark.main
def test_a_person_opens_corrects_tracks_and_exports(scene, worked, tmp_path, driver):
    """A folder with a result is opened in a browser, three points are placed with the mouse, tracked again, passed on.

    What is passed on says `edited`, the log holds the three places, and its replay by the library gives the same bytes.
    """
    out = tmp_path / "out"
    shutil.copytree(worked[0].out / "flight", out / "flight")
    with desk_of(scene, out) as desk, served(desk_page(desk)) as site:
        driver.get(site.address)
        until(driver, "document.body.dataset.ready === '1'")
        driver.find_element("class name", "look").click()
        until(driver, "document.body.dataset.audits === '1'")
        driver.find_element("class name", "read").click()
        until(driver, "document.body.dataset.opened === '1'")
        first = driver.find_elements("class name", "place")[0].text
        assert first.startswith("hand, frame ")  # the gap, which a click settles most
        for n, frame in enumerate((GAP[6], GAP[2], GAP[9]), start=1):
            driver.find_element("tag name", "body").send_keys("f")
            driver.switch_to.active_element.send_keys(str(frame + 1), Keys.ENTER)
            until(driver, f"document.body.dataset.frame === '{frame}'")
            driver.execute_script("views.forEach(v => { v.zoom = 1; v.at = [v.size[0] / 2, v.size[1] / 2]; }); draw();")
            canvas = driver.find_element("id", "film0")
            size = canvas.size
            scale = min(size["width"] / SIZE[0], size["height"] / SIZE[1])
            u, v = ((scene.uv_px[0, frame, HAND] - 0.5 - np.array(SIZE) / 2) * scale).round().astype(int).tolist()
            ActionChains(driver).move_to_element_with_offset(canvas, u, v).click().perform()
            until(driver, f"document.body.dataset.changed === '{n}'")
            until(driver, f"Number(document.body.dataset.settled) >= {n + 1}")
        driver.find_element("css selector", "[data-room=trials]").click()
        until(driver, "document.querySelector('td.changed')")
        driver.find_element("id", "track").click()
        until(driver, "document.body.dataset.tracked === '1'")
        driver.find_element("class name", "pass").click()
        until(driver, "document.body.dataset.passed === '1'")
        assert (out / "flight" / "kinematics" / "report.html").is_file()
        asked = driver.execute_script("return performance.getEntriesByType('resource').map(r => r.name)")
        assert all(url.startswith((site.address, "data:")) for url in asked)
    edits = read_edits(out / "edits" / "flight" / "edits.jsonl")
    assert [(edit.what, edit.frame, edit.marker, edit.camera) for edit in edits] == [
        ("place", frame + 1, "hand", "cam1") for frame in (GAP[6], GAP[2], GAP[9])
    ]
    for edit in edits:
        assert np.abs(np.subtract(edit.uv_px, scene.uv_px[0, edit.frame - 1, HAND])).max() < 3
    result = mocap.load(out / "flight")
    assert (result.markers["repaired"].values[[GAP[2], GAP[6], GAP[9]], HAND, 0] == 2).all()
    again = mocap.read(
        scene.folder / "flight_xypts.csv",
        calibration=scene.folder / "calibration.toml",
        skeleton=scene.folder / "skeleton.toml",
        fps=FPS,
        edits=out / "edits" / "flight" / "edits.jsonl",
    )
    mocap.track(again, model="constant_velocity", validate=False).save(tmp_path / "replay")
    for name in ("markers.csv", "kinematics.csv"):
        assert current(out / "flight", name).read_bytes() == current(tmp_path / "replay", name).read_bytes()
    assert ",edited" in (out / "flight" / "markers.csv").read_text()


def test_a_result_is_passed_on_as_one_page(worked, monkeypatch):
    """With the command that does the same, of a result for which no recording was written.

    What the page holds of the viewer is looked at in `tests/mocap/rerun/test_view_share.py`: its program is left out.
    """
    desk, browser = worked
    page, script, _ = share.fetched_viewer()
    monkeypatch.setattr(share, "fetched_viewer", lambda: (page, script, b""))
    answer = browser.told("pass", {"kind": "page"})
    assert answer.status_code == 200, answer.text
    assert b"<title>flight</title>" in (desk.out / "flight" / "page" / "index.html").read_bytes()
    out = desk.out / "flight"
    assert desk.overview()["trials"][0]["passes"]["page"][1] == f"mocap share {out} --out {out / 'page'} --force"


def test_corrections_and_places_are_passed_on(worked):
    """As movement and SLEAP state them, with the command that does the same for the corrections."""
    desk, _ = worked
    said = desk.pass_on("flight", "edits")
    folder = desk.out / "flight" / "corrections"
    assert said == f"wrote 0 of 0 corrections and the places to check to {folder}"
    assert json.loads((folder / "edits.json").read_text()) == []
    listed = pd.read_csv(folder / "qc_results.csv")
    assert listed["score"].max() == 1
    assert listed["marker"].iloc[0] == "hand"
    command = f"mocap convert {desk.log('flight')} {folder / 'edits.json'} --force"
    assert desk.overview()["trials"][0]["passes"]["edits"][1] == command


def test_places_are_ranked_by_what_a_click_settles(worked):
    """The gap first; the click that was not believed is asked for, with that reason."""
    desk, browser = worked
    assert browser.get("open?trial=flight").status_code == 200
    found = browser.get("places").json()
    worth = [place["worth_mm2"] for place in found]
    assert worth == sorted(worth, reverse=True)
    top = found[0]
    assert NAMES[top["marker"]] == "hand"
    assert (top["first"], top["last"]) == (GAP[0], GAP[-1])
    doubted = [p for p in found if desk.proof.tracks.status[p["frame"], p["marker"]] == Status.REJECTED]
    assert all("not believed" in place["why"] for place in doubted)


@pytest.mark.main
def test_corrections_settle_at_once_and_are_taken_back(worked, scene):
    """Places, an exchange and a deletion change the tracks around them; undone, tracks and recording are as before."""
    desk, browser = worked
    browser.get("open?trial=flight")
    proof = desk.opened()
    before, pixels = proof.tracks, proof.recording.pixels.uv_px
    frame, at = GAP[5], {"frame": GAP[5], "marker": HAND}
    for camera in (0, 1):
        place = {**at, "camera": camera, "uv_px": scene.uv_px[camera, frame, HAND].tolist()}
        assert browser.told("place", place).json()["said"] == f"{camera + 1} correction{'s' * camera} kept"
    assert "known to" in browser.told("settle", {}).json()["said"]
    assert proof.tracks.status[frame, HAND] == Status.MEASURED
    assert np.linalg.norm(proof.tracks.xyz_m[frame, HAND] - scene.xyz_m[frame, HAND]) < 1e-3
    assert proof.tracks.sd_m[frame, HAND] < 0.5 * before.sd_m[frame, HAND]
    left, right = NAMES.index("left"), NAMES.index("right")
    span = {"first": SWAPPED[0], "last": SWAPPED[-1]}
    browser.told("exchange", {"marker": left, "other": right, **span})
    browser.told("delete", {"marker": TAIL, "first": 3, "last": 5})
    browser.told("settle", {})
    assert (proof.tracks.status[3:6, TAIL] != Status.MEASURED).all()
    shown = browser.get("frame", params=at).json()
    assert shown["status"] == "edited"
    assert shown["cameras"][0]["markers"][HAND]["edited"]
    for _ in range(4):
        browser.told("undo", {})
    browser.told("settle", {})
    assert browser.told("undo", {}).json()["said"] == "there is no correction to take back"
    np.testing.assert_array_equal(proof.recording.pixels.uv_px, pixels)
    for name in ("xyz_m", "cov_m2", "status"):
        assert getattr(proof.tracks, name).tobytes() == getattr(before, name).tobytes(), name
    log = desk.log("flight").read_bytes()
    assert log.count(b"\n") == 9  # the recording they are of, four corrections, and as many taken back


def test_lines_and_ellipses_are_where_the_marker_is(worked, scene):
    """The predicted ellipse of a marker contains its true pixel, and its lines pass through it."""
    _, browser = worked
    browser.get("open?trial=flight")
    frame, marker = 10, NAMES.index("nose")
    for c, camera in enumerate(browser.get("frame", params={"frame": frame, "marker": marker}).json()["cameras"]):
        centre = camera["markers"][marker]["ellipse"][:2]
        assert np.linalg.norm(np.subtract(centre, scene.uv_px[c, frame, marker])) < 1.5
        assert len(camera["lines"]) == 2
        for line in camera["lines"]:
            fine = np.linspace(0, len(line) - 1, 20 * len(line))
            fine = np.stack([np.interp(fine, range(len(line)), part) for part in np.transpose(line)], axis=-1)
            assert np.linalg.norm(fine - scene.uv_px[c, frame, marker], axis=1).min() < 2  # clicks are off by 0.3


@pytest.fixture(scope="module")
def drawn(worked):
    """The trial and its skeleton are open."""
    for page in ("open", "draft"):
        worked[1].get(f"{page}?trial=flight")
    return worked


DRAWN = {"names": list(NAMES), "bones": [], "trunk": [], "joints": {}, "dropped": []}
PLACE = {"camera": 0, "frame": 0, "marker": 0, "uv_px": [5, 5]}


@pytest.mark.parametrize(
    ("path", "wrong"),
    [
        *(("place", PLACE | more) for more in ({"camera": 3}, {"frame": -1}, {"marker": 7}, {"uv_px": [-3, 5]})),
        *(("place", PLACE | more) for more in ({"uv_px": [5, 1e9]}, {"frame": "0"}, {"who": "me"})),
        ("delete", {"marker": 0, "first": 0, "last": 60}),
        ("exchange", {"marker": 0, "other": 9, "first": 0, "last": 1}),
        ("state", {"name": "calibration", "value": "/etc/passwd"}),
        ("state", {"name": "fit_lens", "value": "rm"}),
        ("pass", {"kind": "../x"}),
        ("track", {"model": "x"}),
        *(("skeleton", DRAWN | more) for more in ({"bones": [[0, 7, True]]}, {"trunk": [-1]}, {"path": "/etc/x"})),
        *(("skeleton", DRAWN | more) for more in ({"bones": [[0, 1]]}, {"joints": {"a": [0, 1, 9]}})),
    ],
)
def test_what_the_page_does_not_offer_is_refused(drawn, path, wrong):
    """Other numbers, names and values than those of the page: status 400, one line, and nothing is kept."""
    desk, browser = drawn
    before = desk.log("flight").read_bytes() if desk.log("flight").is_file() else b""
    answer = browser.told(path, wrong)
    assert answer.status_code == 400
    assert len(answer.json()["said"].splitlines()) == 1
    assert before == (desk.log("flight").read_bytes() if desk.log("flight").is_file() else b"")


def test_names_that_corrections_have_are_kept(worked):
    """A log names markers: a skeleton in which one is called otherwise is refused until the correction is undone."""
    desk, browser = worked
    browser.get("open?trial=flight")
    browser.told("delete", {"marker": HAND, "first": 3, "last": 5})
    browser.get("draft?trial=flight")
    before = desk.trials["flight"].arguments["skeleton"]
    answer = browser.told("skeleton", DRAWN | {"names": [*NAMES[:HAND], "wrist", *NAMES[HAND + 1 :]]})
    assert "corrections of hand" in answer.json()["said"]
    assert desk.trials["flight"].arguments["skeleton"] == before
    assert not (desk.out / "skeletons" / "flight.toml").exists()
    browser.told("undo", {})


def test_the_guard_stands_before_the_desk(worked):
    """Without the token, of another origin, or another trial: refused; a second desk on the same results, too."""
    desk, browser = worked
    address = str(browser.base_url)
    bare = address.split("/", 3)
    with httpx2.Client(timeout=600) as other:
        assert other.get(f"{bare[0]}//{bare[2]}/overview").status_code == 403
        assert other.post(address + "undo", json={}, headers={"Origin": "http://evil.example"}).status_code == 403
        assert other.post(address + "undo", json={}).status_code == 403
    assert "no trial 'other'" in browser.get("open?trial=other").json()["said"]
    files = [str(path) for path in desk.trials["flight"].paths]
    with pytest.raises(MocapError, match=r"edits"), opened_desk(files, desk.out, options=OPTIONS):
        pass


def test_what_is_found_can_be_mended_and_is_kept(worked):
    """Findings are in words, alarms first; a button states an argument of mocap.read, which the manifest keeps."""
    desk, browser = worked
    found = browser.get("audit?trial=flight").json()
    assert [one["alarm"] for one in found] == sorted((one["alarm"] for one in found), reverse=True)
    assert all(one["text"] for one in found)
    browser.told("state", {"name": "correct_lag", "value": True})
    assert desk.overview()["trials"][0]["status"] == "changed"
    assert "--correct-lag" in desk.overview()["trials"][0]["command"]
    assert "track it first" in browser.told("pass", {"kind": "xlsx"}).json()["said"]
    trials = read_manifest(desk.manifest)
    assert trials[0].arguments["correct_lag"] is True
    desk.trials["flight"].arguments.pop("correct_lag")


def test_cameras_in_another_order_are_swapped_by_a_button(scene, tmp_path, driver):
    """Files of one camera each in a wrong order: the audit finds it, the button puts them right, the command shows it.

    Rays meet then, and the manifest keeps the order: the button is gone.
    """
    for c, name in enumerate("abc"):
        table = scene.uv_px[c].reshape(len(scene.uv_px[c]), -1)
        header = ",".join(f"{marker}_cam1_{axis}" for marker in NAMES for axis in "XY")
        np.savetxt(tmp_path / f"{name}_xypts.csv", table, "%.6f", ",", header=header, comments="")
    stated = {"calibration": scene.folder / "calibration.toml", "fps": FPS}
    wrong = Trial(name="flight", paths=tuple(tmp_path / f"{name}_xypts.csv" for name in "bac"), arguments=stated)
    with result_file(tmp_path / "manifest.csv") as path:
        write_manifest(path, [wrong], folder=tmp_path)
    with (
        opened_desk([str(tmp_path / "manifest.csv")], tmp_path / "out", options=OPTIONS) as desk,
        served(desk_page(desk)) as site,
    ):
        driver.get(site.address)
        until(driver, "document.body.dataset.ready === '1'")
        driver.find_element("class name", "look").click()
        until(driver, "document.body.dataset.audits === '1'")
        (button,) = [b for b in driver.find_elements("css selector", "#findings .mend") if b.text == "Swap the cameras"]
        button.click()
        until(driver, "document.body.dataset.audits === '2'")
        left = [one.text for one in driver.find_elements("css selector", "#findings .mend")]
        assert all(text.startswith("Lengths are in") for text in left)
        shown = driver.find_element("id", "command").text
        assert shown.index("a_xypts") < shown.index("b_xypts") < shown.index("c_xypts")
        (kept,) = read_manifest(desk.manifest)
        assert [path.name for path in kept.paths] == ["a_xypts.csv", "b_xypts.csv", "c_xypts.csv"]


def test_a_frame_rate_is_typed_for_all_trials(scene, tmp_path, driver):
    """Where no file states it and no command did: as people write it, of one trial or, ticked, of all; else refused."""
    for name in ("one", "two"):
        shutil.copy(scene.folder / "flight_xypts.csv", tmp_path / f"{name}_xypts.csv")
    stated = {"calibration": scene.folder / "calibration.toml"}
    with (
        opened_desk([str(tmp_path)], tmp_path / "out", options=OPTIONS, arguments=stated) as desk,
        served(desk_page(desk)) as site,
    ):
        with client(site.address) as browser:
            for name, value in (("fps", -1.0), ("fps", "fast"), ("fps", True), ("correct_lag", 1.0), ("unit", 1.0)):
                answer = browser.told("state", {"name": name, "value": value}, trial="one")
                assert answer.status_code == 400, (name, value)
        driver.get(site.address)
        until(driver, "document.body.dataset.ready === '1'")
        for k, (typed, wanted) in enumerate((("100", [100.0, None]), ("99,5", [99.5, 99.5]))):
            driver.execute_script(f"document.querySelectorAll('#rows .name')[{k}].click()")
            driver.find_element("class name", "look").click()
            until(driver, f"document.body.dataset.audits === '{2 * k + 1}'")
            entry, button = (
                driver.find_element("css selector", f"#findings input.number{more}") for more in ("", " + .mend")
            )
            entry.send_keys("fast")
            button.click()
            until(driver, "document.getElementById('said').textContent.includes('not a number above zero')")
            if k:
                driver.find_element("id", "alike").click()
            entry.clear()
            entry.send_keys(typed)
            button.click()
            until(driver, f"document.body.dataset.audits === '{2 * k + 2}'")
            assert [trial.arguments.get("fps") for trial in read_manifest(desk.manifest)] == wanted


def test_what_a_refusal_names_has_a_button(worked, monkeypatch):
    """Cameras that start apart are refused, as reading has it: the desk offers what mends the error."""
    _, browser = worked

    def refused(*_, **__):
        error = MocapError("the cameras start apart, by cam1 +8 frames: give `correct_lag`")
        error.mends = ("correct_lag",)
        raise error

    monkeypatch.setattr("mocap.batches.trial.read", refused)
    (alarm,) = [one for one in browser.get("audit?trial=flight").json() if one["alarm"]]
    assert alarm["text"].endswith("give --correct-lag")
    assert [(way["name"], way["value"]) for way in alarm["mend"]] == [("correct_lag", True)]


def test_a_person_draws_a_skeleton(scene, tmp_path, driver):
    """Points are named, bones clicked in 3D, a joint ticked, sides mirrored, all saved: what was drawn is in the file.

    A name that two points have is refused, in the page, and nothing is written; the file is what tracking states.
    """
    stated = {"calibration": scene.folder / "calibration.toml", "fps": FPS}
    out, where = tmp_path / "out", [str(scene.folder / "flight_xypts.csv")]
    path = out / "skeletons" / "flight.toml"
    with (
        opened_desk(where, out, options=OPTIONS, jobs=1, arguments=stated) as desk,
        served(desk_page(desk)) as site,
    ):
        desk.trials["flight"].arguments.pop("skeleton", None)
        driver.get(site.address)
        until(driver, "document.body.dataset.ready === '1'")
        driver.find_element("class name", "bones").click()
        until(driver, "document.body.dataset.sketched === '1'")

        def keys(*typed):
            driver.switch_to.active_element.send_keys(*typed)

        def click(marker):
            x, y = driver.execute_script(f"return spots()[{NAMES.index(marker)}]")
            canvas = driver.find_element("id", "body")
            size = canvas.size
            ActionChains(driver).move_to_element_with_offset(
                canvas, round(x - size["width"] / 2), round(y - size["height"] / 2)
            ).click().perform()

        for a, b in (("back", "left"), ("left", "hand")):
            click(a)
            click(b)
        keys("n")
        click("hand")
        keys("hand_l", Keys.ENTER)
        keys("left", Keys.ESCAPE)  # the tail, below it
        keys("s")
        until(driver, "document.getElementById('said').textContent.includes(\"'left' appears twice\")")
        assert not path.exists()
        keys("n")
        click("tail")
        keys("hand_r", Keys.ESCAPE)
        (joint,) = driver.find_elements("css selector", "#joints input")
        joint.click()
        driver.find_element("id", "mirror").click()
        until(driver, "document.body.dataset.drawn === '1'")
        driver.find_element("id", "save").click()
        until(driver, "document.body.dataset.drawn === '2'")
        assert f"--skeleton {path}" in desk.overview()["trials"][0]["command"]
        assert path.is_file()
        (kept,) = read_manifest(desk.manifest)
        assert kept.arguments["skeleton"].resolve() == path
    found = read_skeleton(path)
    assert found.markers == ("nose", "back", "hip", "left", "right", "hand_l", "hand_r")
    assert found.aliases == {"hand": "hand_l", "tail": "hand_r"}
    assert [(b.a, b.b) for b in found.bones] == [
        ("back", "left"), ("left", "hand_l"), ("back", "right"), ("right", "hand_r"),
    ]  # fmt: skip
    assert [(j.name, j.parent, j.centre, j.child) for j in found.joints] == [
        ("left", "back", "left", "hand_l"),
        ("right", "back", "right", "hand_r"),
    ]
    assert mocap.read(where[0], skeleton=path, **stated).names == found.markers


def test_a_person_sees_angles_and_goes_to_a_frame(worked, driver):
    """A joint's potential is drawn; a click on a curve goes to its frame; each room shows its command."""
    _, browser = worked
    driver.get(str(browser.base_url))
    until(driver, "document.body.dataset.ready === '1'")
    driver.find_element("class name", "read").click()
    until(driver, "document.body.dataset.opened === '1'")
    assert "--edits" in driver.find_element("id", "command").text
    driver.find_element("css selector", "[data-room=angles]").click()
    until(driver, "document.body.dataset.curve")
    assert driver.find_element("id", "command").text.startswith("mocap kinematics ")
    driver.execute_script("const j = $('joint'); j.value = 'wrist'; j.onchange({ target: j });")
    until(driver, "$('potential').complete && $('potential').naturalWidth")
    assert driver.execute_script("return $('potential').naturalWidth") == 1000
    until(driver, "document.body.dataset.mapped === '1'")
    driver.execute_script("const j = $('joint'); j.value = ''; j.onchange({ target: j });")
    until(driver, "charts.length === 1")
    assert driver.find_element("css selector", "#quantities input:checked")
    middle = driver.find_element("css selector", "#charts .u-over")
    ActionChains(driver).move_to_element_with_offset(middle, 0, 0).click().perform()
    until(driver, "document.body.dataset.pointed === '1'")
    low, high = driver.execute_script("return [charts[0].scales.x.min, charts[0].scales.x.max]")
    assert abs(driver.execute_script("return frame") - FPS * (low + high) / 2) <= 2
    # ticked while another curve is on its way, as by a quick hand
    driver.execute_script("""delete curves[shownQuantities[0]]; queued(plot);
        setTimeout(() => document.querySelector("#quantities input:not(:checked)").click(), 0);""")
    until(driver, "charts.length && plotted.length > 1 && plotted.length === shownQuantities.length")
    assert "Error" not in driver.execute_script("return $('said').textContent")
    driver.execute_script("""const c = curves[shownQuantities[0]], t = c.seconds;
        c.cycles = { wing: [[t[1], t[3]], [t[3], t[5]], [t[5], t[7]]] }; c.doubtful = { wing: { 1: "not seen" } };
        queued(async () => { await plot(); count("given"); });""")
    until(driver, "document.body.dataset.given === '1'")
    driver.find_element("id", "plots").send_keys("d")
    until(driver, "document.body.dataset.doubted === '1'")
    assert driver.execute_script("return $('said').textContent") == "beat 2 is doubtful: not seen"
    assert driver.execute_script("return [frame, curves[shownQuantities[0]].frames[3]]") == [3, 3]
    driver.find_element("id", "images").click()
    until(driver, "document.body.dataset.room === 'proof'")
    driver.find_element("tag name", "body").send_keys("c")
    until(driver, "document.body.dataset.traced === `${frame} ${marker}`")
    assert len(driver.find_elements("css selector", "#trace canvas")) == 3
    driver.find_element("tag name", "body").send_keys(Keys.ARROW_RIGHT)
    until(driver, "document.body.dataset.traced === `4 ${marker}`")
    driver.find_element("tag name", "body").send_keys("c")
    until(driver, "!$('trace').clientHeight")


def test_the_pictures_of_the_page_are_taken(worked, driver, tmp_path):
    """As ``make pictures`` takes them: each room in the window's size, and none says that something went wrong."""
    _, browser = worked
    taken = []
    for room, picture in rooms(driver, str(browser.base_url), angle="wrist flexion"):
        assert "Error" not in driver.execute_script("return $('said').textContent")
        taken.append(room)
        with Image.open(save(picture, tmp_path / f"{room}.png")) as found:
            assert found.size == (1280, 800)
            assert len(found.getcolors()) > 20
    assert taken == ["trials", "proof", "angles"]


def test_measures_are_ticked_and_points_clicked_in_a_picture(worked, driver):
    """A measure that is unticked is not in the file; points lie where a camera shows them, and a click takes one."""
    desk, browser = worked
    before = desk.trials["flight"].arguments["skeleton"]
    driver.get(str(browser.base_url))
    until(driver, "document.body.dataset.ready === '1'")
    driver.find_element("class name", "bones").click()
    until(driver, "document.body.dataset.sketched === '1'")
    labels = [label.text for label in driver.find_elements("css selector", "#measures span")]
    assert labels == ["distances span: right, hand", "strokes hand: left, hand"]
    driver.execute_script("const by = $('shown-by'); by.value = '1'; by.onchange({ target: by });")
    until(driver, "photo && photo.naturalWidth")
    found = np.array(driver.execute_script("return places3d"), dtype=float)
    pixels = browser.get("points", params={"frame": driver.execute_script("return drawn.frame"), "camera": 1}).json()
    np.testing.assert_array_equal(found, np.array(pixels, dtype=float))
    x, y = driver.execute_script(f"return spots()[{HAND}]")
    canvas = driver.find_element("id", "body")
    half = canvas.size["width"] / 2, canvas.size["height"] / 2
    at = ActionChains(driver).move_to_element_with_offset(canvas, round(x - half[0]), round(y - half[1]))
    at.click().perform()
    assert driver.execute_script("return point") == HAND
    driver.find_elements("css selector", "#measures input")[1].click()
    driver.find_element("id", "save").click()
    until(driver, "document.body.dataset.drawn === '1'")
    kept = read_skeleton(desk.out / "skeletons" / "flight.toml").measures
    desk.state("flight", "skip", "")
    desk.trials["flight"].arguments["skeleton"] = before
    (desk.out / "skeletons" / "flight.toml").unlink()
    assert not kept.strokes
    assert kept.distances == {"span": ("right", "hand")}


@pytest.mark.parametrize("alone", [False, True])
def test_tracking_stops_and_goes_on(scene, tmp_path, monkeypatch, alone):
    """Two trials one after the other: all, or the second alone, stopped at the second.

    That is tracked when told to go on, the first is not.
    """
    where = scene.folder
    for name in "ab":
        shutil.copy(where / "flight_xypts.csv", tmp_path / f"{name}_xypts.csv")
    stated = {"calibration": where / "calibration.toml", "skeleton": where / "skeleton.toml", "fps": FPS}
    sources = [str(tmp_path / f"{name}_xypts.csv") for name in "ab"]
    with opened_desk(sources, tmp_path / "out", options=OPTIONS, jobs=1, arguments=stated) as desk:
        assert desk.stop() == "nothing is being tracked"
        with monkeypatch.context() as patch:
            patch.setenv("PYTHONPATH", str(second_held(tmp_path)))
            desk.track()
        while desk.progress().get("done") != 1:
            assert desk.progress()["running"]
            time.sleep(0.05)
        if alone:
            (held,) = (row["name"] for row in desk.overview()["trials"] if row["status"] == "new")
            assert desk.stop_one(held) == f"{held} is stopped, the others go on"
            while (told := desk.progress())["running"]:
                time.sleep(0.05)
            assert (told["done"], told["total"]) == (1, 1)  # of those that were not stopped
        else:
            assert desk.stop().startswith("stopped")
        assert not desk.progress()["running"]
        assert sorted(row["status"] for row in desk.overview()["trials"]) == ["done", "new"]
        first = {path: path.stat().st_mtime_ns for path in (tmp_path / "out").glob("*/trial.json")}
        told = tracked(desk)
        assert (told.get("done"), told.get("total")) == (2, 2), told
        assert {row["status"] for row in desk.overview()["trials"]} == {"done"}
        assert {path: path.stat().st_mtime_ns for path in first} == first


def test_a_kill_of_the_desk_loses_no_correction(scene, tmp_path, worked):
    """The process that serves is killed in the middle of corrections: all that were acknowledged are in the log."""
    desk, _ = worked
    script = f"""
        from pathlib import Path
        from mocap.batches.trial import Options
        from mocap.desk.desk import opened_desk
        from mocap.desk.page import desk_page
        from mocap.web.server import served
        options = Options(model="constant_velocity", validate=False)
        stated = {{"calibration": Path({str(scene.folder / "calibration.toml")!r}), "fps": {FPS}}}
        out = Path({str(tmp_path / "out")!r})
        with opened_desk([{str(scene.folder / "flight_xypts.csv")!r}], out, options=options, arguments=stated) as desk:
            with served(desk_page(desk)) as site:
                print(site.address, flush=True)
                site.wait()
    """
    shutil.copytree(desk.out / "flight", tmp_path / "out" / "flight")
    with subprocess.Popen([sys.executable, "-c", textwrap.dedent(script)], stdout=subprocess.PIPE, text=True) as run:
        assert run.stdout is not None
        address = run.stdout.readline().strip()
        kept = 0
        with client(address) as browser:
            browser.get("open?trial=flight")
            for frame in range(12):
                answer = browser.told("place", {**PLACE, "frame": frame, "uv_px": [50.5 + frame, 60.25]})
                assert answer.status_code == 200, answer.text
                kept += 1
                if frame == 8:
                    os.kill(run.pid, signal.SIGKILL)
                    break
    assert [edit.frame for edit in read_edits(tmp_path / "out" / "edits" / "flight" / "edits.jsonl")] == list(
        range(1, kept + 1)
    )
    assert kept == 9


def _group(number):
    """The processes of a group that have not ended."""
    for one in psutil.process_iter(["status"]):
        with suppress(ProcessLookupError):
            if one.info["status"] != psutil.STATUS_ZOMBIE and os.getpgid(one.pid) == number:
                yield one.pid


@pytest.mark.rare
@pytest.mark.skipif(os.name != "posix", reason="a terminal's Ctrl-C reaches a group of processes")
@pytest.mark.parametrize("after_s", [0.0, 1.0, 3.0])
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_a_desk_that_is_ended_while_it_reads_shows_no_traceback(scene, tmp_path, after_s, name):
    """Ctrl-C reaches the processes that import and read, too, ``kill`` the command alone: one line, nothing is left."""
    words = ["desk", str(scene.folder), "--calibration", str(scene.folder / "calibration.toml"), "--fps", str(FPS)]
    script = (
        "import faulthandler, signal, sys; faulthandler.dump_traceback_later(120, exit=True); "  # where it waits
        "signal.signal(signal.SIGINT, signal.default_int_handler); "  # a shell that runs tests behind it ignores it
        f"from mocap.cli.main import main; sys.argv = {['mocap', *words, '--out', str(tmp_path)]}; main()"
    )
    environment = {**os.environ, "BROWSER": "true"}
    with subprocess.Popen(
        [sys.executable, "-c", script],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
        env=environment,
    ) as run:
        assert run.stdout is not None
        assert run.stdout.readline().startswith("The desk is at ")
        time.sleep(after_s)
        (os.killpg if name == "SIGINT" else os.kill)(run.pid, getattr(signal, name))
        said = run.stdout.read()  # to its end: no process holds it any more
        assert run.wait() == 0, said
    assert "Traceback" not in said
    assert said.splitlines()[-1].startswith(f"The desk ended ({name})")
    until = time.monotonic() + 10
    while list(_group(run.pid)) and time.monotonic() < until:  # what counts shared things ends after its last user
        time.sleep(0.05)
    assert not list(_group(run.pid))
    assert not [path for path in tmp_path.rglob("*") if path.is_file() and path.name != "manifest.csv"]
