"""Variants of formats that no real file here shows, as their programs write them (their sources and manuals)."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from mocap.cameras.camera import project, stacked
from mocap.errors import FormatError
from mocap.io import registry
from mocap.io.format import Hints
from mocap.io.plain import parse_columns
from mocap.io.profile import read_sba_profile
from mocap.io.registry import formats, identify, read
from mocap.records import Status

QTM = "NO_OF_FRAMES\t2\nNO_OF_MARKERS\t2\nFREQUENCY\t100\nMARKER_NAMES\ta\tb\nTRAJECTORY_TYPES\tMeasured\tMixed\n"
SMALL = {
    "DLTdv 8.4": ("x.csv", "tip_cam1_U,tip_cam1_V\n1,2\n3,4\n", "dltdv-xypts", 1, 1, 2),
    "DLTdv filtered": ("x.csv", "pt1filt_X,pt1filt_Y,pt1filt_Z\n1,2,3\n", "dltdv-xyzpts", 1, 0, 1),
    "Argus": ("x.csv", "a_cam_1_x,a_cam_1_y,a_cam_10_x,a_cam_10_y\n1,2,3,4\n", "argus-xypts", 1, 2, 1),
    "Argus 3D": ("x.csv", "a_x,a_y,a_z\n1,2,3\n", "argus-xyzpts", 1, 0, 1),
    "Argus offsets": ("x.csv", "camera_1,camera_2\n0,3\n", "argus-offsets", 0, 2, 1),
    "Argus intervals": (
        "x.csv",
        "a_x_lower,a_x_upper,a_y_lower,a_y_upper,a_z_lower,a_z_upper\n0,1,0,2,0,3\n",
        "argus-xyz-cis",
        1,
        0,
        1,
    ),
    "Argus residuals": ("b-xyzres.csv", "a,b\n1,2\n", "argus-xyzres", 2, 0, 1),
    "Argus sparse": ("b-xypts.tsv", "Row\tColumn\tEntry\n9\t4\t2\n2\t1\t5.5\n2\t2\t6.5\n", "argus-sparse", 2, 1, 9),
    "Argus cameras": ("x.txt", "900 320 240 1 0 0 0 0 0 0 1 0 0 0 0 0 5\n" * 2, "argus-sba-profile", 0, 2, 0),
    "sparse points": (
        "b-xyzpts.tsv",
        "Sparse format 3D coordinates file\n9\t6\t1\n2\t1\t5.5\n",
        "dltdv-sparse",
        2,
        0,
        9,
    ),
    "point names": ("x", "PointNames_to_go_with_DLTdv8a_sparsesave_arrays\na\nb\n", "dltdv-point-names", 2, 0, 0),
    "XMALab frames": ("x.csv", "Frame,a_X,a_Y,a_Z\n7,1,2,3\n8,NaN,NaN,NaN\n", "xmalab-3d", 1, 0, 2),
    "XMALab offsets": (
        "x.csv",
        "cam0_offsetcam1_offseta_cam1_X,a_cam1_Y,a_cam2_X,a_cam2_Y\n0,0,1,2,3,4\n",
        "xmalab-2d",
        1,
        2,
        1,
    ),
    "Anipose": (
        "x.csv",
        "a_x,a_y,a_z,a_error,a_ncams,a_score,fnum\n1,2,3,0.5,2,0.9,0\n1,2,3,10,2,0.9,1\n",
        "anipose-3d",
        1,
        0,
        2,
    ),
    "Lightning Pose": (
        "x.csv",
        "scorer,lp,lp,lp\nbodyparts,a,a,a\ncoords,x,y,likelihood\n0,1,2,0.5\n",
        "deeplabcut-csv",
        1,
        1,
        1,
    ),
    "two animals": (
        "x.csv",
        "scorer,s,s,s,s\nindividuals,i,i,j,j\nbodyparts,a,a,a,a\ncoords,x,y,x,y\n0,1,2,,\n",
        "deeplabcut-csv",
        2,
        1,
        1,
    ),
    "labels by hand": (
        "x.csv",
        "scorer,,,s,s\nbodyparts,,,a,a\ncoords,,,x,y\nlabeled-data,v,img0001.png,1,2\nlabeled-data,v,img0009.png,,\n",
        "deeplabcut-csv",
        1,
        1,
        2,
    ),
    "a comma at each line's end": ("x.csv", "pt1_cam1_X,pt1_cam1_Y,\n1,2,\n3,4,\n", "dltdv-xypts", 1, 1, 2),
    "QTM without titles": ("x.tsv", QTM + "1\t2\t3\t4\t5\t6\n7\t8\t9\t\t\t\n", "qualisys-tsv", 2, 0, 2),
    "QTM with frames, without titles": (
        "x.tsv",
        QTM + "7\t0.06\t1\t2\t3\t4\t5\t6\t\n8\t0.07\t7\t8\t9\t\t\t\t\n",
        "qualisys-tsv",
        2,
        0,
        2,
    ),
    "plain": ("x.csv", "time,hip.x,hip.y,hip.z\n0,1,2,3\n0.1,4,5,6\n", "csv", 1, 0, 2),
}


@pytest.mark.parametrize("case", SMALL)
def test_small_files_as_the_programs_write_them(case, tmp_path):
    """Variants that no real file here shows: format, points, cameras, frames."""
    name, content, *expected = SMALL[case]
    (tmp_path / name).write_text(content)
    recording = read(tmp_path / name)
    found = [recording.format, len(recording.names), len(recording.camera_names), len(recording.frames)]
    assert found == expected


def test_values_of_small_files(tmp_path):
    """Columns by name, cameras by number, codes as the programs mean them."""

    def small(case):
        name, content, *_ = SMALL[case]
        (tmp_path / name).write_text(content)
        return read(tmp_path / name)

    np.testing.assert_array_equal(small("Argus").pixels.uv_px[:, 0, 0], [[1, 2], [3, 4]])
    assert small("Argus").camera_names == ("cam1", "cam10")
    np.testing.assert_array_equal(small("Argus intervals").tables["interval"][0, 0], [0.5, 1, 1.5])
    np.testing.assert_array_equal(small("XMALab offsets").pixels.uv_px[:, 0, 0], [[1, 2], [3, 4]])
    np.testing.assert_array_equal(small("XMALab frames").frames, [7, 8])
    assert small("DLTdv filtered").points.status[0, 0] == Status.SMOOTHED
    np.testing.assert_array_equal(small("Anipose").points.status[:, 0], [Status.MEASURED, Status.INTERPOLATED])
    np.testing.assert_array_equal(small("Argus sparse").pixels.seen[0, :, 0], np.arange(9) == 1)
    assert small("plain").fps == 10.0
    for case, first in (("QTM without titles", 1), ("QTM with frames, without titles", 7)):
        assert small(case).frames[0] == first
        np.testing.assert_allclose(small(case).points.xyz_m[0], [[1e-3, 2e-3, 3e-3], [4e-3, 5e-3, 6e-3]])
        np.testing.assert_array_equal(small(case).points.seen[1], [True, False])
    assert small("two animals").animals == (("i", "a"), ("j", "a"))


def test_sparse_files_know_their_cameras_and_names(tmp_path):
    """The offsets beside a sparse file tell how many cameras there are, and pointNames.tsv the names; or the user."""
    cells = "".join(f"1\t{c}\t{c}\n" for c in range(1, 9))
    (tmp_path / "b_xypts.tsv").write_text(f"Sparse format camera coordinates file\n3\t8\t8\n{cells}")
    stated = read(tmp_path / "b_xypts.tsv", Hints(cameras=4))
    np.testing.assert_array_equal(stated.pixels.uv_px[:, 0, 0], [[1, 2], [3, 4], [5, 6], [7, 8]])
    (tmp_path / "b_offsets.tsv").write_text("Sparse format camera offsets file\n3\t2\t1\n1\t2\t5\n")
    (tmp_path / "b_pointNames.tsv").write_text("PointNames_to_go_with_DLTdv8a_sparsesave_arrays\ntip of wing\nroot\n")
    told = read(tmp_path / "b_xypts.tsv")
    assert told.names == ("tip of wing", "root")
    assert len(told.camera_names) == 2
    np.testing.assert_array_equal(told.pixels.uv_px[:, 0, 1], [[5, 6], [7, 8]])
    with pytest.raises(FormatError, match="not a whole number of points for 3 cameras"):
        read(tmp_path / "b_xypts.tsv", Hints(cameras=3))


def test_anipose_turns_back(tmp_path):
    """(p + center) M undoes the frame that Anipose put its points into: p = M x - center for a rotation M."""
    rng = np.random.default_rng(0)
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    centre, world = rng.normal(size=3), rng.normal(size=(5, 3))
    table = {f"a_{axis}": (world @ rotation.T - centre)[:, k] for k, axis in enumerate("xyz")}
    table |= {"a_error": 0.5, "a_ncams": 2, "a_score": 0.9}
    table |= {f"M_{i}{j}": rotation[i, j] for i in range(3) for j in range(3)}
    table |= {f"center_{i}": centre[i] for i in range(3)} | {"fnum": np.arange(5)}
    pd.DataFrame(table).to_csv(tmp_path / "a.csv", index=False)
    np.testing.assert_allclose(read(tmp_path / "a.csv").points.xyz_m[:, 0], world, atol=1e-12)


def test_sba_profiles_place_cameras(tmp_path):
    """A camera 5 before the origin that is turned about its axis by 90 degrees: x appears along v."""
    half = np.sqrt(0.5)
    (tmp_path / "p.txt").write_text(f"900 320 240 1 0 -0.1 0 0 0 0 {half} 0 0 {half} 0 0 5\n")
    (camera,) = read_sba_profile(tmp_path / "p.txt")
    uv = project(stacked([camera]), np.array([[0.0, 0, 0], [1.0, 0, 0]]))[0]
    np.testing.assert_allclose(uv, [[320, 240], [320, 240 + 900 / 5]], atol=1e-9)
    assert camera.lens.k == (-0.1, 0.0, 0.0)


def test_columns_can_be_stated(tmp_path):
    """Titles or numbers, with and without a header; what is not there is named."""
    path = tmp_path / "a.csv"
    path.write_text("t,foo,bar,baz,u,v\n0,1,2,3,4,5\n1,6,7,8,9,10\n")
    with pytest.raises(FormatError, match="state what the columns are"):
        read(path)
    recording = read(path, Hints(columns=parse_columns("tip=foo,bar,baz; time=t")))
    np.testing.assert_array_equal(recording.points.xyz_m[:, 0], [[1, 2, 3], [6, 7, 8]])
    assert recording.fps == 1.0
    flat = read(path, Hints(columns=parse_columns("tip=5,6")))
    np.testing.assert_array_equal(flat.pixels.uv_px[0, :, 0], [[4, 5], [9, 10]])
    with pytest.raises(FormatError, match="no column 'nose'"):
        read(path, Hints(columns=parse_columns("tip=nose,bar,baz")))
    path.write_text("1,2,3\n4,,6\n")
    np.testing.assert_array_equal(read(path, Hints(columns=parse_columns("a=1,2,3"))).points.seen[:, 0], [True, False])


def test_trc_is_read_by_its_times(tmp_path):
    """A wrong DataRate is told, times go before it; empty, NaN and (0, 0, 0) are gaps; metres are metres."""
    head = "PathFileType\t4\t(X/Y/Z)\ta.trc\n" + "\t".join(
        ["DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units", "OrigDataRate", "OrigDataStartFrame", "OrigNum"]
    )
    rows = "1\t0.00\t1\t2\t3\n2\t0.01\t\t\t\n3\t0.02\tNaN\tNaN\tNaN\n4\t0.03\t0\t0\t0\n"
    text = f"{head}\n60\t60\t4\t1\tm\t60\t1\t4\nFrame#\tTime\ttip\t\t\n\t\tX1\tY1\tZ1\n\n{rows}"
    (tmp_path / "a.trc").write_text(text)
    recording = read(tmp_path / "a.trc")
    assert recording.fps == pytest.approx(100.0)
    np.testing.assert_array_equal(recording.points.seen[:, 0], [True, False, False, False])
    np.testing.assert_array_equal(recording.points.xyz_m[0, 0], [1, 2, 3])
    assert "DataRate says 60" in " ".join(recording.findings)
    (tmp_path / "b.trc").write_text("\n".join(text.split("\n")[:-2]) + "\n")
    assert "NumFrames is 4, but there are 3 rows" in " ".join(read(tmp_path / "b.trc").findings)


def test_unsupported_cameras_are_refused_by_name(tmp_path):
    """Omnidirectional models are no lens here; the message says which model it is."""
    for columns, name in ((13, "CMei"), (19, "Scaramuzza")):
        path = tmp_path / f"{columns}.txt"
        path.write_text(" ".join(["1"] * columns) + "\n")
        assert identify(path).name == "camera-profile"
        with pytest.raises(FormatError, match=f"{name}.*not supported"):
            read(path)


def test_names_of_formats_are_unique():
    names = [format.name for format in formats()]
    assert len(set(names)) == len(names)


def test_every_file_with_a_format_has_its_place():
    """What defines one stands in ``PLACES``, or is never asked; the last one takes any table."""
    folder = Path(registry.__file__).parent
    defining = {
        path.stem
        for path in folder.glob("*.py")
        if re.search(r"^@file_format\(|^[A-Z_0-9]+ = Format\(", path.read_text(encoding="utf-8"), re.MULTILINE)
    }
    assert len(defining) > 20
    assert defining == {place.partition(":")[0] for place in registry.PLACES} - {registry.ELSEWHERE}
    assert [format.name for format in formats()][-1] == "csv"


def test_a_known_file_loads_the_formats_before_it_only(tmp_path):
    """A table of DLTdv is the second thing that is asked for: the other formats' files are not read by Python."""
    path = tmp_path / "flight_xypts.csv"
    path.write_text("pt1_cam1_X,pt1_cam1_Y\n1.5,2.5\n1.6,2.6\n")
    code = (
        "import sys; from pathlib import Path; from mocap.io.registry import identify; "
        f"print(identify(Path({str(path)!r})).name, 'mocap.io.dltdv' in sys.modules, 'mocap.io.nwb' in sys.modules)"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120)
    assert told.stdout.split() == ["dltdv-xypts", "True", "False"]
