"""A browser without a screen that can reach this computer only."""

import io
import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from selenium import webdriver
from selenium.common.exceptions import WebDriverException

SIZE = (560, 420)
_SETTLE_S = 1.5


@contextmanager
def chromium() -> Iterator[Any]:
    """Chromium with software WebGL; every name but this computer's address is unknown to it."""
    driver_program, program = Path("/usr/bin/chromedriver"), Path("/usr/bin/chromium")
    if not (driver_program.exists() and program.exists()) and not os.environ.get("CI"):
        pytest.skip("no browser: apt-get install chromium chromium-driver")
    options = webdriver.ChromeOptions()
    options.binary_location = str(program)
    for argument in (
        "--headless=new",
        "--no-sandbox",
        "--disable-dev-shm-usage",
        "--use-angle=swiftshader",
        "--enable-unsafe-swiftshader",
        "--js-flags=--wasm-lazy-compilation --no-wasm-tier-up",  # the viewer has 40 MB of it, shown for seconds
        f"--window-size={SIZE[0]},{SIZE[1]}",
        "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
    ):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"performance": "ALL"})
    service = webdriver.ChromeService(executable_path=str(driver_program))
    driver = webdriver.Chrome(options=options, service=service)
    try:
        yield driver
    finally:
        driver.quit()


@contextmanager
def served(folder: Path) -> Iterator[str]:
    """The address of a plain static web server of a folder."""

    class Quiet(SimpleHTTPRequestHandler):
        def log_message(self, *_: object) -> None: ...

    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(folder)))
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/"
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def settled(
    driver: Any, enough: int, shows: Callable[[NDArray[np.uint8]], bool] = lambda _picture: True
) -> NDArray[np.uint8]:
    """(H, W, 3) what the page shows once it has ``enough`` colours and ``shows``, and is at rest."""
    last, since = b"", time.monotonic()
    while True:
        try:
            png = driver.get_screenshot_as_png()
        except WebDriverException:
            png = b""
        if png != last:
            last, since = png, time.monotonic()
        elif png and time.monotonic() - since > _SETTLE_S:
            picture = np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))
            if shows(picture) and len(np.unique(picture @ [1, 256, 256**2])) >= enough:
                return picture
        time.sleep(0.8)
