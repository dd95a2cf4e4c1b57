"""The library: what a notebook imports, against the files of the command line and against itself, to the last bit."""

import json
import pickle
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from matplotlib import pyplot
from matplotlib.figure import Figure
from mocap.datasets import make_lizard, write_recording

import mocap
from docs.tools import columns
from mocap.cli.main import main
from mocap.io.registry import read as read_file
from mocap.rerun.palette import depth
from mocap.variables import VARIABLES

FRAMES = 120


@pytest.fixture(scope="module")
def twin(tmp_path_factory):
    recording = make_lizard(seed=0, n_frames=FRAMES)
    return recording, write_recording(recording, tmp_path_factory.mktemp("twin"))


@pytest.fixture(scope="module")
def recording(twin):
    made, files = twin
    return mocap.read(files["pixels"], calibration=files["coefficients"], fps=made.fps, skeleton=files["skeleton"])


@pytest.fixture(scope="module")
def tracked(recording):
    return mocap.track(recording, model="constant_velocity", validate=False)


@pytest.fixture(scope="module")
def saved(tracked, tmp_path_factory):
    return tracked.save(tmp_path_factory.mktemp("saved") / "run")


def test_tracking_does_not_import_what_few_recordings_need():
    """``scipy.stats``, which ``scipy.signal`` loads as well, is a quarter of what is imported, for two formulas.

    OpenCV straightens videos, Parquet holds long recordings.
    """
    script = (
        "import sys, mocap.cli.main, mocap.results.tracked, mocap.report.job, mocap.rerun.record; "
        "rare = {'scipy.stats', 'scipy.signal', 'filterpy', 'cv2', 'pyarrow.parquet'}; "
        "print(*sorted(rare & set(sys.modules)))"
    )
    found = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert not found.stdout.split()


DEAR = {"matplotlib", "rerun", "distributed", "scipy.stats", "filterpy", "rich.markdown"}


@pytest.mark.parametrize(
    ("header", "last", "said", "dear"),
    [
        ("time_s,a_x,a_y,a_z", "0.2,0.2,0,0.1", "1 point, 3 frames", DEAR),
        ("pt1_cam1_X,pt1_cam1_Y,pt1_cam2_X,pt1_cam2_Y", "7,NaN,NaN,8", "3 frames", DEAR | {"pandas", "scipy"}),
    ],
    ids=["positions", "pixels without a rate"],
)
def test_describing_a_short_table_imports_no_filter_and_no_picture(tmp_path, header, last, said, dear):
    """It is read and cleaned, as tracking does, and that is all; what nobody can clean needs no Dataset either."""
    path = tmp_path / "x.csv"
    path.write_text(f"{header}\n0,0,0,0\n0.1,0.1,0,0\n{last}\n")
    script = (
        f"import sys, contextlib; sys.argv = ['mocap', 'info', {str(path)!r}]; import mocap.cli.main as m\n"
        "with contextlib.suppress(SystemExit): m.main()\n"
        f"print(*sorted({dear!r} & set(sys.modules)), file=sys.stderr)"
    )
    found = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert said in found.stdout
    assert not found.stderr.split()


def test_a_command_seldom_looks_for_circles_of_objects():
    """What a command imports to track makes some 200,000 objects, which Python by itself goes through 300 times.

    At its end it goes through none.
    """
    script = (
        "import atexit, gc, sys, contextlib; sys.argv = ['mocap', '--version']; import mocap.cli.main as m\n"
        "atexit.register(lambda: print(gc.get_freeze_count()))  # the first comes last\n"
        "with contextlib.suppress(SystemExit): m.main()\n"
        "count = lambda: sum(one['collections'] for one in gc.get_stats())\n"
        "before = count(); import mocap.results.tracked; print(count() - before)"
    )
    found = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    passes, kept = map(int, found.stdout.split()[-2:])
    assert passes < 50
    assert kept > 100_000


def test_every_public_name_is_there_and_documented():
    """Each name of ``__all__`` exists, is listed by dir, and has a docstring."""
    for name in mocap.__all__:
        assert getattr(mocap, name).__doc__
        assert name in dir(mocap)
    with pytest.raises(AttributeError, match="no attribute 'tracks'"):
        _ = mocap.tracks  # pyright: ignore[reportAttributeAccessIssue]


