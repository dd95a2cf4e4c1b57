"""Pictures of the desk with three built-in flights, in a browser: ``python -m docs.tools.desk_pictures FOLDER``."""

import io
import shutil
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from mocap.datasets import make_bat, write_recording
from PIL import Image

from mocap.batches.trial import Options
from mocap.desk.desk import opened_desk
from mocap.desk.page import desk_page
from mocap.web.server import served
from tests.mocap.desk.conftest import until
from tests.mocap.rerun.browser import chromium

SIZE = 1280, 800
FLIGHTS, FRAMES = 3, 180
ANGLE = "elbow flexion"
"""What is plotted: the first quantity of which the list of angles says so."""


def season(folder: Path, *, frames: int = FRAMES) -> tuple[list[str], dict[str, object]]:
    """Flights of one bat in a folder: their files, and what is stated of them."""
    stated: dict[str, object] = {}
    for number in range(1, FLIGHTS + 1):
        film = make_bat(seed=number, n_frames=frames, n_cameras=4)
        place = folder / f"{number}"
        place.mkdir(parents=True)
        files = write_recording(film, place)
        shutil.copy(files["pixels"], folder / f"flight_{number}_xypts.csv")
        known = {"calibration": files["coefficients"], "profile": files["profile"], "skeleton": files["skeleton"]}
        stated = {**known, "fps": film.fps, "unit": "m", "origin": "upper-left"}
    return [str(path) for path in sorted(folder.glob("*_xypts.csv"))], stated


def take_pictures(folder: Path, *, frames: int = FRAMES) -> list[Path]:
    """Track the flights and save a picture of each room."""
    folder.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory() as name, chromium() as driver:
        sources, stated = season(Path(name) / "data", frames=frames)
        with opened_desk(sources, Path(name) / "out", options=Options(), jobs=1, arguments=stated) as desk:
            desk.track()
            while desk.progress()["running"]:
                time.sleep(0.5)
            with served(desk_page(desk)) as site:
                return [save(picture, folder / f"desk_{room}.png") for room, picture in rooms(driver, site.address)]


def rooms(driver: Any, address: str, *, angle: str = ANGLE) -> Iterator[tuple[str, bytes]]:
    """Rooms and their pictures: the trials, the worst place of one, an angle of both sides beside the first."""
    measures = {"width": SIZE[0], "height": SIZE[1], "deviceScaleFactor": 1, "mobile": False}
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", measures)
    try:
        driver.get(address)
        until(driver, "document.body.dataset.ready === '1'")
        driver.find_element("class name", "look").click()
        until(driver, "document.body.dataset.audits === '1'")
        yield "trials", driver.get_screenshot_as_png()
        driver.find_element("class name", "read").click()
        until(driver, "document.body.dataset.opened === '1'")
        until(driver, "document.querySelectorAll('.place').length")
        yield "proof", driver.get_screenshot_as_png()
        driver.find_element("css selector", "[data-room=angles]").click()
        until(driver, "document.body.dataset.curve")
        found = f"[...document.querySelectorAll('#quantities label')].find(one => one.textContent.includes('{angle}'))"
        driver.execute_script(f"const one = {found}.querySelector('input'); if (!one.checked) one.click();")
        until(driver, "plotted.length === shownQuantities.length && charts.length")
        yield "angles", driver.get_screenshot_as_png()
    finally:
        driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def save(picture: bytes, path: Path) -> Path:
    """A picture of few colours, as a page is."""
    Image.open(io.BytesIO(picture)).convert("RGB").quantize(96).save(path, optimize=True)
    return path


if __name__ == "__main__":
    take_pictures(Path(sys.argv[1]))
