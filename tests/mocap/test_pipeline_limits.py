"""Each threshold of the way from rays to tracks, with a case just below and one just above it."""

from types import SimpleNamespace

import numpy as np
import pytest

from mocap.cameras.camera import project, stacked
from mocap.cleaning import sentences
from mocap.cleaning.cleaning import clean
from mocap.cli.track import block_size
from mocap.proposing.propose_measures import _swing, cycle_frames, stands
from mocap.reading.ideal_pixels import of_pixels
from mocap.recording import of_points
from mocap.records import PixelTracks, Status, marker_tracks
from mocap.report.summary import Expected
from mocap.skeleton import Skeleton
from mocap.tracking import blocks, learning, potentials
from mocap.tracking.retrack import tracked_again
from mocap.tracking.tracking import moved
from mocap.tracking.two_rays import Disagreement, _wrong_rays, disagreements
from tests.mocap.rigs import ring


@pytest.mark.parametrize(("low_px", "told"), [(1.7, 0), (2.3, 1)])
def test_a_stated_deviation_is_contradicted_by_twice_as_much(low_px, told):
    """Rays show at least so many pixels, or at most one over as many."""
    assert len(sentences.contradiction(1.0, low_px=low_px, high_px=9.0)) == told
    assert len(sentences.contradiction(1.0, low_px=0.01, high_px=1 / low_px)) == told


@pytest.mark.parametrize(("shown", "told"), [(2, 1), (3, 0)])
def test_a_pose_shows_three_fifths_of_the_markers(shown, told):
    """Of five points no frame shows more."""
    xyz = np.full((5, 5, 3), np.nan)
    for frame in range(5):
        xyz[frame, (frame + np.arange(shown)) % 5] = 0.0
    assert len(sentences.never_together(xyz)) == told


@pytest.mark.parametrize(("z", "wrong_by"), [(0.82, "wide"), (0.87, None), (1.17, None), (1.21, "narrow")])
def test_intervals_are_wrong_where_they_hold_less_than_90_percent_or_more_than_98(z, wrong_by):
    """Normal errors: 1.96 / 2.33 = 0.84 and 1.96 / 1.64 = 1.19."""
    found = Expected(rmse=1.0, coverage=None, z=z, half_width=None, samples=100, against="hidden", others={}, unit="mm")
    assert found.wrong_by == wrong_by


@pytest.mark.parametrize(("off_m", "far"), [(0.0026, False), (0.0034, True)])
def test_a_track_leaves_a_sample_by_three_deviations(off_m, far):
    """0.6 and 0.8 mm in each coordinate of both, 1 mm together."""
    at = SimpleNamespace(xyz_m=np.zeros((1, 1, 3)), cov_m2=0.6e-3**2 * np.eye(3)[None, None])
    found = moved(at, np.array([[[0.0, off_m, 0.0]]]), 0.8e-3**2 * np.eye(3)[None, None])
    assert found[1].tolist() == [[far]]


def recorded(uv_px, xyz_m, matrices=None):
    """What rules on two rays read of a recording."""
    return SimpleNamespace(
        uv_px=uv_px,
        xyz_m=xyz_m,
        edited=np.zeros(xyz_m.shape[:2], dtype=bool),
        matrices=matrices,
        ray_sd_px=np.ones(uv_px.shape[:3]),
    )


@pytest.mark.parametrize(("hole", "runs"), [(5, 1), (6, 0)])
def test_runs_go_on_over_five_frames(hole, runs):
    """Rays that miss once before and once after a hole disagree twice if it is one run, and else once each."""
    frames = np.array([0, 1, 2 + hole, 3 + hole])
    uv = np.full((3, 20, 1, 2), np.nan)
    xyz = np.full((20, 1, 3), np.nan)
    uv[:2, frames], xyz[frames[[1, 3]]] = 0.0, 0.0
    assert len(disagreements(recorded(uv, xyz))) == runs


