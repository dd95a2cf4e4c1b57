"""The command ``mocap desk`` as a process: one room for one trial, and nothing believed before it is saved."""

import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from mocap.batches.one import track_trial
from mocap.batches.trial import Options, Trial, read_manifest
from mocap.reading.edits import read_edits
from tests.mocap.desk.conftest import client, until
from tests.mocap.desk.filmed_trial import FPS, trial
from tests.mocap.digitising.filmed import NAMES

OPTIONS = Options(model="constant_velocity", validate=False)
MAIN = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)  # as a shell has it, however the tests were started
from mocap.cli.main import main
main()
"""
HAND = NAMES.index("hand")
SECONDS = 180.0
"""A command on a busy machine starts within that."""


def stated(folder):
    return {"calibration": folder / "calibration.toml", "skeleton": folder / "skeleton.toml", "fps": FPS}


@pytest.fixture(scope="module")
def tracked(tmp_path_factory):
    """A folder with two trials, ``alpha`` and ``beta``, and one with their results."""
    data, out = tmp_path_factory.mktemp("data"), tmp_path_factory.mktemp("tracked") / "out"
    trial(data, videos=False)
    shutil.copy(data / "flight_xypts.csv", data / "alpha_xypts.csv")
    shutil.move(data / "flight_xypts.csv", data / "beta_xypts.csv")
    shutil.rmtree(data / "films", ignore_errors=True)
    for name in ("alpha", "beta"):
        one = Trial(name=name, paths=(data / f"{name}_xypts.csv",), arguments=stated(data))
        assert track_trial(one, OPTIONS, out).status == "done"
    return data, out


@dataclass
class Room:
    """A desk that runs.

    Attributes:
        process: Of the command.
        address: Of its page.
        out: Its folder.
        told: The file of what it said.
    """

    process: subprocess.Popen[Any]
    address: str
    out: Path
    told: Path

    def log(self, name):
        """The bytes of a trial's corrections."""
        path = self.out / "edits" / name / "edits.jsonl"
        return path.read_bytes() if path.is_file() else b""

    def manifest(self):
        """The bytes of what is stated."""
        return (self.out / "manifest.csv").read_bytes()


def command(data, out, told):
    """The process of a desk."""
    words = ["desk", str(data), "--out", str(out), "--model", "constant_velocity", "--no-validate", "--jobs", "1"]
    words += [part for key, value in stated(data).items() for part in (f"--{key}", f"{value}")]
    environment = {**os.environ, "BROWSER": "true", "MOCAP_JOBS": "1"}
    with told.open("wb") as stream:
        return subprocess.Popen([sys.executable, "-c", MAIN, *words], stderr=stream, stdout=stream, env=environment)


@contextlib.contextmanager
def desk(data, out, told):
    """A desk that is served, and ends with the context."""
    process = command(data, out, told)
    try:
        end = time.monotonic() + SECONDS
        while not (found := re.search(r"http://127\.0\.0\.1:\d+/[\w-]+/", told.read_text())):
            assert process.poll() is None, told.read_text()
            assert time.monotonic() < end, told.read_text()
            time.sleep(0.1)
        with client(found[0]) as browser:
            while browser.get("overview").json()["looking"]:  # it is there before the folders are looked through
                assert time.monotonic() < end, told.read_text()
                time.sleep(0.1)
        yield Room(process, found[0], out, told)
    finally:
        process.kill()
        process.wait(60)


@pytest.fixture
def room(tracked, tmp_path):
    data, out = tracked
    shutil.copytree(out, tmp_path / "out")
    with desk(data, tmp_path / "out", tmp_path / "told") as one:
        yield one


PLACE = {"camera": 0, "frame": 3, "marker": HAND, "uv_px": [50.5, 60.25]}
RANGE = {"marker": HAND, "first": 3, "last": 5}
DRAWN = {"names": list(NAMES), "bones": [], "trunk": [], "joints": {}, "dropped": []}


