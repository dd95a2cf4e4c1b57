"""Faults put into a clean recording are found and named; clean recordings raise no alarm."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from mocap.datasets import PERFECT, make_bat, make_lizard

from mocap.audit import (
    alarms,
    audited,
    estimate_offsets,
    in_step,
    late_cameras,
    pixel_findings,
    point_findings,
)
from mocap.audit.file_audit import audit_recording
from mocap.audit.geometry import camera_findings, fit_findings
from mocap.audit.stored import _one_v_row
from mocap.cameras.camera import Camera, flipped, project, record, stacked, undistorted
from mocap.cameras.origin import PixelOptions, decide_origin
from mocap.cameras.triangulate import linear, residual_px
from mocap.io.contents import FileContents
from mocap.records import MarkerTracks, PixelCorner, PixelTracks, Status
from tests.mocap.rigs import ring

NOISE_PX = 0.5
HEIGHT = 1024


@dataclass(frozen=True, eq=False)
class Clean:
    """A clean recording: 4 cameras with lenses, 5 markers on a body that swims about, 0.5 px of noise."""

    cameras: tuple[Camera, ...]
    xyz_m: np.ndarray
    pixels: PixelTracks

    def audit(self, *, cameras=None, uv_px=None, stored=None, origin: PixelCorner = "upper-left"):
        """Findings of the recording with some of it exchanged."""
        cameras = self.cameras if cameras is None else cameras
        pixels = self.pixels if uv_px is None else replace(self.pixels, uv_px=uv_px)
        options = PixelOptions(origin=origin, calibration_origin=origin, image_height_px=HEIGHT)
        decision = decide_origin(cameras, pixels.uv_px, options)
        found = audited(cameras, pixels, self.ideal(cameras, pixels.uv_px, decision), decision, stored=stored)
        return [*found.findings]

    def ideal(self, cameras, uv_px, decision):
        """Ideal pixels as the audit takes them."""
        return decision.ideal(cameras, uv_px)

    def stored(self, xyz_m=None):
        """Points as a program stores them: linear triangulation, six decimals."""
        if xyz_m is None:
            xyz_m = linear(stacked(self.cameras), undistorted(self.cameras, self.pixels.uv_px))
        return points_of(np.round(xyz_m, 6), self.pixels)


def points_of(xyz_m, pixels):
    """Positions as a record."""
    return MarkerTracks(
        names=pixels.names,
        t_s=pixels.t_s,
        xyz_m=xyz_m,
        cov_m2=np.full((*xyz_m.shape, 3), np.nan),
        status=np.where(np.isfinite(xyz_m[..., 0]), Status.MEASURED, Status.MISSING),
    )


def moving(t):
    """(T, 5, 3) markers 6 cm about a middle that swims 30 cm to and fro, turning; a metre a second at 200 frames/s."""
    t = np.asarray(t) / 200
    middle = 0.15 * np.stack([np.sin(5 * t), np.cos(4.1 * t), 0.5 * np.sin(7.3 * t + 1)], axis=-1)
    arms = 0.06 * np.random.default_rng(8).normal(size=(5, 3))
    angle = 3 * np.sin(2.2 * t)
    c, s = np.cos(angle), np.sin(angle)
    turn = np.stack([c, -s, 0 * c, s, c, 0 * c, 0 * c, 0 * c, 1 + 0 * c], axis=-1).reshape(-1, 3, 3)
    return middle[:, None] + np.einsum("tij,mj->tmi", turn, arms)


def clean(seed=1, n_frames=300, late=(0.0, 0.0, 0.0, 0.0), lens=True, wide=1.0):
    """A clean recording; camera c may be late by so many frames, the way of the animal ``wide`` times as large."""
    rng = np.random.default_rng(seed)
    cameras = ring(4, lens=lens)
    t = np.arange(n_frames)
    uv = np.stack([record([c], wide * moving(t + d))[0] for c, d in zip(cameras, late, strict=True)])
    uv += rng.normal(0, NOISE_PX, uv.shape)
    uv[rng.random(uv.shape[:3]) < 0.1] = np.nan
    uv = np.round(uv, 6)
    names = tuple(f"pt{m + 1}" for m in range(5))
    pixels = PixelTracks(names=names, cameras=tuple(c.name for c in cameras), t_s=t / 200, uv_px=uv)
    return Clean(cameras, wide * moving(t), pixels)


def kinds(findings):
    """What alarms are raised."""
    return sorted({f.kind for f in alarms(findings)})


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("lens", [False, True])
def test_clean_recordings_raise_no_alarm(seed, lens):
    """Nothing is wrong, with stored points or without; the decisions are stated as notes."""
    scene = clean(seed, lens=lens)
    findings = scene.audit(stored=scene.stored())
    assert not alarms(findings), [f.text for f in alarms(findings)]
    assert {"pixel origin", "camera offsets"} <= {f.kind for f in findings}


@pytest.mark.parametrize("make", [make_bat, make_lizard])
def test_twins_raise_no_alarm(make):
    """Recordings of other people's making, with gaps, careless clicks and noise: no fault was put in, none is found."""
    twin = make(seed=3, n_frames=200)
    options = PixelOptions(origin="upper-left", calibration_origin="upper-left")
    decision = decide_origin(twin.cameras, twin.pixels.uv_px, options)
    ideal = undistorted(twin.cameras, twin.pixels.uv_px)
    findings = audited(twin.cameras, twin.pixels, ideal, decision).findings
    assert not alarms(findings), [f.text for f in alarms(findings)]


