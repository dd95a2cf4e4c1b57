"""``mocap learn`` and ``mocap track --model``: a model of several recordings, and what people are told."""

import json
import sys
import weakref
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from mocap.datasets import make_bat
from mocap.filters.hidden_gaps import EACH_MARKER, Effort
from mocap.filters.hide import hide_neighbours
from mocap.filters.model import learn_model, renamed, track_with
from mocap.filters.models.articulated import ArticulatedSettings
from mocap.filters.models.constant_velocity import learn_constant_velocity
from mocap.filters.observations import PositionObservations
from mocap.filters.score import joined, residuals_of
from mocap.filters.track import smooth

from mocap.cleaning.cleaning import clean
from mocap.cli.main import main
from mocap.io.dltdv import write_points
from mocap.io.manifest import MANIFEST
from mocap.reading.arrays import from_arrays
from mocap.reading.reading import read
from mocap.recording import Source, of_points
from mocap.records import MarkerTracks, Status
from mocap.skeleton import Bone, Skeleton, write_skeleton
from mocap.tracking import learning
from mocap.tracking.learning import _told_apart, readable_scores
from mocap.tracking.model_file import load_model, save_model
from mocap.tracking.tracking import marker_trial, seen_part
from tests.real_data import real

NAMES = ("sternum", "back", "shoulder_l", "shoulder_r", "elbow_l", "wrist_l")
FPS, SD_M = 240.0, 3e-4


def write_flight(path, seed, *, names=NAMES, n_frames=70, hole=None):
    """A few markers of a flight as an xyzpts file; the truth."""
    flight = make_bat(seed=seed, n_frames=n_frames, n_cameras=2).truth
    truth = flight.xyz_m[:, [flight.names.index(name) for name in names]]
    xyz = truth + np.random.default_rng(seed).normal(0, SD_M, truth.shape)
    if hole is not None:
        xyz[hole] = np.nan
    origin = np.where(np.isnan(xyz[..., 0]), Status.MISSING, Status.MEASURED)
    cov = np.where(np.isnan(xyz[..., 0])[..., None, None], np.nan, SD_M**2 * np.eye(3))
    write_points(path, MarkerTracks(names=names, t_s=flight.t_s, xyz_m=xyz, cov_m2=cov, status=origin))
    return truth


@pytest.fixture(scope="module")
def flights(tmp_path_factory):
    """Two flights to learn from, and one with a wrist that is not seen for 15 frames, and its truth."""
    folder = tmp_path_factory.mktemp("flights")
    for seed in (0, 1):
        write_flight(folder / f"f{seed}_xyzpts.csv", seed, n_frames=50)
    truth = write_flight(folder / "f2_xyzpts.csv", 2, hole=(slice(25, 40), 5))
    return folder, truth


@pytest.fixture(scope="module")
def model(flights):
    """Learned by the command."""
    folder, _ = flights
    path = folder / "bat.npz"
    with pytest.MonkeyPatch.context() as patch:
        tracks = [str(folder / f"f{seed}_xyzpts.csv") for seed in (0, 1)]
        patch.setattr(sys, "argv", ["mocap", "learn", *tracks, "--fps", "240", "--out", str(path)])
        with pytest.raises(SystemExit) as stopped:
            main()
    assert not stopped.value.code
    return path


@pytest.mark.quick
def test_learn_then_track(mocap, flights, model, tmp_path):
    """The gap of a third flight is filled by the learned model, nearer than by a line; the report names its trials.

    A wrist moves by 40 mm in 15 frames, which is half a beat: the line through the gap misses by a good part of it.
    """
    folder, truth = flights
    learned = load_model(model)
    assert learned.names == NAMES
    assert [trial.name for trial in learned.trials] == ["f0", "f1"]
    assert learned.dt_s == pytest.approx(1 / FPS, rel=1e-9)
    before = model.read_bytes()
    out = tmp_path / "run"
    code, stdout, err = mocap(
        "track", folder / "f2_xyzpts.csv", "--fps", 240, "--model", model, "--out", out, "--no-validate", "--json"
    )
    assert code == 0, err
    report = json.loads(stdout)
    assert report["model"]["name"] == "learned"
    assert report["model"]["why"] == "learned from f0, f1"
    markers = pd.read_csv(out / "markers.csv")
    hole = slice(25, 40)
    assert (markers["wrist_l_origin"][hole] == "smoothed").all()
    xyz = markers[[f"wrist_l_{axis}" for axis in "xyz"]].to_numpy()
    off = np.linalg.norm(xyz - truth[:, 5], axis=1)[hole]
    ends = truth[[24, 40], 5]
    line = ends[0] + np.linspace(0, 1, 17)[1:-1, None] * (ends[1] - ends[0])
    straight = np.linalg.norm(line - truth[hole, 5], axis=1)
    assert np.sqrt(np.mean(off**2)) < 0.4 * np.sqrt(np.mean(straight**2))
    assert model.read_bytes() == before


