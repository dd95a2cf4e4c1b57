"""Trials of one session against each other: each fault is named once, of the odd one, with what mends it."""

from dataclasses import replace

import numpy as np
import pytest
from mocap.datasets import make_lizard

import mocap
from mocap.audit.across import TrialFacts, compared, median_lengths, scale
from mocap.findings import Kind
from mocap.reading.session import facts_of
from tests.real_data import real

MARKERS = tuple("abcdef")


def facts(name, *, size=1.0, **more):
    """A trial of six markers, of animals that differ by the posture of the day."""
    rng = np.random.default_rng(len(name) + ord(name[-1]))
    lengths = {f"{a}|{b}": size * 0.05 * rng.uniform(0.97, 1.03) for i, b in enumerate(MARKERS) for a in MARKERS[:i]}
    usual = {
        "fps": 500.0, "markers": MARKERS, "cameras": ("c1", "c2", "c3"), "unit": "m", "mirrored": False,
        "lengths_m": lengths, "step": 0.02, "residual_px": 0.8, "camera_px": (0.8, 0.8, 0.7), "noise_px": 0.3,
        "seen": 0.7,
    }  # fmt: skip
    return TrialFacts(name=name, **(usual | more))


def season(**odd):
    """Four sound trials and one with a fault."""
    return [*(facts(f"t{k}") for k in range(4)), facts("odd", **odd)]


FAULTS = [
    ({"fps": 25.0}, "fps", "filmed at the same rate, and speeds are wrong by 20"),
    ({"mirrored": True}, "origin", "left and right are exchanged"),
    ({"size": 1000.0}, "unit", "m for mm"),
    ({"size": 1 / 25.4}, "unit", "in for mm"),
    ({"cameras": ("c2", "c1", "c3")}, "tracks", "same order"),
    ({"residual_px": 14.0, "camera_px": (20.0, 18.0, 0.9)}, "calibration", "by camera: c1 20, c2 18, c3 0.9"),
    ({"markers": tuple("uvwxyz")}, None, "same names"),
]


@pytest.mark.parametrize(("fault", "mends", "words"), FAULTS)
def test_a_fault_is_named_once_with_what_mends_it(fault, mends, words):
    """An alarm of the odd one, and none of the others; its sentence has the others' value."""
    found = compared(season(**fault))
    (one,) = found.pop("odd")
    assert one.alarm
    assert one.kind == Kind.UNLIKE_SIBLINGS
    assert words in one.text
    assert mends is None or mends in one.mends
    assert not any(found.values())


@pytest.mark.parametrize("fault", [fault for fault, _, _ in FAULTS])
def test_of_two_trials_that_differ_both_say_so(fault):
    """Nobody knows which is wrong: as many alarms of either."""
    found = compared([facts("t0"), facts("odd", **fault)])
    if "residual_px" in fault:  # the larger is the worse of two, too
        assert [len(found["t0"]), len(found["odd"])] == [0, 1]
    else:
        assert [len(found["t0"]), len(found["odd"])] == [1, 1]


@pytest.mark.parametrize(
    "sound",
    [
        {},
        {"fps": 499.0},
        {"size": 1.1},
        {"residual_px": 1.6},
        {"residual_px": np.nan, "camera_px": ()},
        {"noise_px": 0.7},
        {"seen": 0.4},
        {"mirrored": None},
        {"lengths_m": {}},
        {"step": np.nan},
        {"fps": 25.0, "stated": ("fps",)},
        {"session": "another day", "fps": 25.0, "mirrored": True, "size": 1000.0},
    ],
)
def test_sound_trials_have_no_finding(sound):
    """What differs as trials do, what is not known, what was stated for the trial alone, and other sessions."""
    assert not any(compared(season(**sound)).values())


@pytest.mark.parametrize(("fps", "step", "alarm"), [(100.0, 0.02, True), (100.0, 0.1, False), (100.0, np.nan, True)])
def test_a_slower_camera_sees_longer_steps(fps, step, alarm):
    """At a fifth of the rate markers move five times as far in a frame: the rate is right, and no alarm."""
    (one,) = compared(season(fps=fps, step=step))["odd"]
    assert one.alarm == alarm
    assert ("both may be right" in one.text) != alarm


@pytest.mark.parametrize(
    ("animal", "size", "alarm"), [("A", 1.2, True), ("B", 1.2, None), ("", 1.2, None), ("B", 9, True)]
)
def test_one_animal_has_one_size(animal, size, alarm):
    """A fifth longer: of one animal it is wrong, of another it is an animal; nine times is none of the species."""
    trials = [replace(one, animal="A") for one in season(size=size)]
    trials[-1] = replace(trials[-1], animal=animal)
    found = compared(trials)["odd"]
    assert [one.alarm for one in found] == ([] if alarm is None else [alarm])


def test_a_session_of_half_and_half_accuses_nobody():
    """Two rates, three trials each: there is no value that the others have."""
    assert not any(compared([facts(f"t{k}", fps=500.0 if k < 3 else 250.0) for k in range(6)]).values())


