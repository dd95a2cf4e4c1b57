"""Labels taken away, gaps and ghosts added: the names come back, or none."""

import numpy as np
import pytest
from mocap.datasets import bat, lizard
from mocap.filters.hidden_gaps import EACH_MARKER, Effort
from mocap.filters.model import learn_model
from mocap.filters.poses import MarkerTrial

import mocap as library
from mocap.digitising.labelled import cut, label_segments
from mocap.digitising.pose import fit_poses, rigid
from mocap.digitising.register import recognise
from mocap.errors import MocapError
from mocap.io.contents import FileContents
from mocap.io.registry import read, write
from mocap.records import marker_tracks
from mocap.tracking.learning import Model
from tests.real_data import real


def without_labels(xyz, rng, *, gaps=15, ghosts=4):
    """Trajectories (T, N, 3) in any order, each between two gaps, and the marker of each; -1 for ghosts."""
    xyz = xyz.copy()
    n_frames, n_markers = xyz.shape[:2]
    for _ in range(gaps):
        first = rng.integers(n_frames)
        xyz[first : first + rng.integers(3, 40), rng.integers(n_markers)] = np.nan
    columns, truth = [], []
    for m in range(n_markers):
        seen = np.diff(np.concatenate([[0], np.isfinite(xyz[:, m, 0]).astype(int), [0]]))
        for first, last in zip(np.flatnonzero(seen == 1), np.flatnonzero(seen == -1), strict=True):
            columns.append(np.full((n_frames, 3), np.nan))
            columns[-1][first:last] = xyz[first:last, m]
            truth.append(m)
    size = np.nanmax(xyz, axis=(0, 1)) - np.nanmin(xyz, axis=(0, 1))
    for _ in range(ghosts):
        first = rng.integers(n_frames - 1)
        part = slice(first, first + rng.integers(2, 60))
        columns.append(np.full((n_frames, 3), np.nan))
        near = np.nanmean(xyz[part], axis=1)
        columns[-1][part] = near + 0.1 * size * rng.normal(size=3)
        truth.append(-1)
    order = rng.permutation(len(columns))
    return np.stack([columns[i] for i in order], axis=1), np.array(truth)[order]


def score(found, truth):
    """Samples named right, named wrong (ghosts too), and markers' samples left unnamed."""
    right = wrong = left = 0
    for segment, marker in zip(found.segments, found.marker, strict=True):
        n, true = segment.last - segment.first + 1, truth[segment.column]
        if marker >= 0:
            right, wrong = right + n * (marker == true), wrong + n * (marker != true)
        elif true >= 0:
            left += n
    return right, wrong, left


@pytest.mark.parametrize("make", [bat, lizard])
def test_twins_get_their_names_back(make):
    """Poses of one animal name another recording: 99.6 % of the names are right, 97 % of the samples named."""
    taught, other = make(seed=0, n_frames=250), make(seed=3, n_frames=60)
    trunk = [taught.skeleton.markers.index(name) for name in taught.skeleton.trunk]
    rng = np.random.default_rng(0)
    points, truth = without_labels(other.truth.xyz_m, rng)
    right, wrong, left = score(label_segments(points, fit_poses(taught.truth.xyz_m, trunk, rank=12)), truth)
    assert right >= 0.996 * (right + wrong)
    assert right > 0.97 * (right + left)


@pytest.mark.rare
def test_a_real_gait_gets_its_names_back():
    """Twenty-six markers on both legs of a person (C3D sample 1): the first half teaches, the second is named."""
    xyz = read(real("c3d_samples", "sample_01", "Eb015pr.c3d")).points.xyz_m
    half = len(xyz) // 2
    points, truth = without_labels(xyz[half:], np.random.default_rng(1))
    right, wrong, left = score(label_segments(points, fit_poses(xyz[:half], (), rank=12)), truth)
    assert right >= 0.996 * (right + wrong)
    assert right > 0.9 * (right + left)


@pytest.mark.rare
def test_a_real_mouse_gets_its_names_back():
    """Eleven markers on a mouse (Qualisys), of which 26 % of the samples are missing."""
    folder = real("mouse_mocap_qtm")
    xyz = read(next(folder.glob("*.mat"))).points.xyz_m
    points, truth = without_labels(xyz[8000:8600], np.random.default_rng(1))
    right, wrong, left = score(label_segments(points, fit_poses(xyz[:5000], (), rank=12)), truth)
    assert right >= 0.996 * (right + wrong)
    assert right > 0.9 * (right + left)


