"""The demo: the main job on a built-in recording, measured against its truth."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

import numpy as np

from eal.arrays import Array
from mocap.datasets import make_bat, make_lizard, write_recording
from mocap.filters.hide import interior_gaps
from mocap.filters.interpolate import by_chains, by_poses, interpolated
from mocap.filters.models.registry import NAMED
from mocap.filters.score import compared
from mocap.progress import Stages
from mocap.reading.reading import read
from mocap.recording import Recording
from mocap.report.job import run_job
from mocap.report.report import readable
from mocap.tracking.report_part import Report
from mocap.tracking.result import Result
from mocap.tracking.tracking import learn_motion, seen_part, track, with_track

Animal = Literal["bat", "lizard"]


def run_demo(animal: Animal, *, stages: Stages, seed: int = 0, n_frames: int | None = None) -> Result:
    """The run alone; see ``measured_demo``."""
    return measured_demo(animal, stages=stages, seed=seed, n_frames=n_frames)[0]


def measured_demo(
    animal: Animal, *, stages: Stages, seed: int = 0, n_frames: int | None = None
) -> tuple[Result, Recording, Array]:
    """Make the recording, write it as DLTdv files, run the main job on those files, and compare with the truth.

    The report's ``gaps`` holds the error inside the recording's own gaps for the tracker and for what people use today,
    and ``measured`` the error where the markers were seen.

    Args:
        animal: Which.
        stages: Timer and progress.
        seed: Which flight or walk.
        n_frames: How long; None: as long as these recordings usually are.

    Returns:
        The run, the prepared recording, and the true markers (T, M, 3) in metres.
    """
    with stages.stage("make the recording"):
        make = make_bat if animal == "bat" else make_lizard
        recording = make(seed=seed) if n_frames is None else make(seed=seed, n_frames=n_frames)
    with TemporaryDirectory() as folder:
        with stages.stage("make the recording"):
            files = write_recording(recording, Path(folder))
        source = read(
            files["pixels"],
            fps=recording.fps,
            calibration=files["coefficients"],
            profile=files["profile"],
            skeleton=files["skeleton"],
            unit="m",
        )
        run, prepared = run_job(source, model="mixture", stages=stages, validated=False)
    part = seen_part(prepared)
    truth = recording.truth.xyz_m
    seen = np.isfinite(prepared.xyz_m[..., 0])
    where = interior_gaps(seen)
    with stages.stage("the same by other methods") as progress:
        model = learn_motion(part, NAMED["constant_velocity"].settings)
        other = with_track(prepared, part, "constant_velocity", track(part, model, progress=progress))
        methods = {"mixture": run.tracks, "constant_velocity": other.tracks}
        gaps = {name: compared(m.xyz_m, m.cov_m2, truth, where).as_json() for name, m in methods.items()}
        for kind in ("cubic", "linear"):
            filled = interpolated(prepared.xyz_m, prepared.t_s, kind=kind)
            gaps[kind] = compared(filled, None, truth, where).as_json()
        trunk = [prepared.names.index(name) for name in prepared.skeleton.trunk]
        bones = [(prepared.names.index(bone.a), prepared.names.index(bone.b)) for bone in prepared.skeleton.bones]
        chained = by_chains(prepared.xyz_m, prepared.t_s, bones, trunk)
        gaps["chains"] = compared(chained, None, truth, where).as_json()
        for kind in ("conditional_gaussian", "principal_components"):
            filled = by_poses(prepared.xyz_m, prepared.t_s, trunk, kind=kind)
            gaps[kind] = compared(filled, None, truth, where).as_json()
    measured = {name: compared(m.xyz_m, m.cov_m2, truth, seen).as_json() for name, m in methods.items()}
    measured["triangulation"] = compared(prepared.xyz_m, prepared.cov_m2, truth, seen).as_json()
    report = {
        **run.report,
        "gap_samples": int(where.sum()),
        "gaps": gaps,
        "measured": measured,
        "seconds": {**stages.seconds, "total": sum(stages.seconds.values())},
    }
    return run.with_part(Report(numbers=report, text=readable(report, title=f"Demo: {animal}"))), prepared, truth
