"""A test that does not end is ended: no other test has a limit of its own."""

import subprocess
import sys

from tests.conftest import ROOT


def test_a_test_that_hangs_is_named_and_all_stacks_are_printed(tmp_path):
    """By the project's own settings, side by side as ``make test`` runs them; the tests after it are run."""
    (tmp_path / "test_it.py").write_text(
        "import threading\n\n\n"
        "def test_hangs():\n"
        "    threading.Thread(target=threading.Event().wait, daemon=True).start()\n"
        "    threading.Event().wait()\n\n\n"
        "def test_ends(): ...\n"
    )
    command = [sys.executable, "-m", "pytest", "-c", str(ROOT / "pyproject.toml"), "-o", "faulthandler_timeout=1"]
    command += ["--rootdir", str(tmp_path), "-p", "no:cacheprovider", "-p", "no:hypothesispytest", "-n", "1"]
    done = subprocess.run([*command, "test_it.py"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert "crashed while running 'test_it.py::test_hangs'" in done.stdout
    assert "1 failed, 1 passed" in done.stdout
    assert done.stderr.count("in wait") == 2 * 2  # a wait of an event is one of its condition
    assert "in test_hangs" in done.stderr
