"""From films and the clicks of one frame to named dots, against what the films were drawn from."""

from copy import deepcopy
from dataclasses import replace

import cv2
import numpy as np
import pandas as pd
import pytest

import mocap as library
from mocap.cameras.camera import project, stacked
from mocap.digitising.asking import in_sight
from mocap.digitising.clicks import Click, read_clicks, write_clicks
from mocap.digitising.digitised import digitise
from mocap.digitising.engine import unpacked
from mocap.errors import CalibrationError, MocapError
from tests.mocap.digitising.filmed import NAMES, video

HIDDEN = [(c, slice(15, 27), 5) for c in range(3)] + [(1, slice(5, 30), 0)]


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """The hand is hidden from all cameras in frames 15 to 26, the nose from one for longer."""
    return video(tmp_path_factory.mktemp("scene"), hide=HIDDEN)


@pytest.fixture(scope="module")
def told():
    """What was told of progress while ``result`` was made, by stage."""
    return {}


@pytest.fixture(scope="module")
def result(scene, told):
    return digitise(
        scene.folder / "films",
        start=scene.clicks(),
        progress=lambda stage, share: told.setdefault(stage, []).append(share),
        **scene.arguments,
    )


def misses(result, scene):
    """(C, T, M) distance in pixels of what was named from the truth; infinite where the film does not show it."""
    found, true = result.pixels.uv_px, scene.uv_px
    away = np.linalg.norm(found - np.where(np.isfinite(true), true, np.inf), axis=-1)
    return np.where(np.isfinite(found[..., 0]), away, np.nan)


def test_the_function_is_public():
    assert library.digitise.__wrapped__ is digitise


@pytest.mark.rare
def test_names_are_right(result, scene):
    """Nothing wrong is named, and 95 % of what is shown is named, to a fifth of a pixel; hands cross the body."""
    away = misses(result, scene)
    assert np.nanmax(away) < 2
    assert np.sqrt(np.nanmean(away**2)) < 0.3
    shown = np.isfinite(scene.uv_px[..., 0])
    assert result.pixels.seen[shown].mean() > 0.93
    assert not result.pixels.seen[~shown].any()


@pytest.mark.rare
def test_a_faint_spot_is_no_marker(tmp_path):
    """Where the hand is hidden, spots of 0.4 of a dot's contrast 4 mm from it meet in all three films: no name."""
    beside = [(slice(15, 27), NAMES.index("hand"), np.array([0.0, 0.0, 0.004]))]
    scene = video(tmp_path, hide=HIDDEN, faint=beside)
    result = digitise(scene.folder / "films", start=scene.clicks(), **scene.arguments)
    assert not result.pixels.seen[:, 15:27, NAMES.index("hand")].any()
    # the spots are found: it is their strength that tells
    found = [sum(np.isfinite(dots[0, :, 0])) for dots in result.engine.tracks.dots]
    assert np.median(found[16:26]) > np.isfinite(scene.uv_px[0, 20, :, 0]).sum()


@pytest.mark.usefixtures("result")
def test_progress_of_each_stage_only_grows_to_its_end(told):
    """What is left can be told: no pass is silent, none begins the bar of another anew."""
    assert len(told) == 3
    for shares in told.values():
        assert len(shares) > 39
        assert shares == sorted(shares)
        assert shares[-1] == 1.0
        assert shares[0] < 0.1


def test_intervals_hold(result, scene):
    """Of positions seen by two cameras 95 % intervals hold 90 to 100 %; they widen where the hand is hidden."""
    points = result.points
    sd = np.sqrt(np.einsum("tmii->tmi", points.cov_m2))
    inside = np.abs(points.xyz_m - scene.xyz_m) < 1.96 * sd
    assert 0.9 < inside[result.engine.tracks.rays >= 2].mean() <= 1
    hand = NAMES.index("hand")
    assert points.sd_m[20, hand] > 10 * np.median(points.sd_m[:, hand])
    assert (np.abs(points.xyz_m - scene.xyz_m) < 4 * sd)[:, hand].all()


def test_the_next_click_is_where_the_hand_is_hidden(result):
    asked = result.questions()
    assert asked
    assert asked[0].marker == NAMES.index("hand")
    assert 15 <= asked[0].frame <= 26
    assert [q.removes_m2 for q in asked] == sorted((q.removes_m2 for q in asked), reverse=True)


