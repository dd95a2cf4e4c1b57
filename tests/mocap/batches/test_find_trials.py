"""Which trials a folder holds, with which calibration; the manifest of them."""

import csv
import io
from pathlib import Path

import numpy as np
import pytest
from mocap.datasets import make_bat, write_recording

from mocap.batches.find import find_trials
from mocap.batches.trial import is_manifest, read_manifest, write_manifest
from mocap.errors import FormatError, MocapError
from mocap.io.csv_table import write_table
from mocap.io.manifest import MANIFEST
from tests.real_data import real

ROWS = "a_x,a_y,a_z\n1,2,3\n2,3,4\n3,4,6\n"


@pytest.fixture(scope="module")
def twin(tmp_path_factory):
    """A recording with three cameras as the files of many programs."""
    recording = make_bat(seed=1, n_frames=4, n_cameras=3)
    return recording, write_recording(recording, tmp_path_factory.mktemp("twin"), others=True)


def put(twin, folder, name, *kinds):
    """Some of the twin's files, under the name of a trial."""
    folder.mkdir(parents=True, exist_ok=True)
    for kind in kinds:
        source = twin[1][kind]
        (folder / source.name.replace(twin[0].name, name)).write_bytes(source.read_bytes())


def write_deeplabcut(path, uv):
    """Pixels of one camera as DeepLabCut writes them."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = ["scorer,dlc,dlc,dlc", "bodyparts,tip,tip,tip", "coords,x,y,likelihood"]
    path.write_text("\n".join([*lines, *(f"{t},{u},{v},0.99" for t, (u, v) in enumerate(uv))]) + "\n")


def test_a_lab_of_folders(twin, tmp_path):
    """Each trial with the calibration of its name, else of its folder, else of the folder above; others say why not."""
    lab = tmp_path / "lab"
    put(twin, lab / "bat1", "t1", "pixels", "coefficients", "profile", "skeleton", "offsets", "points", "project")
    put(twin, lab / "bat1", "t2", "pixels", "coefficients")
    put(twin, lab / "bat2" / "day1", "t3", "pixels")
    put(twin, lab / "bat2" / "calibration", "rig", "calibration")
    put(twin, lab / "bat3", "t4", "c3d")
    put(twin, lab / "bat3", "t5", "pixels")
    (lab / "bat3" / "notes.csv").write_text("what,when\nflew,noon\n")
    (lab / "bat3" / "t6.c3d").write_bytes(b"cut")
    found = {trial.name: trial for trial in find_trials([lab])}
    assert list(found) == ["bat1/t1", "bat1/t2", "bat2/day1/t3", "bat3/notes", "bat3/t4", "bat3/t5", "bat3/t6"]
    names = {name: {k: v.name for k, v in trial.arguments.items()} for name, trial in found.items()}
    assert names["bat1/t1"] == {
        "calibration": "t1_dltCoefs.csv", "profile": "t1_camera_profile.txt", "skeleton": "t1_skeleton.toml"
    }  # fmt: skip
    assert found["bat1/t1"].paths[0].name == "t1_xypts.csv"
    assert names["bat1/t2"]["calibration"] == "t2_dltCoefs.csv"
    assert found["bat2/day1/t3"].arguments["calibration"] == lab / "bat2" / "calibration" / "rig_calibration.toml"
    assert "without a calibration" in found["bat3/t5"].skip
    assert "up to lab" in found["bat3/t5"].skip
    assert "columns" in found["bat3/notes"].skip
    assert not found["bat3/t4"].skip
    assert not found["bat3/t6"].skip  # a C3D file that cannot be read is a trial that fails


@pytest.mark.parametrize(
    ("paths", "names", "animals"),
    [
        (
            ["bat07/day1/trial3/bat07_day1_trial3", "bat07/day2/trial3/Trial3", "bat08/day1/bat08-trial1"],
            ["bat07/day1/trial3", "bat07/day2/trial3", "bat08/day1/trial1"],
            ["bat07", "bat07", "bat08"],
        ),
        (["day1/Rat 12/run", "day2/Rat 12/run"], ["day1/Rat 12/run", "day2/Rat 12/run"], ["Rat 12"] * 2),
        (["trial1/trial1", "trial2/trial2"], ["trial1", "trial2"], ["", ""]),
        (["FE404/FE404", "FE405/digitised/FE405"], ["FE404", "FE405/digitised"], ["", ""]),  # folders of one trial
        (["light/a", "light/b", "2024/c", "cam1/d"], ["2024/c", "cam1/d", "light/a", "light/b"], [""] * 4),
        (["t1/t10", "t1/t1b"], ["t1/t10", "t1/t1b"], ["", ""]),
        (
            ["078A3/F1/x", "078A3/F2/x", "FE404/F2/x"],
            ["078A3/F1/x", "078A3/F2/x", "FE404/F2/x"],
            ["078A3"] * 2 + ["FE404"],
        ),
        (["Luna/F2/x", "Max/F2/x"], ["Luna/F2/x", "Max/F2/x"], ["", ""]),  # a flight of each
        (["2Apr2021/b7/x", "3Apr2021/b7/x"], ["2Apr2021/b7/x", "3Apr2021/b7/x"], ["b7", "b7"]),
    ],
)
def test_names_say_nothing_twice_and_animals_are_those_that_folders_tell(tmp_path, paths, names, animals):
    """A name is the folders and what the file adds; folders that number days, trials or one trial name no animal."""
    for path in paths:
        file = tmp_path / f"{path}_xyzpts.csv"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(ROWS.replace("a_x,a_y,a_z", "a_X,a_Y,a_Z"))
    found = find_trials([tmp_path])
    assert [trial.name for trial in found] == names
    assert [trial.animal for trial in found] == animals


def test_formats_that_no_list_of_a_batch_names_are_trials(tmp_path):
    """Tables of Kinovea and Caliscope's points hold positions or pixels of one camera: what mocap track takes."""
    (tmp_path / "walk_xyz.csv").write_text(
        "sync_index,point_id,x_coord,y_coord,z_coord\n0,1,0.1,0.2,0.3\n1,1,0.2,0.2,0.3\n"
    )
    (trial,) = find_trials([tmp_path])
    assert (trial.skip, trial.paths[0].name) == ("", "walk_xyz.csv")


