"""Points without a dot: followed by their texture, against where it was drawn."""

from copy import deepcopy
from dataclasses import replace

import cv2
import numpy as np
import pytest

from mocap.digitising.digitised import digitise
from mocap.digitising.texture import TEXTURE_CLICK_PX, begun, followed
from tests.mocap.digitising.filmed import NAMES, textured, video

NOSE, TAIL = NAMES.index("nose"), NAMES.index("tail")


def skin(uv, turn_rad=0.0):
    """A picture of 120 x 160 with a textured point, places counted from 0."""
    grey = np.full((120, 160), 60, dtype=np.uint8)
    noise = np.random.default_rng(int(abs(1000 * uv[0]))).normal(0, 2, grey.shape)
    return np.clip(textured(grey, np.asarray(uv) + 1, turn_rad) + noise, 0, 255).astype(np.uint8)


def test_a_texture_that_turns_is_followed_and_its_drift_is_stated():
    """It moves 1.5 px and turns 2 degrees a frame: places are within 3.5 deviations, which grow with templates."""
    path = np.array([[40 + 1.5 * t, 60 + 0.4 * t] for t in range(40)])
    point = begun(skin(path[0]), path[0])
    sds, templates = [], {id(point.template)}
    for t in range(1, 40):
        point = followed(point, skin(path[t], np.deg2rad(2 * t)), point.uv, 20.0)
        assert point.before is not None
        assert np.abs(point.uv - path[t]).max() < 3.5 * point.sd_px
        sds.append(point.sd_px)
        templates.add(id(point.template))
    assert len(templates) > 1
    assert sds[-1] > sds[0] > TEXTURE_CLICK_PX


def test_what_covers_a_texture_ends_it_until_it_is_found_again():
    """A dot runs over the point: it is not found, or within 1 px; afterwards it is found where it is."""
    place, lost = np.array([80.0, 60.0]), 0
    point = begun(skin(place), place)
    for t in range(40):
        picture = skin(place)
        cv2.circle(picture, (60 + t, 60), 4, 235, cv2.FILLED, cv2.LINE_AA)
        point = followed(point, picture, place, 5.0)
        if point.before is None:
            lost += 1
        else:
            assert np.abs(point.uv - place).max() < 1.0
    assert lost >= 5
    found = followed(point, skin(place), place + np.array([3, -2]), 8.0)
    assert found.before is not None
    assert np.abs(found.uv - place).max() < 0.3


def test_two_places_alike_are_not_chosen_from():
    """A point that was lost, and two that look like it in reach: none is taken."""
    one = skin([50.0, 60.0])
    point = begun(one, np.array([50.0, 60.0]))
    gone = followed(point, np.full_like(one, 60), np.array([50.0, 60.0]), 30.0)
    assert gone.before is None
    both = textured(one, (91.0, 61.0), 0.0)
    assert followed(gone, both, np.array([70.0, 60.0]), 30.0).before is None


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return video(tmp_path_factory.mktemp("scene"), 30, bare=(NOSE,))


@pytest.mark.rare
@pytest.mark.parametrize("start", [0, 12])
def test_a_marker_whose_clicks_show_no_dot_is_followed_by_its_texture(scene, start):
    """It is known by what was clicked alone; both ways from there; errors are inside what is stated."""
    clicks = scene.clicks(start, cameras=(0, 1, 2), sd_px=0.3)
    result = digitise(scene.folder / "films", start=clicks, **scene.arguments)
    textured_ones = result.engine.observer.textured
    np.testing.assert_array_equal(textured_ones, np.arange(len(NAMES)) == NOSE)
    off = np.linalg.norm(result.pixels.uv_px[:, :, NOSE] - scene.uv_px[:, :, NOSE], axis=-1)
    assert np.isfinite(off).mean() > 0.8
    assert np.nanquantile(off, 0.95) < 1.5
    points = result.points
    error = np.abs(points.xyz_m - scene.xyz_m)[:, NOSE] / (points.sd_m[:, NOSE, None] / np.sqrt(3))
    assert (error < 3.5).mean() > 0.95
    dots = np.linalg.norm(result.pixels.uv_px - scene.uv_px, axis=-1)[:, :, TAIL]
    assert np.nanmedian(dots) < 0.3


@pytest.fixture(scope="module")
def first(scene):
    """From clicks of the first frame in two of the films; tests change copies."""
    return digitise(scene.folder / "films", start=scene.clicks(0, sd_px=0.3), **scene.arguments)


def test_an_answer_follows_the_texture_anew(scene, first):
    """A click in a film in which the point was not clicked: it is named there in the frames about, not in one alone."""
    result = deepcopy(first)
    before = np.isfinite(result.pixels.uv_px[2, :, NOSE, 0]).sum()
    click = next(c for c in scene.clicks(15, cameras=(2,), sd_px=0.3) if c.marker == NOSE)
    result.click([click])
    assert np.isfinite(result.pixels.uv_px[2, :, NOSE, 0]).sum() > before + 10


@pytest.mark.rare
def test_a_wrong_click_on_a_texture_is_corrected_or_taken_back(scene, first):
    """A click 3 px off leads the frames about it away; the right one in its place leads them back, and so does undo."""
    result = deepcopy(first)
    right = next(c for c in scene.clicks(15, cameras=(2,), sd_px=0.1) if c.marker == NOSE)
    assert right.uv_px is not None
    wrong = replace(right, uv_px=(right.uv_px[0] + 3.0, right.uv_px[1]))
    result.click([right])

    def found():
        return np.linalg.norm(result.pixels.uv_px - scene.uv_px, axis=-1)[2, :, NOSE]

    before = found()
    result.click([wrong])
    led_away = found()
    assert np.nanmedian(led_away[10:21]) > 2
    result.undo(1)
    np.testing.assert_array_equal(np.isfinite(found()), np.isfinite(before))
    assert np.nanmax(np.abs(found() - before)) < 0.3
    result.click([wrong, right])
    assert np.nanmedian(found()[10:21]) < 1


def test_a_camera_that_starts_late_is_followed_from_its_first_frame(tmp_path):
    """Its film lacks four frames, as its offset says: dots and texture are in step, from clicks in a later frame."""
    late = video(tmp_path, 24, bare=(NOSE,))
    for frame in range(4):
        (tmp_path / "films" / "cam2" / f"{frame:04d}.png").unlink()
    clicks = late.clicks(8, cameras=(0, 1, 2), sd_px=0.3)
    result = digitise(tmp_path / "films", start=clicks, offset_frames=(0, -4, 0), **late.arguments)
    off = np.linalg.norm(result.pixels.uv_px - late.uv_px, axis=-1)
    assert np.isnan(off[1, :4]).all()
    assert np.isfinite(off[1, 4:, NOSE]).mean() > 0.9
    assert np.nanmax(off[:, :, NOSE]) < 1.5
    assert np.nanmedian(off[1]) < 0.3
