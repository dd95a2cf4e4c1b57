"""Cameras of XMALab (MayaCam 2.0, project) and of Bouguet's toolbox: they record what OpenCV projects.

OpenCV is the program that XMALab calibrates with, and whose model is Bouguet's. The files are laid out as the sources
of XMALab (``Camera.cpp``, ``saveMayaCam.m``, ``ProjectFileIO.cpp``) and of the toolbox (``saving_calib.m``) write them.
"""

import zipfile
from xml.sax.saxutils import quoteattr

import cv2
import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

from mocap.cameras.camera import record, stacked, undistorted
from mocap.cameras.triangulate import linear
from mocap.errors import FormatError
from mocap.io.registry import read
from mocap.io.together import joined

POINTS = np.random.default_rng(3).uniform(-60, 60, (40, 3))
BENT = (-0.21, 0.08, 1e-3, -2e-3, 0.01, 0.02, -0.01, 0.003)
RIG = {
    "cam1": ((0.2, -0.4, 0.1), (-16.6, -7.8, 901.4), (2100.0, 2110.0, 803.7, 865.7)),
    "cam2": ((0.1, 0.9, -0.3), (22.0, 3.5, 850.0), (2050.0, 2047.0, 900.2, 870.4)),
}


def projected(name, bend=()):
    """(40, 2) pixels of the points by OpenCV."""
    turn, shift, _ = RIG[name]
    out, _ = cv2.projectPoints(POINTS, np.array(turn), np.array(shift), matrix(name), np.array(bend) if bend else None)
    return out[:, 0]


def matrix(name):
    fx, fy, cx, cy = RIG[name][2]
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])


def rows(values):
    return "".join(",".join(f"{x:.12g}" for x in row) + "\n" for row in np.atleast_2d(values))


def mayacam(path, name, bend=(), in_one_row=False):
    """As ``Camera::saveMayaCamVersion2`` writes it; the lens in one row as ``saveMayaCam.m`` does."""
    turn, shift, _ = RIG[name]
    text = "image size\n1760,1720\n\ncamera matrix\n" + rows(matrix(name)) + "\nrotation\n"
    text += rows(cv2.Rodrigues(np.array(turn))[0]) + "\ntranslation\n" + rows(np.array(shift)[:, None])
    if bend:
        text += "\nundistortion\n" + rows(np.array(bend)[None] if in_one_row else np.array(bend)[:, None])
    path.write_text(text)
    return path


@pytest.mark.parametrize("bend", [(), BENT, (*BENT[:5], 0.0, 0.0, 0.0)])
def test_mayacam_records_as_opencv_projects(tmp_path, bend):
    """Without a lens, with the rational one and with Brown's alone, to the digits that are written; size and name."""
    found = read(mayacam(tmp_path / "trial_Cam1_MayaCam2.txt", "cam1", bend, in_one_row=len(bend) == 8 and bend[7] > 0))
    assert (found.format, found.camera_names, found.cameras[0].size_px) == ("mayacam", ("cam1",), (1760, 1720))
    np.testing.assert_allclose(record(found.cameras, POINTS)[0], projected("cam1", bend), atol=1e-7)
    assert ("exported distorted" in found.findings[0]) == bool(bend)


def test_mayacam_beside_pixels_of_xmalab(tmp_path):
    """Two files, given in the other order, and the pixels give the points: cameras go by the numbers in their names."""
    uv = {name: projected(name, BENT) for name in RIG}
    table = {f"bead_{n}_{axis}": uv[n][:, k] for n in RIG for k, axis in enumerate("XY")}
    pd.DataFrame(table).to_csv(tmp_path / "2dpts.csv", index=False, float_format="%.12g")
    files = [mayacam(tmp_path / f"calib_cam0{c}.txt", f"cam{c}", BENT) for c in (2, 1)]
    whole = joined([read(path) for path in (tmp_path / "2dpts.csv", *files)])
    assert whole.pixels is not None
    assert [camera.name for camera in whole.cameras] == ["cam1", "cam2"]
    found = linear(stacked(whole.cameras), undistorted(whole.cameras, whole.pixels.uv_px))
    np.testing.assert_allclose(found[:, 0], POINTS, atol=1e-6)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("camera matrix\n2100", "camera matrix\nx", "line 5"),
        ("-7.8\n", "", "2 numbers below 'translation', expected 3"),
        ("image size\n1760,1720", "image size\n1760", "1 numbers below 'image size'"),
    ],
)
def test_a_cut_mayacam_is_refused(tmp_path, old, new, message):
    """A number that is missing, or is none, is named."""
    path = mayacam(tmp_path / "cam1.txt", "cam1")
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(FormatError, match=message):
        read(path)