def test_one_of_two_calibrations_is_not_guessed(twin, tmp_path):
    """Two of one kind, neither named as the trial: skipped, and both are named; stated, it is tracked."""
    put(twin, tmp_path, "t1", "pixels")
    put(twin, tmp_path, "monday", "coefficients")
    put(twin, tmp_path, "tuesday", "coefficients")
    (trial,) = find_trials([tmp_path])
    assert "monday_dltCoefs.csv, tuesday_dltCoefs.csv" in trial.skip
    stated = {"calibration": tmp_path / "monday_dltCoefs.csv"}
    (trial,) = find_trials([tmp_path], arguments=stated)
    assert not trial.skip
    assert trial.arguments == stated


@pytest.mark.parametrize("layout", ["{trial}/{camera}", "{trial}_{camera}", "{camera}/{trial}"])
def test_views_of_a_trial_are_put_together(twin, tmp_path, layout):
    """Pixel files of one camera each: a folder a trial, all in one folder, or a folder a camera."""
    recording, files = twin
    (tmp_path / "calibration.toml").write_bytes(files["calibration"].read_bytes())
    for trial in ("t1", "t2"):
        for camera, uv in zip(recording.pixels.cameras, recording.pixels.uv_px[:, :, 0], strict=True):
            write_deeplabcut(tmp_path / f"{layout.format(trial=trial, camera=camera)}.csv", np.nan_to_num(uv))
    found = {trial.name: trial for trial in find_trials([tmp_path])}
    assert list(found) == ["t1", "t2"]
    for name, trial in found.items():
        assert len(trial.paths) == 3
        assert all(name in path.as_posix().removeprefix(tmp_path.as_posix()) for path in trial.paths)
        assert trial.arguments["calibration"].name == "calibration.toml"


