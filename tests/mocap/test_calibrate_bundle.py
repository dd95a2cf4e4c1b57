"""Bundle adjustment against finite differences, SciPy, and scenes whose truth is known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse
from scipy.optimize import least_squares

from mocap.calibration.bundle import _Problem, adjust, minimise
from mocap.calibration.scene import (
    Free,
    KnownLengths,
    RigScene,
    Sightings,
    in_world,
    rig_camera,
    similarity,
    turn,
    upside_down,
)
from mocap.cameras.camera import Camera, dlt_camera, dlt_coefficients, record
from mocap.cameras.lens import BrownLens, FisheyeLens, RationalLens
from tests.mocap.board_scenes import BOARD, poses, rig
from tests.mocap.rigs import cloud, ring

LENSES = [
    BrownLens.of((1200.0, 1212.0), (645.0, 505.0), (-0.2, 0.08, 1e-3, -5e-4, 0.01)),
    RationalLens.of((1200.0, 1212.0), (645.0, 505.0), (0.5, 0.1, 1e-3, -5e-4, 0.01, 0.7, 0.2, 0.01)),
    FisheyeLens.of((1200.0, 1212.0), (645.0, 505.0), (-0.03, 0.01, -0.005, 0.001)),
]


def point_scene(rng, cameras, n=12):
    """Points that all cameras see, with exact pixels."""
    points = cloud(rng, n)
    camera, point = np.divmod(np.arange(len(cameras) * n), n)
    uv = np.concatenate([c.record(points) for c in cameras])
    seen = Sightings(camera=camera, body=point, local_m=np.zeros((len(camera), 3)), uv_px=uv)
    return RigScene(cameras=cameras, rotation=np.broadcast_to(np.eye(3), (n, 3, 3)), position_m=points), seen


@pytest.mark.parametrize("lens", LENSES, ids=lambda lens: lens.model)
@pytest.mark.parametrize("focal", ["none", "one", "two"])
def test_normal_equations_are_those_of_the_residuals(lens, focal):
    """Central differences along every unknown: boards' and cameras' poses, lens, lengths, with a sheared camera.

    The third camera shows one board, and sightings come in no order. Steps move pixels by 1e-3: differences err by
    rounding of 1e-10 / 1e-3, and less by their third order; lengths (sd 1 cm) move by as many deviations.
    """
    rng = np.random.default_rng(4)
    cameras = rig(3, lens)
    cameras = (*cameras[:2], replace(cameras[2], shear=0.01))
    boards = poses(rng, cameras[0], 3)
    local = np.tile(BOARD.points()[::7], (3, 1))
    body = np.repeat(np.arange(3), len(local) // 3)
    n = len(local)
    camera, mixed = np.repeat(np.arange(3), n), rng.permutation(3 * n)
    mixed = mixed[(camera[mixed] < 2) | (np.tile(body, 3)[mixed] == 1)]
    seen = Sightings(
        camera=camera[mixed],
        body=np.tile(body, 3)[mixed],
        local_m=np.tile(local, (3, 1))[mixed],
        uv_px=np.zeros((len(mixed), 2)),
    )
    rotation, position = np.stack([b[:3, :3] for b in boards]), np.stack([b[:3, 3] for b in boards])
    scene = RigScene(cameras=cameras, rotation=rotation, position_m=position)
    lengths = KnownLengths(
        first=np.array([0, 2]), second=np.array([1, 1]), length_m=np.full(2, 0.3), sd_m=np.full(2, 0.01)
    )
    free = Free(focal=focal, coefficients=((True,) * lens.n_coefficients,) * 3, orientation=True, fixed=1)
    problem = _Problem(scene, seen, free, lengths)

    def residuals(step):
        return problem.residuals(problem.retract(scene, step), 0.5)

    n = len(problem.groups)
    weight, error = rng.uniform(0.1, 1, len(mixed) + 2)[problem.groups], rng.normal(size=n)
    found, gradient = problem.normal(scene, 0.5, weight, error)
    step = 1e-3 * np.sqrt(n / found.diagonal())
    slopes = np.stack([residuals(one) - residuals(-one) for one in np.diag(step)], axis=1) / (2 * step)
    length = np.sqrt(weight @ slopes**2)
    expected = slopes.T @ (weight[:, None] * slopes) / np.outer(length, length)
    np.testing.assert_allclose(found.toarray() / np.outer(length, length), expected, rtol=0, atol=1e-6)
    np.testing.assert_allclose(gradient / length, slopes.T @ (weight * error) / length, rtol=0, atol=1e-5)


def test_levenberg_finds_scipys_minimum():
    """Rosenbrock's valley as least squares, plain and with Cauchy's loss: the minimum of SciPy's solver."""
    rng = np.random.default_rng(2)
    t = np.linspace(0, 1, 40)
    y = 2 * np.exp(-3 * t) + 0.01 * rng.normal(size=40)
    y[::9] += 3.0  # outliers

    def residuals(p):
        return (p[0] * np.exp(-p[1] * t) - y) / 0.01

    def normal(p, weight, error):
        e = np.exp(-p[1] * t)
        by_p = np.stack([e, -p[0] * t * e], axis=1) / 0.01
        return sparse.csc_array(by_p.T @ (weight[:, None] * by_p)), by_p.T @ (weight * error)

    for robust in (None, 3.0):
        ours = minimise(
            np.array([1.0, 1.0]),
            residuals=residuals,
            normal=normal,
            retract=lambda p, s: p + s,
            groups=np.arange(40),
            robust=robust,
            tolerance=1e-14,
        )
        loss = "linear" if robust is None else "cauchy"
        theirs = least_squares(
            residuals, [1.0, 1.0], xtol=1e-15, ftol=1e-15, gtol=1e-12, loss=loss, f_scale=robust or 1.0
        )
        assert ours.converged
        assert ours.cost <= theirs.cost * (1 + 1e-9)
        np.testing.assert_allclose(ours.state, theirs.x, rtol=1e-4)


