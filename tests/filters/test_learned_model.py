"""Models of several trials: what they fill in another one, what is kept in a file, what is refused."""

from dataclasses import fields, replace

import numpy as np
import pytest
from mocap.datasets import make_bat
from mocap.filters.errors import FilterError
from mocap.filters.hidden_gaps import WITH_JOINTS, Effort
from mocap.filters.hide import hide_neighbours
from mocap.filters.model import LearnedModel, learn_model, track_with, trials_for
from mocap.filters.models.constant_velocity import learn_constant_velocity
from mocap.filters.observations import PositionObservations
from mocap.filters.poses import MarkerTrial
from mocap.filters.track import smooth

from mocap.errors import MocapError
from mocap.tracking.model_file import load_model, save_model
from tests.filters.small_model import same, small_model

NAMES = ("sternum", "back", "shoulder_l", "shoulder_r", "elbow_l", "wrist_l", "elbow_r", "wrist_r")
TRUNK = NAMES[:4]
SD_M = 3e-4
N_FRAMES = 80


def twin(seed):
    """Some markers of a flight that nobody filmed, with noise; and the truth."""
    flight = make_bat(seed=seed, n_frames=N_FRAMES, n_cameras=2).truth
    truth = flight.xyz_m[:, [flight.names.index(name) for name in NAMES]]
    noise = np.random.default_rng(100 + seed).normal(0, SD_M, truth.shape)
    sd = np.full(truth.shape[:2], SD_M)
    return MarkerTrial(name=f"flight{seed}", t_s=flight.t_s, xyz_m=truth + noise, sd_m=sd), truth


@pytest.fixture(scope="module")
def flights():
    return [twin(seed) for seed in range(5)]


@pytest.fixture(scope="module")
def learned(flights):
    """Learned from two flights."""
    trials = [trial for trial, _ in flights[:2]]
    return learn_model(NAMES, TRUNK, trials, np.random.default_rng(0), effort=Effort(times=1))


def positions(trial):
    """What a tracker sees of a trial."""
    return PositionObservations(xyz_m=trial.xyz_m, sd_m=trial.sd_m)


def without(trial, hole, markers):
    """A trial with a gap."""
    xyz = trial.xyz_m.copy()
    xyz[hole, [[NAMES.index(name)] for name in markers]] = np.nan
    return replace(trial, xyz_m=xyz)


@pytest.fixture(scope="module")
def filled(learned, flights):
    """A wing of three other flights, hidden for 50 frames (two beats) at three places: misses and deviations."""
    parts = []
    places = ((10, [4, 5]), (15, [6, 7]), (25, [6, 7]))
    for (trial, truth), (start, wing) in zip(flights[2:], places, strict=True):
        hole = slice(start, start + 50)
        shown = without(trial, range(start, start + 50), [NAMES[m] for m in wing])
        own = track_with(learned, NAMES, shown, positions(shown)).markers
        plain = smooth(learn_constant_velocity(shown.xyz_m, dt_s=shown.dt_s), positions(shown), shown.t_s)
        miss = [(found.xyz_m - truth)[hole][:, wing] for found in (own, plain)]
        parts.append((*miss, np.sqrt(np.diagonal(own.cov_m2, axis1=-2, axis2=-1))[hole][:, wing], own, shown))
    return parts


def test_a_wing_is_filled_far_better_than_by_constant_velocity(filled):
    """Two beats of 60 mm amplitude: a straight line is off by all of it, the learned model by what beats differ in.

    The seeds are fixed; the twin's cycles differ by 6 to 10 %, which is a tenth of the line's error.
    """
    own, plain = (np.sqrt(np.mean([np.sum(part[k] ** 2, axis=-1).mean() for part in filled])) for k in (0, 1))
    assert own < 0.25 * plain


def test_intervals_hold_the_truth(filled):
    """88 % or more of the coordinates in gaps of flights that were not learned from lie inside 95 % intervals.

    Of a model of two flights, learned on five gaps, they are wide: z of these four gaps is 0.76 (1 is right).
    """
    z = np.concatenate([(miss / sd).ravel() for miss, _, sd, _, _ in filled])
    assert np.mean(np.abs(z) <= 1.959964) >= 0.88
    assert 0.7 < np.sqrt(np.mean(z**2)) < 1.2


def test_what_is_seen_is_kept(filled, flights):
    """Outside the gap tracked markers are nearer to the truth than what was measured, and say so."""
    for (*_, own, shown), (_, truth) in zip(filled, flights[2:], strict=True):
        seen = shown.seen
        assert np.std((own.xyz_m - truth)[seen]) < 0.9 * SD_M
        inside = np.abs(own.xyz_m - truth)[seen] <= 1.959964 * np.sqrt(np.diagonal(own.cov_m2, 0, -2, -1))[seen]
        assert 0.88 <= inside.mean() <= 0.99


