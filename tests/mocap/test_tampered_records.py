"""Records that are read back: a sound one of each kind is read, a tampered one refused in one line, or the same."""

from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from benchmarks.attack.records import KINDS, as_text, judged, sound, tampered
from mocap.digitising.clicks import read_unseen, write_unseen
from mocap.results import stored
from mocap.tracking import potentials

FEW = ("missing", "NaN")
"""Of results, which take a second each to be read: these alone, in turn, of every sixth entry; of headers what is at
the top, of reports entries. ``benchmarks.attack`` has every way of each."""
MANY = 60
"""Of more ways than that every other of an entry is taken, beginning with the first of one, the second of the next."""
SHOWN = ("result, report", "batch record", "model, header", "potential, settings")
"""Records with entries that are only shown, or free: these may be read changed, never with an error of another kind."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Iterator[Path]:
    """A sound record of each kind, as the program writes it."""
    path = tmp_path_factory.mktemp("records")
    sound(path)
    with pytest.MonkeyPatch.context() as patch:
        for room, reader in ((stored, "read_netcdf"), (potentials, "load_potential")):
            patch.setattr(room, reader, once(getattr(room, reader)))
        yield path


def once(reader: Callable[..., Any]) -> Callable[..., Any]:
    """A reader that gives the same for the same bytes: of a result's many files one at a time is tampered with."""
    known: dict[bytes, Any] = {}

    def read(path: Path, **options: Any) -> Any:
        data = path.read_bytes()
        if data not in known:
            known[data] = reader(path, **options)
        return known[data]

    return read


@pytest.fixture(scope="module")
def verdicts(folder):
    """Of a kind: entry, tampering, verdict and its words; judged once for all tests."""

    @cache
    def of(title: str) -> list[tuple[str, str, str, str]]:
        kind = KINDS[title]
        shown = as_text(kind.read(folder))
        ways = list(tampered(kind, folder))
        entries = list(dict.fromkeys(entry for entry, _, _ in ways))
        if title.startswith("result"):
            ways = [w for w in ways if w[1] in FEW and w[0].count(".") <= (title != "result, report")]
            single = {entry for entry in entries if sum(w[0] == entry for w in ways) == 1}
            ways = [w for w in ways if w[0] in single or w[1] == FEW[entries.index(w[0]) % 2]][::6]
        elif len(ways) > MANY:
            ways = [w for i, w in enumerate(ways) if (i + entries.index(w[0])) % 2]
        found = [(entry, name, *judged(kind, folder, change, shown)) for entry, name, change in ways]
        assert as_text(kind.read(folder)) == shown
        return found

    return of


@pytest.mark.parametrize("title", KINDS)
def test_a_tampered_record_is_refused_in_one_line_that_names_its_file(verdicts, title):
    """Every entry, in every way: NaN, infinite, missing, of another type or shape; nothing is an internal error."""
    found = verdicts(title)
    assert found
    assert not [(entry, name, text) for entry, name, verdict, text in found if verdict == "defect"]


@pytest.mark.parametrize("title", [t for t in KINDS if t not in SHOWN and not t.startswith("result")])
def test_numbers_that_cannot_be_are_never_read(verdicts, title):
    """NaN for a whole entry, infinite, above every code, another type: it is refused, or never had the entry."""
    for entry, name, verdict, _ in verdicts(title):
        if (entry, name) == ("frame", "above every code"):
            continue  # the number of a frame is no code: it may be any
        if name in ("infinite", "complex", "text", "objects", "above every code", "another axis", "nested", "digits"):
            assert verdict in ("refused", "same"), (entry, name)


def test_a_table_without_a_row_is_sound(tmp_path):
    """Nobody said of any marker that it is not to be seen."""
    write_unseen(tmp_path / "unseen.csv", [])
    assert read_unseen(tmp_path / "unseen.csv") == []
