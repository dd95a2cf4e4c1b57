"""Pictures of the built-in recordings as their viewer shows them: ``python -m docs.tools.view_pictures FOLDER``."""

import sys
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

from mocap.datasets import make_bat
from mocap.datasets import write_recording as write_files
from PIL import Image

from mocap.progress import Stages
from mocap.reading.reading import read
from mocap.report.demo import Animal, run_demo
from mocap.report.job import run_job
from mocap.rerun.compare import APPLICATION as COMPARISON
from mocap.rerun.compare import compare_blueprint, stored_runs, write_comparison
from mocap.rerun.record import make_blueprint, make_layout, recording_id, write_recording
from mocap.tracking.result import Result
from tests.mocap.rerun.headless import Headless

SIZE = (1600, 1000)
COMPARED = 270
"""The frame of the comparison: much of a wing is hidden."""
TABS = ("angles", "overview", "cameras", "joints", "health")
WANTED: dict[Animal, tuple[int, tuple[str, ...]]] = {
    "bat": (96, ("overview", "joints")),
    "lizard": (300, ("overview",)),
}
"""The frame (from 0) and the tabs that the README shows."""


def take_pictures(folder: Path, *, animal: Animal) -> list[Path]:
    """Run the demo and save the pictures that are wanted of it."""
    frame, tabs = WANTED[animal]
    return picture_run(run_demo(animal, stages=Stages()), folder, prefix=animal, frame=frame, tabs=tabs)


def picture_run(run: Result, folder: Path, *, prefix: str, frame: int, tabs: tuple[str, ...] = TABS) -> list[Path]:
    """Save pictures of tabs of a run at one frame (from 0)."""
    folder.mkdir(parents=True, exist_ok=True)
    out = []
    with TemporaryDirectory() as temporary, Headless(size=SIZE) as viewer:
        rrd = Path(temporary) / "recording.rrd"
        write_recording(run, rrd)
        viewer.load(rrd, recording_id(run))
        for tab in tabs:
            blueprint = make_blueprint(make_layout(run))
            blueprint.root_container.active_tab = TABS.index(tab)
            path = folder / f"{prefix}_{tab}.png"
            Image.fromarray(viewer.show(blueprint, frame=frame)).save(path, optimize=True)
            out.append(path)
    return out


def two_models() -> dict[str, Result]:
    """The built-in flight tracked with the EAL model, and with constant velocity."""
    with TemporaryDirectory() as temporary:
        files = write_files(make_bat(), Path(temporary))
        source = read(
            files["pixels"],
            fps=make_bat().fps,
            calibration=files["coefficients"],
            profile=files["profile"],
            skeleton=files["skeleton"],
        )
        return {model: run_job(source, model=model, validated=False)[0] for model in ("eal", "constant_velocity")}


def picture_comparison(runs: Mapping[str, Result], folder: Path, *, frame: int) -> Path:
    """Save a picture of runs beside each other."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "bat_compare.png"
    with TemporaryDirectory() as temporary, Headless(size=SIZE) as viewer:
        recordings = [Path(temporary) / f"{name}.rrd" for name in runs]
        for run, recording in zip(runs.values(), recordings, strict=True):
            write_recording(run, recording)
        both = Path(temporary) / "both.rrd"
        write_comparison(recordings, both)
        viewer.load(both, " - ".join(runs), application=COMPARISON)
        blueprint = compare_blueprint(*stored_runs(recordings))
        Image.fromarray(viewer.show(blueprint, frame=frame)).save(path, optimize=True)
    return path


if __name__ == "__main__":
    for name in WANTED:
        take_pictures(Path(sys.argv[1]), animal=name)
    picture_comparison(two_models(), Path(sys.argv[1]), frame=COMPARED)