def test_bundle_finds_the_truth():
    """From cameras 3 cm and a degree off and points 1 cm off, without noise: the truth, up to its frame, to 1e-8 m."""
    rng = np.random.default_rng(5)
    scene, seen = point_scene(rng, rig(4), 40)
    moved = tuple(
        replace(
            c,
            rotation=turn(rng.normal(0, 0.015, 3)) @ c.rotation,
            translation_m=c.translation_m + rng.normal(0, 0.03, 3),
        )
        for c in scene.cameras
    )
    start = replace(scene, cameras=moved, position_m=scene.position_m + rng.normal(0, 0.01, scene.position_m.shape))
    pairs = np.arange(39)
    apart = np.linalg.norm(np.diff(scene.position_m, axis=0), axis=-1)
    lengths = KnownLengths(first=pairs, second=pairs + 1, length_m=apart, sd_m=np.full(39, 1e-4))
    found = adjust(start, seen, free=Free(focal="none", centre=False, fixed=0), lengths=lengths, robust=None)
    T = similarity(found.scene.position_m, scene.position_m, scaled=False)
    back = found.scene.position_m @ T[:3, :3].T + T[:3, 3]
    np.testing.assert_allclose(back, scene.position_m, rtol=0, atol=1e-8)
    for ours, true in zip(in_world(found.scene.cameras, T), scene.cameras, strict=True):
        np.testing.assert_allclose(ours.position_m, true.position_m, rtol=0, atol=1e-7)


def test_wrong_sightings_do_not_pull():
    """5 % of the pixels off by 30 px: with Cauchy's loss points stay in the noise, least squares errs 5 times more."""
    rng = np.random.default_rng(6)
    scene, seen = point_scene(rng, rig(4), 60)
    uv = seen.uv_px + rng.normal(0, 0.2, seen.uv_px.shape)
    bad = rng.random(len(uv)) < 0.05
    uv[bad] += 30 * np.sign(rng.normal(size=(bad.sum(), 2)))
    seen = Sightings(camera=seen.camera, body=seen.body, local_m=seen.local_m, uv_px=uv)
    errors = []
    for robust in (3.0, None):
        found = adjust(scene, seen, free=Free(focal="none", centre=False), robust=robust)
        T = similarity(found.scene.position_m, scene.position_m)
        errors.append(
            np.median(np.linalg.norm(found.scene.position_m @ T[:3, :3].T + T[:3, 3] - scene.position_m, axis=1))
        )
        if robust:
            assert found.sd_px == pytest.approx(0.2, rel=0.25)
            assert (found.weight[bad] < 0.1).all()
    assert errors[0] < 6e-4  # 0.2 px at 600 px a metre is 0.33 mm
    assert errors[1] > 5 * errors[0]


def test_focal_deviations_are_honest():
    """Over 12 scenes the error of a focal length over its stated deviation spreads by 0.5 to 1.6."""
    ratios = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        scene, seen = point_scene(rng, rig(3), 50)
        noisy = Sightings(
            camera=seen.camera,
            body=seen.body,
            local_m=seen.local_m,
            uv_px=seen.uv_px + rng.normal(0, 0.3, seen.uv_px.shape),
        )
        found = adjust(scene, noisy, free=Free(focal="one", centre=False), robust=None)
        again = adjust(found.scene, noisy, free=Free(focal="one", centre=False), robust=None)
        f = np.array([c.lens.f_px[0] for c in again.scene.cameras])
        ratios.append((f - 1200.0) / again.f_sd_px)
    assert 0.5 < np.std(ratios) < 1.6


def test_a_camera_comes_apart_and_together():
    """Projection, to lens and pose, and back: the same pixels; DLT coefficients too, sheared and mirrored ones."""
    rng = np.random.default_rng(7)
    points = cloud(rng, 20)
    for camera in ring(2):
        np.testing.assert_allclose(rig_camera(camera).record(points), record([camera], points)[0], rtol=0, atol=1e-8)
    free = dlt_camera("free", dlt_coefficients(ring(1)[0]) * rng.uniform(0.97, 1.03, 11))
    mirrored = Camera(name="mirrored", matrix=ring(1)[0].matrix @ np.diag([1.0, 1, -1, 1]))
    for camera in (free, mirrored):
        again = dlt_camera("again", dlt_coefficients(rig_camera(camera).camera()))
        np.testing.assert_allclose(record([again], points), record([camera], points), rtol=0, atol=1e-7)
    with pytest.raises(ValueError, match="undistort the pixels"):
        rig_camera(replace(free, lens=LENSES[0]))


@pytest.mark.parametrize("lens", LENSES, ids=lambda lens: lens.model)
def test_a_camera_upside_down_counts_rows_from_below(lens):
    """Every pixel (u, v) becomes (u, H - v), distortion included."""
    camera = replace(rig(1, lens)[0], shear=0.0)
    points = cloud(np.random.default_rng(8), 20)
    expected = camera.record(points) * [1, -1] + [0, 1024]
    np.testing.assert_allclose(upside_down(camera, 1024).record(points), expected, rtol=0, atol=1e-8)
