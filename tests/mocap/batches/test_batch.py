"""Many trials: one after the other, killed in between, or on a Dask cluster, the same files."""

import errno
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import psutil
import pytest
from dask import config
from distributed import Client, LocalCluster

import mocap as library
from mocap.batches import cluster, run
from mocap.batches.find import find_trials
from mocap.batches.one import track_trial
from mocap.batches.run import shard_of
from mocap.batches.summary import write_summary
from mocap.batches.trial import Options, earlier_record
from mocap.cli.view import with_recording
from mocap.errors import FormatError, MocapError, OutputError
from mocap.io import output
from mocap.io.dltdv import write_points
from mocap.io.manifest import PARTIAL
from mocap.records import marker_tracks
from mocap.rerun.record import write_recording
from mocap.rerun.stored import recording_file
from tests.mocap.batches.trap import Trap, second_held

FPS = 100.0
QUICK = {"fps": FPS, "model": "constant_velocity", "validate": False}
"""The quickest way to a result that is written: where the law is not how well gaps are filled."""
TIMED = {"times.csv", "summary.html", ".mocap-manifest.json"}
"""Files of the results that tell when, or how long."""


def write_trial(path, seed):
    path.parent.mkdir(parents=True, exist_ok=True)
    rng, t_s = np.random.default_rng(seed), np.arange(24) / FPS
    animal = np.random.default_rng(0).normal(0, 0.05, (5, 3))  # one, which the others tell nothing of
    xyz = animal + 0.02 * np.sin(9 * t_s[:, None, None] + rng.uniform(0, 6, (5, 3)))
    xyz += rng.normal(0, 3e-4, xyz.shape)
    xyz[8:12, 2] = np.nan
    write_points(path, marker_tracks("abcde", t_s, xyz))


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """Five trials of two animals, and one that is cut."""
    folder = tmp_path_factory.mktemp("lab")
    for i in range(5):
        write_trial(folder / f"animal{i % 2}" / f"t{i}_xyzpts.csv", i)
    (folder / "animal1" / "bad_xyzpts.csv").write_text("a_X,a_Y,a_Z\n1,2,3\n4,5\n")
    return folder


@pytest.fixture(scope="module")
def scheduler():
    """The address of a Dask cluster of two processes."""
    settings = {"distributed.scheduler.allowed-failures": 1, "distributed.scheduler.worker-saturation": 1.0}
    settings |= {"distributed.worker.memory.terminate": False, "distributed.worker.memory.pause": False}
    with (
        config.set(settings),
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0") as found,
    ):
        yield found.scheduler_address


def contents(out):
    """SHA-256 of every file of the results that does not tell the time."""
    files = {path.relative_to(out).as_posix(): path for path in out.rglob("*") if path.is_file()}
    return {name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in files.items() if name not in TIMED}


@pytest.fixture(scope="module")
def undisturbed(lab, tmp_path_factory):
    """A batch of all trials, and its folder."""
    out = tmp_path_factory.mktemp("results")
    return library.batch(lab, out, **QUICK), out


