"""Long commands as others on the computer see them, and what a kill or a bad file leaves: tests of the real commands.

A row for each: no port but the page's, which refuses strangers; no secret in arguments; no process that outlives its
command; a file that hangs, kills or fills its reader as a row of the batch's table.
"""

import argparse
from pathlib import Path

import pandas as pd
import pytest

TESTS = Path(__file__).resolve().parents[2] / "tests" / "mocap"
FILES = ("test_strangers_and_orphans.py", "batches/test_trial_limits.py", "test_side_by_side.py")


class _Rows:
    """What pytest tells of each test."""

    def __init__(self) -> None:
        self.rows: list[dict[str, object]] = []

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """One part of a test: its own, or one around it that went wrong."""
        if report.when == "call" or report.failed:
            name = report.nodeid.rpartition("::")[2]
            self.rows.append({"test": name, "outcome": report.outcome, "seconds": round(report.duration, 1)})


def run(options: argparse.Namespace) -> int:
    """Run them; prints the table, and returns the number of defects."""
    found = _Rows()
    files = FILES[:1] if options.quick else FILES
    pytest.main(["-q", "-n", "0", "--no-header", *(str(TESTS / name) for name in files)], plugins=[found])
    table = pd.DataFrame(found.rows, columns=["test", "outcome", "seconds"])
    print(table.to_string(index=False))
    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)
        table.to_csv(options.out / "strangers.csv", index=False)
    defects = int((table["outcome"] == "failed").sum()) + int(table.empty)
    print(f"{len(table)} tests: {defects} defects")
    return defects