def test_stale_points_are_found():
    """Pixels edited after the points were stored: those points, and how far they are off."""
    scene = clean()
    stored = scene.stored()
    uv = scene.pixels.uv_px.copy()
    uv[:, 40, 2] += 15.0
    (found,) = alarms(scene.audit(uv_px=uv, stored=stored))
    assert (found.kind, found.markers, found.frames) == ("stale points", ("pt3",), (41,))
    assert "edited after" in found.text


def test_exchanged_columns_are_found():
    """Points of two markers stored under each other's name."""
    scene = clean()
    xyz = scene.stored().xyz_m.copy()
    xyz[:, [1, 3]] = xyz[:, [3, 1]]
    found = alarms(scene.audit(stored=points_of(xyz, scene.pixels)))
    assert {f.kind for f in found} == {"wrong columns"}
    assert {f.markers for f in found} == {("pt2", "pt4"), ("pt4", "pt2")}


@pytest.mark.parametrize("shift", [3, -2])
def test_a_time_shift_is_found(shift):
    """Points stored some frames after or before their pixels."""
    scene = clean()
    xyz = np.full_like(scene.stored().xyz_m, np.nan)
    source = scene.stored().xyz_m
    xyz[max(0, shift) : len(xyz) + min(0, shift)] = source[max(0, -shift) : len(xyz) - max(0, shift)]
    (found,) = alarms(scene.audit(stored=points_of(xyz, scene.pixels)))
    assert (found.kind, found.numbers["frames"]) == ("time shift", shift)


def test_a_solve_with_one_v_row_is_found():
    """All u rows and one camera's v row: the points of Argus's solve, told from stale ones."""
    scene = clean()
    ideal = undistorted(scene.cameras, scene.pixels.uv_px)
    xyz = _one_v_row(stacked(scene.cameras), ideal, 2)
    at = np.flatnonzero(np.isfinite(ideal[:, :, 0, 0]).all(axis=0))[0]
    # one point again, written out
    rows = [(c.matrix[0] - ideal[i, at, 0, 0] * c.matrix[2]) / c.matrix[2, 3] for i, c in enumerate(scene.cameras)]
    rows.append(
        (scene.cameras[2].matrix[1] - ideal[2, at, 0, 1] * scene.cameras[2].matrix[2]) / scene.cameras[2].matrix[2, 3]
    )
    slow = np.linalg.lstsq(np.array(rows)[:, :3], -np.array(rows)[:, 3], rcond=None)[0]
    np.testing.assert_allclose(xyz[at, 0], slow, atol=1e-9)
    (found,) = alarms(scene.audit(stored=points_of(np.round(xyz, 6), scene.pixels)))
    assert (found.kind, found.cameras) == ("one v row", ("cam3",))