@pytest.mark.main
def test_each_trial_is_tracked_as_by_itself(lab, undisturbed, tmp_path):
    """The tables are those that mocap.track writes, byte for byte; the bad trial is told and stops nothing."""
    found, out = undisturbed
    assert list(found.table["trial"]) == [
        "animal0/t0",
        "animal0/t2",
        "animal0/t4",
        "animal1/bad",
        "animal1/t1",
        "animal1/t3",
    ]
    assert list(found.table["status"]) == ["done"] * 3 + ["failed"] + ["done"] * 2
    alone = library.track(
        library.read(lab / "animal1/t3_xyzpts.csv", fps=FPS), model="constant_velocity", validate=False
    )
    alone.save(tmp_path / "alone")
    same = ("markers.csv", "markers.nc", "kinematics.csv", "recording.nc", "cycles.csv", "angles.csv")
    for name in same:
        assert (out / "animal1/t3" / name).read_bytes() == (tmp_path / "alone" / name).read_bytes()
    summary = pd.read_csv(out / "summary.csv").set_index("trial")
    assert "bad_xyzpts.csv" in summary.loc["animal1/bad", "error"]
    assert summary.loc["animal1/t3", "gaps"] == 1
    assert summary.loc["animal1/t3", "longest_gap_frames"] == 4
    assert set(pd.read_csv(out / "times.csv")["trial"]) == set(summary.index)
    page = (out / "summary.html").read_text()
    assert "6 trials: 5 done, 1 failed" in page
    assert 'href="animal1/t3/"' in page
    assert found.trial("animal1/t3").name == alone.name
    again = library.load_batch(out)
    same = found.table.assign(error=found.table["error"].str.replace(";", ","))  # as a table's cells are written
    texts = dict.fromkeys(["model", "warning", "unit", "unlike", "mirrored", "camera_names"], "")
    pd.testing.assert_frame_equal(
        again.table, same.astype(dict.fromkeys(texts, object)).fillna(texts), check_dtype=False
    )
    assert list(again.table["animal"]) == ["animal0"] * 3 + ["animal1"] * 3
    assert again.trial("animal1/t3").name == alone.name
    with pytest.raises(MocapError, match=r"'animal1/bad' was not tracked .failed.: bad_xyzpts.csv"):
        again.trial("animal1/bad")
    with pytest.raises(MocapError, match=r"there is no trial 't9' in .*: there are animal0/t0, "):
        again.trial("t9")
    with pytest.raises(FormatError, match=r"expected what mocap batch wrote"):
        library.load_batch(lab)


def test_what_is_done_is_not_done_again(lab, undisturbed, tmp_path, monkeypatch):
    """A second call tracks nothing; a changed file, an option or a lost file of the result: that trial alone."""
    _, out = undisturbed
    before = contents(out)
    told = []
    with monkeypatch.context() as patch:
        patch.setattr(run, "track_here", None)  # no process is asked for
        library.batch(lab, out, progress=told.append, **QUICK)
    assert (told[-1].before, told[-1].total) == (6, 6)
    assert contents(out) == before
    copy = tmp_path / "lab"
    for path in lab.rglob("*.csv"):
        (copy / path.relative_to(lab)).parent.mkdir(parents=True, exist_ok=True)
        (copy / path.relative_to(lab)).write_bytes(path.read_bytes())
    library.batch(copy, out, progress=told.append, **QUICK)
    assert told[-1].before == 6  # the same content elsewhere
    write_trial(copy / "animal0/t2_xyzpts.csv", 7)
    (out / "animal1/t1/markers.csv").unlink()
    library.batch(copy, out, progress=told.append, **QUICK)
    assert told[-1].before == 4
    changed = {name.split("/")[1] for name, of in contents(out).items() if "/" in name and before.get(name) != of}
    assert changed == {"t2"}
    library.batch(lab, out, **QUICK)
    assert contents(out) == before


def test_shards_make_the_same_results(lab, undisturbed, tmp_path):
    """Each takes its part; the summary of the last that ends is that of all; times are a file a shard."""
    _, out = undisturbed
    told = []
    first = library.batch(lab, tmp_path / "out", shard="1/2", progress=told.append, **QUICK)
    assert (told[-1].done, told[-1].total, told[-1].failed) == (3, 3, 0)
    assert {doing for progress in told for doing in progress.workers.values()} >= {
        f"{name}: write" for name in first.own
    }
    assert len(first.table) == len(first.own) == 3
    both = library.batch(lab, tmp_path / "out", shard="2/2", **QUICK)
    assert len(both.table) == 6
    times = {"times_1_of_2.csv", "times_2_of_2.csv"}
    found = contents(tmp_path / "out")
    assert times <= found.keys()
    assert {name: text for name, text in found.items() if name not in times} == contents(out)


