"""Occlusion against one ray at a time."""

import numpy as np
import pytest
from mocap.datasets.linkage import turn
from mocap.datasets.occlusion import Solid, hidden_by_grazing, hidden_by_solid, hidden_by_triangles, occluded
from mocap.datasets.rig import tunnel_cameras

from mocap.cameras.camera import decompose


def ray_hits_triangle(eye, marker, corners, clearance_m):
    """Solve eye + depth ray = corner + u e1 + v e2 for one ray."""
    ray = marker - eye
    columns = np.column_stack([ray, corners[0] - corners[1], corners[0] - corners[2]])
    depth, u, v = np.linalg.solve(columns, corners[0] - eye)
    return u >= 0 and v >= 0 and u + v <= 1 and depth > 0 and (1 - depth) * np.linalg.norm(ray) > clearance_m


def ray_enters_solid(eye, marker, centre, rotation, semi_axes, clearance_m):
    """Roots of the quadratic through three values of |(point - centre) / semi-axes|^2 - 1 along one ray."""
    ray = marker - eye

    def outside(depth):
        return np.sum((rotation.T @ (eye + depth * ray - centre) / semi_axes) ** 2) - 1

    roots = np.roots(np.polyfit([0.0, 1.0, 2.0], [outside(0), outside(1), outside(2)], 2))
    if abs(roots.imag).max() > 0:
        return False
    entry = roots.real.min()
    return 0 < entry < 1 - clearance_m / np.linalg.norm(ray)


def test_against_single_rays():
    """Random markers, triangles among them and two ellipsoids: every ray decided as when it is alone."""
    rng = np.random.default_rng(5)
    n_frames, n_markers, clearance_m = 6, 12, 0.01
    xyz_m = rng.normal(scale=0.12, size=(n_frames, n_markers, 3))
    triangles = np.array([rng.choice(n_markers, 3, replace=False) for _ in range(9)])
    solids = [
        Solid(
            centre_m=rng.normal(scale=0.05, size=(n_frames, 3)),
            rotation=turn(0, rng.uniform(0, 6, n_frames)) @ turn(2, rng.uniform(0, 6, n_frames)),
            semi_axes_m=np.array([0.08, 0.03, 0.05]),
        )
        for _ in range(2)
    ]
    cameras = tunnel_cameras(5)
    got = occluded(cameras, xyz_m, triangles=triangles, solids=solids, clearance_m=clearance_m)
    expected = np.zeros_like(got)
    for c, camera in enumerate(cameras):
        eye = decompose(camera).position_m
        for t in range(n_frames):
            for m in range(n_markers):
                expected[c, t, m] = any(
                    ray_hits_triangle(eye, xyz_m[t, m], xyz_m[t, corners], clearance_m)
                    for corners in triangles
                    if m not in corners
                ) or any(
                    ray_enters_solid(eye, xyz_m[t, m], s.centre_m[t], s.rotation[t], s.semi_axes_m, clearance_m)
                    for s in solids
                )
    assert 0.2 < expected.mean() < 0.9
    np.testing.assert_array_equal(got, expected)


@pytest.mark.parametrize(("z_m", "hidden"), [(0.5, True), (-0.5, False), (2.5, False)])
def test_a_triangle_hides_only_between_eye_and_marker(z_m, hidden):
    corners = np.array([[-1, -1, z_m], [1, -1, z_m], [0, 2, z_m]])
    xyz_m = np.concatenate([corners, [[0, 0, 0]]])[None]
    got = hidden_by_triangles(np.array([0, 0, 2.0]), xyz_m, np.array([[0, 1, 2]]), clearance_m=0.01)
    np.testing.assert_array_equal(got, [[False, False, False, hidden]])


def test_a_triangle_never_hides_its_own_corners():
    """Rays to corners meet the triangle at depth 1 to rounding, on either side: with no clearance none may count."""
    xyz_m = np.random.default_rng(8).normal(size=(500, 3, 3))
    assert not hidden_by_triangles(np.array([0.1, 0.2, 9.0]), xyz_m, np.array([[0, 1, 2]]), clearance_m=0).any()


def test_clearance_keeps_markers_on_the_surface_visible():
    """A marker 2 mm under the near side of a ball of 50 mm is visible at 3 mm clearance, at 1 mm it is not."""
    ball = Solid(centre_m=np.zeros((1, 3)), rotation=np.eye(3)[None], semi_axes_m=np.full(3, 0.05))
    eye, xyz_m = np.array([0, 0, 1.0]), np.array([[[0, 0, 0.048], [0, 0, -0.05]]])
    assert hidden_by_solid(eye, xyz_m, ball, clearance_m=0.003).tolist() == [[False, True]]
    assert hidden_by_solid(eye, xyz_m, ball, clearance_m=0.001).tolist() == [[True, True]]


def test_a_rod_is_an_ellipsoid_with_an_infinite_axis():
    rod = Solid(centre_m=np.zeros((1, 3)), rotation=np.eye(3)[None], semi_axes_m=np.array([np.inf, 0.01, 0.01]))
    eye = np.array([0.2, 0, 1.0])
    xyz_m = np.array([[[50.0, 0, -0.02], [50.0, 0, 0.02], [0.2, 0.05, -0.02], [0.2, 0.005, -0.02]]])
    assert hidden_by_solid(eye, xyz_m, rod, clearance_m=0.001).tolist() == [[True, False, False, True]]


def test_no_triangles_hide_nothing():
    got = hidden_by_triangles(np.zeros(3), np.ones((2, 4, 3)), np.empty((0, 3), dtype=int), clearance_m=0.001)
    assert got.shape == (2, 4)
    assert not got.any()


def test_a_membrane_seen_from_its_edge_hides_its_own_markers_only():
    """The angle between ray and membrane, one marker at a time; a lone marker has none."""
    rng = np.random.default_rng(3)
    xyz_m, eye = rng.normal(size=(40, 6, 3)), np.array([0.3, -0.2, 5.0])
    triangles = np.array([[0, 1, 2], [1, 2, 3], [2, 3, 4]])
    got = hidden_by_grazing(eye, xyz_m, triangles, least_rad=np.deg2rad(20))
    for t in range(40):
        for m in range(6):
            normals = [
                np.cross(xyz_m[t, b] - xyz_m[t, a], xyz_m[t, c] - xyz_m[t, a])
                for a, b, c in triangles
                if m in (a, b, c)
            ]
            ray = (xyz_m[t, m] - eye) / np.linalg.norm(xyz_m[t, m] - eye)
            normal = np.sum(normals, axis=0) if normals else None
            angle = 90.0 if normal is None else np.degrees(np.arcsin(abs(ray @ normal) / np.linalg.norm(normal)))
            assert got[t, m] == (angle < 20)
    assert not got[:, 5].any()
    assert 0.1 < got[:, :5].mean() < 0.6