def test_answers_remove_variance_and_touch_only_their_frames(scene, result):
    """Four clicks where nothing is shown (a person knows better) lower the variance; far frames keep their bytes."""
    result = deepcopy(result)
    exact = scene.cameras
    true = np.stack([c.lens.distort(c_uv) for c, c_uv in zip(exact, _ideal(exact, scene.xyz_m), strict=True)])
    hand = NAMES.index("hand")
    before, sd = result.engine.tracks.xyz_m.copy(), result.points.sd_m.copy()
    asked = result.questions(1)[0]
    touched = result.click([_answer(asked, true)])
    assert touched is not None
    outside = np.ones(len(before), dtype=bool)
    outside[touched[0] : touched[1] + 1] = False
    np.testing.assert_array_equal(result.engine.tracks.xyz_m[outside], before[outside])
    made = result.ask(lambda q: tuple(true[q.camera, q.frame, q.marker]), budget=3)
    assert 1 <= made <= 3
    assert np.sum(result.points.sd_m[:, hand] ** 2) < 0.3 * np.sum(sd[:, hand] ** 2)
    error = np.linalg.norm(result.points.xyz_m[15:27, hand] - scene.xyz_m[15:27, hand], axis=-1)
    assert np.median(error) < 0.004


def _ideal(cameras, xyz_m):
    return project(stacked(cameras), xyz_m)


def _answer(question, true):
    return Click(
        camera=question.camera,
        frame=question.frame,
        marker=question.marker,
        uv_px=tuple(true[question.camera, question.frame, question.marker]),
    )


def test_not_to_be_seen_is_an_answer(result):
    """It is not asked again."""
    result = deepcopy(result)
    asked = []

    def blind(question):
        asked.append((question.camera, question.frame, question.marker))

    result.ask(blind, budget=2)
    assert len(set(asked)) == len(asked) == 2


def test_a_click_is_believed_and_not_asked_again(result):
    """A click that no bone and no dot agrees with: the marker is named there, and another place is asked about."""
    result = deepcopy(result)
    hand = NAMES.index("hand")
    far = Click(camera=0, frame=30, marker=hand, uv_px=(20.0, 20.0))
    result.click([far])
    assert result.engine.tracks.rays[30, hand] >= 1
    asked = [(q.camera, q.frame, q.marker) for q in result.questions(1000)]
    assert (far.camera, far.frame, far.marker) not in asked


def test_a_camera_that_showed_the_marker_is_asked_first():
    """It is likelier to show it than one that others contradicted, and than one of which nothing is known."""
    shown, hidden = np.zeros((3, 30), dtype=bool), np.zeros((3, 30), dtype=bool)
    shown[0, :10], hidden[1, :10] = True, True
    likely = in_sight(shown, hidden, 12)
    assert likely[0] > 0.9 > likely[2] > 0.4 > 0.1 > likely[1]


def test_an_answer_changes_what_all_passes_would_say(result):
    """After a click, both passes over all frames again leave positions as they are, to a tenth of a deviation."""
    result = deepcopy(result)
    result.engine.again()
    asked = result.questions(1)[0]
    first, last = result.click([Click(camera=asked.camera, frame=asked.frame, marker=asked.marker, uv_px=asked.uv_px)])
    assert last - first < 39
    here = result.points
    result.engine.again()
    sd = here.sd_m[..., None] / np.sqrt(3)
    assert np.nanmax(np.abs(result.points.xyz_m - here.xyz_m) / sd) < 0.1


def test_names_are_swapped_and_ranges_deleted_by_hand(result, tmp_path):
    """Left is where right was in frames 10 to 20 alone; a deleted range stays empty; both are marked; undo restores."""
    result = deepcopy(result)
    left, right, back = (NAMES.index(name) for name in ("left", "right", "back"))
    before = result.pixels.uv_px.copy()
    clicks = result.swapped("left", "right", 10, 20)
    result.click(clicks, within=True)
    after = result.pixels.uv_px
    np.testing.assert_allclose(after[:, 10:21, left], before[:, 10:21, right], atol=1e-4)
    np.testing.assert_allclose(after[:, 10:21, right], before[:, 10:21, left], atol=1e-4)
    far = [*range(10), *range(21, 40)]
    np.testing.assert_array_equal(after[:, far], before[:, far])
    gone = result.deleted("back", 30, 33)
    result.click(gone, within=True)
    assert np.isnan(result.pixels.uv_px[:, 30:34, back]).all()
    assert np.isfinite(result.pixels.uv_px[:, [29, 34], back]).any()
    result.save(tmp_path / "out")
    origin = pd.read_csv(tmp_path / "out" / "origin.csv")
    assert (origin["back_cam1"].iloc[30:34] == "deleted").all()
    assert (origin["left_cam1"].iloc[10:21] == "click").all()
    assert result.undo(len(gone)) == gone
    assert result.undo(len(clicks)) == clicks
    np.testing.assert_allclose(result.pixels.uv_px[:, 8:38, back], before[:, 8:38, back], atol=1e-4)
    with pytest.raises(MocapError, match="no marker 'wing'"):
        result.deleted("wing", 0, 1)
    with pytest.raises(MocapError, match="frames 39 to 41 are not a range"):
        result.deleted("back", 38, 40)


