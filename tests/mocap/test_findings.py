"""Kinds of findings: what mends them, how bad they are, and that files keep their words."""

from inspect import signature

import pytest

import mocap
from mocap.cleaning.positions import REASONS
from mocap.cleaning.swaps import DOUBTFUL
from mocap.findings import Finding, Harm, Kind, alarm, alarms, worst_first


def test_what_mends_a_finding_is_an_argument_of_read():
    """So that the desk, and whoever reads a report, can state it."""
    known = set(signature(mocap.read).parameters)
    assert {name for kind in Kind for name in kind.mends} <= known


def test_every_reason_to_reject_a_sample_has_a_kind():
    """Its finding is made by the reason's key."""
    assert {Kind(f"rejected: {reason}") for reason in REASONS | DOUBTFUL} <= set(Kind)


def test_a_kind_is_known_by_its_words_and_others_are_refused():
    """Reports keep the words; a kind that nobody declared has neither harm nor a remedy."""
    found = Finding(kind="mirrored world", text="")  # type: ignore[arg-type]
    assert found.kind is Kind.MIRRORED_WORLD
    assert found.as_json()["kind"] == "mirrored world"
    with pytest.raises(ValueError, match="no such thing"):
        Finding(kind="no such thing", text="")  # type: ignore[arg-type]


def test_the_worst_comes_first():
    """All results wrong, then samples, then intervals, then notes; alike ones in their order."""
    kinds = Kind.READING, Kind.QUANTISED_PIXELS, Kind.JUMP, Kind.UNITS, Kind.BAD_CAMERA, Kind.DISTORTION
    found = [Finding(kind=kind, alarm=kind.harm > Harm.NOTHING, text=kind) for kind in kinds]
    assert [f.kind for f in worst_first(found)] == [kinds[i] for i in (3, 5, 2, 4, 1, 0)]
    assert alarms(found) == worst_first(found)[:-1]


def test_an_alarm_is_mended_as_its_kind_is_and_a_note_by_nothing():
    """Unless it says otherwise: then it asks for something though nothing is known to be wrong."""
    lens = alarm(kind=Kind.LENS, text="")
    assert (lens.mends, lens.asks) == (("profile", "fit_lens"), True)
    note = Finding(kind=Kind.LENS, text="")
    assert (note.mends, note.asks) == ((), False)
    assert Finding(kind=Kind.MIRRORED_WORLD, text="", mends=("origin",)).asks


def test_one_fault_that_two_checks_see_is_told_once():
    """With the evidence of both, what mends either, the harm of its kind; one that only decides something stays."""
    rate = alarm(kind=Kind.FRAME_RATE, text="25 frames a second, which is too slow", numbers={"beat_hz": 0.3})
    said = {"kind": Kind.UNLIKE_SIBLINGS, "same_as": (Kind.FRAME_RATE, Kind.CAMERA_OFFSETS), "mends": ("fps",)}
    other = alarm(text="the other 4 trials have 700", numbers={"others": 700.0}, **said)
    (both,) = worst_first([other, rate])
    assert (both.kind, both.alarm, both.mends) == (Kind.FRAME_RATE, True, ("fps",))
    assert both.text == f"{rate.text}. Beside the others: {other.text}"
    assert both.numbers == {"beat_hz": 0.3, "others": 700.0}
    assert alarms([other, rate]) == alarms([both])
    decided = Finding(kind=Kind.FRAME_RATE, text="700 frames a second, as stated")
    assert len(worst_first([other, decided])) == 2
    assert len(worst_first([other, alarm(kind=Kind.LENS, text="a lens")])) == 2
