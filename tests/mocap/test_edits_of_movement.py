"""Corrections exchanged with the package movement: its flag of each sample, and its list of swaps and drops."""

import json
from pathlib import Path

import numpy as np
import pytest

import mocap
from mocap.cli.main import app
from mocap.errors import FormatError
from mocap.io.registry import read, write
from mocap.reading.edits import Edit, append_edit, standing
from mocap.reading.edits_of_movement import any_log, committed, write_committed
from tests.mocap.desk.filmed_trial import FPS, trial
from tests.mocap.test_edits import read as read_scene

SIGNED = {"who": "Ada", "when": "2026-01-01T00:00:00+00:00"}
SWAP = Edit(what="exchange", frame=1003, last=2251, marker="nose", other="tail", **SIGNED)
DROP = Edit(what="delete", frame=7, last=7, marker="ear", **SIGNED)
PLACE = Edit(what="place", frame=7, marker="ear", camera="cam1", uv_px=(3.0, 4.0), **SIGNED)
UNDO = Edit(what="undo", **SIGNED)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return trial(tmp_path_factory.mktemp("exchanged"), videos=False)


def test_what_both_state_survives_a_round_trip(tmp_path):
    """Swaps and drops come back as they were; what was undone, and places in an image, are not in the list."""
    path = tmp_path / "edits.json"
    told = write_committed(path, [SWAP, PLACE, DROP, DROP, UNDO], fps=30.0)
    assert any_log(path).edits == [SWAP, DROP]
    assert told == "2 of 3 corrections; 1 in one camera's image left out, which movement cannot state"


def test_the_list_is_as_movement_proposed_it():
    """Its example: frames from 0, the clock to the millisecond (30 frames a second), ``a`` and ``b``."""
    example = {"type": "swap", "t0_frame": 1002, "t1_frame": 2250, "t0": "00:33.400", "t1": "01:15.000"}
    listed, left = committed([SWAP], fps=30.0)
    assert left == 0
    assert example.items() <= listed[0].items()
    assert (listed[0]["a"], listed[0]["b"]) == ("nose", "tail")


def test_a_list_of_theirs_acts_as_ours(scene, tmp_path):
    """A swap and a drop without anything that we add give the recording that our own edits give."""
    ours, theirs = tmp_path / "edits.jsonl", tmp_path / "edits.json"
    names = read_scene(scene).names
    theirs.write_text(
        json.dumps(
            [
                {"type": "swap", "t0_frame": 9, "t1_frame": 11, "a": names[0], "b": names[1]},
                {"type": "drop", "t0_frame": 3, "t1_frame": 4, "keypoints": list(names[2:4])},
            ]
        )
    )
    append_edit(ours, Edit(what="exchange", frame=10, last=12, marker=names[0], other=names[1], **SIGNED))
    for name in names[2:4]:
        append_edit(ours, Edit(what="delete", frame=4, last=5, marker=name, **SIGNED))
    expected, found = read_scene(scene, edits=ours), read_scene(scene, edits=theirs)
    assert found.edited.sum() == 2 * 3 + 2 * 2
    assert found.data.equals(expected.data)


@pytest.mark.parametrize(
    ("listed", "told"),
    [
        ({}, "no list of edits"),
        ([{"type": "drag", "t0_frame": 1}], "edit 1: expected a swap or a drop, got 'drag'"),
        ([{"type": "drop", "t0_frame": 4, "t1_frame": 3, "a": "m"}], "the first before the last"),
        ([{"type": "drop", "t0_frame": True, "a": "m"}], "no frames from 0"),
        ([{"type": "swap", "t0_frame": 1, "t1_frame": 2, "a": "m"}], "needs other"),
        ([{"type": "drop", "t0_frame": 1, "keypoints": "m"}], "no list of names"),
        ([None], "got None"),
    ],
)
def test_what_is_no_such_list_is_named(tmp_path, listed, told):
    """With the number of its edit."""
    path = tmp_path / "edits.json"
    path.write_text(json.dumps(listed))
    with pytest.raises(FormatError, match=told):
        any_log(path)


def test_a_log_is_converted_by_a_command(tmp_path):
    """``mocap convert edits.jsonl edits.json`` writes the list."""
    log, out = tmp_path / "edits.jsonl", tmp_path / "edits.json"
    for edit in (SWAP, PLACE, DROP):
        append_edit(log, edit)
    app(["convert", str(log), str(out), "--fps", "30"], standalone_mode=False)
    assert standing(any_log(out).edits) == [SWAP, DROP]


@pytest.mark.parametrize("engine", ["h5netcdf", "scipy"])
@pytest.mark.parametrize("dimensions", [2, 3])
def test_the_flag_of_each_sample_is_read_and_written(tmp_path, dimensions, engine):
    """As movement's editor saves it: True where a person has been, without a confidence there.

    By HDF5, and as classic NetCDF, which xarray writes where it finds no library but SciPy.
    """
    import xarray

    rng = np.random.default_rng(1)
    names, shape = ["nose", "tail"], (20, dimensions, 2, 1)
    edited = np.zeros((20, 2, 1), dtype=bool)
    edited[4:7, 1] = True
    confidence = np.where(edited, np.nan, 0.9)
    sample = ("time", "keypoint", "individual")
    theirs = xarray.Dataset(
        {
            "position": (("time", "space", *sample[1:]), 50 + np.cumsum(rng.normal(size=shape), axis=0)),
            "confidence": (sample, confidence),
            "edited": (sample, edited),
        },
        coords={
            "time": np.arange(20) / 50,
            "space": list("xyz"[:dimensions]),
            "keypoint": names,
            "individual": ["id_0"],
        },
        attrs={"ds_type": "poses", "fps": 50.0, "time_unit": "seconds", "source_software": "DeepLabCut"},
    )
    first, again = tmp_path / "theirs.nc", tmp_path / "again.nc"
    theirs.to_netcdf(first, engine=engine)
    contents = read(first)
    np.testing.assert_array_equal(contents.tables["edited"], edited[..., 0])
    assert not write(contents, again)
    with xarray.open_dataset(again, engine="h5netcdf") as found:
        assert found["edited"].dtype == bool
        np.testing.assert_array_equal(found["edited"].values.squeeze(), edited[..., 0])
    stated = {"unit": "mm"} if dimensions == 3 else {}
    np.testing.assert_array_equal(mocap.read(again, **stated).edited, edited[..., 0])


def test_a_result_states_it_as_movement_does(scene, tmp_path):
    """``markers.nc`` flags what a person corrected; movement would show it so, and we read it so."""
    log = tmp_path / "edits.jsonl"
    name = read_scene(scene).names[2]
    append_edit(log, Edit(what="delete", frame=10, last=12, marker=name, **SIGNED))
    mocap.track(read_scene(scene, edits=log), model="constant_velocity", validate=False).save(tmp_path / "out")
    contents = read(next(Path(tmp_path / "out").rglob("markers.nc")))
    assert np.argwhere(contents.tables["edited"]).tolist() == [[9, 2], [10, 2], [11, 2]]
    assert contents.fps == FPS
