"""The time that is said to be left of a whole, beside what was left: traces of real runs, processor seconds."""

import re
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from itertools import groupby, islice, pairwise, permutations

import pytest
from mocap.datasets import make_bat, write_recording
from mocap.filters.hidden_gaps import EACH_MARKER, POSE, Effort
from mocap.filters.models.base import LEARNED, OF_PIXELS
from mocap.filters.models.pose import PoseSettings
from typer.testing import CliRunner

from docs import build
from eal.efforts import in_turn, shares, shares_beside, time_of, with_effort
from mocap.batches import run as batches
from mocap.batches.find import find_trials
from mocap.batches.one import track_trial
from mocap.batches.time_left import SECONDS, time_left, told_whole
from mocap.batches.time_left import TRACKED as TRACKED_STAGE
from mocap.cli import design_joint
from mocap.cli.main import app
from mocap.progress import Stages, as_one, left_s, lines
from mocap.recording import of_points
from mocap.side_by_side import call_all, processes
from mocap.tracking.learning import learn_from

DESIGN = (
    (11.3, "shape the truss", 0.083),
    (18.2, "shape the truss", 0.17),
    (20.7, "shape the truss", 0.25),
    (25.3, "shape the truss", 0.33),
    (30.2, "shape the truss", 0.50),
    (54.5, "shape the truss", 1.0),
    (58.5, "shape the parts", 1.0),
    (61.3, "check", 0.1),
    (84.7, "check", 0.88),
    (87.9, "check", 1.0),
    (93.0, "write", 1.0),
)
"""``mocap design-joint out/demo --joint elbow_l``, on a computer that six people shared."""


@pytest.mark.parametrize(("trace", "seconds"), [(DESIGN, design_joint.SECONDS)], ids=["design-joint"])
def test_what_is_left_is_said_within_a_third(trace, seconds):
    """Of what was left, or 5 % of the whole where that is more."""
    shares = []
    tell = as_one(lambda name, share: shares.append((name, share)), "the whole", seconds)
    for _, stage, share in trace:
        tell(stage, share)
    assert {name for name, _ in shares} == {"the whole"}
    whole = trace[-1][0]
    for (spent, *_), (_, share) in zip(trace, shares, strict=True):
        left = spent * (1 / share - 1)
        assert left == pytest.approx(whole - spent, rel=1 / 3, abs=0.05 * whole), (spent, share)


def test_a_stage_that_is_not_in_the_list_moves_nothing():
    """Nor does it fail; stages of the site have each their time."""
    shares = []
    tell = as_one(lambda _, share: shares.append(share), "the whole", {"a": 1.0, "b": 3.0})
    for stage, share in (("a", 0.5), ("c", 0.9), ("a", 1.0), ("b", 0.5)):
        tell(stage, share)
    assert shares == [0.125, 0.25, 0.625]
    assert min(build.SECONDS.values()) > 0


def half_and_whole(*, progress):
    """A call that tells twice how far it is."""
    progress(0.5)
    progress(1.0)


@pytest.mark.parametrize("caller", [in_turn, call_all])
def test_a_call_counts_for_the_time_that_it_takes(caller):
    """One of four times the effort is four fifths of both; calls that say nothing count alike."""
    for efforts, wanted in (((4.0, 1.0), [0.4, 0.8, 0.9, 1.0]), ((None, None), [0.25, 0.5, 0.75, 1.0])):
        said = []
        calls = [partial(half_and_whole) if e is None else with_effort(partial(half_and_whole), e) for e in efforts]
        caller(calls, said.append)
        assert said == pytest.approx(wanted)
    assert shares(None, [1.0, 2.0]) == [None, None]


