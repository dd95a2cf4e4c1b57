"""The 3D scene beside the page to click in: what was found, in rerun's viewer, from this computer alone."""

import time

import numpy as np
import pytest
from browser import chromium, settled
from rerun.chunk import RrdReader

from mocap.rerun import palette, paths
from tests.mocap.desk.conftest import requests_of
from tests.mocap.desk.test_session import client, session_of, shown, until
from tests.mocap.digitising.filmed import video


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return video(tmp_path_factory.mktemp("page"), 12)


@pytest.mark.viewer
def test_the_scene_is_beside_the_films(scene, tmp_path):
    """The viewer shows what was found, anew after finding again; no request leaves this computer."""
    session = session_of(scene, tmp_path / "out")
    session.clicks += scene.clicks()
    session.run()

    def points(picture):
        right = picture[80:-60, int(0.6 * picture.shape[1]) :].astype(int)
        return (np.abs(right - palette.SKY_BLUE).max(axis=2) < 40).sum() > 20

    with shown(session) as address, chromium() as driver:
        driver.set_window_size(1000, 560)
        driver.get(address + "?renderer=webgl")  # the browser of the tests has no WebGPU
        until(driver, "document.body.dataset.ready === '1'")
        driver.find_element("id", "space").click()
        settled(driver, 100, points)
        asked = requests_of(driver)
        assert sum(url.endswith("/scene/points.rrd") for url in asked) == 1
        driver.execute_script("find()")
        until(driver, "document.body.dataset.found === '1'")
        again = []
        while not any(url.endswith("/scene/points.rrd") for url in again):
            again += requests_of(driver)
            time.sleep(0.5)
        assert sum(url.endswith("/scene/points.rrd") for url in again) == 1
        assert all(url.startswith((address, "data:", "blob:")) for url in asked + again)


def test_the_scene_is_what_was_found(scene, tmp_path):
    """The recording that is served holds the positions; before anything is named there is none, and it says so."""
    session = session_of(scene, tmp_path / "out")
    session.clicks += scene.clicks()
    with shown(session) as address, client(address) as browser:
        early = browser.get("scene/points.rrd")
        assert early.status_code == 409
        assert "nothing is named yet" in early.json()["said"]
        session.run()
        (tmp_path / "points.rrd").write_bytes(browser.get("scene/points.rrd").content)
    frames, xyz = positions(tmp_path / "points.rrd")
    np.testing.assert_array_equal(frames, np.arange(1, 13))
    np.testing.assert_allclose(xyz, session.found.points.xyz_m, atol=1e-6)


def positions(rrd):
    """Frame numbers (T,) and positions (T, M, 3) of the body in a recording."""
    store = RrdReader(rrd).store()
    rows = []
    for chunk in store.stream().filter(content=paths.SKELETON, components="Points3D:positions"):
        if not chunk.is_static:
            batch = chunk.to_record_batch()
            column = batch.column("Points3D:positions").to_pylist()
            rows += zip(np.asarray(batch.column("frame")).tolist(), column, strict=True)
    frames, xyz = zip(*sorted(rows, key=lambda row: row[0]), strict=True)
    return np.array(frames), np.array(xyz)
