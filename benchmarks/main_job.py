"""The main job on the built-in recordings: error inside gaps over seeds beside what people use, and the time it takes.

The seeds are others than those on which the potential was settled (0 to 3; docs/experiments/stiffness.md).
``eal`` is the EAL model of the mixture alone, and ``eal_no_potential`` its control, the same without V_z.
"""

import argparse
from time import perf_counter

import numpy as np
from mocap.filters.hide import interior_gaps
from mocap.filters.models.pose import PoseSettings
from mocap.filters.score import compared

from mocap.progress import Stages
from mocap.recording import Recording
from mocap.report.demo import Animal, measured_demo
from mocap.tracking.tracking import learn_motion, seen_part, track, with_track

METHODS = ("mixture", "eal", "eal_no_potential", "constant_velocity", "cubic", "linear")


def measure(animal: Animal, seed: int) -> dict[str, dict[str, float | None]]:
    """Scores inside the gaps of one recording by method; ``seconds`` holds the time of the demo."""
    start = perf_counter()
    run, prepared, truth_m = measured_demo(animal, stages=Stages(), seed=seed)
    seconds = perf_counter() - start
    scores = {name: dict(value) for name, value in run.report["gaps"].items()}  # type: ignore[attr-defined]
    scores |= controls(prepared, truth_m)
    scores["seconds"] = {"rmse_mm": seconds}
    return scores


def controls(prepared: Recording, truth_m: np.ndarray) -> dict[str, dict[str, float | None]]:
    """The EAL pose model alone, and it without its potential, inside gaps."""
    part = seen_part(prepared)
    seen, out = np.isfinite(prepared.xyz_m[..., 0]), {}
    for name, settings in (("eal", PoseSettings()), ("eal_no_potential", PoseSettings(potential="none"))):
        model = learn_motion(part, settings)
        markers = with_track(prepared, part, name, track(part, model)).tracks
        out[name] = compared(markers.xyz_m, markers.cov_m2, truth_m, interior_gaps(seen)).as_json()
    return out


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="one seed")
    seeds = range(10, 11 if parser.parse_args().quick else 14)
    print(f"{'':8}{'method':24}{'RMSE in gaps, mm':>18}{'spread':>14}{'x ours':>8}{'inside 95 %':>13}")
    for animal in ("bat", "lizard"):
        runs = [measure(animal, seed) for seed in seeds]
        ours = np.array([r["mixture"]["rmse_mm"] for r in runs])
        for method in METHODS:
            rmse = np.array([r[method]["rmse_mm"] for r in runs])
            inside = [r[method]["coverage95"] for r in runs]
            coverage = "-" if None in inside else f"{np.mean([c for c in inside if c is not None]):.1f} %"
            spread = f"{rmse.min():.2f}-{rmse.max():.2f}"
            print(f"{animal:8}{method:24}{rmse.mean():18.2f}{spread:>14}{np.mean(rmse / ours):8.2f}{coverage:>13}")
        seconds = [r["seconds"]["rmse_mm"] for r in runs]
        print(f"{animal:8}demo, seconds {np.median(seconds):.1f} (median of {len(runs)})")


if __name__ == "__main__":
    main()
