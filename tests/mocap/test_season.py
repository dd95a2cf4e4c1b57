"""A season of real flights, some of them spoiled: each is named, with what mends it; sound ones are not."""

import json
import shutil
from dataclasses import replace
from html import unescape

import h5py
import numpy as np
import pandas as pd
import pytest

import mocap
from mocap.batches.plan import planned
from mocap.batches.trial import Options
from mocap.desk.desk import Desk
from mocap.findings import Kind, alarms
from mocap.reading.reading import in_options
from tests.real_data import real

DATA = "udExport/data"


def turned(data):
    """Its calibration is of a world whose x points the other way: the rig's own is mirrored, this one is not."""
    data["dltcoef"][:, [0, 4, 8]] *= -1


def in_mm(data):
    """Lengths of its calibration are in mm."""
    data["dltcoef"][:, [0, 1, 2, 4, 5, 6, 8, 9, 10]] /= 1000.0


def exchanged(data):
    """The coefficients of two cameras have changed places."""
    data["dltcoef"][[0, 1]] = data["dltcoef"][[1, 0]]


def late(data):
    """The third camera is five frames late."""
    group, ends = data["xypts"], data["xypts/jc"][()].astype(int)
    columns = np.repeat(np.arange(len(ends) - 1), np.diff(ends))
    rows = group["ir"][()].astype(int)
    of_third = (columns % 8) // 2 == 2
    rows[of_third] = np.clip(rows[of_third] + 5, 0, int(group.attrs["MATLAB_sparse"]) - 1)
    group["ir"][...] = rows


def another(data):
    """An animal half as large again and more."""
    data["dltcoef"][:, [0, 1, 2, 4, 5, 6, 8, 9, 10]] /= 1.7


SPOILED = {
    "turned": ("F5", turned, Kind.UNLIKE_SIBLINGS, "origin"),
    "in_mm": ("F4", in_mm, Kind.ASSUMED_UNIT, "unit"),
    "exchanged": ("F5", exchanged, Kind.SWAPPED_CAMERAS, None),
    "late": ("F4", late, Kind.CAMERA_OFFSETS, "correct_lag"),
    "another": ("F3", another, Kind.UNLIKE_SIBLINGS, "calibration"),
}


@pytest.fixture(scope="module")
def season(tmp_path_factory):
    """Four sound flights of one bat, one with a rate of playback, five that are spoiled, one of one camera."""
    folder = tmp_path_factory.mktemp("season") / "bat07"

    def project(flight):
        (path,) = real("bat_windtunnel_dltdv8", "078A3", flight).glob("*dvProject.mat")
        return path

    for flight in ("F1", "F2", "F3", "F4", "F5"):
        (folder / flight).mkdir(parents=True)
        (folder / flight / "flight_dvProject.mat").symlink_to(project(flight))
    for name, (flight, spoil, _, _) in SPOILED.items():
        (folder / name).mkdir()
        path = folder / name / "flight_dvProject.mat"
        shutil.copyfile(project(flight), path)
        path.chmod(0o644)
        with h5py.File(path, "r+") as file:
            table = file[f"{DATA}/dltcoef"][()]  # a row for each camera
            data = {"dltcoef": table, "xypts": file[f"{DATA}/xypts"], "xypts/jc": file[f"{DATA}/xypts/jc"]}
            spoil(data)
            file[f"{DATA}/dltcoef"][...] = table
    (folder / "video").mkdir()
    rows = [f"{k},{k / 700:.6f},{100 + k},{200 + 30 * np.sin(k / 9):.3f}" for k in range(60)]
    (folder / "video" / "flight.csv").write_text("\n".join(["frame,time,pt1_x,pt1_y", *rows]) + "\n")
    return folder.parent


@pytest.fixture(scope="module")
def plan(season):
    """What a dry run, and ``mocap info`` of the folder, tell."""
    return planned([season])


def found(plan, name):
    """The alarms of a trial."""
    return alarms(next(of for trial, of in plan.findings.items() if name in trial.split("/")))


@pytest.mark.slow
def test_each_spoiled_trial_is_named_with_what_mends_it(plan):
    """The kind of its fault is among its alarms; what the files of sound flights have themselves is not of it."""
    for name, (_, _, kind, mends) in SPOILED.items():
        named = [one for one in found(plan, name) if one.kind == kind]
        assert named, (name, [str(one) for one in found(plan, name)])
        assert mends is None or any(mends in one.mends for one in named), (name, named)
    rates = [one for one in found(plan, "F2") if "fps" in one.mends]
    assert [(one.kind, one.mends) for one in rates] == [(Kind.FRAME_RATE, ("fps",))]
    assert all(evidence in rates[0].text for evidence in ("25.56", "a pendulum of its length", "the other 9 trials"))