def test_scores_are_of_every_model_and_the_mixture(learned, flights):
    """At each length of gap there are numbers; over lengths the mixture is at most 10 % worse than the best.

    That is what the penalty on its offsets costs where one is the best at all of them, and a fifth of the gaps less.
    """
    assert list(learned.scores)[-1] == "mixture"
    assert len(learned.scores) == len(learned.models) + 1 == 4
    lengths = learned.scores["mixture"]["gap_frames"]
    hidden = hide_neighbours(flights[0][0], np.random.default_rng(0))
    assert {int(n) for n in np.unique(hidden.length[hidden.mask])} <= set(lengths) <= {10, 25, 50}
    level = {name: np.mean(np.log(rows["rmse_mm"])) for name, rows in learned.scores.items()}
    assert level["mixture"] <= min(level.values()) + 0.1
    assert (
        np.abs(np.array(learned.scores["mixture"]["coverage95"]) - 95) < 10
    ).all()  # few gaps of a length share their widths


def test_a_model_is_kept_to_the_last_bit(learned, filled, tmp_path):
    """Saved and loaded it is the same record, and tracks another flight the same; nothing else is left behind."""
    path = tmp_path / "bat.npz"
    save_model(learned, path)
    again = load_model(path)
    for field in fields(LearnedModel):
        assert same(getattr(learned, field.name), getattr(again, field.name)), field.name
    assert [p.name for p in tmp_path.iterdir()] == ["bat.npz"]
    *_, own, shown = filled[0]
    other = track_with(again, NAMES, shown, positions(shown)).markers
    np.testing.assert_array_equal(own.xyz_m, other.xyz_m)
    np.testing.assert_array_equal(own.cov_m2, other.cov_m2)


BONES = tuple((f"{a}_{side}", f"{b}_{side}") for side in "lr" for a, b in (("shoulder", "elbow"), ("elbow", "wrist")))


def test_joint_angles_are_mixed_in_where_bones_hang_on_a_trunk(flights, filled):
    """A third member, and the wing is filled as well as without it, to a tenth; refused without bones.

    A recording that shows no marker of a limb is tracked all the same.
    """
    trials, rng = [trial for trial, _ in flights[:2]], np.random.default_rng(0)
    learned = learn_model(
        NAMES, TRUNK, trials, rng, models=WITH_JOINTS, bones=BONES, effort=Effort(validated=1, times=1)
    )
    assert [type(model).__name__ for model in learned.models] == [
        "LastingSettings",
        "ArticulatedSettings",
        "PoseSettings",
    ]
    shown, (_, truth) = filled[0][4], flights[2]
    own = track_with(learned, NAMES, shown, positions(shown)).markers
    hole = ~shown.seen
    both = [np.sqrt(np.mean((one.xyz_m - truth)[hole] ** 2)) for one in (own, filled[0][3])]
    assert both[0] < 1.1 * both[1]
    trunk = replace(shown, xyz_m=shown.xyz_m[:, :4], sd_m=shown.sd_m[:, :4])
    alone = track_with(learned, TRUNK, trunk, positions(trunk)).markers
    assert np.isfinite(alone.xyz_m).all()
    with pytest.raises(MocapError, match="rigid bones attached to the trunk"):
        learn_model(NAMES, TRUNK, trials, rng, models=WITH_JOINTS, effort=Effort(times=1))


@pytest.fixture
def small():
    return small_model()


@pytest.mark.parametrize("name", ["walk", "another"])
def test_other_rates_are_refused(small, name):
    """Half the rate is named with both numbers, also where recordings have the same name; 0.5 % off is let pass."""
    trial = replace(small.trials[0], name=name)
    slow = replace(trial, t_s=2 * trial.t_s)
    assert issubclass(FilterError, MocapError)
    with pytest.raises(FilterError, match=f"must share a frame rate.*walk 100, {name} 50"):
        trials_for(small, small.names, slow)
    with pytest.raises(MocapError, match="must share a frame rate"):
        learn_model(small.names, (), [small.trials[0], slow], np.random.default_rng(0))
    elsewhere = replace(trial, t_s=1.005 * trial.t_s, xyz_m=trial.xyz_m + 0.1)
    assert len(trials_for(small, small.names, elsewhere).trials) == 1 + len(small.trials)


def test_other_markers_are_refused(small):
    """Fewer than four in common: both sets of names, and what to do."""
    with pytest.raises(MocapError, match=r"knows 3 of the recording's markers \(a, b, c, x, y, .*aliases"):
        trials_for(small, ("a", "b", "c", "x", "y"), small.trials[0])