def test_a_manifest_is_what_it_was_written_from(twin, tmp_path):
    """Trials, paths and all that is stated come back, from another folder too."""
    put(twin, tmp_path / "lab" / "bat1", "t1", "pixels", "coefficients", "skeleton")
    put(twin, tmp_path / "lab" / "bat 2", "t;2", "c3d")
    (tmp_path / "lab" / "bat 2" / "t;2_xyzpts.c3d").rename(tmp_path / "lab" / "bat 2" / "t2.c3d")
    trials = find_trials([tmp_path / "lab"], arguments={"fps": 240.0, "unit": "mm", "origin": "upper-left"})
    (tmp_path / "lists").mkdir()
    write_manifest(tmp_path / "lists" / "m.csv", trials, folder=tmp_path / "lists")
    again = read_manifest(tmp_path / "lists" / "m.csv")
    assert [t.name for t in again] == ["bat 2/t2", "bat1/t1"]

    def plain(trial):
        stated = {k: v.resolve() if isinstance(v, Path) else v for k, v in trial.arguments.items()}
        return trial.name, [p.resolve() for p in trial.paths], stated, trial.animal, trial.skip

    assert list(map(plain, again)) == list(map(plain, trials))


def test_a_manifest_of_a_spreadsheet(tmp_path):
    """Semicolons as a spreadsheet in Germany writes them; what is stated for all fills what a row does not state."""
    (tmp_path / "a_xyzpts.csv").write_text(ROWS)
    (tmp_path / "m.csv").write_text(
        "trial;path;fps;animal;skip\none;a_xyzpts.csv;;bat7;\ntwo;a_xyzpts.csv;500;;blurred\n"
    )
    one, two = find_trials([tmp_path / "m.csv"], arguments={"fps": 100.0})
    assert (one.arguments["fps"], one.animal, two.arguments["fps"], two.skip) == (100.0, "bat7", 500.0, "blurred")


TABLE = [
    ["trial", "path", "fps", "pixel_sd", "correct_lag", "animal", "note"],
    ["one", "a_xyzpts.csv", "25.56", "0.5", "yes", "bat; 7", "two\nlines"],
    ["two", "a_xyzpts.csv", "500", "", "no", 'the "old" one', ""],
]


@pytest.mark.parametrize("mark", [b"", "\ufeff".encode()])
@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("comma", [False, True])
@pytest.mark.parametrize("quotes", [csv.QUOTE_MINIMAL, csv.QUOTE_ALL])
@pytest.mark.parametrize("empty", [0, 3])
def test_a_manifest_as_spreadsheets_save_it(tmp_path, mark, separator, comma, quotes, empty):
    """Excel and LibreOffice of any country: the same trials, whatever stands between, around and behind the cells."""
    words = {"yes": "WAHR", "no": "FALSCH"} if comma else {}
    stream = io.StringIO()
    writer = csv.writer(stream, delimiter=separator, quoting=quotes, lineterminator="\r\n")
    for row in TABLE:
        cells = [cell.replace(".", ",") if comma and cell.replace(".", "").isdigit() else cell for cell in row]
        writer.writerow([*(words.get(cell, cell) for cell in cells), *[""] * empty])
    writer.writerow([""] * (len(TABLE[0]) + empty))
    (tmp_path / "m.csv").write_bytes(mark + stream.getvalue().encode())
    assert is_manifest(tmp_path / "m.csv")
    one, two = read_manifest(tmp_path / "m.csv")
    assert one.arguments == {"fps": 25.56, "pixel_sd": 0.5, "correct_lag": True}
    assert two.arguments == {"fps": 500.0, "correct_lag": False}
    assert (one.animal, two.animal) == ("bat; 7", 'the "old" one')


def test_a_manifest_in_the_letters_of_windows(tmp_path):
    """Excel saves "CSV" in Windows-1252."""
    (tmp_path / "flügel_xyzpts.csv").write_text(ROWS)
    (tmp_path / "m.csv").write_bytes("trial;path;animal\none;flügel_xyzpts.csv;Fledermaus März\n".encode("cp1252"))
    (trial,) = find_trials([tmp_path / "m.csv"])
    assert (trial.paths[0].name, trial.animal) == ("flügel_xyzpts.csv", "Fledermaus März")


