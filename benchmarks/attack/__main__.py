"""``python -m benchmarks.attack [--quick] [--cases N] [--seed S] [--only FORMAT] [--stage STAGE] [--out DIR]``.

A stage is a function of the options that prints its table, writes it below ``--out``, and returns its defects.
"""

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

from benchmarks.attack import disk, files, foreign, page, records, sound, strangers, workers

STAGES: dict[str, Callable[[argparse.Namespace], int]] = {
    "files": files.run,
    "sound": sound.run,
    "foreign": foreign.run,
    "records": records.run,
    "workers": workers.run,
    "strangers": strangers.run,
    "disk": lambda options: disk.main(["--quick"] if options.quick else []),
    "page": page.run,
}
"""What is attacked, in this order; each returns the number of its defects."""


def main(arguments: list[str] | None = None) -> int:
    """Run the stages; 0 where no attack left a traceback, a hang or a blow-up."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.attack", description="Attacks on the program, from seeds."
    )
    parser.add_argument("--stage", choices=tuple(STAGES), action="append", help="only this one; may be repeated")
    parser.add_argument("--cases", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", help="only files of this format")
    parser.add_argument("--quick", action="store_true", help="10 cases a format, without real files")
    parser.add_argument("--track", action="store_true", help="prepare every changed recording, not one in 50")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, help="folder for table.csv and cases.csv")
    options = parser.parse_args(arguments)
    defects = [STAGES[stage](options) for stage in options.stage or STAGES]
    return 1 if any(defects) else 0


if __name__ == "__main__":
    sys.exit(main())