def test_parts_that_are_made_side_by_side_are_done_when_the_last_one_is():
    """By hand: parts of 4, 1, 3 on two processes take 4, and on one 8; what never falls is what is told."""
    assert (time_of([4.0, 1.0, 3.0], 2), time_of([4.0, 1.0, 3.0], 1), time_of([], 3)) == (4.0, 8.0, 0.0)
    said = []
    tell = shares_beside(said.append, [4.0, 1.0, 3.0], 2)
    for second in (1.0, 2.0, 3.0, 4.0):
        tell(0, second / 4)
        tell(1, min(1.0, second))
        tell(2, (second - 1) / 3)
    assert said[2::3] == pytest.approx([0.25, 0.5, 0.75, 1.0])
    tell(1, 0.5)  # a part whose process died is made again
    assert said == sorted(said)


def quarters(*, progress):
    """A call that tells four times how far it is."""
    for quarter in (0.25, 0.5, 0.75, 1.0):
        progress(quarter)


def test_a_process_tells_how_far_it_is_within_its_call():
    """Not only at its end, which comes after minutes."""
    said = []
    with processes(2):
        call_all([partial(quarters), partial(quarters)], said.append)
    assert said == sorted(said)
    assert len(set(said)) > 2
    assert said[-1] == 1.0


def pose_and_marker(markers, frames, hidden, *, pixels):
    """Efforts of the steps of ``mocap track`` of a recording alone, in order: settings, pose and each marker, gaps."""
    pose = PoseSettings(process_noise=1.0)
    fit, gap = pose.fit_s(markers, frames), pose.fit_s(markers, hidden) + pose.fill_s(markers, hidden)
    seen = OF_PIXELS if pixels else 1.0
    whole = [LEARNED * fit + seen * pose.fill_s(markers, frames), seen * EACH_MARKER.fill_s(markers, frames)]
    return [pose.tuned_s(markers, frames), *whole, *[gap + 2 * EACH_MARKER.fill_s(markers, hidden)] * 2]


TRACKED = {
    "simulated bat, 8 cameras": ((34, 540, 300), True, (7.6, 42.6, 45.1, 63.9, 84.6)),
    "flight of a bat, 4 cameras": ((15, 297, 297), True, (1.5, 5.3, 6.1, 9.9, 14.7)),
    "50 markers in 3D": ((50, 93, 93), False, (5.2, 11.4, 11.7, 17.5, 25.2)),
    "simulated lizard": ((24, 150, 150), True, (2.1, 7.1, 7.7, 13.6, 19.1)),
    "snake, 3D": ((12, 542, 300), False, (1.8, 5.6, 6.5, 10.8, 16.3)),
}
"""Markers, frames, those of a stretch with hidden gaps; whether of pixels; processor seconds at which the steps ended.
The efforts of models were chosen by the first three and the last one; the lizard was looked at only."""


@pytest.mark.parametrize(("size", "pixels", "ends"), TRACKED.values(), ids=TRACKED)
def test_tracking_says_what_is_left_within_a_third(size, pixels, ends):
    """By 0.67 to 1.5 times what was left at the end of each step, or to 5 % of the whole where that is more."""
    efforts = pose_and_marker(*size, pixels=pixels)
    for done, spent in enumerate(ends[:-1], start=1):
        left = left_s(spent, sum(efforts[:done]) / sum(efforts))
        true, margin = ends[-1] - spent, 0.05 * ends[-1]
        assert min(true / 1.5, true - margin) <= left <= max(1.5 * true, true + margin), done