@pytest.mark.parametrize("text", ["0/2", "3/2", "1", "a/b", "1/0", "-1/2"])
def test_no_shard(text):
    with pytest.raises(MocapError, match="i from 1 to n"):
        shard_of(text)


def test_a_model_of_all_trials(lab, tmp_path):
    """Learned once from those that can be read; no trial is filled from itself; a shard is told to learn first."""
    options = {"fps": FPS, "validate": False, "model": "learn"}
    found = library.batch(lab / "animal0", tmp_path, **options)
    assert list(found.table["model"]) == ["learned"] * 3
    why = json.loads((tmp_path / "t2" / "report.json").read_text())["model"]["why"]
    assert re.search(r"learned from t0( \(x [\d.]+\))?, t4", why)
    written = (tmp_path / "model.npz").stat().st_mtime_ns
    library.batch(lab / "animal0", tmp_path, **options)
    assert (tmp_path / "model.npz").stat().st_mtime_ns == written
    with pytest.raises(MocapError, match="needs all trials"):
        library.batch(lab, tmp_path, shard="1/2", **options)


def test_a_worker_that_dies_is_replaced(lab, undisturbed, scheduler, tmp_path):
    """Its trial is tried once more, then reported; the others are done; the next run does the rest: the same bytes."""
    counter = tmp_path / "counter"
    counter.write_text("")
    with Client(scheduler, set_as_default=False) as connected:
        connected.register_plugin(Trap("animal0/t2", 2, counter), name="trap")
        found = library.batch(lab, tmp_path / "out", scheduler=scheduler, **QUICK)
        connected.unregister_worker_plugin("trap")
    assert len(counter.read_text()) == 2
    status = found.table.set_index("trial")
    assert list(status["status"]) == ["done", "failed", "done", "failed", "done", "done"], list(status["error"])
    assert "died twice" in status.loc["animal0/t2", "error"]
    library.batch(lab, tmp_path / "out", scheduler=scheduler, **QUICK)
    assert contents(tmp_path / "out") == contents(undisturbed[1])


def has_ended(process):
    """Whether it runs no more; nobody may have asked for its exit code yet."""
    try:
        return process.status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


def test_a_cluster_makes_the_same(lab, undisturbed, scheduler, tmp_path, mocap):
    """The bytes of the processes of this machine; the command says what reaching a scheduler lets others do."""
    code, _, err = mocap(
        "batch", lab, "--out", tmp_path / "out", "--fps", FPS, "--model", "constant_velocity", "--no-validate",
        "--scheduler", scheduler,
    )  # fmt: skip
    assert code == 0
    assert f"Whoever reaches {scheduler} can run programs as you" in err
    assert contents(tmp_path / "out") == contents(undisturbed[1])


@pytest.mark.parametrize("scheduler_goes", [False, True])
def test_without_a_worker_it_ends_in_one_line(lab, tmp_path, monkeypatch, mocap, scheduler_goes):
    """A cluster whose workers do not come, or whose scheduler goes: told, with a summary of what is done."""
    monkeypatch.setattr(cluster, "WORKER_S", 0.5)
    out, look = tmp_path / "out", cluster.Cluster._need_workers
    with LocalCluster(n_workers=0, dashboard_address="127.0.0.1:0") as dask:

        def looks(found):
            if scheduler_goes:
                dask.close()
            look(found)

        monkeypatch.setattr(cluster.Cluster, "_need_workers", looks)
        code, _, err = mocap("batch", lab, "--out", out, "--fps", FPS, "--scheduler", dask.scheduler_address)
    assert code == 1
    assert ("the connection to the Dask scheduler has ended" if scheduler_goes else "without a worker") in err
    assert "0 of 6 trials are finished" in err
    assert sum(line.startswith("error: ") for line in err.splitlines()) == 1
    assert (out / "summary.csv").is_file()