def test_smoothed_points_are_not_called_edited():
    """Points that were smoothed before they were stored follow from no pixels: said so."""
    scene = clean()
    xyz = scene.stored().xyz_m.copy()
    xyz[1:-1] = (xyz[2:] + xyz[1:-1] + xyz[:-2]) / 3
    (found,) = alarms(scene.audit(stored=points_of(xyz, scene.pixels)))
    assert found.kind == "stale points"
    assert "smoothed" in found.text


def test_a_foreign_camera_is_named():
    """One camera was moved after calibration."""
    scene = clean()
    turned = np.array([[1.0, -0.05, 0.0], [0.05, 1.0, 0.0], [0.0, 0.0, 1.0]])
    moved = replace(
        scene.cameras[2], matrix=scene.cameras[2].matrix @ np.block([[turned, np.full((3, 1), 0.03)], [0, 0, 0, 1]])
    )
    rig = (*scene.cameras[:2], moved, scene.cameras[3])
    (found,) = alarms(fit_findings(rig, undistorted(rig, scene.pixels.uv_px)))
    assert (found.kind, found.cameras) == ("foreign camera", ("cam3",))


@pytest.fixture(scope="module")
def exact():
    """Cameras, exact pixels, and of each camera and marker an error that stays, and one of each click."""
    bat = make_bat(seed=3, n_frames=120, n_cameras=4, digitiser=PERFECT)
    uv, rng = project(stacked(bat.cameras), bat.truth.xyz_m), np.random.default_rng(1)
    return bat.cameras, uv, rng.standard_normal((4, 1, uv.shape[2], 2)), rng.standard_normal(uv.shape)


@pytest.mark.parametrize(("stays_px", "clicks_px", "n"), [(8, 0.3, 0), (11, 0.3, 1), (14, 4, 0), (20, 4, 1)])
def test_rays_that_do_not_meet_are_warned_of(exact, stays_px, clicks_px, n):
    """Errors that stay leave residuals of 0.86 of them: from 8 px on, and four times what clicks scatter by."""
    cameras, uv, stays, clicks = exact
    found = fit_findings(cameras, uv + stays_px * stays + clicks_px * clicks)
    assert [f.kind for f in found] == ["large residual"] * n


@pytest.mark.parametrize(
    ("clicks_px", "near_px", "far_px", "n"),
    [(0.1, 2, 3, 0), (0.1, 2, 3.5, 1), (0.05, 0.1, 0.8, 0), (0.05, 0.1, 1.02, 1)],
)
def test_cameras_that_miss_by_three_times_as_much_are_named(exact, clicks_px, near_px, far_px, n):
    """Two cameras of one half of the markers, two of the other: three times, and a pixel."""
    cameras, uv, stays, clicks = exact
    uv, half = uv + clicks_px * clicks, uv.shape[2] // 2
    uv[:2] += near_px * stays[:2]
    uv[2:] += far_px * stays[2:]
    uv[:2, :, half:] = uv[2:, :, :half] = np.nan
    assert [f.kind for f in fit_findings(cameras, uv)] == ["uneven cameras"] * n


def test_a_foreign_calibration_is_found():
    """Coefficients of another day: every camera elsewhere."""
    scene = clean()
    rig = tuple(replace(c, matrix=o.matrix) for c, o in zip(scene.cameras, ring(4, radius_m=1.4)[::-1], strict=True))
    assert kinds(fit_findings(rig, undistorted(rig, scene.pixels.uv_px))) == ["foreign calibration"]


def test_copied_cameras_are_found():
    """The calibration of one camera under the name of another; and its pixels too."""
    scene = clean()
    rig = (*scene.cameras[:3], replace(scene.cameras[2], name="cam4"))
    (found,) = camera_findings(rig, y_up=False)
    assert (found.kind, found.cameras) == ("copied cameras", ("cam3", "cam4"))
    uv = scene.pixels.uv_px.copy()
    uv[3] = uv[2]
    assert [f.cameras for f in pixel_findings(replace(scene.pixels, uv_px=uv))] == [("cam3", "cam4")]


