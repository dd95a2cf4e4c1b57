"""A file that hangs, kills or fills the process that reads it is a row of the table, and the others are done."""

import os
import subprocess
import sys

import pandas as pd
import pytest

from tests.mocap.batches.test_batch import FPS, write_trial

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the memory of another process is told in /proc")

PLUGIN = """
import os, re, signal, time
import numpy as np
from mocap.io.format import file_format

@file_format("bad", "what no file should do", lambda head: head.first.startswith("# "))
def read(path, hints):
    way, *later = path.read_text().splitlines()[0][2:].split()
    seen = path.with_suffix(".seen")
    if later and not seen.exists():  # the look at it
        seen.touch()
        from mocap.io.registry import read

        return read(path.with_name("ok_xyzpts.csv"), hints)
    with path.with_suffix(".count").open("a") as counter:
        counter.write("x")
    if way == "HANG":
        re.match("(a+)+$", "a" * 64 + "b")  # keeps Python's lock
    if way == "EAT":
        np.ones(1 << 28)  # 2 GB
        time.sleep(600)
    if way == "RAISE":
        raise KeyError("what no reader expects")
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.fixture(scope="module")
def plugin(tmp_path_factory):
    """A folder for ``PYTHONPATH``, with a package of another's format."""
    folder = tmp_path_factory.mktemp("plugin")
    info = folder / "bad-1.0.dist-info"
    info.mkdir()
    (info / "entry_points.txt").write_text("[mocap.formats]\nbad = badformat:read\n")
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: bad\nVersion: 1.0\n")
    (folder / "badformat.py").write_text(PLUGIN)
    return folder


def mocap(plugin, *words):
    """The command in a process of its own."""
    script = "if __name__ == '__main__': from mocap.cli.main import main; main()"
    variables = {**os.environ, "PYTHONPATH": str(plugin)}
    line = [sys.executable, "-c", script, *map(str, words)]
    return subprocess.run(line, capture_output=True, text=True, check=False, timeout=500, env=variables)


@pytest.fixture
def lab(tmp_path):
    """A trial, and files of each kind of trouble: as they are looked at, and later, as they are tracked."""
    lab = tmp_path / "lab"
    write_trial(lab / "ok_xyzpts.csv", 1)
    for way in ("HANG", "DIE", "EAT", "RAISE"):
        for when in ("", " LATER"):
            (lab / f"{way.lower()}{when.strip().lower()}.csv").write_text(f"# {way}{when}\na,b\n1,2\n")
    return lab


def test_one_that_is_not_read_stops_no_other(lab, plugin, tmp_path):
    """Each says what became of it; one whose process ends is tried twice, one that takes too long once."""
    options = ["--fps", FPS, "--model", "constant_velocity", "--no-validate", "--jobs", 2]
    done = mocap(plugin, "batch", lab, "--out", tmp_path / "out", *options, "--limit-s", 12, "--memory", "1GB")
    assert done.returncode == 0, done.stderr
    table = pd.read_csv(tmp_path / "out" / "summary.csv").set_index("trial")
    assert table["status"].to_dict() == {
        "ok": "done",
        **dict.fromkeys(["hang", "die", "eat"], "skipped"),
        **dict.fromkeys(["hanglater", "dielater", "eatlater", "raiselater"], "failed"),
    }
    why = table["error"]
    assert (
        why["hang"] == "hang.csv: was not read within 12 s, and was left out: if it only needs longer, give `limit_s`"
    )
    assert "within 12 s, and was ended: if it only needs longer, give `limit_s`" in why["hanglater"]
    assert "took more than 1 GB of memory" in why["eat"]
    assert "took more than 1 GB of memory, twice: give fewer `jobs` or more `memory`" in why["eatlater"]
    assert "died" in why["die"]
    assert "its process died twice" in why["dielater"]
    assert "KeyError" in done.stderr, (
        done.stderr
    )  # the package is named, and its format left out: nothing knows that file
    assert "KeyError" in why["raiselater"]
    tried = {path.stem: len(path.read_text()) for path in lab.glob("*.count")}
    # what raises as it is compared with the others is told as what raises when it is tracked
    twice = dict.fromkeys(["die", "eat", "dielater", "eatlater", "raiselater"], 2)
    assert tried == {**dict.fromkeys(["hang", "raise", "hanglater"], 1), **twice}
    assert not list((tmp_path / "out").rglob(".mocap-partial*/report.json"))


def test_a_plan_says_what_is_not_read(lab, plugin, tmp_path):
    """Reading a trial for the manifest is limited alike."""
    for path in lab.glob("*.csv"):
        if path.stem not in ("ok_xyzpts", "hanglater"):
            path.unlink()
    done = mocap(plugin, "batch", lab, "--dry-run", "--out", tmp_path / "m.csv", "--fps", FPS, "--limit-s", 12)
    assert done.returncode == 0, done.stderr
    notes = pd.read_csv(tmp_path / "m.csv").set_index("trial")["note"]
    assert "was not read within 12 s" in notes["hanglater"]
    assert "frames a second" in notes["ok"]
