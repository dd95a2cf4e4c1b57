"""What is wrong with a file is the same list, in the same order, wherever it is told."""

import json
import re
from dataclasses import replace
from html import unescape

import numpy as np
import pytest
from mocap.datasets import make_lizard

import mocap as library
from mocap.batches.beside import seen_here
from mocap.batches.trial import Options, Trial
from mocap.cameras.lens import BrownLens
from mocap.cleaning.trial_audit import looked_at
from mocap.desk.desk import Desk
from mocap.findings import Kind, alarms, worst_first
from mocap.io.dltdv import write_coefficients, write_pixels
from mocap.reading.reading import in_options

MADE = make_lizard(seed=3, n_frames=60, n_cameras=3)
UV, CAMERAS = MADE.pixels.uv_px, MADE.cameras
LATER = {Kind.JOINTS, Kind.INTERVALS}
"""Kinds that only tracking can find: what a model makes of the recording."""


def jumped(uv):
    uv[:, 30:, 2] += 60
    return uv


def unseen(uv):
    uv[:, :, 4] = np.nan
    return uv


def late(uv):
    uv[1, 6:] = uv[1, :-6].copy()
    return uv


def copied(uv):
    uv[:, :, 3] = uv[:, :, 2]
    return uv


def stopped(uv):
    uv[:, 20:28] = uv[:, 20:21]
    return uv


def exchanged(uv):
    uv[0, :, [1, 5]] = uv[0, :, [5, 1]]
    return uv


def bent(uv):
    lens = BrownLens(f_px=(900.0, 900.0), centre_px=tuple(uv.reshape(-1, 2)[:1].mean(0) * 0 + 512), k=(-0.3, 0, 0))
    return np.stack([lens.distort(one) for one in uv])


def turned(cameras):
    """The same cameras of a world whose x points the other way."""
    return [replace(one, matrix=one.matrix * np.array([-1.0, 1.0, 1.0, 1.0])) for one in cameras]


def in_mm(cameras):
    return [replace(one, matrix=one.matrix * np.array([1e-3, 1e-3, 1e-3, 1.0])) for one in cameras]


FAULTS = {
    "sound": (lambda uv: uv, list),
    "jump": (jumped, list),
    "never seen": (unseen, list),
    "late": (late, list),
    "copied": (copied, list),
    "stopped": (stopped, list),
    "exchanged": (exchanged, list),
    "rounded": (lambda uv: np.round(uv / 8) * 8, list),
    "mirrored": (lambda uv: uv, turned),
    "in mm": (lambda uv: uv, in_mm),
    "distorted": (bent, list),
    "swapped": (lambda uv: uv[[1, 0, 2]], list),
    "a camera twice": (lambda uv: uv, lambda cameras: [cameras[0], cameras[0], cameras[2]]),
}


MAIN = ("sound", "exchanged")
"""The others are told in the same way, five seconds each."""


@pytest.fixture(params=[one if one in MAIN else pytest.param(one, marks=pytest.mark.rare) for one in FAULTS])
def trial(request, tmp_path):
    """A faulty file of pixels and its calibration."""
    pixels, cameras = FAULTS[request.param]
    folder = tmp_path / "lab"
    folder.mkdir()
    write_pixels(folder / "t_xypts.csv", replace(MADE.pixels, uv_px=pixels(UV.copy())))
    write_coefficients(folder / "t_dltCoefs.csv", [replace(one, lens=None) for one in cameras(CAMERAS)])
    return Trial(
        name="t",
        paths=(folder / "t_xypts.csv",),
        arguments={"calibration": folder / "t_dltCoefs.csv", "fps": MADE.fps, "origin": "upper-left"},
    )


def test_every_entrance_tells_the_same(trial, mocap, tmp_path):
    """Python, ``info``, the plan of a batch, the desk; where it can be tracked also ``track``, its report and page."""
    looked = looked_at(trial.recording)
    texts = [one.text for one in looked.findings]
    options = ["--calibration", trial.arguments["calibration"], "--fps", MADE.fps, "--origin", "upper-left"]
    code, out, _ = mocap("info", *trial.paths, *options, "--json")
    assert code == 0
    assert [one["text"] for one in json.loads(out)[0]["audit"]] == texts
    seen = seen_here(trial)
    assert [one.text for one in seen.findings] == texts
    assert bool(seen.refused) == (looked.recording is None or looked.refused is not None)
    desk = Desk(out=tmp_path / "desk", trials={"t": trial}, options=Options(model="constant_velocity", validate=False))
    assert [one["text"] for one in desk.audit("t")] == [in_options(text) for text in texts]
    assert texts == [one.text for one in worst_first(looked.findings)]
    if looked.refused is not None:
        return
    told: list[str] = []
    asks = [f"{one.text}" for one in looked.findings if one.asks]

    class Enough(Exception):
        pass

    def tell(line):
        if line.startswith(f"{looked.recording.name}: "):
            told.append(line.partition(": ")[2])
        if " samples" in line:
            raise Enough

    with pytest.raises((Enough, library.MocapError)):
        library.learn([looked.recording], tell=tell)
    assert [text for text in told if text in texts] == asks
    tracked = library.track(trial.recording(), model="constant_velocity", validate=False)
    own = [one.text for one in tracked.findings if one.alarm and one.kind not in LATER]
    assert own == [one.text for one in alarms(looked.findings)]
    assert [text for text in tracked.report["wrong"] if text in own] == own
    tracked.save(tmp_path / "run")
    page = unescape(re.sub(r"<[^>]*>", "", (tmp_path / "run" / "report.html").read_text()))
    assert ("Nothing is wrong" in page) == (not tracked.report["wrong"])
    again = library.load(tmp_path / "run")
    assert [one.text for one in again.findings if one.alarm] == [one.text for one in tracked.findings if one.alarm]
