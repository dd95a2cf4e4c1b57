"""Exchanged markers: undone where they were exchanged, and nowhere else."""

import numpy as np
import pytest
from mocap.datasets import make_bat, make_lizard

from mocap.cameras.camera import project, stacked, undistorted
from mocap.cameras.triangulate import robust
from mocap.cleaning.swapped_rays import exchange_rays, exchanged_rays
from mocap.cleaning.swaps import Swap, exchange, exchanged_markers, exchanged_samples
from mocap.io.optical_csv import read_vicon
from mocap.io.qualisys import read_mat, read_tsv
from tests.real_data import real

NO_BONES = np.zeros((0, 2), dtype=np.int64)
GATE_PX = 12.0
"""Clicks further off than this are wrong; 3.34 px is the deviation of a careless one."""


class Twin:
    """A built-in recording with what its cameras see without error."""

    def __init__(self, recording):
        """Triangulate it."""
        self.names = recording.skeleton.markers
        self.matrices = stacked(recording.cameras)
        self.uv = undistorted(recording.cameras, recording.pixels.uv_px)
        self.truth = recording.truth.xyz_m
        self.exact = project(self.matrices, self.truth)
        bones = [(self.names.index(b.a), self.names.index(b.b)) for b in recording.skeleton.bones if b.rigid]
        self.bones = np.array(bones, dtype=np.int64)
        self.xyz = robust(self.matrices, self.uv).xyz_m

    def pair(self, name):
        """A marker on the left and its like on the right."""
        return self.names.index(f"{name}_l"), self.names.index(f"{name}_r")

    def wrong(self, uv):
        """(C, T, M) clicks that are nowhere near their marker."""
        return np.linalg.norm(uv - self.exact, axis=-1) > GATE_PX


@pytest.fixture(scope="module")
def bat():
    return Twin(make_bat(seed=40, n_frames=300, n_cameras=5))


@pytest.fixture(scope="module")
def lizard():
    return Twin(make_lizard(seed=40, n_frames=300))


def swap(a, b, frames, camera=None):
    return Swap(a=a, b=b, frames=np.asarray(frames), camera=camera, gain=0.0)


@pytest.mark.parametrize(("animal", "bones"), [("bat", False), ("lizard", True)])
def test_positions_exchanged_in_all_cameras_come_back(animal, bones, request):
    """Runs of 1 to 100 frames, one to the end: what is given is right, at most 2 % are withheld as doubtful."""
    twin = request.getfixturevalue(animal)
    joints = ("elbow", "wrist", "shoulder", "d3_tip", "d5_pip") if animal == "bat" else ("elbow", "knee", "foot", "hip")
    ranges = [range(30, 31), range(40, 50), range(60, 160), range(120, 123), range(220, 300)]
    runs = [swap(*twin.pair(name), frames) for name, frames in zip(joints, ranges, strict=False)]
    runs.append(swap(twin.names.index("snout"), twin.names.index("head"), range(200, 220)))
    given = exchange(twin.xyz, runs)
    found = exchanged_markers(given, twin.bones if bones else NO_BONES)
    back = np.where(found.unsure[..., None], np.nan, exchange(given, found.swaps))
    seen = np.isfinite(back[..., 0])
    np.testing.assert_array_equal(back[seen], twin.xyz[seen])
    was = np.isfinite(twin.xyz[..., 0])
    assert (was & ~seen).sum() <= 0.02 * sum(2 * len(run.frames) for run in runs)
    assert {frozenset((s.a, s.b)) for s in found.swaps} == {frozenset((s.a, s.b)) for s in runs}
    marked = exchanged_samples(was.shape, found.swaps)["exchanged_marker"]
    assert marked[exchanged_samples(was.shape, runs)["exchanged_marker"] & seen].all()


def test_a_wing_exchanged_with_the_other_one(bat):
    """All markers of both hands at once: bones within a hand say nothing, the ways of the markers do."""
    digits = [name[:-2] for name in bat.names if name[0] == "d" and name.endswith("_l")]
    runs = [swap(*bat.pair(name), range(100, 140)) for name in digits]
    given = exchange(bat.xyz, runs)
    found = exchanged_markers(given, bat.bones)
    back = np.where(found.unsure[..., None], np.nan, exchange(given, found.swaps))
    seen = np.isfinite(back[..., 0])
    np.testing.assert_array_equal(back[seen], bat.xyz[seen])