def test_mirrored_worlds_are_found():
    """A reflected world fits as well; only the handedness of the cameras tells. One camera alone is named."""
    scene = clean()
    mirror = np.diag([1.0, -1.0, 1.0, 1.0])
    rig = tuple(replace(c, matrix=c.matrix @ mirror) for c in scene.cameras)
    assert kinds(scene.audit(cameras=rig)) == ["mirrored world"]
    assert not alarms(camera_findings(rig, y_up=None))  # rows may count from below: a note asks
    assert kinds(camera_findings((rig[0], *scene.cameras[1:]), y_up=False)) == ["mirrored camera"]


def test_rows_from_below_are_right_handed():
    """Pixels and coefficients from the lower left describe the same world: no alarm when stated."""
    scene = clean(lens=False)
    flip = np.array([[1.0, 0, 0], [0, -1, HEIGHT], [0, 0, 1]])
    rig = tuple(replace(c, matrix=flip @ c.matrix) for c in scene.cameras)
    assert not alarms(scene.audit(cameras=rig, uv_px=flipped(scene.pixels.uv_px, HEIGHT), origin="lower-left"))


@pytest.mark.parametrize(
    ("change", "says"),
    [("undistorted", "already undistorted"), ("none given", "give the camera profile"), ("twice", "undistorted twice")],
)
def test_lenses_applied_wrongly_are_found(change, says):
    """Pixels undistorted before; distorted ones without a lens; and coefficients for pixels undistorted twice.

    The animal reaches the corners of the pictures, where the lenses move pixels by 10 px: about 20 times the noise.
    """
    scene = clean(wide=3.0)
    rig, uv = scene.cameras, scene.pixels.uv_px
    if change == "undistorted":
        uv = undistorted(rig, uv)
    elif change == "twice":
        uv = np.stack([c.lens.distort(u) for c, u in zip(rig, uv, strict=True) if c.lens is not None])
    else:
        rig = tuple(replace(c, lens=None) for c in rig)
    (found,) = alarms(scene.audit(cameras=rig, uv_px=uv))
    assert found.kind == "distortion"
    assert says in found.text
    if change == "none given":
        assert found.numbers["k1"] == pytest.approx(-0.2, abs=0.05)  # the rig's k1, with k2 and k3 in it


@pytest.mark.parametrize("step", [1.0, 0.5])
def test_rounded_pixels_are_found(step):
    """All cameras named, with the rounding's deviation step / sqrt(12)."""
    scene = clean()
    found = alarms(scene.audit(uv_px=np.round(scene.pixels.uv_px / step) * step))
    assert {f.kind for f in found} == {"quantised pixels"}
    assert len(found) == 4
    assert all(f.numbers["sd_px"] == pytest.approx(step / np.sqrt(12)) for f in found)


def test_half_precision_is_found():
    """Pixels that went through float16, as one program saves them again."""
    scene = clean()
    found = alarms(scene.audit(uv_px=scene.pixels.uv_px.astype(np.float16).astype(float)))
    assert {f.kind for f in found} == {"quantised pixels"}
    assert all("float16" in f.text for f in found)


def test_repeated_frames_are_found():
    """Two frames stored again in place of the next ones."""
    scene = clean()
    uv = scene.pixels.uv_px.copy()
    uv[1, 101] = uv[1, 100]
    uv[1, 201] = uv[1, 200]
    (found,) = alarms(pixel_findings(replace(scene.pixels, uv_px=uv)))
    assert (found.kind, found.cameras, found.frames) == ("repeated frames", ("cam2",), (102, 202))


