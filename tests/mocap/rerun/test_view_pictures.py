"""What a person sees: pictures of a viewer, held against our own camera model."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rerun.blueprint as rrb
from flapping import make_run
from numpy.typing import NDArray
from PIL import Image
from vulkan import need_vulkan

from mocap.cameras.camera import project, stacked
from mocap.records import Status
from mocap.rerun import palette, paths
from mocap.rerun.blueprint import series_view
from mocap.rerun.log_markers import gap_map_view
from mocap.rerun.record import make_blueprint, make_layout, recording_id, write_recording
from mocap.rerun.row_map import WIDE, row_map_view
from mocap.rerun.scene_views import camera_view, scene_view
from mocap.rerun.tabs.joints import heat_map_view, spectrum_view, surface_view, volume_view
from mocap.tracking.result import Result
from tests.mocap.rerun.headless import Headless

INK = True  # the pictures of the pages are of recordings that are written
FRAME = 33
SHIFT_PX = 12.0
NEAR = 60.0  # of 441: shading darkens the rim of a ball and blends it with what is behind


def loaded(viewer: Headless, run: Result, folder: Path) -> Result:
    """The run under a name of its own, in the viewer."""
    run = replace(run, name=folder.name)
    write_recording(run, folder / "recording.rrd")
    viewer.load(folder / "recording.rrd", recording_id(run))
    return run


def tile(run: Result, name: str, *contents: str, hidden: tuple[str, ...] = ()) -> rrb.View:
    """A camera's whole image, with nothing but these entities."""
    width, height = next(c for c in make_layout(run).scene.cameras if c.name == name).size_px
    return rrb.Spatial2DView(
        origin=paths.image(name),
        contents=list(contents),
        background=palette.GROUND,
        visual_bounds=rrb.VisualBounds2D(x_range=[0, width], y_range=[0, height]),
        overrides={path: rrb.EntityBehavior(visible=False) for path in hidden},
    )


def expected_px(run: Result, c: int, frame: int, code: Status) -> NDArray:
    """(N, 2) pixels where our camera model puts the markers of one origin, in the image as it is shown."""
    markers = run.tracks
    uv = project(stacked(run.cameras), markers.xyz_m[frame])[c][markers.status[frame] == code]
    return uv * (1, -1) + (0, 800) if run.y_up else uv


def share_found(picture: NDArray, uv_px: NDArray, color: palette.Rgb, *, size_px=(1280, 800)) -> float:
    """Share of the pixels at which the picture has the colour, give or take one pixel of the screen.

    A view shows its bounds as large as fits, centred.
    """
    height, width = picture.shape[:2]
    scale = min(width / size_px[0], height / size_px[1])
    at = np.round((uv_px - np.array(size_px) / 2) * scale + np.array([width, height]) / 2 - 0.5).astype(int)
    found = []
    for u, v in at:
        patch = picture[v - 1 : v + 2, u - 1 : u + 2].reshape(-1, 3).astype(float)
        found.append(bool((np.linalg.norm(patch - color, axis=1) < NEAR).any()))
    return float(np.mean(found))


def amount(picture: NDArray, color: palette.Rgb | None) -> int:
    """Number of pixels that have the colour; None: one that is not that of the ground."""
    if color is None:
        return int((np.linalg.norm(picture.astype(float) - palette.GROUND, axis=-1) > NEAR).sum())
    return int((np.linalg.norm(picture.astype(float) - color, axis=-1) < NEAR).sum())