def test_processes_that_die_as_they_start(lab, tmp_path, command):
    """The batch ends, and says that they could not be started; a script without a guard is told so."""
    place = tmp_path / "dies"
    place.mkdir()
    (place / "sitecustomize.py").write_text(
        "import os, signal, sys\nif 'forkserver' in str(sys.orig_argv):\n    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    done = command("batch", lab, "--out", tmp_path / "out", "--fps", FPS, environment={"PYTHONPATH": str(place)})
    assert done.returncode == 1
    assert re.search(r"could not be started.*memory", done.stderr)
    script = tmp_path / "script.py"
    script.write_text(f"import mocap\nmocap.batch({str(lab)!r}, {str(tmp_path / 'out')!r}, fps={FPS})\n")
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 1
    assert 'call mocap below `if __name__ == "__main__":`' in done.stderr.splitlines()[-1]


@pytest.fixture
def command():
    """The command in a process of its own."""

    def run_it(*words, environment=None, timeout_s=300):
        script = "if __name__ == '__main__': from mocap.cli.main import main; main()"
        variables = {**os.environ, **(environment or {})}
        line = [sys.executable, "-c", script, *map(str, words)]
        return subprocess.run(line, capture_output=True, text=True, check=False, timeout=timeout_s, env=variables)

    return run_it


def write_again(folder):
    """The same result once more."""
    files = [path for path in folder.rglob("*") if path.is_file() and not path.name.startswith(".")]
    with output.result_folder(folder, "track", replace=True) as stage:
        for file in files:
            (stage / file.relative_to(folder)).parent.mkdir(parents=True, exist_ok=True)
            (stage / file.relative_to(folder)).write_bytes(file.read_bytes())


def test_a_disk_that_was_full_leaves_nothing(lab, undisturbed, tmp_path, monkeypatch):
    """Where only the last list of a finished trial could not be written, the next run completes and cleans up."""
    out = Path(shutil.copytree(undisturbed[1], tmp_path / "out"))
    folder, real = out / "animal0" / "t0", output.write_manifest

    def full(place, manifest):
        if place == folder and manifest.pending is None:
            raise OSError(errno.ENOSPC, "No space left on device", str(place))
        real(place, manifest)

    with monkeypatch.context() as patch:
        patch.setattr(output, "write_manifest", full)
        with pytest.raises(OutputError):
            write_again(folder)
    assert list(folder.glob(f"{PARTIAL}*"))
    library.batch(lab, out, **QUICK)  # nothing is left to track
    assert not list(out.rglob(f"{PARTIAL}*"))
    assert contents(out) == contents(undisturbed[1])


def test_equal_failures_are_told_once(tmp_path, mocap):
    """In the order of the trials, with a count; before anything is tracked by --dry-run; exit 1 if nothing is."""
    for name in "cab":
        write_trial(tmp_path / "lab" / f"{name}_xyzpts.csv", 0)
    (tmp_path / "lab" / "d_xyzpts.csv").write_text("a_X,a_Y,a_Z\n1,2,3\n4,5\n")
    told = "3 trials (a, b, c): the frame rate is not in the file: give --fps"
    code, _, err = mocap("batch", tmp_path / "lab", "--dry-run", "--out", tmp_path / "m.csv")
    assert code == 0
    assert err.startswith(f"4 of 4 trials cannot be tracked: {told}; d: d_xyzpts.csv: ")
    code, _, err = mocap("batch", tmp_path / "lab", "--out", tmp_path / "out")
    assert code == 1
    lines = [line for line in err.splitlines() if line.startswith("failed: ")]
    assert lines[0] == f"failed: {told}"
    assert lines[1].startswith("failed: d: d_xyzpts.csv: ")
    assert len(lines) == 2


def test_killed_at_once(lab, undisturbed, tmp_path):
    """SIGKILL of the command while it tracks, and it goes on: the same bytes, nothing done twice, nothing left over."""
    out = tmp_path / "out"
    command = [sys.executable, "-c", "if __name__ == '__main__': from mocap.cli.main import main; main()"]
    command += ["batch", str(lab), "--out", str(out), "--fps", str(FPS), "--jobs", "1"]
    command += ["--model", "constant_velocity", "--no-validate"]
    place = second_held(tmp_path)
    environment = {**os.environ, "PYTHONPATH": str(place)}
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment) as running:
        while not (place / "held").exists() and running.poll() is None:
            time.sleep(0.05)
        left = psutil.Process(running.pid).children(recursive=True)
        running.kill()
    end = time.monotonic() + 10  # they end when its pipes do
    while not all(map(has_ended, left)):
        assert time.monotonic() < end, [process for process in left if not has_ended(process)]
        time.sleep(0.05)
    first = {path: path.stat().st_mtime_ns for path in out.glob("*/*/trial.json")}
    assert len(first) == 1
    library.batch(lab, out, **QUICK)
    assert contents(out) == contents(undisturbed[1])
    assert {path: path.stat().st_mtime_ns for path in first} == first
    assert not list(out.rglob(".mocap-partial*"))