def test_a_mirrored_mayacam_is_refused(tmp_path):
    """A matrix with determinant -1 turns nothing."""
    path = mayacam(tmp_path / "cam1.txt", "cam1")
    text = path.read_text()
    above, below = text.split("rotation\n")
    first, rest = below.split("\n", 1)
    path.write_text(above + "rotation\n" + ",".join(str(-float(x)) for x in first.split(",")) + "\n" + rest)
    with pytest.raises(FormatError, match="no rotation"):
        read(path)


def test_mayacam_1_is_named(tmp_path):
    """The file for Maya itself is no table of five frames."""
    path = tmp_path / "Cam1_MayaCam.csv"
    path.write_text("-737.5,-514.9,94.3\n289.7,-2.0,-55.2\n33.9,4.1,-632.5\n4840.2,839.2,-6325.8\n50.1,1760,1760\n")
    with pytest.raises(FormatError, match=r"MayaCam 1\.0.*MayaCams 2\.0"):
        read(path)


def project(path, *, bend=(), grid=False, references=("1",), separator="\\", sequence=False):
    """As ``ProjectFileIO::saveProject`` does; two images of the calibration, of which the second is the reference."""
    entries, cameras = {}, ""
    for name, (turn, shift, _) in RIG.items():
        data = f"{name}{separator}data{separator}"
        entries[f"{name}/data/{name}_CameraMatrix.csv"] = rows(matrix(name)).replace(",", ", ")
        parts = f'CameraMatrix="{data}{name}_CameraMatrix.csv"'
        if bend:
            entries[f"{name}/data/{name}_UndistortionParameter.csv"] = rows(np.array(bend)[:, None])
            parts += f' UndistortionParameter="{data}{name}_UndistortionParameter.csv"'
        inside = f'<UndistortionGrid Filename="g.png" isComputed="{int(grid)}"/>'
        inside += '<CalibrationSequence Filename="s" Frames="9" Width="1760" Height="1720"/>' if sequence else ""
        for image, (r, t) in enumerate((((0.0, 0.1, 0.2), (1.0, 2.0, 800.0)), (turn, shift))):
            entries[f"{name}/data/i{image}_RotationMatrix.csv"] = rows(cv2.Rodrigues(np.array(r))[0]).replace(",", ", ")
            entries[f"{name}/data/i{image}_TranslationVector.csv"] = rows(np.array(t)[:, None])
            what = f'Frame="{image + 3}"' if sequence else f'Filename="{name}{separator}i{image}.png"'
            inside += (
                f'<CalibrationImage {what} isCalibrated="1"><RotationMatrix Filename="{data}i{image}_RotationMatrix'
                f'.csv"/><TranslationVector Filename="{data}i{image}_TranslationVector.csv"/></CalibrationImage>'
            )
        cameras += f'<Camera Name={quoteattr(name)} isCalibrated="1" {parts}>{inside}</Camera>'
    trials = "".join(
        f'<Trial Name="t{i}" startFrame="1" endFrame="9" referenceCalibration="{r}" recordingSpeed="250"/>'
        for i, r in enumerate(references)
    )
    entries["project.xml"] = f'<?xml version="1.0"?>\n<Project Version="0.3">{cameras}{trials}</Project>'
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in entries.items():
            archive.writestr(name, text)
    return path


@pytest.mark.parametrize("separator", ["\\", "/"])
def test_project_places_cameras_by_the_reference_image(tmp_path, separator):
    """Cameras stand as in the image that the trial refers to, whichever system saved the project."""
    found = read(project(tmp_path / "pig.xma", bend=BENT, separator=separator))
    assert (found.format, found.camera_names) == ("xmalab-project", ("cam1", "cam2"))
    for name, uv in zip(RIG, record(found.cameras, POINTS), strict=True):
        np.testing.assert_allclose(uv, projected(name, BENT), atol=1e-7)
    assert "1 trials at 250 frames a second (t0)" in found.findings[1]