@pytest.mark.parametrize(("handed", "y_up", "skew"), [(1.0, False, 0.0), (-1.0, True, 150.0)])
def test_the_viewer_projects_markers_to_our_pixels(viewer, tmp_path, handed, y_up, skew):
    """Every ball in a camera's tile is where our model puts the marker, in two frames and two cameras.

    The viewer gets positions, pose and lens, and projects by itself, so this is an independent check of all three.
    A mirrored world, pixels that run up, and a skewed sensor included. Twelve pixels beside, there is nothing.
    """
    run = loaded(viewer, make_run(n_frames=60, n_cameras=3, handed=handed, y_up=y_up, skew=skew), tmp_path)
    for c, frame in ((0, FRAME), (2, 50)):
        for name, code in (("measured", Status.MEASURED), ("filled", Status.SMOOTHED)):
            picture = viewer.picture(tile(run, f"cam{c + 1}", paths.child(paths.MARKERS, name)), frame=frame)
            uv_px = expected_px(run, c, frame, code)
            assert len(uv_px) > 0
            assert share_found(picture, uv_px, palette.ORIGIN[name]) == 1.0
            assert share_found(picture, uv_px + SHIFT_PX, palette.ORIGIN[name]) < 0.5


def test_what_is_hidden_is_not_seen(viewer, tmp_path):
    """Each layer of a tile has its own colour, which goes when the layer is hidden."""
    run = loaded(viewer, make_run(n_frames=60, n_cameras=2), tmp_path)
    image = paths.image("cam1")
    layers = {
        f"{image}/measured": palette.SKY_BLUE,
        f"{image}/reprojected": palette.GREEN,
        f"{image}/residual": palette.ORANGE,
        paths.child(paths.MARKERS, "filled"): palette.YELLOW,
    }
    for path, color in layers.items():
        assert amount(viewer.picture(tile(run, "cam1", path), frame=FRAME), color) > 10
    hidden = viewer.picture(tile(run, "cam1", *layers, hidden=tuple(layers)), frame=FRAME)
    assert not any(amount(hidden, color) for color in layers.values())


@pytest.mark.main
def test_measured_pixels_are_seen_where_they_were_measured(viewer, tmp_path):
    """The dots of the tracks, in pixels that run up, are drawn at height minus v."""
    run = loaded(viewer, make_run(n_frames=60, n_cameras=2, handed=-1.0, y_up=True), tmp_path)
    uv_px = run.ideal_px[1, FRAME][run.used[1, FRAME]] * (1, -1) + (0, 800)
    picture = viewer.picture(tile(run, "cam2", f"{paths.image('cam2')}/measured"), frame=FRAME)
    assert share_found(picture, uv_px, palette.SKY_BLUE) == 1.0
    assert share_found(picture, uv_px + SHIFT_PX, palette.SKY_BLUE) < 0.5


@pytest.mark.main
def test_tile_and_scene_of_the_blueprint_show_the_animal(viewer, tmp_path):
    """The views that a user gets hold body, gaps and bones, framed: neither a dot nor out of sight."""
    run = loaded(viewer, make_run(n_frames=60, n_cameras=2), tmp_path)
    layout = make_layout(run)
    for view in (scene_view(layout), camera_view(layout, "cam1")):
        picture = viewer.picture(view, frame=FRAME)
        bones = np.argwhere(np.linalg.norm(picture.astype(float) - palette.GREY, axis=-1) < NEAR)
        assert amount(picture, palette.YELLOW) > 20
        assert np.ptp(bones[:, 1]) > 0.15 * picture.shape[1]


@pytest.mark.parametrize(("n_cameras", "n_joints"), [(4, 2), (0, 0)])
def test_every_tab_is_shown_without_reports(viewer, tmp_path, n_cameras, n_joints):
    """The viewer has nothing to complain about in any tab, and each looks different."""
    run = loaded(viewer, make_run(n_frames=40, n_cameras=n_cameras, n_joints=n_joints), tmp_path)
    layout = make_layout(run)
    pictures = []
    for i in range(len(make_blueprint(layout).root_container.contents)):
        blueprint = make_blueprint(layout)
        blueprint.root_container.active_tab = i
        pictures.append(viewer.show(blueprint, frame=20).tobytes())
    assert len(set(pictures)) == len(pictures) >= 3