def test_a_recording_shows_what_it_holds(recording, twin):
    """Frames, markers, cameras, the share seen: as the made recording has them; in a notebook as a table."""
    made, _ = twin
    rows = recording.summary()
    assert rows["frames"].startswith(f"{FRAMES} ")
    assert rows["markers"].split(": ")[1].split(", ") == list(made.truth.names)
    assert rows["cameras"] == str(len(made.cameras))
    assert float(rows["seen"].split()[0]) == pytest.approx(100 * made.pixels.seen.mean(), abs=0.051)
    assert recording._repr_html_().count("<tr>") == len(rows)


@pytest.mark.rare
def test_markers_are_laid_out_as_the_tracker_has_them(tracked):
    """Positions, covariance and status by name are those of the arrays that the tracker returned."""
    markers, data = tracked.tracks, tracked.markers
    name, t = markers.names[7], 40
    one = data.sel(keypoint=name, individual="id_0").isel(time=t)
    np.testing.assert_array_equal(one["position"].sel(space=["x", "y", "z"]), markers.xyz_m[t, 7])
    np.testing.assert_array_equal(one["covariance"].transpose("space", "space_to"), markers.cov_m2[t, 7])
    assert int(one["status"]) == markers.status[t, 7]
    assert data["position"].dims == ("time", "space", "keypoint", "individual")


def test_it_gives_what_the_command_writes(tracked, twin, tmp_path, monkeypatch):
    """markers.csv and joints.csv of ``mocap track`` hold the library's numbers, to the decimals that are written."""
    made, files = twin
    words = [files["pixels"], "--dlt", files["coefficients"], "--skeleton", files["skeleton"], "--fps", made.fps]
    words += ["--model", "constant_velocity", "--no-validate", "--out", tmp_path / "run"]
    monkeypatch.setattr(sys, "argv", ["mocap", "track", *map(str, words)])
    with pytest.raises(SystemExit, match="0"):
        main()
    table = pd.read_csv(tmp_path / "run" / "markers.csv")
    for name in tracked.markers["keypoint"].values:
        ours = tracked.markers["position"].sel(keypoint=name, individual="id_0").transpose("time", "space")
        np.testing.assert_allclose(table[[f"{name}_{k}" for k in "xyz"]], ours, atol=0.51e-7)
    table = pd.read_csv(tmp_path / "run" / "joints.csv")
    for name, joint in tracked.joints.items():
        ours = joint.to_dataframe()[["limb_x_m", "limb_y_m", "sd_m"]]
        np.testing.assert_allclose(table[[f"{name}_limb_x", f"{name}_limb_y", f"{name}_sd"]], ours, atol=0.51e-7)
    xr.testing.assert_identical(mocap.load(tmp_path / "run").markers, tracked.markers)


def test_what_was_saved_is_loaded_to_the_last_bit(tracked, saved):
    """Every array and sentence of the run; the potentials give the same values."""
    again = mocap.load(saved.folder)
    xr.testing.assert_identical(again.markers, tracked.markers)
    for name, joint in tracked.joints.items():
        pd.testing.assert_frame_equal(again.joints[name].to_dataframe(), joint.to_dataframe(), check_exact=True)
    for name, potential in tracked.potentials.items():
        q = potential.samples_m[::7] * 1.1
        np.testing.assert_array_equal(again.potential(name).value(q), tracked.potential(name).value(q))
    for name, potential in tracked.spatial_potentials.items():
        q = potential.samples_m[::7] * 1.1
        np.testing.assert_array_equal(again.spatial_potentials[name].value(q), potential.value(q))
    assert again.model == tracked.model
    for name in ("reprojected_px", "innovation_px", "used", "nis", "n_rows", "log_likelihood"):
        np.testing.assert_array_equal(getattr(again, name), getattr(tracked, name))
    np.testing.assert_array_equal(again.ideal_px, tracked.ideal_px)
    assert again.skeleton == tracked.skeleton
    assert again.report == json.loads(json.dumps(tracked.report))
    assert again.report_text == tracked.report_text