@pytest.mark.parametrize(
    ("table", "told"),
    [
        ("trial,path,callibration\na,a.c3d,x\n", None),
        ("trial,path,fps\na,a.c3d,fast\n", "line 2: fps 'fast' is not a number"),
        ('trial,path,fps\na,a.c3d,"1,000"\n', "line 2: fps '1,000' is not a number"),  # one, or a thousand
        ("trial;path;fps\na;a.c3d;b.c3d;7\n", "line 2: '7' stands beyond the last column"),
        ("trial,path,path\na,a.c3d,b.c3d\n", "path (twice)"),
        ("trial,path\na," + "x" * 200_000 + "\n", "line 2 has a cell of more than"),
        ("trial,path\na,a.c3d\nA,b.c3d\n", "line 3: two trials are called 'A'"),
        ("trial,path\n../a,a.c3d\n", "line 2: the trial '../a'"),
        ("trial,path\na,\n", "line 2: names no file"),
        ("trial,path\n", "has no trials"),
    ],
)
def test_a_manifest_with_a_mistake(tmp_path, table, told):
    """The line and what is wrong with it; a table with other columns is no manifest."""
    path = tmp_path / "m.csv"
    path.write_text(table)
    if told is None:
        (trial,) = find_trials([path])
        assert "columns" in trial.skip
        with pytest.raises(FormatError, match="callibration"):
            read_manifest(path)
        return
    with pytest.raises(FormatError, match=r"m\.csv") as refused:
        find_trials([path])
    assert told in str(refused.value)


def test_nothing_found_says_what_was_looked_for(tmp_path):
    """And where."""
    with pytest.raises(MocapError, match=r"no trial was found: .*C3D") as refused:
        find_trials([tmp_path])
    assert str(tmp_path) in str(refused.value)
    with pytest.raises(MocapError, match="no file or folder fits"):
        find_trials([f"{tmp_path}/**/*.c3d"])
    with pytest.raises(MocapError, match="there is no such file or folder"):
        find_trials([tmp_path / "absent"])


def test_results_are_no_trials(tmp_path):
    """The folder of results, and folders that mocap track wrote, are not looked into; patterns find the same."""
    for folder in ("data/day1", "results/x", "data/tracked"):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "a_xyzpts.csv").write_text(ROWS)
    (tmp_path / "data/tracked" / MANIFEST).write_text('{"results": {"track": {"files": {}, "folders": []}}}')
    assert [t.name for t in find_trials([tmp_path], out=tmp_path / "results")] == ["data/day1/a"]
    assert [t.name for t in find_trials([f"{tmp_path}/data/d*/*xyzpts.csv"])] == ["day1/a"]


def test_trials_of_one_name_are_told_apart(tmp_path):
    """The same names in two folders that are given: by the folders; two files of one folder: by what they are."""
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        write_table(tmp_path / folder / "a_xyzpts.csv", ["a_X", "a_Y", "a_Z"], np.arange(9.0).reshape(3, 3))
    assert [t.name for t in find_trials([tmp_path / "one", tmp_path / "two"])] == ["one/a", "two/a"]
    files = [tmp_path / folder / "a_xyzpts.csv" for folder in ("one", "two")]
    found = find_trials(files)
    assert len({trial.name for trial in found}) == 2
    assert {trial.paths[0] for trial in found} == set(files)


def test_plain_tables_are_trials(mocap, tmp_path):
    """As ``mocap track`` reads them: positions by their titles; pixels of one camera are one video."""
    (tmp_path / "lab").mkdir()
    rows = [f"{t},{t / 100},{t},2,3" for t in range(9)]
    (tmp_path / "lab" / "walk.csv").write_text("\n".join(["frame,time,m0_x,m0_y,m0_z", *rows]))
    (tmp_path / "lab" / "run.csv").write_text("\n".join(["frame,time,m0_x,m0_y", *(r[:-2] for r in rows)]))
    (tmp_path / "lab" / "what.csv").write_text("what,why\n1,2\n")
    found = {trial.name: trial for trial in find_trials([tmp_path / "lab"])}
    assert not found["walk"].skip
    assert found["walk"].recording().fps == pytest.approx(100)
    assert found["run"].recording().planar
    assert "a plain table of 2 columns (what, why)" in found["what"].skip
    write_table(tmp_path / "lab" / "walk_xyzpts.csv", ["a_X", "a_Y", "a_Z"], np.arange(9.0).reshape(3, 3))
    (walk,) = (trial for trial in find_trials([tmp_path / "lab"]) if trial.name == "walk")
    assert walk.paths[0].name == "walk_xyzpts.csv"  # a program's own format goes before
    _, _, err = mocap("batch", tmp_path / "lab", "--dry-run", "--out", tmp_path / "m.csv")
    assert err.startswith("2 of 3 trials cannot be tracked: ")  # walk, now, has no frame rate


