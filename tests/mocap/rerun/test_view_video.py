"""Films under the tracks: each disc that was filmed is seen where its marker's ideal pixel is."""

import os
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from flapping import SIZE_PX, make_run
from readback import column
from test_view_pictures import SHIFT_PX, loaded, share_found, tile

from mocap.cameras.camera import project, stacked
from mocap.cameras.lens import BrownLens
from mocap.errors import MocapError
from mocap.io.movies import FIRST_PIXEL, open_movie, open_movies
from mocap.rerun import paths
from mocap.rerun.footage import footage
from mocap.rerun.log_video import av1, coded_size, not_in_real_time, offsets_of, with_footage
from mocap.rerun.record import write_recording
from mocap.tracking.report_part import Report

N_FRAMES, SEEN = 24, 17
GRID = np.mgrid[: SIZE_PX[1], : SIZE_PX[0]]
DARK = np.full((48, 64, 3), 40, dtype=np.uint8)
"""A small picture without a disc."""
MAGENTA = (230, 20, 230)
LENS = BrownLens(f_px=(1100.0, 1100.0), centre_px=(150.0, 120.0), k=(-0.35, 0.1, 0.0), p=(0.002, -0.001))


def bent_run(**options):
    """A run of two cameras with a lens, whose tracked motion is the truth."""
    run = make_run(n_frames=N_FRAMES, n_cameras=2, n_joints=0, **options)
    return replace(run, cameras=tuple(replace(c, lens=LENS) for c in run.cameras))


def discs(uv_px):
    """(H, W, 3) what is filmed when markers are at recorded pixels (M, 2), rows downwards, counted from 1."""
    picture = np.full((SIZE_PX[1], SIZE_PX[0], 3), 40, dtype=np.uint8)
    for u, v in uv_px - FIRST_PIXEL:
        near = np.s_[max(0, int(v) - 9) : int(v) + 10, max(0, int(u) - 9) : int(u) + 10]
        rows, columns = (grid[near] for grid in GRID)
        picture[near][(columns - u) ** 2 + (rows - v) ** 2 < 8**2] = MAGENTA
    return picture


def film(path, pictures, coder):
    """Write a movie, or a folder of PNGs."""
    if coder == "png":
        path.mkdir()
        for k, picture in enumerate(pictures):
            with av.open(str(path / f"shot{k + 8}.png"), "w", format="image2") as one:
                _encode(one, "png", [picture], "rgb24")
        return
    with av.open(str(path), "w") as container, not_in_real_time():
        _encode(container, coder, pictures, "yuv420p")


def _encode(container, coder, pictures, pix_fmt):
    height, width = pictures[0].shape[:2]
    stream = container.add_stream(coder, rate=30, width=width, height=height, pix_fmt=pix_fmt)
    stream.time_base = Fraction(1, 30)
    stream.bit_rate = 40_000_000
    for picture in pictures:
        container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
    container.mux(stream.encode(None))


def filmed(run, folder, coder, *, lead=0, bent=True):
    """The movie of the run's second camera, ``lead`` frames ahead of the tracks."""
    ideal = project(stacked(run.cameras), run.xyz_m)[1][:, :-1]
    if run.y_up:  # DLTdv's lower left: the lowest row is 1
        ideal = ideal * (1, -1) + (0, SIZE_PX[1] + 1)
    recorded = LENS.distort(ideal) if bent else ideal
    path = folder / ("film" if coder == "png" else "film.mp4")
    film(path, [discs(recorded[0])] * lead + [discs(uv) for uv in recorded], coder)
    return ideal, path


@pytest.mark.parametrize(("coder", "y_up", "lead"), [("mpeg4", False, 5), ("png", True, 0)])
def test_a_bent_film_lies_under_the_ideal_pixels(viewer, tmp_path, coder, y_up, lead):
    """Straightened and shifted as stated, every disc is where the marker's ideal pixel is, and nowhere else.

    Unstraightened, or a few frames off, a movie is not: the film is bent by tens of pixels, and wings beat.
    """
    run = bent_run(y_up=y_up)
    ideal, path = filmed(run, tmp_path, coder, lead=lead)
    movies = open_movies([path, path])
    assert movies[0].n_frames == N_FRAMES + lead
    view = {
        "right": {"offsets": (np.array([[lead]]), "as stated")},
        "bent": {"offsets": (np.array([[lead]]), "as stated"), "straight": True},
        "late": {"offsets": (np.array([[lead - 5]]), "as stated")},
    }
    found = {}
    for name, options in view.items() if coder == "mpeg4" else [("right", view["right"])]:
        folder = tmp_path / name
        folder.mkdir()
        shown = loaded(viewer, with_footage(run, movies, **options), folder)
        picture = viewer.picture(tile(shown, "cam2", f"{paths.image('cam2')}/video"), frame=SEEN)
        found[name] = share_found(picture, ideal[SEEN], MAGENTA)
        if name == "right":
            assert share_found(picture, ideal[SEEN] + 2 * SHIFT_PX, MAGENTA) < 0.5
    assert found.pop("right") == 1.0
    assert all(share < 0.7 for share in found.values()), found