READ, CHECK, MIX, JOINTS, WRITE = (
    "read, triangulate, clean",
    "check points of two rays",
    "track with a mixture of models",
    "joints and potentials",
    "write",
)
FLIGHTS = (
    (
        816,
        9.9,
        (
            (0.9, READ, 0.0),
            (2.0, READ, 1.0),
            (2.0, CHECK, 0.0),
            (3.5, CHECK, 1.0),
            (3.5, MIX, 0.0),
            (4.4, MIX, 0.18),
            (4.6, MIX, 0.36),
            (5.3, MIX, 0.57),
            (5.9, MIX, 0.75),
            (6.5, MIX, 0.93),
            (7.2, JOINTS, 0.0),
            (7.7, JOINTS, 1.0),
            (7.8, WRITE, 0.0),
            (9.8, WRITE, 1.0),
        ),
    ),
    (
        2264,
        38.8,
        (
            (0.6, READ, 0.0),
            (2.1, READ, 1.0),
            (2.1, CHECK, 0.0),
            (18.5, CHECK, 1.0),
            (18.5, MIX, 0.0),
            (22.2, MIX, 0.18),
            (23.9, MIX, 0.36),
            (27.2, MIX, 0.57),
            (29.3, MIX, 0.75),
            (32.5, MIX, 0.93),
            (33.8, JOINTS, 0.0),
            (36.4, JOINTS, 1.0),
            (36.5, WRITE, 0.0),
            (38.5, WRITE, 1.0),
        ),
    ),
    (
        954,
        15.7,
        (
            (0.7, READ, 0.0),
            (1.9, READ, 1.0),
            (1.9, CHECK, 0.0),
            (5.0, CHECK, 1.0),
            (5.0, MIX, 0.0),
            (7.0, MIX, 0.18),
            (7.7, MIX, 0.36),
            (8.9, MIX, 0.57),
            (10.0, MIX, 0.75),
            (11.0, MIX, 0.93),
            (12.2, JOINTS, 0.0),
            (13.4, JOINTS, 1.0),
            (13.4, WRITE, 0.0),
            (15.5, WRITE, 1.0),
        ),
    ),
    (
        3440,
        31.5,
        (
            (0.8, READ, 0.0),
            (3.1, READ, 1.0),
            (3.1, CHECK, 0.0),
            (8.4, CHECK, 1.0),
            (8.4, MIX, 0.0),
            (11.2, MIX, 0.18),
            (13.2, MIX, 0.36),
            (16.9, MIX, 0.57),
            (19.9, MIX, 0.75),
            (24.1, MIX, 0.93),
            (26.0, JOINTS, 0.0),
            (29.4, JOINTS, 1.0),
            (29.5, WRITE, 0.0),
            (31.3, WRITE, 1.0),
        ),
    ),
    (
        3402,
        51.1,
        (
            (0.7, READ, 0.0),
            (2.5, READ, 1.0),
            (2.5, CHECK, 0.0),
            (20.3, CHECK, 1.0),
            (20.3, MIX, 0.0),
            (26.0, MIX, 0.18),
            (29.1, MIX, 0.36),
            (34.8, MIX, 0.57),
            (39.8, MIX, 0.75),
            (45.7, MIX, 0.93),
            (47.5, JOINTS, 0.0),
            (49.1, JOINTS, 1.0),
            (49.2, WRITE, 0.0),
            (50.9, WRITE, 1.0),
        ),
    ),
    (
        3805,
        35.2,
        (
            (0.9, READ, 0.0),
            (3.0, READ, 1.0),
            (3.0, CHECK, 0.0),
            (11.7, CHECK, 1.0),
            (11.7, MIX, 0.0),
            (14.2, MIX, 0.18),
            (16.2, MIX, 0.36),
            (21.0, MIX, 0.57),
            (24.6, MIX, 0.75),
            (28.2, MIX, 0.93),
            (29.9, JOINTS, 0.0),
            (33.3, JOINTS, 1.0),
            (33.3, WRITE, 0.0),
            (35.0, WRITE, 1.0),
        ),
    ),
)
"""Six flights of bats, each tracked alone: samples, seconds, and what was told when."""


