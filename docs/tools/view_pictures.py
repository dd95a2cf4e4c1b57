"""Pictures of the built-in recordings as their viewer shows them: ``python -m docs.tools.view_pictures FOLDER``."""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image

from mocap.progress import Stages
from mocap.report.demo import Animal, run_demo
from mocap.rerun.record import make_blueprint, make_layout, recording_id, write_recording
from mocap.tracking.result import Result
from tests.mocap.rerun.headless import Headless

SIZE = (1600, 1000)
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


if __name__ == "__main__":
    for name in WANTED:
        take_pictures(Path(sys.argv[1]), animal=name)