def test_clicks_in_dltdv_format_come_back(scene, tmp_path):
    """Written and read again, to the sixth decimal."""
    clicks = scene.clicks(3)
    path = tmp_path / "clicks_xypts.csv"
    cameras = tuple(camera.name for camera in scene.cameras)
    write_clicks(path, clicks, names=NAMES, cameras=cameras, n_frames=40, fps=100.0)
    again = read_clicks(path, scene.skeleton, n_cameras=3, n_frames=40)
    key = {(c.camera, c.frame, c.marker): c.uv_px for c in again}
    assert len(again) == len(clicks)
    for click in clicks:
        np.testing.assert_allclose(key[click.camera, click.frame, click.marker], click.uv_px, atol=1e-6)


def test_films_in_a_wrong_order_are_refused(scene):
    """With the order in which the clicks meet."""
    videos = [scene.folder / "films" / name for name in ("cam2", "cam1", "cam3")]
    swapped = [replace(c, camera={0: 1, 1: 0}.get(c.camera, c.camera)) for c in scene.clicks(cameras=(0, 1, 2))]
    for path, name in zip(videos, "abc", strict=True):
        target = scene.folder / name
        if not target.exists():
            target.symlink_to(path)
    with pytest.raises(CalibrationError, match=r"not in the order.*a: cam2, b: cam1, c: cam3"):
        digitise([scene.folder / name for name in "abc"], start=swapped, **scene.arguments)


def test_films_of_another_size_or_number_are_refused(scene, tmp_path):
    other = video(tmp_path, 2)
    for path in (other.folder / "films" / "cam2").iterdir():
        cv2.imwrite(str(path), cv2.imread(str(path))[:200])
    with pytest.raises(MocapError, match="is 320 x 200 px, but camera cam2 was calibrated at 320 x 240: it fits no"):
        digitise(other.folder / "films", start=other.clicks(), **other.arguments)
    with pytest.raises(MocapError, match=r"2 videos .* for 3 cameras"):
        digitise([scene.folder / "films" / n for n in ("cam1", "cam2")], start=scene.clicks(), **scene.arguments)


@pytest.mark.parametrize(
    ("clicks", "said"),
    [
        ([], "there are no clicks"),
        ([Click(camera=0, frame=99, marker=0, uv_px=(5.0, 5.0))], "frame 100"),
        ([Click(camera=0, frame=0, marker=0, uv_px=(50.0, 50.0))], "no marker is clicked in two cameras"),
    ],
)
def test_useless_clicks_are_refused(scene, clicks, said):
    with pytest.raises(MocapError, match=said):
        digitise(scene.folder / "films", start=clicks, **scene.arguments)


def test_the_command_writes_what_the_library_finds(scene, result, mocap, tmp_path):
    """DLTdv's tables, the questions, the calibration; a second run needs --force."""
    cameras = tuple(camera.name for camera in scene.cameras)
    start = tmp_path / "start_xypts.csv"
    write_clicks(start, scene.clicks(), names=NAMES, cameras=cameras, n_frames=40, fps=100.0)
    out, where = tmp_path / "out", scene.folder
    options = ["--calibration", where / "calibration.toml", "--skeleton", where / "skeleton.toml", "--fps", 100]
    command = ["digitise", where / "films", *options, "--start", start, "--budget", 3, "--out", out]
    code, shown, said = mocap(*command)
    assert code == 0, said
    assert "clicks" in shown
    table = pd.read_csv(out / "xypts.csv")
    assert table.shape == (40, 7 * 3 * 2)
    found = np.isfinite(table["back_cam1_X"].to_numpy())
    np.testing.assert_allclose(table["back_cam1_X"], result.pixels.uv_px[0, :, 1, 0], atol=0.1)
    assert found.mean() > 0.9
    assert 1 <= len(pd.read_csv(out / "asked.csv")) <= 3
    origin = pd.read_csv(out / "origin.csv")
    assert origin["nose_cam1"].iloc[0] == "click"
    assert origin["back_cam3"].iloc[20] == "dot"
    assert mocap(*command)[0] == 1
    code, _, said = mocap("track", out / "xypts.csv", "--calibration", out / "calibration.toml", "--fps", 100,
                          "--skeleton", out / "skeleton.toml", "--no-validate", "--model", "constant_velocity",
                          "--out", tmp_path / "tracked")  # fmt: skip
    assert code == 0, said