def test_a_request_of_another_tab_writes_nothing(room):
    """Whatever a tab asks for that shows another trial, has not seen the last edit, or says neither: 409, reload.

    Logs, manifest and skeletons are as they were; what shows what is open is done.
    """
    with client(room.address) as first, client(room.address) as second:
        known = first.get("open?trial=alpha").json()["seen"]
        first.get("draft?trial=alpha")
        for asked in ("open?trial=beta", "draft?trial=beta"):
            second.get(asked)
        before = room.manifest()
        writes = [
            ("place", PLACE),
            *((path, {}) for path in ("undo", "settle")),
            ("exchange", {**RANGE, "other": 0}),
            ("delete", RANGE),
            *((path, DRAWN) for path in ("skeleton", "propose", "measure", "mirror")),
        ]
        for path, what in writes:
            for more in ({"trial": "alpha", "edits": known}, {"trial": "beta", "edits": 7}, {"trial": "beta"}, {}):
                answer = first.post(path, json={**what, **more})
                assert (answer.status_code, answer.json()["said"]) == (409, "opened elsewhere: reload"), (path, more)
                assert answer.json()["reload"] is True
        # numbers of the other trial's frames and markers are not looked at
        assert first.post("place", json={**PLACE, "frame": 10**6, "trial": "alpha", "edits": 0}).status_code == 409
        assert first.get("frame?frame=3&marker=0&trial=alpha").status_code == 409
        assert second.get("frame?frame=3&marker=0&trial=beta").status_code == 200
        assert second.told("place", PLACE, trial="beta").status_code == 200
        assert second.told("place", PLACE, trial="beta", edits=0).status_code == 409
        stale = {"name": "unit", "value": "mm"}
        assert first.told("state", stale, trial="beta", edits=0).status_code == 409
        assert first.told("track", trial="", edits=0).status_code == 409
        assert room.manifest() == before
        assert first.told("state", stale, trial="beta").status_code == 200
        assert room.manifest() != before
        assert second.told("pass", {"kind": "xlsx"}, trial="beta", edits=2).status_code == 409
    assert room.log("alpha") == b""
    assert [edit.frame for edit in read_edits(room.out / "edits" / "beta" / "edits.jsonl")] == [4]
    assert not (room.out / "skeletons").exists()


def test_the_page_says_that_it_is_old_and_that_the_program_ended(room, driver):
    """In a browser: where another tab was faster there is a button to reload; after SIGTERM, where the work is."""
    driver.get(room.address)
    until(driver, "document.body.dataset.ready === '1'")
    driver.find_element("class name", "read").click()
    until(driver, "document.body.dataset.opened === '1'")
    with client(room.address) as other:
        assert other.told("place", PLACE, trial="alpha").status_code == 200
    log = room.log("alpha")
    assert not driver.find_element("id", "reload").is_displayed()
    driver.find_element("id", "unseen").click()
    until(driver, "!document.getElementById('reload').hidden")
    assert "opened elsewhere: reload" in driver.find_element("id", "said").text
    assert room.log("alpha") == log
    driver.find_element("id", "reload").click()
    until(driver, "document.body.dataset.ready === '1'")
    driver.find_element("class name", "read").click()
    until(driver, "document.body.dataset.opened === '1'")
    driver.find_element("id", "undo").click()
    until(driver, "document.body.dataset.changed === '1'")
    assert room.log("alpha").startswith(log)
    driver.find_element("css selector", "[data-room=trials]").click()
    until(driver, "Number(document.body.dataset.overviews) >= 2")
    driver.find_element("id", "track").click()
    until(driver, "document.getElementById('progress').textContent !== ''")
    told = len(room.told.read_bytes())
    room.process.send_signal(signal.SIGTERM)
    room.process.wait(60)
    until(driver, "document.body.dataset.ended === '1'")
    assert str(room.out) in driver.find_element("id", "said").get_attribute("textContent")
    lines = room.told.read_text()[told:].splitlines()
    assert len(lines) <= 1, lines
    assert room.log("alpha").count(b"\n") == 3


