"""The laws of both twins' motion: rigid bones, feet that stand, cycles that differ."""

import numpy as np
import pytest
from mocap.datasets import make_bat, make_lizard
from mocap.datasets.linkage import turn
from mocap.datasets.lizards import SLOPE_RAD, Gait


def lengths_m(recording):
    index = {name: m for m, name in enumerate(recording.truth.names)}
    bones = [(index[b.a], index[b.b]) for b in recording.skeleton.bones if b.rigid]
    ends = recording.truth.xyz_m[:, np.array(bones)]
    return np.linalg.norm(ends[:, :, 0] - ends[:, :, 1], axis=-1)


@pytest.mark.parametrize("make", [make_bat, make_lizard])
@pytest.mark.parametrize("seed", [7])
def test_bones_keep_their_length(make, seed):
    """Without skin motion to 1e-12 m; with it, by no more than two offsets."""
    rigid = lengths_m(make(seed=seed, skin_m=0))
    np.testing.assert_allclose(rigid, np.broadcast_to(rigid[0], rigid.shape), atol=1e-12, rtol=0)
    skin = lengths_m(make(seed=seed, skin_m=0.0005))
    change = np.abs(skin - rigid)
    # a coordinate: at most 1.4 x 0.5 mm x sqrt(1/2) (sqrt 2 + sqrt 10) = 2.3 mm, three coordinates, two ends
    assert 1e-4 < change.max() < 2 * np.sqrt(3) * 0.0023


@pytest.mark.parametrize("make", [make_bat, make_lizard])
def test_motion_depends_on_the_seed_only(make):
    """More frames and cameras begin with the same motion; another seed moves otherwise."""
    short, long = make(seed=2, n_frames=50), make(seed=2, n_frames=120, n_cameras=6)
    # sums of sinusoids over another number of times may be blocked otherwise: a few roundings
    np.testing.assert_allclose(short.truth.xyz_m, long.truth.xyz_m[:50], atol=1e-15)
    assert np.abs(make(seed=3, n_frames=50).truth.xyz_m - short.truth.xyz_m).max() > 0.001


@pytest.mark.parametrize("make", [make_bat, make_lizard])
@pytest.mark.parametrize("seed", range(2))
def test_no_marker_is_faster_than_the_skeleton_says(make, seed):
    recording = make(seed=seed)
    speed = np.linalg.norm(np.diff(recording.truth.xyz_m, axis=0), axis=-1) * recording.fps
    assert speed.max() < 0.75 * recording.skeleton.max_speed_m_s


@pytest.mark.parametrize("seed", range(2))
def test_feet_stand_still_on_the_rod(seed):
    """Each stance slips less than 0.1 mm, on the surface of the rod; feet stand for the duty factor of the time."""
    recording = make_lizard(seed=seed)
    along_rod = recording.truth.xyz_m @ turn(1, np.array(-SLOPE_RAD))
    feet = np.flatnonzero(recording.contact.any(axis=0))
    assert {recording.truth.names[m] for m in feet} == {"hand_l", "hand_r", "foot_l", "foot_r"}
    for m in feet:
        changes = np.flatnonzero(np.diff(recording.contact[:, m].astype(int))) + 1
        for run in np.split(np.arange(len(along_rod)), changes):
            if recording.contact[run[0], m]:
                slip = np.linalg.norm(recording.truth.xyz_m[run, m] - recording.truth.xyz_m[run[0], m], axis=-1)
                assert slip.max() < 1e-4
    radius = np.linalg.norm(along_rod[:, feet, 1:], axis=-1)[recording.contact[:, feet]]
    np.testing.assert_allclose(radius, 0.006, atol=1e-12)
    # some 6 strides: the share may be off by half a stance
    assert abs(recording.contact[:, feet].mean() - Gait().duty) < 0.06


@pytest.mark.parametrize("seed", range(12))
def test_every_seed_walks(seed):
    """No seed asks a limb for a step out of its reach."""
    make_lizard(seed=seed, n_cameras=2)


def wing_coordinates(recording):
    """(T, 10, 3) left wing relative to the shoulder, in the axes of the trunk."""
    index = {name: m for m, name in enumerate(recording.truth.names)}
    xyz = recording.truth.xyz_m
    ahead = xyz[:, index["sternum"]] - xyz[:, index["pelvis"]]
    left = xyz[:, index["shoulder_l"]] - xyz[:, index["shoulder_r"]]
    up = np.cross(ahead, left)
    axes = np.stack([v / np.linalg.norm(v, axis=1, keepdims=True) for v in (np.cross(left, up), left, up)], axis=1)
    names = [f"{d}_{j}_l" for d in ("d3", "d4", "d5") for j in ("mcp", "pip", "tip")]
    wing = xyz[:, [index[n] for n in ("wrist_l", *names)]] - xyz[:, None, index["shoulder_l"]]
    return np.einsum("tij,tmj->tmi", axes, wing)


def test_the_wing_beats_at_nine_hertz_and_never_twice_the_same():
    """The strongest frequency is 9 Hz; a beat differs from the last by more than 1 mm, and by far less than itself."""
    recording = make_bat(seed=0, n_frames=960, skin_m=0)
    wing = wing_coordinates(recording)
    height = wing[:, -1, 2] - wing[:, -1, 2].mean()
    frequency = np.fft.rfftfreq(len(height), 1 / recording.fps)
    assert abs(frequency[np.abs(np.fft.rfft(height)).argmax()] - 9) < 0.5
    deviation = wing - wing.mean(axis=0)
    scale = np.sqrt(np.mean(np.sum(deviation**2, axis=-1)))
    lag = min(
        np.sqrt(np.mean(np.sum((wing[k:] - wing[:-k]) ** 2, axis=-1)))
        for k in range(round(recording.fps / 10.5), round(recording.fps / 7.5))
    )
    assert 0.001 < lag < 0.4 * scale


def test_the_wing_moves_on_a_low_dimensional_curved_set():
    """Principal axes of 10 markers: after 8 of 30 less is left than a click is worth (1 mm); after 2, an ellipse, much.

    A periodic motion along one ellipse would leave nothing after 2.
    """
    wing = wing_coordinates(make_bat(seed=0, n_frames=960, skin_m=0)).reshape(960, -1)
    variance = np.linalg.svd(wing - wing.mean(axis=0), compute_uv=False) ** 2
    left_m = np.sqrt(np.cumsum(variance[::-1])[::-1][1:] / len(wing) / 10)
    assert left_m[7] < 0.001
    assert left_m[1] > 0.004


@pytest.mark.parametrize("make", [make_bat, make_lizard])
def test_wrong_sizes_say_what_is_wanted(make):
    with pytest.raises(ValueError, match="n_cameras must be 2 or more"):
        make(n_cameras=1)
    with pytest.raises(ValueError, match="n_frames must be 1 or more"):
        make(n_frames=0)


def test_one_frame():
    assert make_bat(n_frames=1).truth.xyz_m.shape == (1, 34, 3)
    assert make_lizard(n_frames=1).truth.xyz_m.shape == (1, 24, 3)
