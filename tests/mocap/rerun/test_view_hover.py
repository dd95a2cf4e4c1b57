"""What a person reads who points at a marker: its name and position, at the pixel that our camera model predicts."""

import io
import re
import time

import numpy as np
import pytest
from flapping import SIZE_PX, make_run
from PIL import Image
from pointer import Pointer, screen
from test_view_pictures import loaded, tile
from vulkan import need_vulkan

from mocap.cameras.camera import project, stacked
from mocap.records import Status
from mocap.rerun import paths
from tests.mocap.rerun.headless import Headless

pytestmark = pytest.mark.viewer
FRAME = 33


def place_of(viewer, view):
    """Size (w, h) of a view's picture and where (x, y) it lies in that of the window, once both show the same."""
    while True:
        picture = viewer.picture(view, frame=FRAME)
        window = np.asarray(Image.open(io.BytesIO(viewer.client.take_screenshot())).convert("RGB"))
        (h, w), dot = picture.shape[:2], np.argwhere((picture != picture[0, 0]).any(axis=-1))[0]
        for y, x in np.argwhere((window == picture[*dot]).all(axis=-1)) - dot:
            if y >= 0 and x >= 0 and np.array_equal(window[y : y + h, x : x + w], picture):
                return np.array([w, h]), np.array([x, y])


def read_at(pointer, place, *words):
    """All texts when the pointer is at a place, once they hold all words."""
    while True:
        pointer.hover(float(place[0]), float(place[1]))
        for _ in range(4):  # a tool tip is shown when the hand has come to rest
            time.sleep(0.5)
            text = "\n".join(pointer.texts())
            if all(word in text for word in words):
                return text


def numbers(text):
    """What a tool tip says of positions."""
    found = re.search(r"positions\n\[([^]]*)\]", text)
    assert found is not None, text
    clean = found[1].replace("−", "-").replace("\u2009", "").replace(" ", "")
    return np.array([float(part) for part in clean.split(",")])


def test_pointing_at_a_marker_reads_its_name_and_position(tmp_path):
    """In a camera's tile the viewer projects, picks and prints; beside the markers it has nothing to say.

    Balls of the scene say where they are in metres, dots of the tracks where they are in pixels.
    """
    need_vulkan()
    run = make_run(n_frames=60, n_cameras=2)
    markers = run.tracks
    uv = project(stacked(run.cameras), markers.xyz_m[FRAME])[0]
    entities = {
        paths.child(paths.MARKERS, "measured"): markers.xyz_m[FRAME],
        f"{paths.image('cam1')}/reprojected": run.reprojected_px[0, FRAME],
    }
    apart = np.linalg.norm(uv[:, None] - uv, axis=-1) + 1e3 * np.eye(len(uv))
    lonely = next(m for m in np.argsort(-apart.min(axis=1)) if markers.status[FRAME, m] == Status.MEASURED)
    with screen() as display, Headless(size=(700, 500), display=display) as viewer:
        run = loaded(viewer, run, tmp_path)
        with Pointer(viewer.client.url.removeprefix("rerun+").removesuffix("/proxy")) as pointer:
            for entity, expected in entities.items():
                size, corner = place_of(viewer, tile(run, "cam1", entity))
                scale = min(size / SIZE_PX)
                places = (uv - np.array(SIZE_PX) / 2) * scale + size / 2 + corner
                words = (f'"{markers.names[lonely]}"', f"{entity.rsplit('/', 1)[1]}[", "positions")
                text = read_at(pointer, places[lonely], *words)
                # the viewer prints six digits or more of float32
                np.testing.assert_allclose(numbers(text), expected[lonely], rtol=2e-6, atol=1e-6)
                assert "positions" not in read_at(pointer, places[lonely] + (0, 60))