def test_a_result_is_looked_at(undisturbed, tmp_path, monkeypatch):
    """A batch leaves the recording for the viewer out; mocap view makes it of the result."""
    monkeypatch.setattr("mocap.rerun.record.write_recording", write_recording)
    folder = undisturbed[1] / "animal1" / "t3"
    assert not (folder / "recording.rrd").exists()
    made = with_recording(folder, tmp_path)
    assert made.name == "t3"  # as a shared page calls it
    assert recording_file(made).stat().st_size > 1000


@pytest.mark.main
def test_wrong_usage(lab, tmp_path, mocap, monkeypatch):
    """One line each that tells what to do."""
    monkeypatch.setattr(cluster, "CONNECT_S", 0.5)
    for options, told in (
        ({"model": "bad.npz"}, "or a file that mocap learn wrote"),
        ({"jobs": 0}, "give 1 or more"),
        ({"memory": "100MB"}, "needs 500 MB"),
        ({"memory": "much"}, "give it as 2GB"),
        ({"limit_s": 0}, "seconds that a trial may take"),
        ({"scheduler": "tcp://127.0.0.1:9"}, "no Dask scheduler answers"),
    ):
        with pytest.raises(MocapError, match=told):
            library.batch(lab, tmp_path / "out", **{**QUICK, **options})
    with pytest.raises(OutputError, match="lies where its result would be written"):
        library.batch(_in_its_own_place(tmp_path), tmp_path / "data", **QUICK)
    code, _, err = mocap("batch", tmp_path / "absent", "--out", tmp_path / "out")
    assert code == 1
    assert "there is no such file or folder" in err


def _in_its_own_place(folder):
    write_trial(folder / "data" / "t" / "t_xyzpts.csv", 0)
    return folder / "data" / "t" / "t_xyzpts.csv"


def test_long_trials_are_tracked_in_blocks(tmp_path, monkeypatch):
    """As by mocap track; the batch has their frames, and their cycles beside those of the others."""
    monkeypatch.setattr("mocap.batches.one.LONG", 20)
    monkeypatch.setattr("mocap.recording.BLOCK", 10)
    write_trial(tmp_path / "lab" / "bat07" / "t_xyzpts.csv", 1)
    trial = find_trials([tmp_path / "lab"], arguments={"fps": FPS})[0]
    options = Options(model="constant_velocity", validate=False)
    record = track_trial(trial, options, tmp_path / "out")
    folder = tmp_path / "out" / trial.name
    assert record.status == "done"
    assert (record.row["frames"], record.row["markers"]) == (24, 5)
    assert record.row["measured_percent"] == pytest.approx(100 * (1 - 4 / 120), abs=0.01)
    assert "seconds_total" not in json.loads((folder / "report.json").read_text())
    assert {"markers.parquet", "cycles.csv", "angles.csv", "blocks.csv"} <= {path.name for path in folder.iterdir()}
    write_summary([record], tmp_path / "out")
    assert (tmp_path / "out" / "cycles.csv").read_text().startswith("trial,animal")
    assert earlier_record(trial, options, tmp_path / "out") == record