@pytest.mark.parametrize(
    ("wrong_sd", "right_sd", "found"), [(2.4, 0.0, False), (2.9, 0.0, True), (20.0, 5.0, True), (20.0, 7.0, False)]
)
def test_a_ray_is_wrong_if_the_other_one_fits(wrong_sd, right_sd, found):
    """Deviations of two rays from a point that is known: odds of 33 are 2.6 of them, and the better has less than 6."""
    matrices = stacked(ring(3))
    xyz = np.array([[[0.05, 0.1, 0.02]]])
    uv = project(matrices, xyz)
    uv[0, ..., 1] += wrong_sd
    uv[1, ..., 1] += right_sd
    runs = [Disagreement(marker=0, frames=np.array([0]), cameras=(0, 1))]
    wrong = _wrong_rays(recorded(uv, xyz, matrices), runs, xyz, 1e-14 * np.eye(3)[None, None])
    assert wrong[:, 0, 0].tolist() == [found, False, False]


@pytest.mark.parametrize(("samples", "learned"), [(25, []), (35, [35]), (600, [500])])
def test_a_potential_has_thirty_samples_and_at_most_five_hundred(monkeypatch, samples, learned):
    """How many reach what learns it."""
    q_m, seen = np.zeros((700, 2)), np.arange(700) < samples
    monkeypatch.setattr(potentials, "_measured", lambda *_: [("elbow", seen, q_m)])
    monkeypatch.setattr(potentials, "_potential", lambda _name, _frame, some, _trials: len(some))
    found = potentials.joint_potentials({}, "limb", None, None)
    assert list(found.values()) == learned


def test_one_camera_believes_likelihoods_of_three_fifths():
    """Clicks just below and just above, in a film without a calibration."""
    pixels = PixelTracks(names=("a",), cameras=("c",), t_s=np.arange(4) / 100, uv_px=np.ones((1, 4, 1, 2)))
    score = np.array([0.57, 0.63, 0.9, 0.9]).reshape(1, 4, 1)
    found = clean(of_pixels(pixels, (), name="film", score=score)).data["status"].values
    assert (found[:, 0] == Status.MEASURED).tolist() == [False, True, True, True]


def test_forty_frames_around_an_edit_are_tracked_again():
    """Of a marker at rest, edited in two frames."""
    t_s, xyz = np.arange(200) / 100, np.random.default_rng(0).normal(0, 1e-3, (200, 1, 3))
    tracks = marker_tracks(("a",), t_s, xyz, cov_m2=np.tile(1e-6 * np.eye(3), (200, 1, 1, 1)))
    rest = of_points(tracks, Skeleton(markers=("a",)), name="rest")
    window, found = tracked_again(rest, tracks, sd_px=1.0, markers=[0], first=100, last=101)
    assert (window.start, window.stop) == (60, 142)
    assert len(found.t_s) == 82


@pytest.mark.parametrize(("frames", "kept"), [(4900, 4), (5100, 3)])
def test_a_model_is_learned_from_twenty_thousand_frames(frames, kept):
    """Four recordings of so many frames: all of them, or all but the last lot."""
    some = learning._Some()
    for number in range(4):
        some.add(number, SimpleNamespace(trial=SimpleNamespace(t_s=np.arange(frames))))
    assert len(some.kept) == kept


def test_a_model_is_learned_from_five_thousand_frames_of_a_recording():
    """The second half, as the marker is seen in all frames there, and in every other one of the first."""
    xyz = np.zeros((10_000, 1, 3))
    xyz[1:5000:2] = np.nan
    tracks = marker_tracks(("a",), np.arange(10_000) / 100, xyz)
    found = learning._Kept.of(clean(of_points(tracks, Skeleton(markers=("a",)), name="long"))).trial.t_s
    assert (found[0], len(found)) == (50.0, 5000)


@pytest.mark.parametrize(("frames", "size"), [(19_000, 0), (21_000, 4000)])
def test_recordings_of_twenty_thousand_frames_are_tracked_in_blocks(frames, size):
    """Of 4000 frames each."""
    assert block_size(SimpleNamespace(name="long", t_s=np.arange(frames)), None) == size


@pytest.mark.parametrize(
    ("dt_s", "hidden", "frames"),
    [(0.02, 0, 60), (0.002, 0, 250), (0.02, 100, 130), (0.02, 969, 999), (0.02, 985, 1000)],
)
def test_margins_are_of_half_a_second_sixty_frames_and_thirty_sightings(dt_s, hidden, frames):
    """Of two markers one is seen after so many frames; a thousand frames are the most, the last 15 of which show it."""
    seen = np.ones((1500, 2), dtype=bool)
    seen[:hidden, 1] = False
    assert blocks.margin(seen, dt_s) == frames