@pytest.mark.parametrize(("factor", "guess"), [(1e3, "mm"), (1e-6, None)])
def test_lengths_that_no_animal_has_are_reported(factor, guess):
    """Millimetres taken for metres: reported, with a guess; the numbers stay."""
    scene = clean()
    (found,) = point_findings(points_of(scene.xyz_m * factor, scene.pixels))
    assert found.kind == "units"
    assert guess is None or guess in found.text


@pytest.mark.parametrize("late", [0.3, -1.4, 4.0])
def test_a_late_camera_is_found(late):
    """Camera 2 shows what happens ``late`` frames after the others see it: found within its stated deviation, by name.

    Offsets have mean 0: cameras 1, 3, 4 get -late / 4. Four deviations are exceeded once in 16,000.
    """
    scene = clean(late=(0.0, late, 0.0, 0.0))
    ideal = undistorted(scene.cameras, scene.pixels.uv_px)
    found = estimate_offsets(stacked(scene.cameras), ideal)
    assert found is not None
    expected = np.array([-late / 4, 3 * late / 4, -late / 4, -late / 4])
    assert (np.abs(found.offset_frames - expected) < 4 * found.sd_frames + 0.01).all()
    assert (found.sd_frames < 0.1).all()
    (named,) = [f for f in scene.audit() if f.kind == "camera offsets"]
    assert named.alarm
    assert "cam2" in named.cameras


def test_offset_deviations_are_honest():
    """Over 20 recordings in step, estimates divided by their stated deviations spread by about 1 (0.6 to 1.5)."""
    ratios = []
    for seed in range(20):
        scene = clean(seed, n_frames=80)
        found = estimate_offsets(stacked(scene.cameras), undistorted(scene.cameras, scene.pixels.uv_px))
        assert found is not None
        ratios.append(found.offset_frames / found.sd_frames)
    assert 0.6 < np.std(ratios) < 1.5


def test_a_still_animal_has_no_offset():
    """Where nothing moves nothing tells time: no estimate is better than a wild one, and no alarm is raised."""
    scene = clean()
    uv = np.repeat(scene.pixels.uv_px[:, :1], 300, axis=1) + np.random.default_rng(1).normal(0, 0.3, (4, 300, 5, 2))
    findings = scene.audit(uv_px=uv)
    assert not [f for f in alarms(findings) if f.kind == "camera offsets"]


def test_a_late_camera_is_brought_in_step():
    """Its tracks read between their frames meet those of the others as if it had never been late; the others stay.

    A cubic through 1 m/s at 200 frames a second errs far below the noise; only samples beside gaps are lost.
    """
    scene = clean(late=(0.0, 1.3, 0.0, 0.0))
    ideal = undistorted(scene.cameras, scene.pixels.uv_px)
    matrices = stacked(scene.cameras)
    found = estimate_offsets(matrices, ideal)
    assert found is not None
    late = late_cameras(found)
    assert (late != 0).tolist() == [False, True, False, False]
    moved = in_step(ideal, late)
    np.testing.assert_array_equal(moved[[0, 2, 3]], ideal[[0, 2, 3]])
    misses = [np.nanmedian(residual_px(matrices, uv, linear(matrices, uv))) for uv in (ideal, moved)]
    assert misses[0] > 1.6 * misses[1]
    assert misses[1] < 0.6  # median residual of 0.5 px noise: 0.48 px
    assert np.isfinite(moved[1]).mean() > 0.9 * np.isfinite(ideal[1]).mean()


def test_pixels_that_do_not_fit_their_calibration_are_told_of_once():
    """Of cropped videos: what decides on the corner refuses them, and the check of the fit need not repeat it."""
    scene = clean()
    cropped = replace(scene.pixels, uv_px=0.3 * scene.pixels.uv_px)
    frames = np.arange(len(cropped.t_s))
    contents = FileContents(
        format="x",
        paths=(Path("a.csv"),),
        names=cropped.names,
        frames=frames,
        pixels=cropped,
        camera_names=cropped.cameras,
        cameras=scene.cameras,
    )
    told = [found.text for found in audit_recording(contents) if "triangulation residual" in found.text]
    assert len(told) == 1
    assert "crop" in told[0]
