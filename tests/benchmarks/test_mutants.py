"""Each mutant changes what stands there once, into what Python reads, and has tests of that name."""

import ast
import re

import pytest

from benchmarks.mutants import MUTANTS, ROOT


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda one: f"{one.file} {one.new.strip()}")
def test_a_mutant_is_one_change_and_has_tests(mutant):
    """Renamed constants and tests are renamed there as well: one that applies nowhere would measure nothing."""
    text = (ROOT / mutant.file).read_text(encoding="utf-8")
    assert text.count(mutant.old) == 1
    changed = text.replace(mutant.old, mutant.new)
    assert ast.dump(ast.parse(changed)) != ast.dump(ast.parse(text))
    file, _, chosen = mutant.tests.partition(" -k ")
    names = re.findall(r"^def (test_\w+)", (ROOT / "tests" / file).read_text(encoding="utf-8"), re.MULTILINE)
    assert any(chosen in name for name in names)


def test_there_are_sixty():
    """Nine of them survived when they were first tried."""
    assert len({(one.file, one.old, one.new) for one in MUTANTS}) == 60
    assert sum(one.listed for one in MUTANTS) == 9
