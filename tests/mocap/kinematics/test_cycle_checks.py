"""Which cycles count: beats of simulated bats whose turning points were hidden, moved, or made up."""

from dataclasses import replace

import numpy as np
import pytest
from mocap.datasets.bats import bat_motion, make_bat

from mocap.kinematics.compute import kinematics
from mocap.kinematics.cycle_checks import GAP, checked, gap_at
from mocap.kinematics.cycles import counted, cycles, turning_sd, why_none
from mocap.kinematics.records import COUNTED, DOUBTFUL, without_unknown_angles
from mocap.measures import Measures
from tests.mocap.kinematics.test_cycles import exact

FPS = 240.0


@pytest.fixture(scope="module")
def flight():
    """A motion, its skeleton, and a function that gives the beats with samples of markers hidden."""
    skeleton = make_bat(seed=3, n_frames=2, n_cameras=2).skeleton
    motion = exact(bat_motion(3), skeleton, np.arange(240) / FPS)
    found = kinematics(motion, skeleton)

    def beats(hidden=()):
        measured = motion.measured.copy()
        for marker, start, stop in hidden:
            measured[start:stop, motion.index(marker)] = False
        seen = replace(motion, measured=measured)
        return cycles(found, seen, skeleton)

    return motion, skeleton, found, beats


def frame(time):
    return round(time * FPS)


def test_beats_that_were_seen_count(flight):
    """All of a sound flight, of both wings."""
    rows = flight[3]()
    assert len(rows) >= 14
    assert all(row.status == COUNTED and row.reason == "" for row in rows)


@pytest.mark.parametrize(("share", "counts"), [(0.8 * GAP, True), (1.3 * GAP, False)])
@pytest.mark.parametrize("marker", [0, 1])
def test_a_gap_at_a_turning_point_counts_by_its_length(flight, share, counts, marker):
    """Root or tip hidden about the lower turning point, for less and for more than a quarter of the beat."""
    beat = [row for row in flight[3]() if row.of == "wing_l"][2]
    name = flight[1].measures.strokes["wing_l"][marker]
    lower = beat.start_s + beat.downstroke_fraction * beat.duration_s
    # a gap is as long as from the last measured frame to the next
    half = (share * beat.duration_s * FPS - 1) / 2
    rows = flight[3]([(name, round(lower * FPS - half), round(lower * FPS + half))])
    one = next(row for row in rows if row.of == "wing_l" and row.number == beat.number)
    assert (one.status == COUNTED) == counts, one.reason
    assert counts or "gap" in one.reason
    assert all(row.status == COUNTED for row in rows if row.of == "wing_r")


def test_a_long_gap_between_turning_points_is_none_of_theirs(flight):
    """A third of a beat, in the middle of a stroke: all three turning points were seen."""
    beat = [row for row in flight[3]() if row.of == "wing_l"][2]
    tip = flight[1].measures.strokes["wing_l"][1]
    half = 0.5 * beat.downstroke_fraction * beat.duration_s
    middle, width = beat.start_s + half, 0.7 * half
    rows = flight[3]([(tip, frame(middle - width) + 1, frame(middle + width))])
    one = next(row for row in rows if row.of == "wing_l" and row.number == beat.number)
    assert one.status == COUNTED
    assert 0.2 < one.filled < 0.45


def test_what_is_filled_of_a_beat_is_root_and_tip(flight):
    """The whole trunk and the elbow hidden: nothing of the beats is filled (the trunk has markers enough)."""
    _, skeleton, _, beats = flight
    others = [m for m in skeleton.markers if m not in {n for line in skeleton.measures.strokes.values() for n in line}]
    assert all(row.filled == 0 for row in beats([(name, 50, 150) for name in others]))


def test_extrapolated_turning_points_do_not_count(flight):
    """The root is not seen after the fifth beat: beats that end before it count, later ones do not."""
    rows = [row for row in flight[3]() if row.of == "wing_l"]
    root, last = flight[1].measures.strokes["wing_l"][0], rows[4]
    cut = frame(0.5 * (rows[4].start_s + rows[4].end_s))
    after = [row for row in flight[3]([(root, cut, 240)]) if row.of == "wing_l"]
    assert [row.status for row in after] == [COUNTED if row.end_s < last.end_s else DOUBTFUL for row in rows]
    assert "extrapolated" in after[-1].reason