def test_every_file_and_column_is_documented(tracked, saved):
    """What a run writes is on the page of files: names of files, columns, variables, keys of the report."""
    names = documented_names(tracked)
    for table in ("markers.csv", "joints.csv", "cycles.csv", "peaks.csv"):
        assert not columns.undocumented(pd.read_csv(saved.folder / table, nrows=0).columns, table, names), table
    quantities = [
        c for c in pd.read_csv(saved.folder / "kinematics.csv", nrows=0) if not c.endswith(("_sd", "_status"))
    ]
    assert not columns.undocumented(quantities, "kinematics.csv", names)
    for table in ("markers.nc", "kinematics.nc"):
        with xr.open_dataset(saved.folder / table, engine="h5netcdf") as found:
            assert not columns.undocumented(map(str, found.variables), table, {}), table
    with xr.open_dataset(saved.folder / "recording.nc", engine="h5netcdf") as found:
        assert set(found.data_vars) <= set(VARIABLES)  # which the page of the record is made of
    report = json.loads((saved.folder / "report.json").read_text())
    assert not columns.undocumented(report, "report.json", {})
    with np.load(next((saved.folder / "potentials").iterdir())) as arrays:
        assert not columns.undocumented(arrays, "potentials/<joint>.npz", {})
    listed = columns.page().split("### ")[0]
    assert not [p.name for p in saved.folder.iterdir() if f"`{p.name}{'/' if p.is_dir() else ''}`" not in listed]


def documented_names(result):
    """What the page's ``<marker>``, ``<joint>``, ... stand for in a result."""
    skeleton, measures = result.skeleton, result.skeleton.measures
    return {
        "marker": result.tracks.names,
        "joint": [joint.name for joint in skeleton.joints],
        "axis": "xyz",
        "stroke": list(measures.strokes),
        "distance": list(measures.distances),
        "area": list(measures.areas),
    }


def test_a_notebook_shows_figures_that_it_did_not_give_axes_for(tracked):
    """pyplot, whose figures a notebook shows, knows the figure; axes that are given stay where they are."""
    before = pyplot.get_fignums()  # of other tests
    ax = tracked.plot.gaps()
    assert pyplot.gcf() is ax.figure
    pyplot.close(ax.figure)
    assert pyplot.get_fignums() == before
    tracked.plot.gaps(ax=Figure().add_subplot())
    assert pyplot.get_fignums() == before


def test_saving_again_needs_to_be_told(tracked, saved, tmp_path, monkeypatch):
    """An earlier result is replaced only where ``overwrite`` says so."""
    with pytest.raises(mocap.MocapError, match="exists"):
        tracked.save(saved.folder)
    monkeypatch.setattr(type(tracked), "write", lambda _result, stage: (stage / "report.json").write_text("again"))
    folder = tmp_path / "run"
    assert [tracked.save(folder, overwrite=again).folder for again in (False, True)] == [folder, folder]


def test_a_folder_without_a_result_is_refused(tmp_path):
    """The message names the folder and what was expected."""
    with pytest.raises(mocap.MocapError, match=r"contains no recording\.nc: expected a folder that .*track"):
        mocap.load(tmp_path)


def test_our_own_reader_reads_what_was_saved(tracked, saved):
    """markers.nc is a movement file: positions, status and rate come back."""
    found = read_file(saved.folder / "markers.nc")
    assert found.points is not None
    np.testing.assert_array_equal(found.points.xyz_m, tracked.tracks.xyz_m)
    np.testing.assert_array_equal(found.points.status, tracked.tracks.status)
    assert found.fps == pytest.approx(250.0)
    assert found.unit == "m"


def test_objects_travel_between_processes(recording, tracked):
    """Recordings and results are pickled whole, as an engine that tracks in other processes needs it."""
    again = pickle.loads(pickle.dumps(recording))
    assert again.summary() == recording.summary()
    xr.testing.assert_identical(pickle.loads(pickle.dumps(tracked)).markers, tracked.markers)