def test_trials_without_room_are_refused(small):
    """Five frames: what is needed is said."""
    trial = small.trials[0]
    short = replace(trial, t_s=trial.t_s[:5], xyz_m=trial.xyz_m[:5], sd_m=trial.sd_m[:5])
    with pytest.raises(MocapError, match="no gap could be hidden in these trials: that needs"):
        learn_model(small.names, (), [short], np.random.default_rng(0))


def test_markers_may_come_in_any_order_be_missing_or_more(learned, flights):
    """A recording with its markers reversed is tracked the same, to six tenths of what is stated.

    That is 95 % of coordinates, none by more than 2.5: the widths of the subspace's residual, and how well each model
    does in the recording, are found on samples hidden by a seed, others in another order of markers.
    Without one marker and with a new one that follows the back it is tracked nearly the same: the pose is known from
    the others, and the new marker, which the model has never seen, is followed where it is seen.
    """
    trial, truth = flights[2]
    shown = without(trial, range(40, 65), ["wrist_r"])
    hole, wrist = slice(40, 65), NAMES.index("wrist_r")
    base = track_with(learned, NAMES, shown, positions(shown)).markers
    turned = replace(shown, xyz_m=shown.xyz_m[:, ::-1], sd_m=shown.sd_m[:, ::-1])
    other = track_with(learned, NAMES[::-1], turned, positions(turned)).markers
    sd = np.sqrt(np.diagonal(base.cov_m2, axis1=-2, axis2=-1))
    ratio = np.abs(other.xyz_m[:, ::-1] - base.xyz_m) / sd
    assert np.quantile(ratio, 0.95) < 0.6, ratio.max()
    assert ratio.max() < 2.5
    names = (*NAMES[1:], "logger")
    extra = trial.xyz_m[:, 1:2] + [0.0, 0.0, 0.01]
    extra[62:74] = np.nan
    more = replace(
        shown,
        xyz_m=np.concatenate([shown.xyz_m[:, 1:], extra], axis=1),
        sd_m=np.full((N_FRAMES, len(names)), SD_M),
    )
    found = track_with(learned, names, more, positions(more)).markers
    assert np.isfinite(found.cov_m2).all()
    miss = [
        np.linalg.norm((f.xyz_m[:, m] - truth[:, wrist])[hole], axis=1) for f, m in ((base, wrist), (found, wrist - 1))
    ]
    assert np.sqrt(np.mean(miss[1] ** 2)) < 2 * np.sqrt(np.mean(miss[0] ** 2))
    off = found.xyz_m[:, -1] - truth[:, 1] - [0, 0, 0.01]
    assert np.sqrt(np.mean(off[np.r_[:62, 74:N_FRAMES]] ** 2)) < 1.2 * SD_M
    assert np.abs(off[62:74]).max() < 0.02


def test_progress_goes_from_nothing_to_all(small):
    """Shares increase, and end at 1."""
    told = []
    track_with(small, small.names, small.trials[0], positions(small.trials[0]), progress=told.append)
    assert told == sorted(told)
    assert told[-1] == 1


def test_calls_that_do_not_wait_are_made_as_wanted(small):
    """Made backwards by a function of the caller's they give the same."""
    made = []

    def backwards(calls, progress):  # noqa: ARG001
        made.append(len(calls))
        return [call(progress=None) for call in calls[::-1]][::-1]

    found = [
        track_with(small, small.names, small.trials[0], positions(small.trials[0]), **options).markers
        for options in ({}, {"call_all": backwards})
    ]
    assert made == [2]
    np.testing.assert_array_equal(found[0].xyz_m, found[1].xyz_m)
    np.testing.assert_array_equal(found[0].cov_m2, found[1].cov_m2)


def test_a_recording_that_was_learned_from_is_not_its_own_teacher(flights):
    """A model of a flight and another tracks that flight by the other alone: hidden samples stay hidden."""
    (first, _), (second, _) = flights[:2]
    small = replace(small_model(), names=NAMES, bones=(), trials=(first, second))
    backwards = NAMES[::-1]
    cut = replace(first, t_s=first.t_s[20:90], xyz_m=first.xyz_m[20:90, ::-1], sd_m=first.sd_m[20:90, ::-1])
    hidden = hide_neighbours(cut, np.random.default_rng(0)).shown
    assert [trial.name for trial in trials_for(small, backwards, hidden).trials] == [second.name, first.name]
    third = flights[2][0]
    assert [t.name for t in trials_for(small, NAMES, third).trials] == [first.name, second.name, third.name]