@pytest.mark.parametrize(("frames", "starts"), [(2000, 5), (2500, 6), (9000, 6)])
def test_blocks_learn_from_six_stretches_of_four_hundred_frames(monkeypatch, frames, starts):
    """Evenly over the recording, which shows nothing."""
    asked = []
    recording = SimpleNamespace(t_s=np.arange(frames), at=asked.append)
    monkeypatch.setattr(blocks, "sighted", lambda _part: np.zeros((1, 1), dtype=bool))
    assert blocks.learn_excerpts(recording)[0] is None
    first = np.linspace(0, frames - 400, starts).astype(int)
    assert [(part.start, part.stop) for part in asked] == [(start, start + 400) for start in first]


@pytest.mark.parametrize(("degrees", "swings"), [(14.0, False), (16.5, True)])
def test_a_limb_swings_by_fifteen_degrees(degrees, swings):
    """From the 5th to the 95th percentile: here of two directions, half of the time each."""
    angle = np.deg2rad(np.where(np.arange(60) % 2 == 0, 0.5, -0.5) * degrees)
    xyz = np.zeros((60, 2, 3))
    xyz[:, 1] = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    assert np.isfinite(_swing(xyz, np.tile(np.eye(3), (60, 1, 1)), 0, 1)).all() == swings


@pytest.mark.parametrize(("few", "swings"), [(9, False), (12, True)])
@pytest.mark.parametrize("way", [1, -1])
def test_a_swing_that_a_twentieth_of_the_frames_shows_counts(few, swings, way):
    """Of 200 frames, on either side of the others."""
    angle = way * np.where(np.arange(200) < few, 0.5, 0.0)
    xyz = np.zeros((200, 2, 3))
    xyz[:, 1] = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    assert np.isfinite(_swing(xyz, np.tile(np.eye(3), (200, 1, 1)), 0, 1)).all() == swings


@pytest.mark.parametrize(
    ("frames", "period", "lag"),
    [(100, 36, 36), (100, 48, 0), (100, 3, 0), (100, 4, 4)],  # 2.5 of them are seen; of more than three frames
)
def test_cycles_are_of_four_frames_to_two_fifths_of_a_recording(frames, period, lag):
    """Of a cosine; without its trend the peak of one of 48 is at 40."""
    assert cycle_frames(np.cos(2 * np.pi * np.arange(frames) / period)) == lag


@pytest.mark.parametrize(("noise", "repeats"), [(0.9, True), (1.12, False)])
def test_half_of_the_variance_repeats(noise, repeats):
    """A cosine in noise, 1 / (1 + noise^2) of the variance: 0.55 and 0.44."""
    t = np.arange(20_000)
    y = np.sqrt(2) * np.cos(2 * np.pi * t / 40) + noise * np.random.default_rng(0).standard_normal(len(t))
    assert (cycle_frames(y[:2000]) > 0) == repeats


@pytest.mark.parametrize(("half", "lag"), [(0.3, 20), (0.36, 40)])
def test_of_peaks_of_the_autocorrelation_the_first_high_one_is_the_cycle(half, lag):
    """Four fifths of the highest: of a cosine and one half as fast at a cycle (1 - half^2) / (1 + half^2)."""
    t = np.arange(2000)
    y = np.cos(2 * np.pi * t / 20) + half * np.cos(2 * np.pi * t / 40)
    assert abs(cycle_frames(y) - lag) <= 1


@pytest.mark.parametrize(("seen", "cycle"), [(49, False), (51, True)])
def test_a_lag_is_judged_by_ten_pairs(seen, cycle):
    """Of the longest lag, 40 of 100 frames, of which so many are seen."""
    y = np.cos(2 * np.pi * np.arange(100) / 20)
    y[seen:] = np.nan
    assert (cycle_frames(y) > 0) == cycle


@pytest.mark.parametrize(
    ("share", "slow", "foot"), [(0.22, 0.0, False), (0.28, 0.0, True), (0.5, 0.2, True), (0.5, 0.3, False)]
)
def test_a_foot_is_at_a_quarter_of_its_speed_for_a_quarter_of_the_time(share, slow, foot):
    """Speeds of two kinds, of mean 1, in a cycle of ten frames, whose tenth is one."""
    speed = np.full(1000, (1 - share * slow) / (1 - share))
    speed[: round(1000 * share)] = slow
    path = np.cumsum(np.append(0.0, speed))[:, None] * [1.0, 0, 0]
    assert stands(path, 10) == foot
