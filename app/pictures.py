"""Pictures of the built-in recordings as their viewer shows them: ``python -m app.pictures FOLDER``."""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image

from app.demo import Animal, run_demo
from app.main_job import Stages
from app.run import Run
from app.view.blueprint import make_blueprint
from app.view.headless import Headless
from app.view.record import make_layout, recording_id, write_recording

SIZE = (1600, 1000)
FRAME = {"bat": 96, "lizard": 300}
TABS = ("overview", "cameras", "joints", "health")


def take_pictures(folder: Path, *, animal: Animal) -> list[Path]:
    """Run the demo and save a picture of each tab."""
    return picture_run(run_demo(animal, stages=Stages()), folder, prefix=animal, frame=FRAME[animal])


def picture_run(run: Run, folder: Path, *, prefix: str, frame: int) -> list[Path]:
    """Save a picture of each tab of a run at one frame (from 0)."""
    folder.mkdir(parents=True, exist_ok=True)
    out = []
    with TemporaryDirectory() as temporary, Headless(size=SIZE) as viewer:
        rrd = Path(temporary) / "recording.rrd"
        write_recording(run, rrd)
        viewer.load(rrd, recording_id(run))
        for i, tab in enumerate(TABS):
            blueprint = make_blueprint(make_layout(run))
            blueprint.root_container.active_tab = i
            path = folder / f"{prefix}_{tab}.png"
            Image.fromarray(viewer.show(blueprint, frame=frame)).save(path, optimize=True)
            out.append(path)
    return out


if __name__ == "__main__":
    for name in ("bat", "lizard"):
        take_pictures(Path(sys.argv[1]), animal=name)