@pytest.mark.rare
def test_a_model_of_numbered_points_tracks_what_a_skeleton_names(mocap, model, tmp_path):
    """Files that number their points, a skeleton that names them by aliases: sample by sample what named files give."""
    numbers = {name: f"pt{i}" for i, name in enumerate(NAMES, start=1)}
    learned = load_model(model)
    save_model(
        replace(
            learned,
            names=tuple(map(numbers.__getitem__, learned.names)),
            trunk=tuple(map(numbers.__getitem__, learned.trunk)),
            bones=tuple((numbers[a], numbers[b]) for a, b in learned.bones),
        ),
        tmp_path / "numbered.npz",
    )
    named = tmp_path / "named_xyzpts.csv"
    write_flight(named, 2, n_frames=40, hole=(slice(15, 25), 5))
    text = named.read_text()
    for name, number in numbers.items():
        text = text.replace(f"{name}_", f"{number}_")
    (tmp_path / "numbered_xyzpts.csv").write_text(text)
    plain = Skeleton(name="bat", markers=NAMES)
    write_skeleton(tmp_path / "named.toml", plain)
    write_skeleton(tmp_path / "aliases.toml", replace(plain, aliases={n: name for name, n in numbers.items()}))
    for out, tracks, skeleton, used in (
        ("named", named, "named.toml", model),
        ("numbered", tmp_path / "numbered_xyzpts.csv", "aliases.toml", tmp_path / "numbered.npz"),
    ):
        code, _, err = mocap(
            "track", tracks, "--fps", FPS, "--model", used, "--skeleton", tmp_path / skeleton, "--no-validate",
            "--out", tmp_path / out,
        )  # fmt: skip
        assert code == 0, err
    assert (tmp_path / "named" / "markers.csv").read_text() == (tmp_path / "numbered" / "markers.csv").read_text()


@pytest.mark.rare
def test_joints_are_one_more_model_where_there_are_bones(mocap, tmp_path):
    """``--joints`` mixes joint angles in and says how well they fill; without bones it says what is missing."""
    tracks = tmp_path / "s_xyzpts.csv"
    write_flight(tracks, 0, n_frames=40)
    bones = tuple(Bone(a=a, b=b) for a, b in (("shoulder_l", "elbow_l"), ("elbow_l", "wrist_l")))
    write_skeleton(tmp_path / "arm.toml", Skeleton(name="arm", markers=NAMES, bones=bones, trunk=NAMES[:4]))
    path = tmp_path / "m.npz"
    code, _, err = mocap("learn", tracks, "--fps", FPS, "--joints", "--out", path)
    assert code == 1
    assert "rigid bones attached to the trunk" in err
    assert not path.exists()
    code, stdout, err = mocap(
        "learn", tracks, "--fps", FPS, "--joints", "--skeleton", tmp_path / "arm.toml", "--out", path
    )
    assert code == 0, err
    assert [type(model) for model in load_model(path).models][1] is ArticulatedSettings
    assert "joint angles" in stdout + err


def test_names_that_a_model_knows_are_not_taken(model):
    """An alias does not give a marker the name of another that the model has; two are not made one."""
    learned = load_model(model)
    other = replace(learned, names=("pt1", *learned.names[1:]))
    skeleton = Skeleton(name="s", markers=NAMES, aliases={"pt1": NAMES[1], NAMES[2]: NAMES[0], NAMES[3]: NAMES[0]})
    assert renamed(other, skeleton.renamed(other.names)).names == other.names


@pytest.mark.rare
def test_validation_measures_the_learned_model_too(mocap, flights, model, tmp_path):
    """Hidden samples of the recording are filled by all methods, the learned one among them, and told."""
    folder, _ = flights
    code, stdout, err = mocap(
        "track", folder / "f2_xyzpts.csv", "--fps", 240, "--model", model, "--out", tmp_path / "run", "--json"
    )
    assert code == 0, err
    methods = json.loads(stdout)["validation"]["methods"]
    assert {"learned", "linear", "cubic"} <= set(methods)
    assert methods["learned"]["rmse_mm"] < methods["linear"]["rmse_mm"]