def test_a_trial_that_lacks_a_wing_says_which_markers():
    """No alarm: it can be tracked."""
    (one,) = compared(season(markers=MARKERS[:4]))["odd"]
    assert not one.alarm
    assert "lacks e, f" in one.text


def test_recordings_of_other_things_in_one_folder_are_not_held_against_each_other():
    """No marker, camera or number of markers in common: what differs is noted, and no rate or size is wrong."""
    (one,) = compared(season(markers=tuple("uvw"), cameras=(), fps=120.0, lengths_m={"u|v": 40.0}))["odd"]
    assert not one.alarm
    assert "of another animal" in one.text


@pytest.mark.parametrize(
    ("long", "size", "kinds"), [(0.12, 1.0, ["length"]), (0.145, 1.0, []), (0.12, 0.5, ["size"]), (np.nan, 1.0, [])]
)
def test_a_length_of_the_whole_that_disagrees_is_named_where_bones_agree(long, size, kinds):
    """A note: a part of the animal is digitised; of bones that differ, too, the size is wrong, and told alone."""
    trials = [facts(f"t{k}", long_m=0.15 + 0.003 * k) for k in range(4)]
    found = compared([*trials, facts("odd", long_m=long, size=size)])
    assert [one.text.partition(":")[0] for one in found.pop("odd")] == kinds
    assert not any(found.values())


def test_facts_are_the_same_after_a_file():
    """As a batch keeps them."""
    one = facts("t1", stated=("fps",))
    assert TrialFacts.from_json(one.as_json()) == one


def test_lengths_do_not_depend_on_where_the_animal_is():
    """Turned, moved, and twice as large: a scale of 2 over all pairs; a marker that is never seen is in none."""
    rng = np.random.default_rng(0)
    xyz = rng.standard_normal((20, 5, 3))
    xyz[:, 4] = np.nan
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    a, b = (
        TrialFacts(name=name, lengths_m=median_lengths("vwxyz", points))
        for name, points in (("a", xyz), ("b", 2 * xyz @ turn + 7))
    )
    assert scale(b, a) == pytest.approx(2)
    assert len(a.lengths_m) == 6


def test_facts_of_a_recording_are_those_that_it_was_made_with():
    """A simulated lizard, pixels and positions: rate, cameras, size within 2 %, no mirror, the share digitised."""
    made = make_lizard(seed=2, n_frames=60, n_cameras=4)
    uv, names = made.pixels.uv_px, made.skeleton.markers
    filmed = facts_of(mocap.from_pixels(uv, cameras=made.cameras, names=names, fps=made.fps))
    given = facts_of(mocap.from_arrays(made.truth.xyz_m, names=names, fps=made.fps, unit="m"))
    for one in (filmed, given):
        assert one.fps == made.fps
        assert one.markers == names
    assert filmed.mirrored is False
    assert given.mirrored is None
    assert filmed.cameras == tuple(camera.name for camera in made.cameras)
    assert scale(filmed, given) == pytest.approx(1, abs=0.02)
    assert filmed.step == pytest.approx(given.step, rel=0.5)
    assert filmed.residual_px < 3
    assert filmed.seen == pytest.approx(np.isfinite(uv[..., 0]).mean(), abs=0.02)
    assert given.seen == 1
    assert not compared([filmed, replace(given, name="given")])["given"]


FLIGHTS = [("078A3", f"F{k}") for k in (1, 2, 3, 4, 5)] + [("FE404", "F2")]


@pytest.mark.rare
def test_the_flight_with_a_playback_rate_is_the_one_that_is_named():
    """Of six flights one project states 25.56 frames a second, five 700; no other alarm, two bats and all."""
    trials = []
    for animal, flight in FLIGHTS:
        (path,) = real("bat_windtunnel_dltdv8", animal, flight).glob("*dvProject.mat")
        trials.append(facts_of(mocap.read(path), animal=animal, name=f"{animal} {flight}"))
    alarms = {name: [one for one in found if one.alarm] for name, found in compared(trials).items()}
    (rate,) = alarms.pop("078A3 F2")
    assert rate.mends == ("fps",)
    assert "700" in rate.text
    assert not any(alarms.values())


def test_learning_tells_of_the_odd_one_out_before_it_learns():
    """Three lizards, one of them in mm that were stated to be metres: a line that names it, and what to state."""
    made = [make_lizard(seed=seed, n_frames=40, n_cameras=3) for seed in (4, 5, 6)]
    trials = [
        mocap.from_arrays(
            one.truth.xyz_m * (1000 if k == 1 else 1), names=one.skeleton.markers, fps=one.fps, unit="m", name=f"t{k}"
        )
        for k, one in enumerate(made)
    ]
    told = []

    class Enough(Exception):
        pass

    def tell(line):
        told.append(line)
        if line.startswith("t2: ") and " samples" in line:
            raise Enough  # all were looked at

    with pytest.raises(Enough):
        mocap.learn(trials, tell=tell)
    assert [line for line in told if line.startswith("t1: size") and "state `unit`" in line]
    assert not any(line.startswith(("t0: size", "t2: size")) for line in told)