def test_dry_run_touches_nothing_else(mocap, twin, tmp_path):
    """It writes one file; the trial that cannot be read says why in its note; corrected, it is tracked from."""
    put(twin, tmp_path / "lab", "t1", "pixels", "coefficients")
    (tmp_path / "lab" / "t2.c3d").write_bytes(b"cut")
    before = {path: path.read_bytes() for path in (tmp_path / "lab").iterdir()}
    code, _, err = mocap("batch", tmp_path / "lab", "--dry-run", "--fps", "240", "--out", tmp_path / "trials.csv")
    assert code == 0
    assert "2 trials" in err
    assert {path: path.read_bytes() for path in (tmp_path / "lab").iterdir()} == before
    assert {p.name for p in tmp_path.iterdir()} == {"lab", "trials.csv", MANIFEST}
    with (tmp_path / "trials.csv").open(newline="") as stream:
        rows = {row["trial"]: row for row in csv.DictReader(stream)}
    assert rows["t1"]["path"] == "lab/t1_xypts.csv"
    assert (rows["t1"]["frames"], rows["t1"]["cameras"], rows["t1"]["fps"]) == ("4", "3", "240.0")
    assert "t2.c3d" in rows["t2"]["note"]


def test_real_folders():
    """A lab's folders as they are: four views of DeepLabCut with the rig's easyWand file, and DLTdv's tables."""
    root = real("bat_windtunnel_dltdv8")
    found = {trial.name: trial for trial in find_trials([f"{root}/*/F5_markerless/*.csv", f"{root}/derived_csv/*"])}
    assert list(found) == ["078A3/F5_markerless", "078A3_F5", "FE404_F2"]
    assert not any(trial.skip for trial in found.values())
    markerless = found["078A3/F5_markerless"]
    assert len(markerless.paths) == 4
    assert markerless.arguments["calibration"].name == "extrinsicCalib_20230228_easyWandData.mat"
    assert found["FE404_F2"].arguments["profile"].name == "FE404_F2_camera_profile.txt"


def test_a_manifest_with_a_cell_too_long_is_refused_in_its_line(tmp_path):
    """131,073 characters are no path of a file: one line with the manifest's name, and no word of an error of ours."""
    path = tmp_path / "manifest.csv"
    path.write_text(f"trial,path\na,a.csv\nb,{'x' * 131_073}\n", encoding="utf-8")
    with pytest.raises(FormatError, match=r"^manifest.csv: line 3 has a cell of more than 131,072 characters"):
        read_manifest(path)


def test_a_project_without_coefficients_takes_the_calibration_that_lies_above(tmp_path):
    """As pixels of other programs do; a project that has its own needs none, and takes none."""
    arena, tunnel = real("bat_arena_two_digitisers"), real("bat_windtunnel_dltdv8", "078A3", "F1")
    (without,) = arena.glob("validation_files_1/103*.mat")
    (own,) = tunnel.glob("*.mat")
    (tmp_path / "flight").mkdir()
    for file in (without, own):
        (tmp_path / "flight" / file.name).symlink_to(file)
    (rig,) = arena.glob("*easyWandData.mat")
    (tmp_path / rig.name).symlink_to(rig)
    found = {trial.paths[0].name: trial for trial in find_trials([tmp_path])}
    assert found[without.name].arguments["calibration"].name == rig.name
    assert not found[without.name].skip
    assert "calibration" not in found[own.name].arguments
    assert not found[own.name].skip