@pytest.mark.parametrize("seed", [41, 42])
def test_what_is_not_exchanged_stays(seed):
    """Twins as they are, with and without bones: no run, no doubt; of rays only those that were clicked wrong."""
    for make in (make_bat, make_lizard):
        twin = Twin(make(seed=seed, n_frames=240, n_cameras=4))
        for bones in (twin.bones, NO_BONES):
            found = exchanged_markers(twin.xyz, bones)
            assert not found.swaps
            assert not found.unsure.any()
        right = exchange_rays(twin.uv, exchanged_rays(twin.matrices, twin.uv, robust(twin.matrices, twin.uv)))
        changed = ~((right == twin.uv) | np.isnan(right) & np.isnan(twin.uv)).all(axis=-1)
        assert not (changed & ~np.isnan(right[..., 0]) & twin.wrong(right)).any()


def test_markers_that_cross_are_not_exchanged():
    """Two markers that fly through each other's place, half a millimetre apart, keep their names."""
    rng = np.random.default_rng(0)
    t = np.linspace(-1, 1, 201)
    a = np.stack([0.2 * t, 0.05 * t**2, np.zeros_like(t)], axis=-1)
    b = np.stack([-0.2 * t, 0.05 * t**2 + 0.0005, np.zeros_like(t)], axis=-1)
    xyz = np.stack([a, b], axis=1) + 0.0005 * rng.standard_normal((201, 2, 3))
    assert not exchanged_markers(xyz, NO_BONES).swaps
    # ... and what is exchanged while they are apart is seen
    found = exchanged_markers(exchange(xyz, [swap(0, 1, range(40, 70))]), NO_BONES).swaps
    assert [s.frames.tolist() for s in found] == [list(range(40, 70))]


def test_a_change_while_one_is_hidden(bat):
    """The names of the ears, whose bones are alike, change while one ear is hidden: where the other's name jumps."""
    a, b = bat.pair("ear")
    xyz = bat.truth + 2e-4 * np.random.default_rng(2).standard_normal(bat.truth.shape)
    xyz[90:105, a] = np.nan
    given = exchange(xyz, [swap(a, b, range(100, 150))])
    (run,) = exchanged_markers(given, bat.bones).swaps
    assert run.frames.tolist() == list(range(100, 150))


def test_the_name_of_a_hidden_marker(bat):
    """The right elbow bears the name of the left one, hidden all the while: bones tell; without them it stays."""
    a, b = bat.pair("elbow")
    xyz = bat.truth + 2e-4 * np.random.default_rng(3).standard_normal(bat.truth.shape)
    xyz[95:150, a] = np.nan
    given = exchange(xyz, [swap(a, b, range(100, 150))])
    (run,) = exchanged_markers(given, bat.bones).swaps
    assert run.frames.tolist() == list(range(100, 150))
    assert not exchanged_markers(given, NO_BONES).swaps


def test_a_few_frames_under_the_name_of_a_hidden_marker_are_doubtful(bat):
    """Nothing but the hole that they fill tells whose they are; in their own place they are kept."""
    a, b = bat.pair("elbow")
    xyz = bat.truth + 2e-4 * np.random.default_rng(3).standard_normal(bat.truth.shape)
    few = range(100, 103)
    xyz[np.setdiff1d(np.arange(90, 130), few), a] = np.nan
    own = xyz.copy()
    own[few, b] = np.nan
    xyz[few, a] = np.nan
    given = exchange(xyz, [swap(a, b, few)])
    found = exchanged_markers(given, NO_BONES)
    assert not found.swaps
    assert np.argwhere(found.unsure).tolist() == [[frame, a] for frame in few]
    assert not exchanged_markers(own, NO_BONES).unsure.any()


def test_the_longer_of_two_stretches_keeps_its_names():
    """Names that change once without a bone to tell: the stretch that is longer is believed."""
    t = np.arange(100.0)
    xyz = np.stack([np.stack([0.01 * t, np.full(100, y), np.zeros(100)], axis=-1) for y in (0.0, 1.0)], axis=1)
    xyz += 1e-4 * np.random.default_rng(1).standard_normal(xyz.shape)
    for frames in (range(30), range(70, 100)):
        found = exchanged_markers(exchange(xyz, [swap(0, 1, frames)]), NO_BONES).swaps
        assert [s.frames.tolist() for s in found] == [list(frames)]