def test_a_beat_that_lost_a_turning_point_is_doubtful_and_the_other_wing_is_not(flight):
    """Two beats read as one: 2 times as long as the others; the right wing has both, and is believed."""
    motion, skeleton, _, beats = flight
    rows = beats()
    left = [row for row in rows if row.of == "wing_l"]
    one, two = left[2:4]
    joined = replace(
        one, end_s=two.end_s, duration_s=two.end_s - one.start_s, frequency_hz=1 / (two.end_s - one.start_s)
    )
    found = checked([row for row in rows if row not in (one, two)] + [joined], motion, skeleton)
    assert [row for row in found if row.status == DOUBTFUL] == [found[-1]]
    assert "times as long" in found[-1].reason


def test_of_two_beats_the_other_wing_says_which_is_wrong(flight):
    """Four beats in all, as of a short flight: 9.4, 9.1 and 8.8 Hz, and one of 5.7 Hz, which is doubtful."""
    motion, skeleton, _, beats = flight
    rows = [row for row in beats() if row.number in (3, 4)]
    last = rows[-1]
    longer = replace(last, end_s=last.start_s + last.duration_s * 9.1 / 5.7, duration_s=last.duration_s * 9.1 / 5.7)
    found = checked([*rows[:-1], longer], motion, skeleton)
    assert [row.status for row in found] == [COUNTED] * (len(rows) - 1) + [DOUBTFUL]


def test_an_animal_that_slows_down_is_believed(flight):
    """Beats that grow longer by a tenth each, to twice the first: none is doubtful."""
    motion, skeleton, _, beats = flight
    rows, out, start = [row for row in beats() if row.of == "wing_l"], [], 0.02
    for k, row in enumerate(rows):
        length = 0.06 * 1.1**k
        out.append(replace(row, start_s=start, end_s=start + length, duration_s=length, frequency_hz=1 / length))
        start += length
    assert all(row.status == COUNTED for row in checked(out, motion, skeleton))


def test_a_flutter_is_no_beat(flight):
    """A beat with a third of the others' amplitude."""
    motion, skeleton, _, beats = flight
    rows = beats()
    found = checked([replace(rows[0], amplitude_deg=0.33 * rows[0].amplitude_deg), *rows[1:]], motion, skeleton)
    assert [row.status for row in found].count(DOUBTFUL) == 1
    assert "amplitude" in found[0].reason


def test_the_time_of_a_turning_point_has_the_deviation_of_the_rate_over_its_slope():
    """A rate that falls by 40 a second, known to 2: 0.05 s, wherever it crosses between frames."""
    t_s = np.arange(100) / 50
    for crossing in (1.0, 1.003, 1.017):
        rate = 40 * (crossing - t_s)
        first = int(np.searchsorted(-rate, 0)) - 1
        assert turning_sd(t_s, rate, np.full(100, 2.0), first) == pytest.approx(0.05, rel=1e-9)
        # one that is known better than a frame is long
        assert turning_sd(t_s, rate, np.full(100, 0.1), first) == pytest.approx(0.0025, rel=1e-9)


def test_a_turning_point_beside_a_gap_is_known_less_well():
    """Its deviation is that at the crossing, 0.05 s, and the more the later the interval is left: 0.5 s later 10."""
    t_s = np.arange(200) / 50
    rate, sd = 40 * (2 - t_s), np.where(t_s > 2.05, 20.0, 2.0)
    assert turning_sd(t_s, rate, sd, 100) > 4 * 0.05
    assert turning_sd(t_s, rate, np.full(200, 1e3), 100) == pytest.approx(25, rel=1e-9)  # longer than the recording


def test_a_turning_point_before_the_end_is_known_by_its_slope():
    """One and a half frames before the recording ends, or before nothing is known: 0.05 s, as in its middle."""
    t_s = np.arange(102) / 50
    rate, sd = 40 * (1.99 - t_s), np.full(102, 2.0)
    assert turning_sd(t_s, rate, sd, 99) == pytest.approx(0.05, rel=1e-9)
    longer = np.concatenate([rate, np.full(9, np.nan)])
    sd = np.concatenate([sd, np.full(9, np.nan)])
    assert turning_sd(np.arange(111) / 50, longer, sd, 99) == pytest.approx(0.05, rel=1e-9)
    sd[99:102] = 50.0  # known less well there: later by up to a second
    assert turning_sd(np.arange(111) / 50, longer, sd, 99) > 0.5


def test_gaps_are_found_at_times():
    """Between two measured frames there is none; at a hidden one all of it."""
    t_s, seen = np.arange(10) / 10, np.array([1, 1, 1, 0, 0, 0, 1, 1, 1, 1], dtype=bool)
    assert gap_at(0.15, t_s, seen) is None
    assert gap_at(0.25, t_s, seen) == (3, 6)
    assert gap_at(0.45, t_s, seen) == (3, 6)
    assert gap_at(0.65, t_s, seen) is None