def test_the_gradient_of_a_joints_potential_is_its_slope(tracked):
    """Central differences of the value in metres; their error is of second order in a step of 1e-6 of the range."""
    name = next(iter(tracked.potentials))
    potential = tracked.potential(name)
    samples = potential.samples_m
    q = samples.mean(axis=0) + 0.4 * (samples.max(axis=0) - samples.min(axis=0))
    step = 1e-6 * float(np.ptp(samples))
    along = np.eye(2) * step
    slope = (potential.value(q + along) - potential.value(q - along)) / (2 * step)
    np.testing.assert_allclose(potential.gradient(q), slope, rtol=1e-5, atol=1e-5 * np.abs(slope).max())
    turn = (potential.gradient(q + along) - potential.gradient(q - along)) / (2 * step)
    np.testing.assert_allclose(potential.hessian(q), turn, rtol=1e-4, atol=1e-4 * np.abs(turn).max())


def test_a_potential_is_asked_at_an_angle_and_shows_how_often_it_was_there(tracked):
    """At an angle of degrees V is that of the point there; the shares of all bars are 1; joints are listed."""
    name = next(iter(tracked.potentials))
    assert tracked.potential() == tuple(tracked.potentials)
    potential = tracked.potential(name)
    found = potential.map
    x, y = potential.samples_m.T
    length = np.median(np.hypot(x, y))
    angle = np.degrees(np.arctan2(y, x))
    at = potential.at(degrees=angle)
    q = length * np.stack([np.cos(np.radians(angle)), np.sin(np.radians(angle))], axis=-1)
    np.testing.assert_allclose(at, potential.value(q), atol=1e-12)
    assert potential.at(degrees=90).shape == ()
    assert found.share.sum() == pytest.approx(1.0)
    assert np.isnan(found.never_deg) or potential.at(degrees=found.never_deg) > 0.9
    beyond = found.degrees[np.argmax(found.share)]
    assert np.abs((angle - beyond + 180) % 360 - 180).min() <= 2.5  # half of a bar


@pytest.mark.rare
def test_plots_show_the_samples_they_are_of(tracked):
    """The lines of a joint are its coordinates in mm; the points of a potential its samples."""
    from matplotlib import pyplot

    name = next(iter(tracked.potentials))
    joint = tracked.joints[name]
    lines = joint.plot().get_lines()
    np.testing.assert_allclose(lines[0].get_ydata(), 1e3 * joint.q_m["limb"][:, 0])
    np.testing.assert_allclose(joint.plot("body").get_lines()[2].get_ydata(), 1e3 * joint.q_m["body"][:, 2])
    assert np.isfinite(joint.q_m["world"][joint.filled]).all()
    ax = tracked.potential(name).plot()
    points = ax.get_lines()[0]
    np.testing.assert_allclose(points.get_xdata(), 1e3 * tracked.potential(name).samples_m[:, 0])
    assert "yellow where it was held" in ax.get_title()
    places = {text.get_text(): text.get_position() for text in ax.texts if text.get_text().endswith("°")}
    assert "0°" in places
    for text, (x, y) in places.items():  # degrees are those of the map's own axes
        assert abs((np.degrees(np.arctan2(y, x)) - float(text[:-1]) + 180) % 360 - 180) < 1e-6
    image = ax.get_images()[0]
    np.testing.assert_allclose(255 * np.array(image.cmap(0.0)[:3]), depth(np.array([0.0]))[0], atol=1)  # rerun's
    expert = tracked.potential(name).plot(expert=True)
    bar, low = expert.child_axes[0], expert.collections[0].get_facecolors()[0][:3]
    assert bar.get_position().height > 0.9 * expert.get_position().height
    assert "rank" in expert.get_title()
    # the middle of the first step
    np.testing.assert_allclose(255 * low, depth(np.array([1 / 40]))[0], atol=1)
    with pytest.raises(mocap.MocapError, match="give one of world, body, plane, limb"):
        joint.plot("room")
    with pytest.raises(mocap.MocapError, match="no potential of a joint 'ear'"):
        tracked.potential("ear")
    pyplot.close("all")
