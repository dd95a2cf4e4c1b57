"""Films of each kind through the command line, as a new user types it, against what they were drawn from."""

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from mocap.cli.main import app
from mocap.digitising.clicks import write_clicks
from mocap.io.format import Hints
from mocap.io.movies import pyav
from mocap.io.registry import read
from tests.mocap.digitising.filmed import NAMES, SIZE, video

N_FRAMES = 20
KINDS = {
    "h264": ("libx264", "yuv420p", ".mp4", 1, 0.2),
    "mjpeg": ("mjpeg", "yuvj420p", ".avi", 1, 0.3),
    "16 bits": ("ffv1", "gray16le", ".mkv", 257, 0.15),
    "12 bits": ("ffv1", "gray12le", ".mkv", 16, 0.15),
    "12 bits in 16": ("ffv1", "gray16le", ".mkv", 16, 0.15),
    "tiff of 12 bits in 16": (None, "", ".tif", 16, 0.15),
}


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    folder = tmp_path_factory.mktemp("kinds")
    made = video(folder, N_FRAMES)
    names = [camera.name for camera in made.cameras]
    write_clicks(folder / "start.csv", made.clicks(), names=NAMES, cameras=names, n_frames=N_FRAMES, fps=100.0)
    return made


def copied(scene, folder, kind):
    """The scene's films, of another kind."""
    codec, pixels, ending, factor, _ = KINDS[kind]
    for camera in scene.cameras:
        paths = sorted((scene.folder / "films" / camera.name).iterdir())
        pictures = [cv2.imread(str(path), cv2.IMREAD_UNCHANGED) for path in paths]
        if factor > 1:
            pictures = [picture.astype(np.uint16) * factor for picture in pictures]
        if codec is None:
            (folder / camera.name).mkdir(parents=True)
            for path, picture in zip(paths, pictures, strict=True):
                cv2.imwrite(str(folder / camera.name / f"{path.stem}{ending}"), picture)
            continue
        library = pyav()
        folder.mkdir(exist_ok=True)
        with library.open(str(folder / f"{camera.name}{ending}"), "w") as container:
            stream = container.add_stream(codec, rate=100)
            (stream.width, stream.height), stream.pix_fmt = SIZE, pixels
            for picture in pictures:
                frame = library.VideoFrame.from_ndarray(picture, format=pixels if factor > 1 else "gray")
                container.mux(stream.encode(frame.reformat(format=pixels)))
            container.mux(stream.encode())


@pytest.mark.parametrize("kind", list(KINDS))
def test_films_of_every_kind(scene, tmp_path, kind):
    """97 % of what is shown is named, none wrong, to a root mean square that the kind's noise allows.

    Lossless ones as the pictures themselves (0.07 px); the blocks of H.264 and MJPEG add to it.
    """
    copied(scene, tmp_path / "films", kind)
    options = {
        "--calibration": "calibration.toml",
        "--skeleton": "skeleton.toml",
        "--start": "start.csv",
    }
    typed = [text for option, file in options.items() for text in (option, str(scene.folder / file))]
    out = tmp_path / "out"
    done = CliRunner().invoke(app, ["digitise", str(tmp_path / "films"), *typed, "--fps", "100", "--out", str(out)])
    assert done.exit_code == 0, done.output
    pixels = read(out / "xypts.csv", Hints(cameras=3)).pixels
    away = np.linalg.norm(pixels.uv_px - scene.uv_px, axis=-1)
    assert pixels.seen.mean() > 0.95
    assert np.nanmax(away) < 2
    assert np.sqrt(np.nanmean(away**2)) < KINDS[kind][4]