@pytest.mark.slow
def test_sound_flights_are_not_accused_by_the_others(plan):
    """Four flights have the alarms of their own files alone, and the video none; it is tracked, too."""
    for name in ("F1", "F3", "F4", "F5", "video"):
        assert not [one for one in found(plan, name) if one.kind is Kind.UNLIKE_SIBLINGS], name
    assert [name.split("/")[-2] for name in plan.untracked] == ["exchanged"]


@pytest.mark.rare
@pytest.mark.slow
def test_the_desk_tells_what_the_plan_tells(plan, tmp_path):
    """Of the flight with a rate of playback: the same sentences but for the number of siblings it has read."""
    trials = {trial.name: trial for trial in plan.trials}
    (name,) = (name for name in trials if "F2" in name.split("/"))
    desk = Desk(out=tmp_path, trials=trials, options=Options())
    told = [one for one in desk.audit(name) if one["alarm"]]
    assert [one["kind"] for one in told] == [one.kind for one in found(plan, name.split("/")[-2])]
    (row,) = (row for row in desk.overview()["trials"] if row["name"] == name)
    assert [text for text in row["wrong"] if "frame rate" in text]
    assert "frame rate" in row["unlike"]


@pytest.fixture(scope="module")
def few(season):
    """Folders of a flight with a rate of playback, a sound one, one whose world is turned, one in mm."""
    return [season / "bat07" / name for name in ("F2", "F5", "turned", "in_mm")]


LATER = {Kind.JOINTS, Kind.INTERVALS}
"""Kinds that only tracking can find."""


@pytest.mark.slow
@pytest.mark.rare
def test_a_batch_tells_each_fault_once_wherever_it_tells(few, tmp_path):
    """What the plan tells is told by summary.csv and its page, by report.json, report.md and the desk's table."""
    plan, out = planned(few), tmp_path / "out"
    went = mocap.batch(few, out, model="constant_velocity", validate=False, jobs=1)
    table = pd.read_csv(out / "summary.csv").set_index("trial")
    desk = Desk(out=out, trials={one.name: one for one in plan.trials}, options=Options())
    rows = {row["name"]: row for row in desk.overview()["trials"]}
    page = unescape((out / "summary.html").read_text(encoding="utf-8"))
    for record in went.records:
        name, wrong = record.trial, plan.wrong[record.trial]
        report = json.loads((out / name / "report.json").read_text(encoding="utf-8"))
        readable = (out / name / "report.md").read_text(encoding="utf-8").replace("\\", "")
        kinds = {one.text: one.kind for one in went.trial(name).findings}
        assert [text for text in report["wrong"] if kinds[text] not in LATER] == wrong, name
        told = str(record.row["warning"]).split(" | ")
        assert [text for text in told if text in wrong] == wrong
        assert len(told) == table.loc[name, "warnings"] == len(report["wrong"])
        assert table.loc[name, "warning"] == " | ".join(told).replace(";", ",")  # which separate cells of some
        assert rows[name]["wrong"] == [in_options(text) for text in told]
        assert all(readable.count(f"- **{in_options(text)}**") == 1 for text in wrong)
        assert " | ".join(told) in page
    (rate,) = [text for text in plan.wrong[next(n for n in plan.wrong if "F2" in n)] if "`fps`" in text]
    assert "the other 3 trials" in rate
    assert "a pendulum" in rate


@pytest.mark.rare
@pytest.mark.slow
def test_learning_tells_what_the_plan_tells(few):
    """Of each trial the alarms of the plan, in its order, before anything is learned."""
    plan, told = planned(few), []

    class Enough(Exception):
        pass

    def tell(line):
        told.append(line)
        if sum(" samples" in one and "frames, " in one for one in told) == len(few):
            raise Enough

    trials = [replace(one.recording(), name=one.name) for one in plan.trials]
    with pytest.raises(Enough):
        mocap.learn(trials, tell=tell)
    for name, wrong in plan.wrong.items():
        own = [line.partition(": ")[2] for line in told if line.startswith(f"{name}: ")]
        assert [text for text in own if text in wrong] == wrong
