"""What each step found is saved, loaded, cut and told by the parts of a recording, one way for all of them."""

from dataclasses import make_dataclass
from typing import TypeVar

import numpy as np
import pytest
from mocap.datasets import make_bat

import mocap
from mocap.cleaning.cleaned import Cleaned
from mocap.errors import FormatError, MocapError
from mocap.findings import Finding, Kind, worst_first
from mocap.json_records import plain, record
from mocap.reading.decided import Decided
from mocap.reading.session import Siblings
from mocap.recording import Recording
from mocap.rerun.footage import Footage
from mocap.results.stored import PARTS
from mocap.tracking.model_choice import ModelChoice
from mocap.tracking.potentials import Potentials
from mocap.tracking.report_part import Report
from tests.mocap.same import same, same_result
from tests.real_data import real


def bat(**options):
    """A short flight with a wrong click, an exchange of names and a gap, its lens estimated or not."""
    film = make_bat(seed=2, n_frames=60, n_cameras=3)
    uv = np.array(film.pixels.uv_px)
    uv[:, 20:30, 4] = np.nan
    uv[0, 33, 5] += 200.0
    uv[:, 40:46, [7, 8]] = uv[:, 40:46, [8, 7]]
    given = {"names": film.pixels.names, "fps": film.fps, "unit": "m", "skeleton": film.skeleton, "pixel_sd": 0.7}
    return mocap.from_pixels(uv, film.cameras, **given, **options)


def flight():
    folder = real("bat_windtunnel_dltdv8", "derived_csv", "078A3_F5")
    pixels, rig = (folder / f"078A3_F5_{name}.csv" for name in ("xypts", "dltCoefs"))
    return mocap.read(pixels, calibration=rig, fps=700, fit_lens=True)


def pig():
    files = [real("xmalab_pig", f"{name}.csv") for name in ("3dpts", "rbt")]
    return mocap.read(files, fps=250)


def walk():
    return mocap.read(real("c3d_samples", "sample_02", "pc_real.c3d"))


@pytest.mark.parametrize("given", [bat, walk, pig, flight])
def test_what_is_loaded_is_what_was_saved_in_every_public_property(given, tmp_path):
    """A loaded result answers what was found, decided, and why: nothing is at its default again."""
    tracked = mocap.track(given(), model="constant_velocity", validate=given is bat)
    tracked.write(tmp_path, pictures=False)
    loaded = mocap.load(tmp_path)
    same_result(tracked, loaded)
    assert loaded.findings
    assert loaded.findings == tracked.findings


@pytest.fixture(scope="module")
def tracked():
    """With a model's why and scores, and findings of every step."""
    return mocap.track(bat(), model="constant_velocity", validate=True)


@pytest.mark.parametrize("kind", [*PARTS.values(), Footage])
def test_every_part_keeps_the_protocol(kind, tracked, tmp_path):
    """All frames and all markers of it are it; what a file holds of it is it again; its findings are findings."""
    assert kind.step in ("read", "clean", "track")
    assert set(kind.depends_on) <= {one.__name__ for one in PARTS.values()}
    alone = {Footage: Footage(cameras=()), Siblings: Siblings(told=(Finding(kind=Kind.UNLIKE_SIBLINGS, text="x"),))}
    part = alone[kind] if kind in alone else tracked[kind]
    n_frames, n_markers = tracked.xyz_m.shape[:2]
    for cut in (part.at(np.arange(n_frames)), part.only(np.arange(n_markers))):
        same(part, cut, kind.__name__)
    assert all(isinstance(one, Finding) for one in part.findings())
    tracked.write(tmp_path, pictures=False)
    same(part, kind.of_file(part.to_file(tmp_path), tmp_path, "here"), kind.__name__)


def test_parts_of_some_frames_and_markers_are_at_their_new_places():
    """Cut to frames 10 to 49 and without the first three markers, the exchange of 7 and 8 is of 4 and 5, 10 earlier."""
    whole = mocap.clean(bat())
    (swap,) = (one for one in whole[Cleaned].swaps if {one.a, one.b} == {7, 8})
    cut = whole.at(slice(10, 50)).only(np.arange(3, len(whole.names)))
    (moved,) = (one for one in cut[Cleaned].swaps if {one.a, one.b} == {4, 5})
    np.testing.assert_array_equal(moved.frames, swap.frames - 10)
    assert {cut.names[moved.a], cut.names[moved.b]} == {whole.names[7], whole.names[8]}
    np.testing.assert_array_equal(cut[Cleaned].noise.marker, whole[Cleaned].noise.marker[3:])
    assert not whole.at(slice(0, 10))[Cleaned].swaps
    assert not whole.only(np.arange(7))[Cleaned].swaps


def test_what_is_found_anew_takes_away_what_rested_on_it(tracked):
    """Cleaned again, a recording has no model, no potentials and no report of before; read again, not even that."""
    assert set(tracked.with_part(Cleaned()).parts) == {Decided, Cleaned}
    assert set(tracked.with_part(Decided()).parts) == {Decided}
    assert set(tracked.with_part(Potentials()).parts) == {Decided, Cleaned, ModelChoice, Potentials}
    assert set(tracked.with_part(tracked[Report]).parts) == set(tracked.parts)


def test_what_is_not_known_yet_says_before_which_step():
    """Not a KeyError, nor a default that looks like a result."""
    with pytest.raises(MocapError, match=r"Cleaned holds is not known before mocap\.clean"):
        bat()[Cleaned]
    assert Cleaned not in bat()
    assert bat().get(Cleaned) is None


def test_a_record_that_was_changed_is_refused_by_the_name_of_its_field():
    """A number for a text, an unknown field, an index that is no whole number: each where it stands."""
    sound = plain(mocap.clean(bat())[Cleaned])
    same(record(Cleaned, sound, "x"), mocap.clean(bat())[Cleaned], "again")
    wrong = {
        "jitter_px": "much",
        "told": [{"kind": "no such thing", "text": ""}],
        "swaps": [{**sound["swaps"][0], "frames": [1.5]}],
        "elbow": 1.0,
        "noise": [],
    }
    for name, value in wrong.items():
        with pytest.raises(FormatError, match=rf"x.*{name}"):
            record(Cleaned, {**sound, name: value}, "x")


def test_findings_are_those_of_the_parts_step_by_step(tracked):
    """Alarms before; and the report lists these."""
    assert tracked.findings == tuple(worst_first(f for part in tracked.parts.values() for f in part.findings()))
    assert tracked.report["findings"] == [f.text for f in tracked.findings]
    assert isinstance(tracked, Recording)


@pytest.mark.quick
def test_arrays_are_read_by_the_name_of_their_type():
    """``NDArray`` is a type's alias from NumPy 2.5 on, which is installed from Python 3.12 on: as one made here."""
    extensions = pytest.importorskip("typing_extensions")
    number = TypeVar("number", bound=np.generic)
    alias = extensions.TypeAliasType("alias", np.ndarray[tuple[int, ...], np.dtype[number]], type_params=(number,))
    kind = make_dataclass("Kind", [("a", alias[np.float64]), ("b", alias[np.int64] | None)], frozen=True)
    found = record(kind, {"a": [1, 2.5], "b": [3]}, "a file")
    assert (found.a.tolist(), found.b.tolist()) == ([1.0, 2.5], [3])
    with pytest.raises(FormatError, match=r"a file: b: .*expected whole numbers"):
        record(kind, {"a": [1], "b": [0.5]}, "a file")