def cropped(scene, folder, corners=((30, 20), (25, 30), (40, 10)), size=(250, 200)):
    """The scene's films in windows, their corners as a table, and the clicks of the first frame in the windows."""
    for camera, (x, y) in zip(scene.cameras, corners, strict=True):
        (folder / "films" / camera.name).mkdir(parents=True)
        for path in sorted((scene.folder / "films" / camera.name).iterdir()):
            picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
            cv2.imwrite(str(folder / "films" / camera.name / path.name), picture[y : y + size[1], x : x + size[0]])
    rows = [f"{camera.name},{x},{y}" for camera, (x, y) in zip(scene.cameras, corners, strict=True)]
    (folder / "crop.csv").write_text("\n".join(["camera,x,y", *rows]) + "\n")
    clicks = [replace(k, uv_px=tuple(np.subtract(k.uv_px, corners[k.camera]))) for k in scene.clicks()]
    return clicks, np.array(corners, dtype=float)


@pytest.mark.rare
def test_windows_of_the_pictures_give_the_same_positions(scene, result, tmp_path):
    """Named pixels are those of the whole pictures less the corners, and the calibration that is written is theirs."""
    clicks, corners = cropped(scene, tmp_path)
    found = digitise(tmp_path / "films", start=clicks, crop=tmp_path / "crop.csv", **scene.arguments)
    moved = found.pixels.uv_px + corners[:, None, None] - result.pixels.uv_px
    inside = np.isfinite(moved[..., 0])
    assert inside.sum() > 0.97 * result.pixels.seen.sum()
    assert np.abs(moved[inside]).max() < 0.01
    found.save(tmp_path / "out")
    again = digitise(
        tmp_path / "films", start=clicks, **{**scene.arguments, "calibration": tmp_path / "out" / "calibration.toml"}
    )
    np.testing.assert_allclose(again.points.xyz_m, found.points.xyz_m, atol=1e-5)


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ("camera,x,y\ncam1,1,2\ncam2,3,4\n", "one for each camera"),
        ("camera,x,y\ncam1,30,20\ncam2,25,30\ncam3,90,10\n", "cam3, 250 x 200 px at .90, 10., is not inside"),
    ],
)
def test_windows_that_cannot_be_are_refused(scene, tmp_path, table, said):
    clicks, _ = cropped(scene, tmp_path)
    (tmp_path / "crop.csv").write_text(table)
    with pytest.raises(MocapError, match=said):
        digitise(tmp_path / "films", start=clicks, crop=tmp_path / "crop.csv", **scene.arguments)
    with pytest.raises(MocapError, match="give `crop`"):
        digitise(tmp_path / "films", start=clicks, **scene.arguments)


def test_a_window_that_moves_is_refused(scene, tmp_path):
    clicks, _ = cropped(scene, tmp_path)
    for camera in scene.cameras:
        (tmp_path / f"{camera.name}.csv").write_text("x,y\n10,20\n11,20\n")
    files = [tmp_path / f"{camera.name}.csv" for camera in scene.cameras]
    with pytest.raises(MocapError, match="window of cam1 moves"):
        digitise(tmp_path / "films", start=clicks, crop=files, **scene.arguments)


def test_dots_are_looked_for_where_a_lost_marker_may_be(result):
    """A tail that is known to 0.1 m, 60 mm away from the others: each window reaches 40 px about its place."""
    engine = deepcopy(result).engine
    state = unpacked(engine.tracks.forward[20])
    tail = NAMES.index("tail")
    state.mean[tail, :3] += [0.0, 0.0, -0.06]
    state.cov[tail, :3, :3] = 0.01 * np.eye(3)
    uv = _ideal(engine.cameras, state.mean[tail, :3])
    for camera, window, ideal in zip(engine.cameras, engine._windows(state), uv, strict=True):
        at = camera.lens.distort(ideal)
        left, top, right, bottom = window
        width, height = camera.size_px
        assert left <= max(at[0] - 40, 0)
        assert right >= min(at[0] + 40, width)
        assert top <= max(at[1] - 40, 0)
        assert bottom >= min(at[1] + 40, height)