def test_two_desks_on_one_folder(room, tracked, tmp_path):
    """The second says so and ends; a desk that was killed is no obstacle for the next, which has its corrections."""
    second = command(tracked[0], room.out, tmp_path / "second")
    assert second.wait(SECONDS) == 1
    *_, line = (tmp_path / "second").read_text().splitlines()  # after its address, which is there before it looks
    assert "a desk is open there already" in line
    with client(room.address) as browser:
        browser.get("open?trial=alpha")
        assert browser.told("place", PLACE, trial="alpha").status_code == 200
    room.process.send_signal(signal.SIGKILL)
    room.process.wait(60)
    with desk(tracked[0], room.out, tmp_path / "third") as again, client(again.address) as browser:
        assert browser.get("overview").json()["trials"][0]["edits"] == 1


@contextlib.contextmanager
def small_disk(place, megabytes):
    """A disk of its own that fills up."""
    place.mkdir()
    words = ["mount", "-t", "tmpfs", "-o", f"size={megabytes}m", "tmpfs", str(place)]
    if os.name != "posix" or subprocess.run(words, capture_output=True, check=False).returncode:
        pytest.skip("only the administrator mounts a disk")
    try:
        yield place
    finally:
        subprocess.run(["umount", "-l", str(place)], check=True)


def test_what_a_full_disk_refuses_is_nowhere(tracked, tmp_path):
    """A click, a unit, a skeleton on a full disk: refused by its name, and neither in memory nor in a file.

    When there is space again all go on.
    """
    data, out = tracked
    with small_disk(tmp_path / "disk", 60) as disk:
        shutil.copytree(out, disk / "out")
        with desk(data, disk / "out", tmp_path / "told") as room, client(room.address) as browser:
            browser.get("open?trial=alpha")
            assert browser.told("place", PLACE, trial="alpha").status_code == 200
            log, manifest, shown = room.log("alpha"), room.manifest(), browser.get("frame?frame=3&marker=5").json()
            browser.get("draft?trial=alpha")
            before = browser.get("overview").json()
            with contextlib.suppress(OSError), (disk / "filler").open("wb", buffering=0) as filler:
                while True:
                    filler.write(b"x" * 4096)
            with contextlib.suppress(OSError), (disk / "rest").open("wb", buffering=0) as filler:
                while True:
                    filler.write(b"x")
            for _ in range(100):  # the page of memory that holds the end of the log has 4096 bytes, a line 100
                kept = room.log("alpha")
                answer = browser.told("delete", RANGE, trial="alpha")
                if answer.status_code != 200:
                    break
            refused = [answer]
            for path, what in (("delete", RANGE), ("state", {"name": "unit", "value": "mm"}), ("skeleton", DRAWN)):
                refused.append(browser.told(path, what, trial="alpha"))
            for answer in refused:
                assert answer.status_code == 409, answer.text
                said = answer.json()["said"]
                assert re.search("disk is full|No space left", said), said
                assert "error in mocap" not in said
                assert str(disk) in said
            assert room.log("alpha") == kept
            now = browser.get("overview").json()
            assert now["trials"][0]["stated"] == before["trials"][0]["stated"]
            assert now["trials"][0]["edits"] == len(read_edits(disk / "out" / "edits" / "alpha" / "edits.jsonl"))
            assert browser.get("drawn").json()["bones"]
            assert room.manifest() == manifest
            (disk / "filler").unlink()
            for path, what in (("delete", RANGE), ("state", {"name": "unit", "value": "mm"}), ("skeleton", DRAWN)):
                assert browser.told(path, what, trial="alpha").status_code == 200, path
            assert room.log("alpha").startswith(log)
            assert read_manifest(disk / "out" / "manifest.csv")[0].arguments["unit"] == "mm"
            assert shown["status"] != "missing"


def again(data, folder, change, **how):
    """The same folder, its tables as another program saves them, or with a change."""
    shutil.copytree(data, folder)
    for path in folder.glob("*_xypts.csv"):
        change(pd.read_csv(path)).to_csv(path, index=False, **how)
    return folder


