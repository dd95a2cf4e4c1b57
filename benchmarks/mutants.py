"""Numbers and terms of the core changed one at a time, in a copy: ``python -m benchmarks.mutants [--quick] --out DIR``.

Each of 60 mutants changes one constant or one term of a formula in filters, eal, cameras or cleaning, by so much that a
person would see it, and runs the tests that are nearest to it. One that no test sees survives: the number has no reason
that anything checks. ``--quick`` runs the nine that survived when an engineer first changed numbers by hand.
"""

import argparse
import contextlib
import io
import os
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import pandas as pd

ROOT = Path(__file__).resolve().parents[1]
LIMIT_S = 300
"""A mutant whose tests take longer by the clock counts as seen: it made something endless."""


@dataclass(frozen=True)
class Mutant:
    """A change of one file.

    Attributes:
        file: In the repository.
        old: What stands there once.
        new: What stands there instead.
        tests: Files of tests, below ``tests/``, and what they are chosen by, as ``-k`` takes it.
        listed: Whether it survived when it was first tried by hand.
    """

    file: str
    old: str
    new: str
    tests: str
    listed: bool = False


LIMITS, CLEANING = "filters/test_filter_limits.py", "mocap/test_cleaning_limits.py"
EAL, CALIBRATION = "eal/test_eal_limits.py", "mocap/test_calibration_limits.py"
ORIGIN, SEEN, RIGID = "mocap/test_pixel_origin.py", "filters/test_observe.py", "filters/test_rigid.py"
JOINTS, GAUSSIAN = "filters/test_articulated_motion.py -k derivatives", "filters/test_gaussian.py"
MUTANTS = (
    Mutant("filters/gaussian.py", "SUBTRACTS_TO = 1e4", "SUBTRACTS_TO = 1e5", f"{LIMITS} -k subtracted", listed=True),
    Mutant("filters/gaussian.py", "eps) ** -0.5", "eps) ** -0.4", f"{LIMITS} -k half_of_the_digits"),
    Mutant(
        "filters/gaussian.py",
        "rest, moved = (1 - share) ** 0.5,",
        "rest, moved = (1 - share),",
        f"{LIMITS} -k half_of_the_digits",
    ),
    Mutant("filters/gaussian.py", "min(1.0, farthest / size)", "min(2.0, farthest / size)", f"{LIMITS} -k no_further"),
    Mutant("filters/gaussian.py", "diagonal(across)[...] += 1", "diagonal(across)[...] += 2", GAUSSIAN),
    Mutant("filters/gaussian.py", "solved, 2 * float(", "solved, 1 * float(", f"{SEEN} -k three_rows"),
    Mutant("filters/observe.py", "GATE_SD = 6.0", "GATE_SD = 5.0", f"{LIMITS} -k six_deviations", listed=True),
    Mutant("filters/observe.py", "freedom / (freedom + 2)", "freedom / (freedom + 3)", f"{SEEN} -k fixed_point"),
    Mutant("filters/observe.py", "rounds: int = 3", "rounds: int = 2", f"{SEEN} -k three_rounds"),
    Mutant("filters/observe.py", "+ 1) >= 2", "+ 1) >= 1", f"{SEEN} -k gated"),
    Mutant("filters/observe.py", "values > 1e-12 *", "values > 1e-3 *", f"{SEEN} -k three_rows"),
    Mutant("filters/mixture.py", "UNCHANGED = 2.0", "UNCHANGED = 3.0", f"{LIMITS} -k two_gaps", listed=True),
    Mutant("filters/mixture.py", "PRIOR = 12.0", "PRIOR = 14.0", f"{LIMITS} -k twelve_gaps"),
    Mutant(
        "filters/rigid.py", "NOT_BY_CHANCE = 0.999", "NOT_BY_CHANCE = 0.998", f"{LIMITS} -k stands_out", listed=True
    ),
    Mutant("filters/rigid.py", "WOBBLES_DEG = 5.0", "WOBBLES_DEG = 6.0", f"{RIGID} -k broad"),
    Mutant("filters/rigid.py", "shown = 2 * power", "shown = 1 * power", f"{RIGID} -k independent"),
    Mutant("filters/motion/pose.py", " @ slope + whole @ bent", " @ slope", JOINTS, listed=True),
    Mutant("filters/motion/pose.py", "speed -= decay * position", "speed += decay * position", JOINTS),
    Mutant("filters/motion/articulated.py", "BENT_RAD = 0.1", "BENT_RAD = 0.13", f"{LIMITS} -k joints_bend"),
    Mutant("filters/tree.py", "STEP_RAD = 0.5", "STEP_RAD = 0.6", f"{LIMITS} -k joints_bend"),
    Mutant("filters/whittaker.py", "FASTEST_HZ = 30.0", "FASTEST_HZ = 33.0", f"{LIMITS} -k thirty_hertz"),
    Mutant("filters/whittaker.py", "0.2 / dt_s", "0.25 / dt_s", f"{LIMITS} -k thirty_hertz"),
    Mutant("filters/bones.py", "RIGID = 0.05", "RIGID = 0.06", f"{LIMITS} -k five_percent"),
    Mutant("filters/bones.py", "LEAST_SIZE = 0.02", "LEAST_SIZE = 0.025", f"{LIMITS} -k two_sizes"),
    Mutant("filters/bones.py", "(0.005 * length)", "(0.01 * length)", f"{LIMITS} -k half_a_percent"),
    Mutant("filters/independent.py", "INDEPENDENT = 0.1\n", "INDEPENDENT = 0.12\n", f"{LIMITS} -k ten_frames"),
    Mutant("filters/poses.py", "LEAST_KNOWN = 0.8", "LEAST_KNOWN = 0.74", f"{LIMITS} -k four_fifths"),
    Mutant("filters/poses.py", "1.6783", "1.6983", f"{LIMITS} -k matern"),
    Mutant("filters/joint_types.py", "MOVES_DEG = 10.0", "MOVES_DEG = 12.0", f"{LIMITS} -k ten_degrees"),
    Mutant("filters/joint_types.py", "STRAIGHT_DEG = 15.0", "STRAIGHT_DEG = 18.0", f"{LIMITS} -k fifteen_degrees"),
    Mutant("filters/trajectory.py", "SETTLED = 0.05", "SETTLED = 0.06", f"{LIMITS} -k twentieth"),
    Mutant("filters/models/lagrangian.py", "FLESH = 0.3", "FLESH = 0.4", f"{LIMITS} -k inertia"),
    Mutant("eal/potential.py", "2.0 * self.kernel.curv", "4.0 * self.kernel.curv", f"{EAL} -k curvature", listed=True),
    Mutant("eal/potential.py", "USUAL_WIDTH = 4.0", "USUAL_WIDTH = 5.0", "eal/test_usual_kernel.py -k stated_gaussian"),
    Mutant("eal/potential.py", "w *= -2.0", "w *= -1.0", "eal/test_potential.py -k differences"),
    Mutant("eal/kernels.py", "u / 3.0) - u", "u / 2.0) - u", "eal/test_kernels.py -k textbook"),
    Mutant("eal/fitting.py", "WIDE = 500", "WIDE = 600", f"{EAL} -k 500_pivots"),
    Mutant("eal/fitting.py", "moved = 2.0 * np", "moved = 1.0 * np", f"{EAL} -k left_out_of_a_factor"),
    Mutant("eal/choice.py", "FARTHEST_FACTOR = 12", "FARTHEST_FACTOR = 11", f"{EAL} -k twelve_factors"),
    Mutant("eal/choice.py", "LEFT_OUT_BLOCKS = 5", "LEFT_OUT_BLOCKS = 6", f"{EAL} -k five_blocks"),
    Mutant("eal/checks.py", "MIN_LAMBDA = 1e-13", "MIN_LAMBDA = 2e-13", f"{EAL} -k above_rounding"),
    Mutant(
        "eal/integrators.py", "2.0 * np.sqrt(2.0)", "2.0 * np.sqrt(3.0)", "eal/test_integrators.py -k method_breaks"
    ),
    Mutant(
        "mocap/cameras/origin.py",
        "AS_PROGRAMS_DO = 1.5",
        "AS_PROGRAMS_DO = 1.3",
        f"{ORIGIN} -k one_corner",
        listed=True,
    ),
    Mutant(
        "mocap/cameras/origin.py", "MISFIT_PX = 0.03,", "MISFIT_PX = 0.05,", f"{ORIGIN} -k three_percent", listed=True
    ),
    Mutant("mocap/cameras/origin.py", "= 0.03, 10.0", "= 0.03, 12.0", f"{ORIGIN} -k three_percent"),
    Mutant("mocap/cameras/origin.py", "CLEARLY = 1.2", "CLEARLY = 1.3", f"{ORIGIN} -k a_fifth"),
    Mutant("mocap/cameras/triangulate.py", "MISSES = 5.0", "MISSES = 6.0", f"{CLEANING} -k misses_by_five"),
    Mutant(
        "mocap/cameras/lens_of_tracks.py", "np.maximum(0.03,", "np.maximum(0.05,", f"{CALIBRATION} -k lens_of_tracks"
    ),
    Mutant("mocap/cameras/camera.py", "(reach > 0.75 *", "(reach > 0.9 *", f"{ORIGIN} -k three_quarters"),
    Mutant(
        "mocap/cleaning/click_noise.py",
        "LOG_DOF_SD = 0.5",
        "LOG_DOF_SD = 0.6",
        f"{CLEANING} -k degrees_of_freedom",
        listed=True,
    ),
    Mutant("mocap/cleaning/click_noise.py", "SHRINK = 30.0", "SHRINK = 40.0", f"{CLEANING} -k thirty_errors"),
    Mutant("mocap/cleaning/bias.py", "UNSEEN = 2.0", "UNSEEN = 3.0", f"{CLEANING} -k twice_what_differs"),
    Mutant(
        "mocap/cleaning/camera_health.py",
        "WORSE = 3.0, 2.0",
        "WORSE = 4.0, 2.0",
        f"{CLEANING} -k three_times_its_level",
    ),
    Mutant("mocap/cleaning/camera_health.py", "WORSE = 3.0, 2.0", "WORSE = 3.0, 2.5", f"{CLEANING} -k twice_its_level"),
    Mutant("mocap/cleaning/likelihoods.py", "FAR = 6.0", "FAR = 7.0", f"{CLEANING} -k six_deviations"),
    Mutant("mocap/cleaning/likelihoods.py", "WORTHLESS = 1 / 3", "WORTHLESS = 1 / 2", f"{CLEANING} -k third_is_wrong"),
    Mutant("mocap/cleaning/swaps.py", "MARGIN = 8.0", "MARGIN = 11.0", f"{CLEANING} -k two_changes"),
    Mutant(
        "mocap/cleaning/swap_states.py", "STATE_CHANGE = 7.0", "STATE_CHANGE = 8.0", f"{CLEANING} -k once_in_a_thousand"
    ),
    Mutant("mocap/cleaning/swapped_rays.py", "OUTLIERS = 0.01", "OUTLIERS = 0.02", f"{CLEANING} -k one_click"),
    Mutant(
        "mocap/cleaning/positions.py",
        "0.25 * median, 8.0",
        "0.35 * median, 8.0",
        f"{CLEANING} -k quarter_of_its_length",
    ),
)
"""The mutants; where one changes a threshold, by more than the cases on either side of it are from it."""