def moments(flights, workers):
    """Of a batch of these flights: what is said to be left after each thing told, what is left, and the whole."""
    free, plan = [0.0] * workers, []
    for _, seconds, told in flights:
        at = min(range(workers), key=free.__getitem__)
        plan.append((free[at], free[at] + seconds, told))
        free[at] += seconds
    samples = {str(i): flight[0] for i, flight in enumerate(flights)}
    for now in sorted({begin + second for begin, _, told in plan for second, *_ in told}):
        took = {str(i): end - begin for i, (begin, end, _) in enumerate(plan) if end <= now}
        works = {}
        for i, (begin, end, told) in enumerate(plan):
            if begin + told[0][0] <= now < end:
                shares = []
                tell = told_whole(lambda _, share, shares=shares: shares.append(share))
                for second, stage, share in told:
                    if begin + second <= now:
                        tell(stage, share)
                works[str(i)] = now - begin - told[0][0], shares[-1]
        left = time_left(samples, took, works, workers=min(workers, len(flights) - len(took)))
        yield left, max(free) - now, max(free)


@pytest.mark.parametrize("workers", [1, 2])
def test_a_batch_says_what_is_left_within_a_third(workers):
    """Or 5 % of the whole where that is more, at 7 of 10 moments, in any order; a count of trials: 3 of 10.

    How long points of two rays take to check, 15 to 47 % of a trial, its number of samples does not tell.
    """
    found = [one for order in islice(permutations(FLIGHTS), 0, None, 29) for one in moments(order, workers)]
    said = [(left, true, whole) for left, true, whole in found if left is not None]
    assert len(said) > 0.9 * len(found)
    right = [left == pytest.approx(true, rel=1 / 3, abs=0.05 * whole) for left, true, whole in said]
    assert sum(right) > 0.7 * len(right)


@pytest.mark.rare
def test_the_stages_that_are_weighed_are_those_of_a_run(tmp_path):
    """Of a flight of which two of three cameras see six markers: none is called otherwise, none is weighed in vain."""
    film = make_bat(n_frames=60, n_cameras=3)
    uv = film.pixels.uv_px.copy()
    uv[2, :, :6] = float("nan")
    files = write_recording(replace(film, pixels=replace(film.pixels, uv_px=uv)), tmp_path)
    stated = {"calibration": files["coefficients"], "skeleton": files["skeleton"], "fps": film.fps, "unit": "m"}
    (found,) = find_trials([str(files["pixels"])], arguments=stated, out=tmp_path / "out")
    said = []
    track_trial(found, batches.Options(validate=False), tmp_path / "out", progress=lambda stage, _: said.append(stage))
    assert {TRACKED_STAGE if stage.startswith(TRACKED_STAGE) else stage for stage in said} == SECONDS.keys()


def test_a_trial_that_is_tracked_twice_does_not_go_back():
    """The mixture settles on one model, and is followed by it."""
    shares = []
    tell = told_whole(lambda _, share: shares.append(share))
    for stage, share in ((MIX, 0.5), (MIX, 1.0), ("track", 0.0), ("track", 1.0), (JOINTS, 0.0), (WRITE, 1.0)):
        tell(stage, share)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_what_is_left_is_not_said_too_early_nor_at_the_end():
    """Of trials without known samples as of the others; a failure, which took no time, tells nothing."""
    assert time_left({"a": 100, "b": 100}, {}, {"a": (5.0, 0.2)}, workers=1) is None
    assert time_left({"a": 100, "b": 0}, {"a": 10.0}, {}, workers=1) == pytest.approx(10.0)
    assert time_left({"a": 0, "b": 0}, {"a": 10.0}, {"b": (5.0, 0.5)}, workers=2) == pytest.approx(5.0)
    assert time_left({"a": 100}, {"a": 10.0}, {}, workers=1) is None
    assert time_left({}, {}, {}, workers=0) is None


LEARN = ((4.0, 0.0), (9.2, 0.223), (14.4, 0.471), (20.7, 0.72), (29.0, 1.0))
"""Share of the hidden gaps that is filled, of ``mocap learn`` of three flights of 15 markers, 831 frames in all."""