JOINT = "L_elbow"
SURFACE, HEAT_MAP, CLOUD = paths.joint(JOINT, "surface"), paths.joint(JOINT, "map"), paths.joint(JOINT, "volume")
SHOWN = {
    "scene": (
        scene_view,
        [(paths.SKELETON, palette.GREY), (paths.PATH, palette.WHITE), (paths.TRAILS, palette.TRAIL["right"])],
    ),
    "surface": (lambda x: surface_view(x, JOINT), [(f"{SURFACE}/now", palette.VERMILLION)]),
    "heat map": (
        lambda x: heat_map_view(x, JOINT),
        [(f"{HEAT_MAP}/potential", (68, 1, 84))],
    ),
    "volume": (lambda x: volume_view(x, JOINT), [(f"{CLOUD}/potential", None)]),
    "spectrum": (
        lambda _: spectrum_view(JOINT),
        [
            (f"{paths.joint(JOINT, 'spectrum')}/dots", palette.SKY_BLUE),
            (f"{paths.joint(JOINT, 'spectrum')}/lines", palette.ORANGE),
        ],
    ),
    "gap map": (
        lambda _: gap_map_view(),
        [(f"{paths.GAP_MAP}/now", palette.WHITE), (f"{paths.GAP_MAP}/samples", palette.YELLOW)],
    ),
    "error map": (
        lambda _: row_map_view(paths.RESIDUAL_MAP, "map", WIDE),
        [(f"{paths.RESIDUAL_MAP}/now", palette.WHITE), (f"{paths.RESIDUAL_MAP}/samples", (253, 231, 37))],
    ),
    "series": (
        lambda _: series_view(f"{paths.joint(JOINT, 'series')}/potential", "V", legend=False),
        [(f"{paths.joint(JOINT, 'series')}/potential/value", palette.ORANGE)],
    ),
}
"""For each kind of view what it shows, and the colour that nothing else in it has; None: any that is no ground."""


@pytest.fixture(scope="module")
def layered(viewer, tmp_path_factory):
    return loaded(viewer, make_run(n_frames=120, n_cameras=6), tmp_path_factory.mktemp("layered"))


@pytest.mark.parametrize("name", SHOWN)
def test_what_is_hidden_in_a_view_is_gone(viewer, layered, name):
    """Each view shows what it is for: hidden, its colour is gone, or nearly where others blend to it."""
    make, layers = SHOWN[name]
    layout = make_layout(layered)
    whole, view = viewer.picture(make(layout), frame=FRAME), make(layout)
    for path, _ in layers:
        view.visualizer_overrides[path] = rrb.EntityBehavior(visible=False)
    without = viewer.picture(view, frame=FRAME)
    for path, color in layers:
        assert amount(whole, color) > 8 + 2 * amount(without, color), path


def test_the_pictures_of_the_pages_are_taken(tmp_path):
    """As ``make pictures`` takes them, of a small recording: each tab by its name."""
    need_vulkan()
    from docs.tools.view_pictures import TABS, WANTED, picture_run

    assert {tab for _, tabs in WANTED.values() for tab in tabs} <= set(TABS)
    run = make_run(n_frames=30, n_cameras=2)
    taken = picture_run(run, tmp_path, prefix="small", frame=10, tabs=("overview", "joints"))
    assert [path.name for path in taken] == ["small_overview.png", "small_joints.png"]
    for path in taken:
        picture = np.asarray(Image.open(path))
        assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 100


@pytest.mark.parametrize(("n_cameras", "size"), [(4, (570, 750)), (8, (900, 340))])
def test_wide_and_narrow_windows_show_the_animal_and_every_camera(tmp_path, n_cameras, size):
    """In any window the scene shows the body, and each camera's tile some of it: no picture of one colour."""
    need_vulkan()
    run = replace(make_run(n_frames=40, n_cameras=n_cameras, n_joints=0), name="window")
    write_recording(run, tmp_path / "r.rrd")
    with Headless(size=size) as viewer:
        viewer.load(tmp_path / "r.rrd", recording_id(run))
        for tab in (0, 1):
            blueprint = make_blueprint(make_layout(run))
            blueprint.root_container.active_tab = tab
            picture = viewer.show(blueprint, frame=20)
            assert amount(picture[100:], palette.GREY) > 200
            assert amount(picture[100:], palette.SKY_BLUE) + amount(picture[100:], palette.GREEN) > 20 * min(
                n_cameras, 5
            )