def copied(folder: Path) -> None:
    """The tree in a folder, as it is installed: filters and datasets below mocap."""
    places = {"filters": "mocap/filters", "datasets": "mocap/datasets"}
    for top in ("eal", "mocap", "filters", "datasets", "tests", "docs", "benchmarks"):
        shutil.copytree(ROOT / top, folder / places.get(top, top))
    shutil.copy(ROOT / "pyproject.toml", folder)


def place(folder: Path, file: str) -> Path:
    """A file of the repository in the copy."""
    return folder / ("mocap" if file.split("/")[0] in ("filters", "datasets") else "") / file


def passes(folder: Path, tests: str) -> bool:
    """Whether tests pass in the copy, in a process that has of other packages what takes long to import."""
    child = os.fork()
    if not child:
        _run(folder, tests)
    deadline = time.monotonic() + LIMIT_S
    while time.monotonic() < deadline:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return os.waitstatus_to_exitcode(status) == 0
        time.sleep(0.05)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return False


def _run(folder: Path, tests: str) -> None:
    """The tests, in a child process, which ends with their exit code."""
    import pytest

    os.chdir(folder)
    # not what an editable installation finds in the repository, and nothing compiled of another mutant
    sys.meta_path[:] = [one for one in sys.meta_path if not getattr(one, "__module__", "").startswith("__editable__")]
    sys.path[:] = [str(folder), *(one for one in sys.path if Path(one or ".").resolve() != ROOT)]
    files, _, chosen = tests.partition(" -k ")
    words = ["-x", "-q", "-n", "0", "-p", "no:cacheprovider", "-W", "ignore::pytest.PytestAssertRewriteWarning"]
    words += [*(f"tests/{name}" for name in files.split())]
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        code = int(pytest.main([*words, *(["-k", chosen] if chosen else [])]))
    os._exit(code)