@pytest.mark.quick
def test_what_was_learned_is_told(model):
    """Errors by length of gap, a row for each model and the mixture, whose intervals have two; bones of the file."""
    learned = load_model(model)
    text, _, bones = readable_scores(learned).partition("Distances that models with bones keep")
    with np.load(model) as file:
        arm = file["bone_ends"].tolist().index([learned.names.index(name) for name in ("shoulder_l", "elbow_l")])
        assert f"| shoulder_l, elbow_l | {1e3 * file['bone_length_m'][arm]:.4g} | " in bones
    assert "6 markers, 240 frames a second" in text
    rows = [line for line in text.splitlines() if line.startswith("| ")]
    assert len(rows) == 1 + len(learned.scores) + 2
    scores = learned.scores["mixture"]
    assert rows[-3].startswith(f"| mixture | {scores['rmse_mm'][0]:.3g} | ")
    assert rows[-2].startswith(f"| inside | {scores['coverage95'][0]:.0f} % | ")
    assert rows[-1].startswith(f"| z | {scores['z'][0]:.2f} | ")
    assert all(f"{n} frames" in rows[0] for n in scores["gap_frames"])


@pytest.mark.quick
def test_recordings_of_one_name_are_told_apart():
    """By their folders, as trials of a season often have the name of the camera alone."""
    one = from_arrays(np.zeros((3, 2, 3)), names=["a", "b"], fps=100, unit="m")
    named = [("bat", Path("monday/bat.csv")), ("bat", Path("tuesday/bat.csv")), ("cat", Path("cat.csv")), ("bat", None)]
    told = _told_apart([replace(one, name=name, source=Source(file=file)) for name, file in named])
    assert [one.name for one in told] == ["monday/bat", "tuesday/bat", "cat", "bat"]


@pytest.mark.rare
def test_json_is_one_object_and_a_seed_the_same_model(mocap, flights, tmp_path):
    """--json: where it is and how it did, nothing else on stdout; the same files and seed give the same model."""
    folder, _ = flights
    short = tmp_path / "s_xyzpts.csv"
    write_flight(short, 0, names=NAMES[:4], n_frames=26)
    path = tmp_path / "m.npz"
    arguments = ["learn", short, "--fps", 240, "--out", path, "--json"]
    code, stdout, err = mocap(*arguments)
    assert code == 0, err
    summary = json.loads(stdout)
    assert summary["out"] == str(path)
    first = load_model(path)
    assert summary["scores"] == first.scores
    assert "s: 26 frames, 104 samples" in err
    code, _, err = mocap(*arguments)
    assert code == 1
    assert "--force" in err
    assert mocap(*arguments, "--force")[0] == 0
    again = load_model(path)
    assert again.scores == first.scores
    assert again.models == first.models
    assert mocap("learn", short, "--fps", 240, "--out", short, "--force")[0] == 1
    assert {p.name for p in tmp_path.iterdir()} == {"s_xyzpts.csv", "m.npz", MANIFEST}
    assert folder.exists()


def test_the_model_is_never_written_over(mocap, flights, model):
    """It is read from, as the recording is."""
    folder, _ = flights
    before = model.read_bytes()
    for out in (model, model.parent):
        code, _, err = mocap("track", folder / "f2_xyzpts.csv", "--fps", 240, "--model", model, "--out", out, "--force")
        assert code == 1
        assert "read from" in err
    assert model.read_bytes() == before


