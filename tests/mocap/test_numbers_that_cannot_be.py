"""Numbers that no animal and no camera gives: found without a skeleton, whatever the unit, through every entrance."""

import json

import numpy as np
import pytest

from mocap import clean, from_arrays, from_pixels, read, track
from mocap.audit.names import OFTEN, THROUGHOUT, exchange_rates, exchanged_in_a_camera
from mocap.audit.samples import point_findings
from mocap.audit.units import FAR, unit_findings
from mocap.cameras.camera import LARGEST_DLT, dlt_camera, dlt_coefficients, record, stacked
from mocap.errors import CalibrationError, FormatError
from mocap.io.contents import point_recording
from mocap.io.plausible import MOST_LIKELY
from mocap.io.registry import write
from mocap.records import marker_tracks
from tests.mocap.rigs import ring

FRAMES, NAMES = 160, ("a", "b", "c", "d")
SIZES = [1e-3, 0.1, 10.0]
"""Metres: of an insect, a bat and a whale, which is 30 m from end to end."""


def animal(size=0.1, *, still=False, seed=0):
    """(T, 4, 3) markers of an animal that flies past the origin at 15 to 20 of its sizes, with noise of a hundredth."""
    rng = np.random.default_rng(seed)
    t = np.arange(FRAMES) / 100
    path = 0.0 if still else np.stack([5 * t, np.sin(3 * t), np.cos(2 * t)], axis=-1)[:, None]
    flap = 1 + 0.3 * np.sin(25 * t)[:, None, None] * (not still)
    shape = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -0.7, 0.7]])
    return size * (path + flap * shape + [10.0, 8.0, 12.0] + rng.normal(0, 0.01, (FRAMES, 4, 3)))


def kinds(xyz):
    """What is found of positions."""
    tracks = marker_tracks([f"m{i}" for i in range(xyz.shape[1])], np.arange(len(xyz)) / 100, xyz)
    return [f.kind for f in point_findings(tracks)]


def in_mm(xyz):
    """One of four markers in millimetres among metres."""
    xyz[:, 1] *= 1e3
    return xyz


