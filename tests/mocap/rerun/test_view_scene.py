"""The scene and its cameras, without a viewer."""

from dataclasses import replace

import numpy as np
import pytest
from flapping import SIZE_PX, flight_m, ring

from mocap.cameras.camera import Camera, project, stacked
from mocap.rerun.scene import image_size_px, make_scene

# a projection of coordinates near 1 m to pixels near 1000 loses some 1e3 * 1e-16 * (condition 1e3) px
TOLERANCE_PX = 1e-9


@pytest.mark.parametrize("handed", [1.0, -1.0])
@pytest.mark.parametrize("y_up", [False, True])
@pytest.mark.parametrize("skew", [0.0, 25.0])
@pytest.mark.parametrize("scale", [1.0, -3.0])
def test_points_of_the_scene_fall_on_the_pixels_of_the_view(handed, y_up, skew, scale):
    """A pinhole with a proper pose sees the scene's points where the recording's camera sees the world's."""
    cameras = tuple(replace(c, matrix=c.matrix * scale) for c in ring(5, handed=handed, y_up=y_up, skew=skew))
    xyz = flight_m(np.linspace(0, 0.5, 7)) * (handed, 1, 1)
    scene = make_scene(cameras, xyz_m=xyz, uv_px=None, y_up=y_up)
    pixels = project(stacked(cameras), xyz)
    for camera, uv in zip(scene.cameras, pixels, strict=True):
        inside = np.linalg.solve(camera.world_from_camera, (scene.points(xyz) - camera.position_m)[..., None])[..., 0]
        homogeneous = inside @ camera.intrinsic.T
        assert (inside[..., 2] > 0).all()
        np.testing.assert_allclose(homogeneous[..., :2] / homogeneous[..., 2:], camera.pixels(uv), atol=TOLERANCE_PX)
        assert np.linalg.det(camera.world_from_camera) > 0
        assert camera.is_rigid == (skew == 0)
        assert camera.intrinsic[0, 1] == 0
        assert (camera.pixel_signs == (1, -1 if y_up else 1)).all()
    assert scene.signs.prod() == handed
    np.testing.assert_array_equal(scene.up, (0, 0, 1))


def test_a_camera_that_looks_into_a_mirror_is_turned_on_its_own():
    """One reflection among proper cameras turns that camera's u, not the world."""
    cameras = list(ring(4))
    mirror = np.array([[-1, 0, SIZE_PX[0]], [0, 1, 0], [0, 0, 1.0]])
    cameras[2] = replace(cameras[2], matrix=mirror @ cameras[2].matrix)
    scene = make_scene(cameras, xyz_m=flight_m(np.zeros(1)), uv_px=None, y_up=False)
    assert (scene.signs == 1).all()
    assert [tuple(c.pixel_signs) for c in scene.cameras] == [(1, 1), (1, 1), (-1, 1), (1, 1)]


def test_up_is_where_the_images_say():
    """Cameras that are turned so that y points up make a scene with y up; its ground is below the motion."""
    turn = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0.0]])  # z to y
    turn_back = np.block([[turn.T, np.zeros((3, 1))], [0, 0, 0, 1]])
    cameras = [Camera(name=c.name, matrix=c.matrix @ turn_back) for c in ring(4)]
    scene = make_scene(cameras, xyz_m=flight_m(np.linspace(0, 1, 9)) @ turn.T, uv_px=None, y_up=False)
    np.testing.assert_array_equal(scene.up, (0, 1, 0))
    assert scene.ground_m < (flight_m(np.linspace(0, 1, 9)) @ turn.T)[..., 1].min()


@pytest.mark.parametrize("n_points", [0, 1])
def test_next_to_nothing_still_makes_a_scene(n_points):
    """No cameras, and no or one position: a ball of a millimetre."""
    scene = make_scene((), xyz_m=np.full((1, n_points, 3), 0.25), uv_px=None, y_up=False)
    assert scene.radius_m == 1e-3
    assert np.isfinite(scene.centre_m).all()


def test_image_size_holds_the_pixels_and_does_not_believe_an_absurd_principal_point():
    """Without a known size: twice the principal point, no less than the tracks need, and no twelve times as much."""
    camera = replace(ring(1)[0], size_px=None)
    np.testing.assert_array_equal(image_size_px(camera, None), (1300, 770))
    uv_px = np.array([[100.0, 100.0], [np.nan, np.nan], [1200.0, 1000.0]])
    assert (image_size_px(camera, uv_px) >= (1300, 1000)).all()
    far = replace(camera, matrix=np.array([[1, 0, 8000], [0, 1, 0], [0, 0, 1.0]]) @ camera.matrix)
    assert image_size_px(far, uv_px)[0] < 2000
    assert image_size_px(replace(camera, size_px=(640, 480)), uv_px).tolist() == [640, 480]
