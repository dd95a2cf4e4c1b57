"""A recording that teaches itself how to mix models."""

from dataclasses import replace

import numpy as np
import pytest
from mocap.filters.anatomy import Anatomy
from mocap.filters.mixture import crossed
from mocap.filters.model import track_alone
from mocap.filters.models.base import TrialSet, estimate
from mocap.filters.models.constant_velocity import MarkerSettings
from mocap.filters.models.pose import PoseSettings
from mocap.filters.observations import PositionObservations
from mocap.filters.score import Residuals

from tests.filters.test_gaps_in_trials import trial_of

NAMES = tuple("abcdefgh")
SETTINGS = PoseSettings(ranks=(2,))


def lost_wing(frames):
    """A flapping animal of which a wing is not seen for some frames."""
    trial = trial_of(3)
    xyz = trial.xyz_m.copy()
    xyz[frames, 5] = np.nan
    return replace(trial, xyz_m=xyz)


@pytest.fixture(scope="module")
def lost():
    """The animal without its wing in frames 40 to 69, what is seen, and the track of it alone."""
    trial = lost_wing(slice(40, 70))
    seen = PositionObservations(xyz_m=trial.xyz_m, sd_m=trial.sd_m)
    both = track_alone(NAMES, NAMES[:4], trial, seen, SETTINGS)
    assert both is not None
    return trial, seen, both


@pytest.mark.rare
def test_a_lost_wing_is_found_by_the_mixture(lost):
    """Nearer than by constant velocity, within 2 mm of the 20 that it deviates by, with an interval that says so."""
    gap, (trial, seen, both) = slice(40, 70), lost
    found = both.markers
    plain = estimate(MarkerSettings(), TrialSet([trial], Anatomy((0, 1, 2, 3))), seen)
    miss, plainly = (f.xyz_m[gap, 5] - trial_of(3).xyz_m[gap, 5] for f in (found, plain))
    assert np.sqrt(np.mean(np.sum(miss**2, axis=1))) < min(2e-3, np.sqrt(np.mean(np.sum(plainly**2, axis=1))))
    sd = np.sqrt(np.diagonal(found.cov_m2[gap, 5], axis1=1, axis2=2))
    assert np.mean(np.abs(miss) < 1.96 * np.sqrt(sd**2 + 1e-8)) > 0.85


def test_what_is_seen_is_the_filter_s_own(lost):
    """Where the marker was measured nothing is mixed: positions and covariances are those of the pose model."""
    trial, seen, both = lost
    found, alone = both.markers, both.eal
    own = estimate(SETTINGS, TrialSet([trial], Anatomy((0, 1, 2, 3))), seen)
    np.testing.assert_allclose(alone.xyz_m, own.xyz_m, atol=1e-12)
    np.testing.assert_array_equal(found.xyz_m[trial.seen], alone.xyz_m[trial.seen])
    np.testing.assert_array_equal(found.cov_m2[trial.seen], alone.cov_m2[trial.seen])


@pytest.mark.rare
def test_the_gaps_that_teach_a_mixture_score_it(lost):
    """The track is the same; errors in hidden gaps are of curves, of both members, and of the mixture, in order."""
    trial, seen, first = lost
    again = track_alone(NAMES, NAMES[:4], trial, seen, SETTINGS, compared={"constant_velocity": MarkerSettings()})
    assert again is not None
    np.testing.assert_array_equal(again.markers.xyz_m, first.markers.xyz_m)
    assert not first.scores
    assert set(again.scores) == {"linear", "cubic", "eal", "constant_velocity", "mixture"}
    assert len({one.samples for one in again.scores.values()}) == 1
    errors = {name: one.rmse_mm for name, one in again.scores.items()}
    assert errors["mixture"] < 0.5 * min(errors["constant_velocity"], errors["linear"], errors["cubic"])


def test_no_gap_is_scored_by_a_mixture_that_it_taught():
    """An error that is enormous in one gap changes nothing in the others of its fifth, and something in the rest."""
    rng, gap = np.random.default_rng(0), np.repeat(np.arange(10), 6)
    parts = [
        Residuals(
            error_m=1e-3 * rng.standard_normal((60, 3)),
            variance=np.full((60, 3), 1e-6),
            noise=np.full(60, 1e-8),
            gap=gap,
            length=np.full(60, 8),
        )
        for _ in range(2)
    ]
    wrong = np.where((gap == 3)[:, None], 1.0, parts[0].error_m)
    before, after = crossed(parts), crossed([replace(parts[0], error_m=wrong), parts[1]])
    assert before is not None
    assert after is not None
    same = np.array([np.array_equal(a, b) for a, b in zip(before.variance, after.variance, strict=True)])
    fold = np.concatenate([gap[gap % 5 == k] for k in range(5)])
    assert same[fold == 8].all()
    assert not same[(fold != 8) & (fold != 3)].any()


def test_a_recording_too_short_to_hide_anything_teaches_nothing():
    """Six frames: no gap has three measured frames on both sides."""
    trial = trial_of(3, 6)
    assert track_alone(NAMES, (), trial, PositionObservations(xyz_m=trial.xyz_m, sd_m=trial.sd_m), SETTINGS) is None