def test_of_very_many_recordings_some_are_kept(monkeypatch):
    """Memory does not grow with their number: each is read when its turn comes, and most are dropped again."""
    monkeypatch.setattr(learning, "MOST_FRAMES", 120)
    monkeypatch.setattr(learning, "LONGEST", 30)
    alive, most, told = weakref.WeakSet(), 0, []

    def flights():
        nonlocal most
        for seed in range(9):
            flight = make_bat(seed=seed, n_frames=40, n_cameras=2)
            one = clean(of_points(flight.truth, flight.skeleton, name=f"f{seed}"))
            alive.add(one)
            most = max(most, len(alive))
            yield one
            del one

    learned = learning.learn_from(
        flights(), effort=Effort(times=1), models=(EACH_MARKER, EACH_MARKER), tell=told.append
    )
    assert len(learned.trials) == 4
    assert [len(trial.t_s) for trial in learned.trials] == [30] * 4
    names = [trial.name for trial in learned.trials]
    assert names == sorted(names)
    assert "learned from 4 of 9 recordings, drawn by chance: 120 frames" in told
    assert most <= 2


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (
            "best",
            "--model best: give auto, mixture, eal, articulated, lagrangian, smooth_acceleration, constant_velocity, "
            "or a file that mocap",
        ),
        ("nowhere.npz", "--model nowhere.npz: there is no such file: give auto"),
        (".", "--model .: is a folder: give auto"),
    ],
)
def test_a_wrong_name_of_a_model(mocap, flights, tmp_path, given, said):
    """The three names and the file are said, in one line; nothing is written."""
    folder, _ = flights
    code, stdout, err = mocap(
        "track", folder / "f2_xyzpts.csv", "--fps", 240, "--model", given, "--out", tmp_path / "run"
    )
    assert code == 1
    assert stdout == ""
    assert said in err
    assert len(err.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_another_rate_or_other_markers(mocap, flights, model, tmp_path):
    """Both rates, or both sets of names; exit code 1, nothing written."""
    folder, _ = flights
    code, _, err = mocap(
        "track", folder / "f2_xyzpts.csv", "--fps", 120, "--model", model, "--out", tmp_path / "r", "--no-validate"
    )
    assert code == 1
    assert "f0 240" in err
    assert "f2 120" in err
    other = tmp_path / "o_xyzpts.csv"
    write_flight(other, 3, names=("snout", "head", "ear_l", "ear_r", "tail"), n_frames=30)
    code, _, err = mocap("track", other, "--fps", 240, "--model", model, "--out", tmp_path / "r", "--no-validate")
    assert code == 1
    assert "knows 0 of the recording's markers" in err
    assert not (tmp_path / "r").exists()


@pytest.mark.parametrize(
    ("n_frames", "names", "options", "said"),
    [
        (40, NAMES, [], "give --fps"),
        (5, NAMES, ["--fps", 240], "no gap could be hidden"),
        (40, NAMES[:3], ["--fps", 240], "only 3 markers are ever seen"),
        (40, NAMES, ["--fps", 240, "--pixel-sd", 0], "--pixel-sd"),
    ],
)
def test_what_cannot_be_learned_from(mocap, tmp_path, n_frames, names, options, said):
    """One reason on the last line, exit code 1, no model."""
    tracks = tmp_path / "a_xyzpts.csv"
    write_flight(tracks, 0, names=names, n_frames=n_frames)
    code, _, err = mocap("learn", tracks, "--out", tmp_path / "m.npz", *options)
    assert code == 1
    assert said in err
    assert not (tmp_path / "m.npz").exists()


PROJECTS = {
    "F2": "carollia_2Apr2021_078A3m_trial2_dvProject.mat",
    "F3": "carollia_2April2021_078A3m_trial3_dvProject.mat",
    "F5": "carollia_2April2021_078A3m_trial5_dvProject.mat",
}


@pytest.mark.rare
def test_real_flights_teach_a_third():
    """Two flights of a bat (078A3 F2 and F3, 80 and 60 frames) teach a third, F5, in which gaps are hidden twice.

    In gaps of 10 and 25 frames as well as by constant velocity, in those of 50 and 100 with less than half the error.
    """
    flights = {}
    for name, file in PROJECTS.items():
        prepared = clean(read(real("bat_windtunnel_dltdv8", "078A3", name, file), fps=700))
        flights[name] = prepared.names, marker_trial(seen_part(prepared))
    names, own = flights["F5"]
    trials = [excerpt(flights["F2"][1], 80), excerpt(flights["F3"][1], 60)]
    learned = learn_model(names, (), trials, np.random.default_rng(0), effort=Effort(times=1))
    fills = []
    for draw in range(2):
        hidden = hide_neighbours(own, np.random.default_rng(draw))
        shown = hidden.shown
        seen = PositionObservations(xyz_m=shown.xyz_m, sd_m=shown.sd_m)
        plain = smooth(learn_constant_velocity(shown.xyz_m, dt_s=shown.dt_s), seen, shown.t_s)
        found = track_with(learned, names, shown, seen).markers
        fills.append([residuals_of(hidden, by.xyz_m, by.cov_m2) for by in (found, plain)])
    learned_fill, plain_fill = (joined(list(parts)) for parts in zip(*fills, strict=True))
    squared, plain_squared = (np.sum(fill.error_m**2, axis=1) for fill in (learned_fill, plain_fill))
    for n, share in ((10, 1.1), (25, 1.1), (50, 0.5), (100, 0.5)):
        at = plain_fill.length == n
        assert np.sqrt(squared[at].mean()) < share * np.sqrt(plain_squared[at].mean())
    inside = np.abs(learned_fill.error_m) < 1.96 * np.sqrt(learned_fill.expected)
    assert 0.88 < inside.mean() < 0.99


def excerpt(trial, most):
    """The stretch of so many frames in which most is seen."""
    counts = [trial.seen[start : start + most].sum() for start in range(len(trial.t_s) - most + 1)]
    inside = slice(int(np.argmax(counts)), int(np.argmax(counts)) + most)
    return replace(trial, t_s=trial.t_s[inside], xyz_m=trial.xyz_m[inside], sd_m=trial.sd_m[inside])