@pytest.mark.skipif(not hasattr(os, "sched_getscheduler"), reason="Linux alone schedules so")
def test_coding_a_film_leaves_no_thread_in_real_time():
    """Run by root, the coder gives itself and its caller real-time priority, which what they start inherits."""
    pictures = (av.VideoFrame(64, 64, "yuv420p") for _ in range(6))
    policies = set()
    for _ in av1(pictures, (64, 64)):
        for task in Path("/proc/self/task").iterdir():
            with suppress(ProcessLookupError):
                policies.add(os.sched_getscheduler(int(task.name)))
    assert policies == {os.SCHED_OTHER}
    assert os.sched_getscheduler(0) == os.SCHED_OTHER


def test_an_av1_film_is_taken_as_it_is(viewer, tmp_path):
    """Its bytes are in the recording; its frames are shown at those of the tracks; none where it has none."""
    run = make_run(n_frames=N_FRAMES, n_cameras=2, n_joints=0)
    ideal, path = filmed(run, tmp_path, "libsvtav1", bent=False)
    shown = with_footage(run, open_movies([path, path]), offsets=(np.array([[-4]]), "as stated"))
    assert "20 have no image" not in shown.report_text
    assert "4 frames have no image" in shown.report_text
    shown = loaded(viewer, shown, tmp_path)
    entity = f"{paths.image('cam2')}/video"
    blob = column(tmp_path / "recording.rrd", entity, "AssetVideo:blob")[2]
    assert bytes(blob.astype(np.uint8)) == path.read_bytes()
    assert column(tmp_path / "recording.rrd", entity, "VideoFrameReference:timestamp")[1].tolist() == [0] * 4 + [1] * 20
    picture = viewer.picture(tile(shown, "cam2", entity), frame=SEEN)
    assert share_found(picture, ideal[SEEN - 4], MAGENTA) == 1.0
    hidden = viewer.picture(tile(shown, "cam2", entity, hidden=(entity,)), frame=SEEN)
    assert share_found(hidden, ideal[SEEN - 4], MAGENTA) == 0.0


def test_frames_are_found_by_number(tmp_path):
    """Any increasing frames of a movie, with seeks over key frames, are those that were written; others are None."""
    level = (10 * np.arange(24)).astype(np.uint8)
    pictures = [np.full_like(DARK, v) for v in level]
    for name, coder in (("a.mp4", "mpeg4"), ("folder", "png")):
        film(tmp_path / name, pictures, coder)
        movie = open_movie(tmp_path / name)
        wanted = np.array([-1, 13, 14, 14, 20, 23, 24])
        got = [None if f is None else int(f.to_ndarray(format="rgb24")[5, 5, 0]) for f in movie.frames(wanted)]
        assert got[0] is None
        assert got[-1] is None
        np.testing.assert_allclose(np.array(got[1:-1], dtype=float), level[wanted[1:-1]], atol=3)  # coding


def test_offsets_come_from_the_user_or_the_file_beside(tmp_path):
    """What is stated goes before the offsets file; without either they are 0."""
    tracks = tmp_path / "t_xypts.csv"
    assert offsets_of(tracks, None)[0].tolist() == [[0.0]]
    (tmp_path / "t_offsets.csv").write_text("cam1_offset,cam2_offset\n0,7\n0,7\n")
    assert offsets_of(tracks, None)[0].tolist() == [[0, 7], [0, 7]]
    assert offsets_of(tracks, [3])[0].tolist() == [[3.0]]