def test_reasons_for_no_cycles_are_true(flight):
    """Each cause has its sentence, with the line of TOML that mends it."""
    motion, skeleton, found, beats = flight
    measures = skeleton.measures
    bare = replace(skeleton, measures=replace(measures, forward=None, left=None, feet=(), chain=()))
    (axes,) = why_none(bare, kinematics(motion, bare), [])
    assert "axes of the trunk" in axes
    assert "forward = [" in axes
    assert "left = [" in axes
    assert [note for note in kinematics(motion, bare).notes if "no yaw, pitch and roll: add forward = [" in note]
    half = replace(skeleton, measures=replace(measures, left=None))
    assert [note for note in kinematics(motion, half).notes if "there is no roll: add left = [" in note]
    assert not [note for note in found.notes if "no roll" in note or "and roll" in note]
    (none,) = why_none(replace(skeleton, measures=Measures()), found, [])
    assert "names no limbs" in none
    assert "strokes" in none
    (short,) = why_none(replace(skeleton, measures=replace(measures, feet=(), chain=())), found, [])
    assert "no two upper turning points" in short
    rows = beats([("shoulder_l", 0, 240), ("shoulder_r", 0, 240)])
    assert not counted(rows)
    (doubtful,) = why_none(skeleton, found, rows)
    assert "extrapolated" in doubtful
    assert why_none(skeleton, found, beats()) == []


def without(motion, *markers):
    """The motion in which these markers are never known."""
    xyz = motion.xyz_m.copy()
    xyz[:, [motion.index(marker) for marker in markers]] = np.nan
    return replace(motion, xyz_m=xyz)


@pytest.mark.parametrize(
    ("states", "lost", "said"),
    [
        (
            {"strokes": {"wing_l": ("shoulder_l", "wrist_l")}},
            ("wrist_l",),
            "wing_l has no stroke angle: trunk, root and tip were not known together",
        ),
        ({"feet": ("wrist_l",)}, (), "no foot (wrist_l) set down twice"),
        ({"chain": ("shoulder_l", "elbow_l", "wrist_l")}, (), "a wave needs a chain of four markers"),
        (
            {"chain": ("shoulder_r", "shoulder_l", "elbow_l", "wrist_l")},
            ("wrist_l",),
            "the whole chain was never tracked for one wave",
        ),
    ],
)
def test_each_cause_of_an_empty_table_of_cycles_has_its_sentence(flight, states, lost, said):
    """A limb whose tip is never known, a foot that never stands, a chain that is too short or not seen."""
    motion, skeleton, *_ = flight
    states = {"feet": (), "chain": (), "strokes": {}} | states
    one = replace(skeleton, measures=replace(skeleton.measures, **states))
    part = without(motion, *lost)
    found = kinematics(part, one)
    reasons = why_none(one, found, cycles(found, part, one))
    assert any(said in reason for reason in reasons), reasons
    assert all(reason.startswith("cycles.csv is empty: ") for reason in reasons)


def test_an_angle_of_which_nothing_is_known_is_empty(flight):
    """An elbow known to 45 degrees is kept (its interval is 176 wide); to 47 it is empty, rates too; a yaw is not."""
    found = flight[2]
    sd = found["elbow_l_flexion_deg"].sd.copy()
    sd[10:20], sd[20:30] = 45.0, 47.0
    names = ("elbow_l_flexion_deg", "elbow_l_flexion_rate_deg_s", "elbow_l_flexion_acceleration_deg_s2", "body_yaw_deg")
    some = [replace(found[name], sd=sd if name.endswith("_deg") else found[name].sd) for name in names]
    known, notes = without_unknown_angles(some)
    for one in known[:3]:
        assert np.isnan(one.value[20:30]).all()
        assert np.isfinite(one.value[10:20]).all()
        assert (one.rests[20:30] == 0).all()
    assert np.isfinite(known[3].value).all()
    assert len(notes) == 1
    assert "10 frames" in notes[0]
    twice = [*some, replace(found["elbow_l_angle_deg"], sd=sd), replace(found["elbow_r_angle_deg"], sd=np.roll(sd, 40))]
    one, other = without_unknown_angles(twice)[1]  # a sentence for those that are unknown in the same frames
    assert one.endswith(": elbow_l_flexion_deg, elbow_l_angle_deg")
    assert other.endswith(": elbow_r_angle_deg")