def test_corrections_of_another_recording_are_asked_about(tracked, room, tmp_path):
    """The files saved again by another program: opened. Their first ten frames cut: asked, and opened if so said.

    The command refuses them with what differs, and takes them with its option.
    """
    data, out = tracked
    with client(room.address) as browser:
        browser.get("open?trial=alpha")
        assert browser.told("place", PLACE, trial="alpha").status_code == 200
    room.process.send_signal(signal.SIGINT)
    assert room.process.wait(60) == 0
    log = room.out / "edits" / "alpha" / "edits.jsonl"
    for kind, change, how in (
        ("same", lambda table: table, {"na_rep": "NaN", "float_format": "%.12g"}),
        ("cut", lambda table: table.iloc[10:], {}),
    ):
        folder = again(data, tmp_path / kind, change, **how)
        results = tmp_path / f"out-{kind}"
        shutil.copytree(out, results)
        shutil.copytree(room.out / "edits", results / "edits")
        with desk(folder, results, tmp_path / f"told-{kind}") as one, client(one.address) as browser:
            answer = browser.get("open?trial=alpha")
            if kind == "same":
                assert answer.status_code == 200, answer.text
                continue
            assert answer.status_code == 409
            assert "made on 60 frames of 3 cameras, and here are 50 frames of 3 cameras" in answer.json()["said"]
            found = browser.get("audit?trial=alpha").json()
            (way,) = [way for one in found for way in one["mend"] if way["name"] == "edits_anyway"]
            assert browser.told("state", {"name": way["name"], "value": way["value"]}, trial="alpha").status_code == 200
            assert "--edits-anyway" in browser.get("overview").json()["trials"][0]["command"]
            answer = browser.get("audit?trial=alpha").json()
            assert isinstance(answer, list), answer
            assert any(one["kind"] == "corrections" and one["alarm"] for one in answer)
    words = [
        "skeleton",
        tmp_path / "cut" / "alpha_xypts.csv",
        "--calibration",
        data / "calibration.toml",
        "--edits",
        log,
    ]
    for more, code in (([], 1), (["--edits-anyway"], 0)):
        run = subprocess.run(
            [sys.executable, "-c", MAIN, *map(str, words), "--fps", "100", *more],
            capture_output=True,
            text=True,
            timeout=SECONDS,
            check=False,
        )
        assert run.returncode == code, run.stderr
        assert ("--edits-anyway" in run.stderr) == (code == 1), run.stderr


def test_a_manifest_that_was_corrected_in_a_spreadsheet_is_read(tracked, room, tmp_path):
    """As Excel in Germany saves it: BOM, semicolons, decimal comma, quotes, empty columns; the desk starts and goes on.

    What is corrected while a desk is open is not replaced: it says so.
    """
    path = room.out / "manifest.csv"
    room.process.send_signal(signal.SIGINT)
    assert room.process.wait(60) == 0
    table = pd.read_csv(path, dtype=str, keep_default_na=False)
    table.loc[0, ["fps", "animal", "correct_lag"]] = ["99,5", "Fledermaus; März", "WAHR"]
    rows = [
        [f'"{cell}"' if ";" in cell or '"' in cell else cell for cell in row] for row in [table.columns, *table.values]
    ]
    path.write_bytes("\r\n".join(";".join([*row, "", ""]) for row in rows).encode("utf-8-sig"))
    with desk(tracked[0], room.out, tmp_path / "again") as one, client(one.address) as browser:
        alpha, beta = browser.get("overview").json()["trials"]
        assert alpha["stated"]["fps"] == "99.5"
        assert alpha["stated"]["correct_lag"] == "True"
        assert beta["stated"]["fps"] == "100.0"
        assert browser.told("state", {"name": "skip", "value": "blurred"}, trial="beta").status_code == 200
        alpha, beta = read_manifest(path)
        assert (alpha.animal, alpha.arguments["fps"], beta.skip) == ("Fledermaus; März", 99.5, "blurred")
        corrected = path.read_bytes() + b"\r\n"
        path.write_bytes(corrected)
        answer = browser.told("state", {"name": "skip", "value": ""}, trial="beta")
        assert answer.status_code == 409
        assert "changed by another program while this desk is open" in answer.json()["said"]
        assert path.read_bytes() == corrected
        assert browser.get("overview").json()["trials"][1]["status"] == "skipped"