def test_learning_says_what_is_left_within_a_third():
    """0.67 to 1.6 times; settings, which tell nothing while they are learned, count for the time that they take."""
    tuned = POSE.tuned_s(15, 831)
    known = replace(POSE, process_noise=1.0)
    gaps = 4 * (known.fit_s(15, 831) + known.fill_s(15, 277) + 2 * EACH_MARKER.fill_s(15, 277))
    for spent, filled in LEARN[:-1]:
        left, true = left_s(spent, (tuned + gaps * filled) / (tuned + gaps)), LEARN[-1][0] - spent
        assert true / 1.5 <= left <= 1.6 * true, spent


def test_a_line_says_the_stage_the_share_and_what_is_left():
    """Of 40 s that a quarter took, 120 are left; a stage that tells no share is named once, none is said twice."""
    said, now = [], iter([0.0, 40.0, 40.1, 90.0])
    tell = lines(said.append, clock=lambda: next(now))
    for share in (0.0, 0.25, 0.251, 1.0):
        tell("learn", share)
    assert said == ["learn", "learn, 25 %, about 2 min left", "learn, 100 %"]


@pytest.mark.parametrize("known", [True, False])
def test_learning_tells_each_stage_from_its_begin_to_its_end(known):
    """Two, in order; each grows from 0 to 1, the first by recordings where their number is known."""
    flights = [make_bat(seed=seed, n_frames=40, n_cameras=2) for seed in (0, 1)]
    read = [of_points(one.truth, one.skeleton, name=f"f{k}") for k, one in enumerate(flights)]
    told, effort = [], Effort(validated=1, times=1)
    stages = Stages(tell=lambda *said: told.append(said))
    learn_from(read if known else iter(read), effort=effort, models=(EACH_MARKER, EACH_MARKER), stages=stages)
    shares_of = {stage: [share for _, share in some] for stage, some in groupby(told, lambda one: one[0])}
    assert [*shares_of] == ["read, triangulate, clean", "learn, fill hidden gaps"] == [*stages.seconds]
    first, second = shares_of.values()
    assert first == ([0.0, 0.5, 1.0, 1.0] if known else [0.0, 1.0])
    assert all(later >= earlier for earlier, later in pairwise(second))
    assert (second[0], second[-1]) == (0.0, 1.0)


@pytest.mark.parametrize(
    ("command", "stage"),
    [
        (("track", "--fit-lens", "--out", "out"), "read, estimate the lens"),
        (("track", "--out", "out"), "read"),
        (("skeleton",), "read"),
        (("learn", "--out", "a.npz"), "read"),
    ],
)
def test_what_is_read_before_the_work_begins_is_told(monkeypatch, command, stage):
    """Before the file is opened: a large one is read, and its lens estimated, for a while."""
    told = []

    @contextmanager
    def heard():
        yield lambda *said: told.append(said)

    monkeypatch.setattr(f"mocap.cli.{command[0]}.progress", heard)
    assert CliRunner().invoke(app, [*command, "no_such_file.csv"]).exit_code
    assert told == [(stage, 0.0)]


def test_a_batch_that_learns_tells_stages_and_what_is_left(tmp_path, monkeypatch):
    """Which trial is read, how many there are, and the stages of ``mocap learn``."""
    flights = [make_bat(seed=seed, n_frames=30, n_cameras=2) for seed in (0, 1)]
    trials = []
    for number, one in enumerate(flights):
        files = write_recording(one, tmp_path / f"t{number}")
        arguments = {"fps": 240, "calibration": files["coefficients"], "profile": files["profile"]}
        trials += find_trials([files["pixels"]], arguments=arguments | {"skeleton": files["skeleton"]})
    said = []
    monkeypatch.setattr(
        batches, "learn_from", partial(learn_from, effort=Effort(validated=1, times=1), models=(EACH_MARKER,) * 2)
    )
    batches.learn_model(trials, tmp_path, 0, progress=said.append)
    assert all(line.startswith("learning from all trials: ") for line in said)
    assert sum(line.endswith((", 1 of 2", ", 2 of 2")) for line in said) == 2
    assert any(re.search(r"learn, fill hidden gaps, \d+ %, about \d+ (s|min) left$", line) for line in said)
