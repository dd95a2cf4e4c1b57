"""Each threshold of the way from rays to tracks, with a case just below and one just above it."""

from types import SimpleNamespace

import numpy as np
import pytest

from mocap.cameras.camera import project, stacked
from mocap.pipeline import potentials, sentences
from mocap.pipeline.summary import Expected
from mocap.pipeline.tracking import moved
from mocap.pipeline.two_rays import Disagreement, _wrong_rays, disagreements
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