def tried(folder: Path, mutant: Mutant, number: int) -> dict[str, object]:
    """What became of a mutant."""
    path = place(folder, mutant.file)
    text = path.read_text(encoding="utf-8")
    if text.count(mutant.old) != 1:
        raise SystemExit(f"{mutant.file}: {mutant.old!r} stands there {text.count(mutant.old)} times, expected once")
    begun = time.monotonic()
    _write(path, text.replace(mutant.old, mutant.new), number)
    seen = not passes(folder, mutant.tests)
    _write(path, text, number + len(MUTANTS))
    change = f"{mutant.old.strip()} -> {mutant.new.strip()}"
    row = {"file": mutant.file, "change": change, "listed": mutant.listed, "seen": seen, "tests": mutant.tests}
    return row | {"seconds": round(time.monotonic() - begun, 1)}


def _write(path: Path, text: str, number: int) -> None:
    """A file of a time of its own, by which Python sees that what it compiled before is of another text."""
    path.write_text(text, encoding="utf-8")
    os.utime(path, (1_000_000 + number, 1_000_000 + number))


def main(arguments: Sequence[str] | None = None) -> None:
    """Try all, and print those that survive."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="only those that survived when they were first tried")
    parser.add_argument("--out", type=Path, required=True, help="folder for table.csv")
    options = parser.parse_args(arguments)
    for name in ("hypothesis", "scipy.linalg", "scipy.optimize", "scipy.signal", "scipy.spatial", "typer", "xarray"):
        import_module(name)  # for the children

    chosen = [one for one in MUTANTS if one.listed or not options.quick]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        copied(folder)
        for file in sorted({one.tests.partition(" -k ")[0] for one in chosen}):
            words = {one.tests.partition(" -k ")[2] for one in chosen if one.tests.partition(" -k ")[0] == file}
            if not passes(folder, file if "" in words else f"{file} -k {' or '.join(sorted(words))}"):
                raise SystemExit(f"{file}: a test fails without a mutant")
        rows = []
        for number, mutant in enumerate(chosen):
            rows.append(tried(folder, mutant, number))
            print(f"{'seen' if rows[-1]['seen'] else 'SURVIVES'}  {rows[-1]['file']}: {rows[-1]['change']}", flush=True)
    table = pd.DataFrame(rows)
    options.out.mkdir(parents=True, exist_ok=True)
    table.to_csv(options.out / "table.csv", index=False)
    listed = table[table["listed"]]
    print(
        f"{table['seen'].sum()} of {len(table)} are seen ({table['seen'].mean():.0%}); "
        f"of the {len(listed)} that survived at first {int((~listed['seen']).sum())} survive"
    )


if __name__ == "__main__":
    main()