def test_another_animal_is_not_recognised():
    """Nothing is named rather than something wrong."""
    poses = fit_poses(bat(seed=0, n_frames=200).truth.xyz_m, ())
    with pytest.raises(MocapError, match="recognised in no frame"):
        label_segments(lizard(seed=0, n_frames=4).truth.xyz_m, poses)


def test_a_moved_and_turned_pose_is_recognised():
    """Whatever the rotation, among ghosts, with points in any order."""
    rng = np.random.default_rng(2)
    recording = lizard(seed=0, n_frames=240).truth.xyz_m
    poses = fit_poses(recording[:200], ())
    pose = recording[220]
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turned = pose @ (q * np.sign(np.linalg.det(q))).T + [1.0, -2.0, 0.5]
    order = rng.permutation(len(pose))
    points = np.concatenate([turned[order], turned.mean(axis=0) + 0.1 * rng.normal(size=(5, 3))])
    found = recognise(points, poses)
    assert found is not None
    named = found.point >= 0
    np.testing.assert_array_equal(order[found.point[named & found.sure]], np.flatnonzero(named & found.sure))
    assert found.sure.sum() > 16


def test_rigid_motion_is_found_exactly():
    """Kabsch's rotation and shift, of points without noise."""
    rng = np.random.default_rng(0)
    a, (q, _) = rng.normal(size=(6, 3)), np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.linalg.det(q))
    rotation, shift = rigid(a, a @ q.T + [1, 2, 3])
    np.testing.assert_allclose(rotation, q, atol=1e-12)
    np.testing.assert_allclose(shift, [1, 2, 3], atol=1e-12)


def test_segments_end_at_gaps_and_jumps():
    path = np.zeros((20, 1, 3))
    path[:, 0, 0] = np.arange(20) * 0.001
    path[12:, 0, 1] = 0.5
    path[5:7] = np.nan
    assert [(s.first, s.last) for s in cut(path, jump_m=0.05)] == [(0, 4), (7, 11), (12, 19)]


@pytest.fixture(scope="module")
def take(tmp_path_factory):
    """A C3D of columns ``*1``, ``*2``, ..., the marker of each, and a model of another recording of the animal."""
    folder = tmp_path_factory.mktemp("take")
    taught, other = lizard(seed=0, n_frames=300), lizard(seed=4, n_frames=60).truth
    sd_m = np.full(taught.truth.seen.shape, 1e-4)
    trial = MarkerTrial(name="a", t_s=taught.truth.t_s, xyz_m=taught.truth.xyz_m, sd_m=sd_m)
    names, trunk = taught.skeleton.markers, taught.skeleton.trunk
    effort = Effort(most_frames=60, times=1)
    learned = learn_model(names, trunk, [trial], np.random.default_rng(0), models=[EACH_MARKER], effort=effort)
    Model(learned).save(folder / "lizard.npz")
    points, truth = without_labels(other.xyz_m, np.random.default_rng(0), gaps=5, ghosts=2)
    columns = tuple(f"*{i + 1}" for i in range(points.shape[1]))
    tracks = marker_tracks(columns, other.t_s, points)
    frames = np.arange(1, 61)
    file = FileContents(format="c3d", paths=(), names=columns, frames=frames, fps=250.0, unit="mm", points=tracks)
    write(file, folder / "take.c3d", "c3d")
    return folder, other, truth


def test_the_function_is_public(take):
    folder, other, truth = take
    found = library.label(folder / "take.c3d", model=folder / "lizard.npz")
    assert found.contents.names[:24] == other.names
    right, wrong, left = score(found.found, truth)
    assert wrong == 0
    assert found.summary["named_samples"] == right
    assert found.summary["unnamed_samples"] >= left


def test_the_command_names_a_c3d(take, mocap, monkeypatch):
    """Columns ``*1``, ``*2``, ... become markers; what is no marker is U_1, ...; written beside the caller."""
    folder, other, _ = take
    monkeypatch.chdir(folder)
    code, _, said = mocap("label", "take.c3d", "--model", "lizard.npz")
    assert code == 0, said
    again = read(folder / "take_labelled.c3d")
    assert again.points is not None
    named = again.points.xyz_m[:, [again.names.index(name) for name in other.names]]
    there = np.isfinite(named[..., 0])
    assert there.mean() > 0.8
    # single precision of C3D in mm
    assert np.abs(named - other.xyz_m)[there].max() < 1e-6
    assert [name for name in again.names if name not in other.names] == ["U_1", "U_2"][: len(again.names) - 24]
    assert mocap("label", "take.c3d", "--model", "lizard.npz")[0] == 1