@pytest.mark.parametrize("cameras", [3, 5])
def test_rays_exchanged_in_one_camera_come_back(cameras):
    """Runs in one camera: nine of ten rays that were exchanged are right again, none that was right is made wrong."""
    twin = Twin(make_bat(seed=45, n_frames=240, n_cameras=cameras))
    joints = ("elbow", "wrist", "d3_tip", "d5_pip", "ankle")
    runs = [
        swap(*twin.pair(name), range(20 + 40 * k, 24 + 50 * k), camera=k % cameras) for k, name in enumerate(joints)
    ]
    given = exchange_rays(twin.uv, runs)
    found = exchanged_rays(twin.matrices, given, robust(twin.matrices, given))
    back = exchange_rays(given, found)
    before, after, clean = (twin.wrong(uv).sum() for uv in (given, back, twin.uv))
    assert before > clean + 80
    assert after - clean < 0.1 * (before - clean)
    assert not (twin.wrong(back) & ~twin.wrong(given)).any()
    assert all(s.gain > 8 for s in found)


def test_two_cameras_need_the_points_as_well():
    """Which of two cameras was exchanged only the ways of the points tell: together they give seven of eight back.

    The others are of frames in which exchanged rays happen to meet as well.
    """
    twin = Twin(make_lizard(seed=46, n_frames=240, n_cameras=2))
    runs = [swap(*twin.pair("elbow"), range(60, 100), camera=0), swap(*twin.pair("knee"), range(90, 160), camera=1)]
    given = exchange_rays(twin.uv, runs)
    rays = exchanged_rays(twin.matrices, given, robust(twin.matrices, given))
    back = exchange_rays(given, rays)
    points = exchanged_markers(robust(twin.matrices, back).xyz_m, twin.bones)
    back = exchange_rays(back, points.swaps)
    before, after, clean = (twin.wrong(uv).sum() for uv in (given, back, twin.uv))
    assert before > clean + 200
    assert after - clean < (before - clean) / 8


def test_edges():
    """Nothing seen, one frame, one marker: nothing found, nothing raised."""
    for shape in ((5, 3), (1, 3), (5, 1), (0, 2)):
        for xyz in (np.full((*shape, 3), np.nan), np.zeros((*shape, 3))):
            assert exchanged_markers(xyz, NO_BONES).swaps == ()
    matrices = Twin(make_lizard(seed=1, n_frames=2, n_cameras=2)).matrices
    uv = np.full((2, 4, 3, 2), np.nan)
    assert exchanged_rays(matrices, uv, robust(matrices, uv, sd_px=1.0)) == []


@pytest.mark.parametrize("kind", ["snake_glide_qualisys", "snake_gap_vicon"])
def test_snakes_of_others_are_not_exchanged(kind):
    """Recordings that their authors corrected by hand hold no exchange."""
    folder, read = real(kind), read_tsv if "glide" in kind else read_vicon
    files = sorted(p for p in folder.iterdir() if p.suffix in (".tsv", ".csv"))
    assert files
    for path in files[:4]:
        found = exchanged_markers(read(path).points.xyz_m, NO_BONES)
        assert not found.swaps


def test_a_mouse_whose_knee_is_called_ankle():
    """One run in 10 500 frames: in it, distances to all other markers are those of the other of the two names."""
    tracks = read_mat(real("mouse_mocap_qtm", "MOS1aD_S15_M5_MC2_T2_TRM_15MMIN_B.mat")).points
    (run,) = exchanged_markers(tracks.xyz_m, NO_BONES).swaps
    knee, ankle = (tracks.names.index(f"left_{name}") for name in ("knee", "ankle"))
    assert {run.a, run.b} == {knee, ankle}
    back = tracks.names.index("left_back")

    def far(marker, frames):
        return np.nanmedian(np.linalg.norm(tracks.xyz_m[frames, marker] - tracks.xyz_m[frames, back], axis=-1))

    usual = {marker: far(marker, slice(None)) for marker in (knee, ankle)}
    for name, is_really in ((knee, ankle), (ankle, knee)):
        there = far(name, run.frames)
        assert abs(there - usual[is_really]) < 0.3 * abs(there - usual[name])