def test_project_of_a_sequence_counts_frames(tmp_path):
    """Images of a video have their frame's number, and the size of the video."""
    found = read(project(tmp_path / "pig.xma", references=("4",), sequence=True))
    np.testing.assert_allclose(record(found.cameras, POINTS)[0], projected("cam1"), atol=1e-7)
    assert found.cameras[0].size_px == (1760, 1720)


def test_project_says_which_pixels_it_is_for(tmp_path):
    """A grid that is computed undistorts images; one that is not does nothing."""
    assert "exported undistorted" in read(project(tmp_path / "a.xma", grid=True)).findings[0]
    assert "exported undistorted" not in read(project(tmp_path / "b.xma")).findings[0]


def test_project_of_two_references_is_refused(tmp_path):
    """Two trials that place the cameras otherwise have no calibration in common; two of one reference have."""
    assert len(read(project(tmp_path / "a.xma", references=("1", "1"))).cameras) == 2
    with pytest.raises(FormatError, match=r"2 images of the calibration \(0, 1\)"):
        read(project(tmp_path / "b.xma", references=("0", "1")))


def bouguet(path, sides, **more):
    """Variables as ``saving_calib.m`` and ``saving_stereo_calib.m`` name and shape them."""
    table = {"nx": 1760.0, "ny": 1720.0, "dX": 30.0, **more}
    for end, (name, bend) in sides.items():
        fx, fy, cx, cy = RIG[name][2]
        column = {"fc": (fx, fy), "cc": (cx, cy), "kc": bend}
        table |= {f"{n}{end}": np.array(v)[:, None] for n, v in column.items()}
        table |= {f"alpha_c{end}": more.get("alpha_c", 0.0), f"KK{end}": matrix(name)}
    savemat(path, table)
    return path


@pytest.mark.parametrize("bend", [BENT[:5], BENT[:4]])
def test_bouguet_lens(tmp_path, bend):
    """One camera is a lens that bends as OpenCV's does, also of the years when there was no k3."""
    found = read(bouguet(tmp_path / "Calib_Results_left.mat", {"": ("cam1", bend)}))
    (lens, size), xy = found.lenses[0], POINTS[:, :2] / 300
    assert (found.format, size, found.camera_names) == ("bouguet", (1760, 1720), ("left",))
    expected, _ = cv2.projectPoints(
        np.column_stack([xy, np.ones(len(xy))]), np.zeros(3), np.zeros(3), matrix("cam1"), np.array(bend)
    )
    ideal = xy * lens.f_px + np.array(lens.centre_px)
    np.testing.assert_allclose(lens.distort(ideal), expected[:, 0], atol=1e-9)


def test_bouguet_stereo(tmp_path):
    """The right camera stands where R and T put it; the left one is the world."""
    turn, shift = np.array([0.02, -0.1, 0.01]), np.array([-300.0, 3.0, 12.0])
    more = {"R": cv2.Rodrigues(turn)[0], "T": shift[:, None], "om": turn[:, None]}
    sides = {"_left": ("cam1", BENT[:5]), "_right": ("cam2", BENT[:5])}
    found = read(bouguet(tmp_path / "Calib_Results_stereo.mat", sides, **more))
    assert found.camera_names == ("left", "right")
    away = POINTS + np.array([0, 0, 900])
    for name, uv, (r, t) in zip(RIG, record(found.cameras, away), ((np.zeros(3),) * 2, (turn, shift)), strict=True):
        expected, _ = cv2.projectPoints(away, r, t, matrix(name), np.array(BENT[:5]))
        np.testing.assert_allclose(uv, expected[:, 0], atol=1e-8)


def test_bouguet_with_skew_is_refused_where_it_matters(tmp_path):
    """Skew of 1e-3 moves pixels of the edge by 0.9 px, of 1e-6 by none that can be seen."""
    with pytest.raises(FormatError, match=r"skew moves pixels by up to 0\.86 px"):
        read(bouguet(tmp_path / "Calib_Results.mat", {"": ("cam1", BENT[:5])}, alpha_c=1e-3))
    assert read(bouguet(tmp_path / "b.mat", {"": ("cam1", BENT[:5])}, alpha_c=1e-6)).lenses