def half(xyz):
    """The latter half in millimetres."""
    xyz[FRAMES // 2 :] *= 1e3
    return xyz


def every_second(xyz):
    """Two names exchanged in every second frame."""
    xyz[::2, [0, 1]] = xyz[::2, [1, 0]]
    return xyz


def four_times(xyz):
    """40 frames, each of them four times, as 60 Hz exported at 240."""
    return np.repeat(xyz[: FRAMES // 4], 4, axis=0)


def huge(xyz):
    """An animal of 1e7 sizes."""
    return 1e7 * xyz


WRONG = {in_mm: "units", half: "units", every_second: "exchanged names", four_times: "repeated frames", huge: "units"}


@pytest.mark.parametrize("still", [False, True])
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("damage", WRONG, ids=lambda one: one.__name__)
def test_what_cannot_be_is_found_at_every_size(damage, size, still):
    """The same of an insect and a whale, that fly or lie still; of the sound animal nothing.

    Of the still one repeated frames are none: it lies still in the others, too, but for noise.
    """
    assert kinds(animal(size, still=still)) == []
    assert WRONG[damage] in kinds(damage(animal(size, still=still)))


@pytest.mark.parametrize("factor", [100.0, 1000.0, 1e-3, 25.4, 30.48])
def test_a_marker_in_another_unit_is_named_with_its_factor(factor):
    """To the ratio of two units that lie apart by more than limbs do."""
    xyz = animal()
    xyz[:, 2] *= factor
    (found,) = unit_findings(xyz, NAMES)
    assert found.markers == ("c",)
    assert found.numbers["factor"] == pytest.approx(factor, rel=0.25)  # inches and feet are not told apart by limbs


def test_a_stretch_in_another_unit_is_told_from_frame_to_frame():
    """Frames 51 to 100 of 160, also of one marker, also after a hole."""
    for xyz in (animal(), animal()[:, :1]):
        xyz[50:100] *= 100
        xyz[48:50] = np.nan
        (found,) = unit_findings(xyz, NAMES[: xyz.shape[1]], first=1000)
        assert found.frames == (1051, 1101)
        assert found.numbers["factor"] == 100


def sound():
    """Recordings that are right, however odd."""
    rng, xyz = np.random.default_rng(3), animal()
    fixed = np.zeros((FRAMES, 1, 3))
    t = np.arange(FRAMES)[:, None] / 100
    tip = 0.1 * FAR * 0.7 * np.concatenate([np.cos(40 * t), np.sin(40 * t), 0 * t], axis=1)
    flat = xyz.copy()
    flat[..., 2] = 0.0
    pendulum = np.concatenate([np.sin(3 * t), 0 * t, -np.cos(3 * t)], axis=1)[:, None] * np.array(
        [[0.01], [0.5], [1.0]]
    )
    jump = animal()
    jump[80:] += [0.5, 0.5, 0.0]
    swaps = animal()
    swaps[50:60, [0, 1]] = swaps[50:60, [1, 0]]
    pair = xyz[:, :1] + rng.normal(0, 1e-3, (FRAMES, 2, 3))
    return {
        "planar": flat,
        "a landmark far away": np.concatenate([xyz, fixed + 80.0 + rng.normal(0, 1e-4, fixed.shape)], axis=1),
        "a landmark at the origin": np.concatenate([xyz, fixed + rng.normal(0, 1e-5, fixed.shape)], axis=1),
        "a whip": np.concatenate([xyz[:, :3], xyz[:, 3:] + tip[:, None]], axis=1),
        "a pendulum about the origin": pendulum + rng.normal(0, 1e-5, pendulum.shape),
        "a jump": jump,
        "one identity switch": swaps,
        "two markers in one place": pair,
        "two markers in one place, whole numbers": np.round(pair * 1e3) * 1e-3,
        "a root at the origin": np.concatenate([fixed, xyz - xyz[:, :1]], axis=1)[:, [0, 2, 3, 4]],
        "every third frame empty": np.where((np.arange(FRAMES) % 3 == 0)[:, None, None], np.nan, xyz),
        "one marker": xyz[:, :1],
        "never seen": np.full_like(xyz, np.nan),
    }


@pytest.mark.parametrize("case", sound())
def test_sound_recordings_are_not_accused(case):
    """None of these is of two units, or has names that are exchanged in many frames."""
    xyz = sound()[case]
    names = [f"m{i}" for i in range(xyz.shape[1])]
    assert unit_findings(xyz, names) == []
    assert exchange_rates(xyz, names) == []
    assert "repeated frames" not in kinds(xyz)


@pytest.mark.parametrize("share", [OFTEN * 0.7, OFTEN * 1.4])
def test_names_are_exchanged_too_often_from_a_share_on(share):
    """Each exchange of one frame is two steps; on either side of ``OFTEN``."""
    xyz = animal()
    at = np.linspace(2, FRAMES - 3, round(share * FRAMES / 2)).astype(int)
    xyz[at, 0], xyz[at, 1] = xyz[at, 1], xyz[at, 0].copy()
    assert bool(exchange_rates(xyz, NAMES)) == (share > OFTEN)


@pytest.mark.parametrize("share", [THROUGHOUT * 0.8, THROUGHOUT * 1.2, 1.0])
def test_one_camera_of_three_that_has_names_exchanged_is_named(share):
    """The two that agree say so, from half of the frames on; of two cameras none can."""
    cameras = ring(3)
    uv = record(cameras, animal() - animal().mean(axis=(0, 1)))
    first = round(share * FRAMES)
    uv[1, :first] = uv[1, :first][:, [1, 0, 2, 3]]
    found = exchanged_in_a_camera(stacked(cameras), uv, NAMES, ["cam1", "cam2", "cam3"])
    assert [(f.cameras, f.markers) for f in found] == ([(("cam2",), ("a", "b"))] if share > THROUGHOUT else [])
    assert exchanged_in_a_camera(stacked(cameras[:2]), uv[:2], NAMES, ["cam1", "cam2"]) == []


@pytest.mark.parametrize("damage", WRONG, ids=lambda one: one.__name__)
def test_every_entrance_says_it(damage, mocap, tmp_path):
    """``mocap info`` and ``mocap.clean`` of a file and of an array with the unit stated: the same kind, as an alarm."""
    xyz = damage(animal())
    path = tmp_path / "a.csv"
    write(point_recording(path, "made", names=NAMES, xyz=xyz, unit="m", fps=100.0), path)
    code, out, _ = mocap("info", path, "--json")
    assert code == 0
    assert WRONG[damage] in [f["kind"] for f in json.loads(out)["audit"] if f["alarm"]]
    for recording in (read(path), from_arrays(xyz, fps=100, unit="m", names=NAMES)):
        assert WRONG[damage] in [f.kind for f in clean(recording).findings if f.alarm]


def test_what_is_wrong_is_told_of_what_was_tracked():
    """The report's list of what is wrong has it, of positions and of pixels."""
    found = track(from_arrays(in_mm(animal()), fps=100, unit="m"), model="constant_velocity", validate=False)
    assert any("in another unit" in text for text in found.report["wrong"])
    cameras = ring(3)
    uv = record(cameras, animal() - animal().mean(axis=(0, 1)))
    uv[1] = uv[1][:, [1, 0, 2, 3]]
    coefficients = [dlt_coefficients(camera) for camera in cameras]
    done = clean(from_pixels(uv, coefficients, fps=100, unit="m"))
    assert any("their names are exchanged there" in f.text for f in done.findings if f.alarm)


@pytest.mark.parametrize("value", [-0.01, MOST_LIKELY + 0.01, 2.0, np.nan, 0.0, 1.0])
def test_a_likelihood_is_between_0_and_1(value):
    """Others are refused with what to do; NaN is none."""
    cameras = ring(2)
    uv = record(cameras, animal() - animal().mean(axis=(0, 1)))
    likelihood = np.full(uv.shape[:3], 0.9)
    likelihood[1, 3, 2] = value

    def taken():
        return clean(from_pixels(uv, cameras, fps=100, unit="m", likelihood=likelihood))

    if not np.isnan(value) and not 0 <= value <= 1:
        with pytest.raises(FormatError, match="expected 0 to 1, or NaN where there is none"):
            taken()
    else:
        assert taken().cleaned


@pytest.mark.parametrize("times", [1e300, 1e300 * 1j, np.nan, np.inf, 0.0, 1j])
def test_coefficients_of_no_camera_are_refused(times):
    """Too large, complex, none, infinite, all 0: one line names the camera or the argument."""
    coefficients = np.stack([dlt_coefficients(camera) for camera in ring(2)])
    uv = record(ring(2), animal() - animal().mean(axis=(0, 1)))
    with pytest.raises(CalibrationError, match=r"cam1|`cameras` is complex numbers"):
        from_pixels(uv, coefficients * times, fps=100, unit="m")


@pytest.mark.parametrize("most", [LARGEST_DLT * 0.9, LARGEST_DLT * 1.1])
def test_the_largest_coefficient(most):
    """On either side of what is refused."""
    coefficients = np.ones(11) * most
    if most > LARGEST_DLT:
        with pytest.raises(CalibrationError, match="up to"):
            dlt_camera("cam1", coefficients)
    else:
        assert dlt_camera("cam1", coefficients).name == "cam1"