def test_movies_that_do_not_fit_are_refused(tmp_path):
    """Too few, of another size, no movie, nothing: one line each that says what to give."""
    run = make_run(n_frames=4, n_cameras=2, n_joints=0)
    film(tmp_path / "a.mp4", [discs(np.zeros((0, 2)))] * 4, "mpeg4")
    movie = open_movie(tmp_path / "a.mp4")
    zero = (np.zeros((1, 1)), "")
    with pytest.raises(MocapError, match=r"1 movies .a.mp4. for 2 cameras: give one for each camera"):
        with_footage(run, [movie], offsets=zero)
    with pytest.raises(MocapError, match="3 for 4 frames of 2 cameras"):
        with_footage(run, [movie, movie], offsets=(np.zeros((1, 3)), ""))
    with pytest.raises(MocapError, match=r"a.mp4 is 640 x 800, but camera cam1 is 1280 x 800"):
        with_footage(run, [replace(movie, size_px=(640, 800)), movie], offsets=zero)
    (tmp_path / "b.mp4").write_text("no movie")
    (tmp_path / "empty").mkdir()
    for path, words in (("b.mp4", "convert it"), ("empty", "contains no images"), ("none.mp4", "no such movie")):
        with pytest.raises(MocapError, match=words):
            open_movie(tmp_path / path)


def test_coded_pictures_are_even_and_no_larger_than_shown():
    assert coded_size((1281, 801)) == (1280, 800)
    assert coded_size((4096, 2160)) == (1280, 676)
    assert coded_size((639, 33)) == (640, 64)


def test_a_folder_of_movies_is_sorted_by_number(tmp_path):
    """cam10 comes after cam2; a folder of pictures is one movie."""
    for name in ("cam10.mp4", "cam2.mp4"):
        film(tmp_path / name, [DARK] * 2, "mpeg4")
    assert [m.path.name for m in open_movies([tmp_path])] == ["cam2.mp4", "cam10.mp4"]
    film(tmp_path / "cam3", [DARK] * 2, "png")
    assert [m.path.name for m in open_movies([tmp_path])] == ["cam2.mp4", "cam3", "cam10.mp4"]
    assert [m.n_frames for m in open_movies([tmp_path / "cam3"])] == [2]


def test_no_more_than_a_frame_is_decoded_ahead(tmp_path):
    """Whoever takes one frame of a folder has one picture read: the others may be absent."""
    film(tmp_path / "shots", [DARK] * 3, "png")
    movie = open_movie(tmp_path / "shots")
    for path in movie.pictures[1:]:
        path.unlink()
    assert next(movie.frames(np.arange(3))) is not None


def test_recordings_of_films_are_written_without_lens_too(tmp_path):
    """A run without a lens, whose camera size nothing states, takes that of the movie."""
    run = make_run(n_frames=4, n_cameras=2, n_joints=0)
    run = replace(run, cameras=tuple(replace(c, size_px=None) for c in run.cameras))
    film(tmp_path / "a.mp4", [discs(np.zeros((0, 2)))] * 4, "mpeg4")
    movies = open_movies([tmp_path / "a.mp4"] * 2)
    shown = with_footage(run, movies, offsets=(np.zeros((1, 1)), "not stated"))
    assert [c.size_px for c in shown.cameras] == [SIZE_PX] * 2
    write_recording(shown, tmp_path / "r.rrd")
    assert len(column(tmp_path / "r.rrd", f"{paths.image('cam1')}/video", "VideoStream:sample")[0]) == 4


def test_films_that_started_apart_are_shown_in_step(tmp_path):
    """A lag that was taken out of the tracks is taken out of the films: frame t of the tracks is t - late of a film."""
    run = bent_run()
    run = replace(run, cameras=tuple(replace(camera, size_px=None) for camera in run.cameras))
    for name in ("a", "b"):
        film(tmp_path / name, [DARK] * N_FRAMES, "png")
    movies = open_movies([tmp_path / "a", tmp_path / "b"])
    shown = with_footage(
        run.with_part(Report(numbers={**run.report, "late_frames": [0.2, -7.4]}, text="")),
        movies,
        offsets=offsets_of(None, [3]),
    )
    first = [int(one.frames[0]) for one in footage(shown)]
    assert first == [3, 10]  # 3 - 0.2 and 3 + 7.4, to the frame
    assert "lag that was corrected" in shown.report["video"][1]
    assert footage(shown)[1].there.sum() == N_FRAMES - 10
