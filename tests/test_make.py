"""``make.py``: the same targets as the Makefile, on every system; installation says how far it is."""

import importlib.util
import re
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.quick
ROOT = Path(__file__).resolve().parents[1]
PIP = """\
Collecting numpy==2.4.0 (from -r requirements.lock (line 1))
  Downloading numpy-2.4.0-cp311-manylinux.whl (16.6 MB)
Collecting filterpy==1.4.5 (from -r requirements.lock (line 9))
  Downloading filterpy-1.4.5.zip (178 kB)
"""


@pytest.fixture
def make():
    spec = importlib.util.spec_from_file_location("make", ROOT / "make.py")
    assert spec is not None
    assert spec.loader is not None
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found


def test_the_makefile_has_the_same_targets(make):
    """Each is handed on, but for those of others: ``check`` and ``test-all``."""
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    (phony,) = re.findall(r"^\.PHONY: (.*)$", makefile, re.MULTILINE)
    assert phony.split() == re.findall(r"[\w-]+", phony)
    assert set(phony.split()) == set(make.TARGETS)


def test_what_make_test_leaves_out_is_slow_and_there(pytestconfig):
    """A file in the table of rare ones takes seconds, and ``make test-all`` finds it; each stands under one reason."""
    tests = pytestconfig.pluginmanager.get_plugin(str(ROOT / "tests" / "conftest.py"))
    named = [name for names in tests.RARE.values() for name in names]
    assert len(named) == len(tests.RARE_FILES)
    assert tests.SLOW.keys() >= tests.RARE_FILES
    assert all((ROOT / "tests" / name).exists() for name in tests.SLOW)


def test_all_tests_are_those_of_make_test_and_the_rare_ones(make, monkeypatch):
    """One expression is the other's opposite, and neither leaves out a folder."""
    asked = []
    monkeypatch.setattr(make, "setup", lambda: None)
    monkeypatch.setattr(make, "pytest", lambda *words: asked.append(words))
    make.test_all()
    assert asked == [("-m", "not rare"), ("-m", "rare")]


def test_installation_counts_packages_and_megabytes(make):
    """As pip prints them, without its bars."""
    shown = make.Installed(60)
    for line in PIP.splitlines():
        shown(line)
    assert str(shown) == "2 packages of about 60, 17 MB downloaded"
    shown("Installing collected packages: numpy, filterpy")
    assert str(shown) == "unpacking 2 packages, 17 MB downloaded"
    assert make.packages(ROOT / "requirements.lock") > 30


def test_a_silent_minute_is_none(make, capsys):
    """Where lines come slowly, how far it is stands in a line now and then."""
    script = "import time\nfor _ in range(4):\n    print('Collecting a', flush=True)\n    time.sleep(0.2)"
    make.counted([sys.executable, "-c", script], total=4, every_s=0.3)
    lines = capsys.readouterr().out.splitlines()
    assert 1 <= len(lines) <= 3
    assert all(re.fullmatch(r"  \d packages of about 4, \d+ s", line) for line in lines)


def test_what_fails_says_why(make):
    """The last lines of pip, and no success."""
    with pytest.raises(SystemExit, match="no such package") as stopped:
        make.counted([sys.executable, "-c", "print('no such package'); raise SystemExit(3)"], total=1)
    assert stopped.value.code != 0


def test_an_unknown_target_and_an_old_python_are_refused(make, monkeypatch):
    """The first with a list of those that there are, the second with what to type."""
    monkeypatch.setattr(sys, "argv", ["make.py", "dmeo"])
    with pytest.raises(SystemExit, match="dmeo: there is no such target\n  setup "):
        make.main()
    monkeypatch.setattr(make, "OLDEST", (99, 0))
    with pytest.raises(SystemExit, match="or newer is needed"):
        make.main()
