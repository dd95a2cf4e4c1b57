"""Movies of the twins: a spot of light at every marker that is seen, where the files of pixels say it is."""

import numpy as np
import pytest
from mocap.datasets.bats import bat_motion
from mocap.datasets.disturbances import Disturbances
from mocap.datasets.film import view
from mocap.datasets.lizards import SLOPE_RAD, lizard_motion
from mocap.datasets.movie import picture, write_movies
from mocap.datasets.rig import tank_cameras, tunnel_cameras
from scipy.ndimage import label

from mocap.io.movies import FIRST_PIXEL, open_movie

SCENES = {
    "bat": (bat_motion(1), tunnel_cameras(2)),
    "lizard": (lizard_motion(1), tank_cameras(2, slope_rad=SLOPE_RAD)),
}


def spots(grey):
    """(N, 2) centroids (u, v) of what is brighter than any bone, as files of pixels count, and their areas."""
    marks, count = label(grey > 185)
    weight = np.maximum(grey - 135.0, 0)
    v, u = np.mgrid[: grey.shape[0], : grey.shape[1]]
    sums = [np.bincount(marks.ravel(), (weight * x).ravel(), count + 1)[1:] for x in (u, v, np.ones_like(u))]
    return np.stack(sums[:2], axis=1) / sums[2][:, None] + FIRST_PIXEL, np.bincount(marks.ravel())[1:]


@pytest.mark.parametrize("animal", SCENES)
def test_a_spot_at_every_seen_marker_and_no_other(animal):
    """Spots that do not touch another lie at their markers, without bias; no spot is where no marker is seen."""
    motion, cameras = SCENES[animal]
    scene = motion(np.linspace(0.1, 0.4, 4))
    misses = []
    for camera in cameras:
        uv_px, hidden = view(scene, camera)
        for frame in range(4):
            found, area = spots(picture(scene, camera, frame, uv_px[frame], hidden[frame]))
            seen = uv_px[frame, ~hidden[frame]]
            away = found[:, None] - seen
            # nearer than two radii spots merge, and their centroid lies between
            assert np.linalg.norm(away, axis=-1).min(axis=1).max() < 6
            assert abs(np.median(area) - np.pi * 3**2) < 8
            apart = np.sort(np.linalg.norm(seen[:, None] - seen, axis=-1), axis=1)[:, 1] > 12
            nearest = np.linalg.norm(away, axis=-1).argmin(axis=0)
            misses.append(away[nearest, np.arange(len(seen))][apart])
    miss = np.concatenate(misses)
    assert len(miss) > 80
    # discs in sixteenths of a pixel and whole grey levels, on bones of which the centroid takes a part: 0.12 px each;
    # one pixel of shift, of which files and pictures may disagree, would be twenty times the bound
    assert np.abs(miss.mean(axis=0)).max() < 0.05
    assert miss.std() < 0.2


def test_a_movie_is_its_pictures(tmp_path):
    """Read back by the reader of movies: size, number, and grey levels but for noise and coding."""
    motion, cameras = SCENES["lizard"]
    t_s = np.arange(4) / 250
    paths = write_movies(
        motion, t_s, cameras[:1], tmp_path, fps=250, start_s=np.array([0.002]), disturbances=Disturbances(noise=1.0)
    )
    movie = open_movie(paths[0])
    assert (movie.n_frames, movie.size_px) == (4, (1024, 1024))
    scene = motion(t_s + 0.002)
    uv_px, hidden = view(scene, cameras[0])
    for frame, got in enumerate(movie.frames(np.arange(4))):
        expected = picture(scene, cameras[0], frame, uv_px[frame], hidden[frame])
        difference = got.to_ndarray(format="gray").astype(float) - expected
        assert abs(difference.mean()) < 1.5
        assert difference.std() < 4
