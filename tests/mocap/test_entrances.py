"""The table of entrances, row by row: what each command takes, and the reason with which it refuses."""

import json
from dataclasses import replace

import numpy as np
import pytest
from mocap.datasets import make_lizard

import mocap as library
from mocap.batches.beside import seen_here
from mocap.batches.find import find_trials
from mocap.batches.trial import Options
from mocap.desk.desk import Desk
from mocap.entrances import ENTRANCES, TABLE
from mocap.errors import MocapError
from mocap.io.dltdv import write_coefficients, write_pixels, write_points
from mocap.reading.reading import in_options

MADE = make_lizard(seed=3, n_frames=40, n_cameras=3)
ONE = replace(MADE.pixels, uv_px=MADE.pixels.uv_px[:1], cameras=MADE.pixels.cameras[:1])


def labels(path):
    """DeepLabCut's table of two animals, one camera."""
    rng, names = np.random.default_rng(0), [(a, p) for a in ("ann", "bob") for p in ("nose", "tail", "paw")]
    heads = ["scorer", "individuals", "bodyparts", "coords"]
    columns = [("s", animal, part, axis) for animal, part in names for axis in ("x", "y", "likelihood")]
    lines = [",".join([head, *(column[k] for column in columns)]) for k, head in enumerate(heads)]
    for t in range(30):
        cells = [f"{v:.3f}" for _ in names for v in (*(100 + t + rng.normal(0, 9, 2)), 0.99)]
        lines.append(",".join([str(t), *cells]))
    path.write_text("\n".join(lines) + "\n")


def bodies(path):
    """XMALab's transforms of one body."""
    entries = ["R11", "R12", "R13", "01", "R21", "R22", "R23", "02", "R31", "R32", "R33", "03", "TX", "TY", "TZ", "1"]
    rows = ["1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1"] * 20
    path.write_text("\n".join([",".join(f"Jaw_{entry}_50Hz" for entry in entries), *rows]) + "\n")


def _rare(name: str) -> bool:
    """Positions and calibrated pixels go through all commands, which takes half a minute each."""
    return name in ("positions", "pixels of several cameras, calibrated")


@pytest.fixture(params=[pytest.param(one, marks=pytest.mark.rare) if _rare(one) else one for one in TABLE])
def kind(request, tmp_path):
    """A kind of recording; its file in a folder of its own, and what is stated of it."""
    lab = tmp_path / "lab"
    lab.mkdir()
    stated = {"fps": 100.0}
    if request.param.startswith("pixels of several"):
        file = lab / "t_xypts.csv"
        write_pixels(file, MADE.pixels)
        if "without" not in request.param:
            write_coefficients(lab / "t_dltCoefs.csv", [replace(one, lens=None) for one in MADE.cameras])
            stated |= {"calibration": lab / "t_dltCoefs.csv", "origin": "upper-left", "unit": "m"}
    elif request.param == "pixels of one video":
        file = lab / "t_xypts.csv"
        write_pixels(file, ONE)
    elif request.param == "positions":
        file = lab / "t_xyzpts.csv"
        write_points(file, MADE.truth)
        stated |= {"unit": "m"}
    elif request.param == "rigid bodies alone":
        file = lab / "t.csv"
        bodies(file)
    elif request.param == "angles alone":
        file = lab / "t.csv"
        file.write_text("time,elbow_deg,knee_deg\n" + "".join(f"{t / 100},{t},{-t}\n" for t in range(30)))
    else:
        file = lab / "tDLC_s.csv"
        labels(file)
    return request.param, file, stated


def told_by(file, stated, mocap, tmp_path):
    """What each entrance answers: the reason why it refuses, or nothing."""
    told = {}

    def asked(name, work):
        try:
            told[name] = work() or ""
        except MocapError as error:
            told[name] = str(error)

    options = [part for key, value in stated.items() for part in (f"--{key}", value)]

    def command(*words):
        code, _, err = mocap(*words)
        return err if code else ""

    def info():
        _, out, _ = mocap("info", file, *options, "--json")
        found = json.loads(out)
        return (found[0] if isinstance(found, list) else found).get("error", "")

    def track():
        library.track(library.read(file, **stated), model="constant_velocity", validate=False).save(tmp_path / "run")

    asked("info", info)
    asked("python", track)
    asked("track", lambda: command("track", file, *options, "--model", "constant_velocity", "--no-validate", "--out",
                                   tmp_path / "out"))  # fmt: skip
    there = (tmp_path / "out").is_dir()
    asked("kinematics", lambda: command("kinematics", tmp_path / "out") if there else told["track"])
    fps = options[:2]
    asked("convert", lambda: command("convert", file, tmp_path / "x.nc", *fps))
    asked("learn", lambda: (library.learn([library.read(file, **stated)]), "")[1])
    try:
        (trial,) = find_trials([file.parent], arguments=stated)
    except MocapError as error:
        return told | dict.fromkeys(("batch", "desk"), str(error))
    asked("batch", lambda: trial.skip or seen_here(trial).refused)
    desk = Desk(out=tmp_path / "desk", trials={trial.name: replace(trial, skip="")}, options=Options())
    refused = [one["text"] for one in desk.audit(trial.name) if one["kind"] == "refused"]
    told["desk"] = " ".join(refused)
    return told


def test_each_entrance_answers_as_the_table_says(kind, mocap, tmp_path):
    """Taken where it says so; else refused with its reason, in which options stand for arguments on a terminal."""
    name, file, stated = kind
    told = told_by(file, stated, mocap, tmp_path)
    for entrance in ENTRANCES:
        expected = TABLE[name][entrance]
        if expected:
            assert expected in told[entrance] or in_options(expected) in told[entrance], (entrance, told[entrance])
        else:
            assert not told[entrance], (entrance, told[entrance])
