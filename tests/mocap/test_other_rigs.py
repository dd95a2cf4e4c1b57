"""Calibrations and clicks of other programs: a rig written by their conventions sees points where it saw them."""

import json
import pickle

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mocap.cameras.camera import decompose, record
from mocap.errors import FormatError
from mocap.io.format import head
from mocap.io.registry import identify, nearest, read
from mocap.io.together import joined
from tests.mocap.rigs import cloud, ring

POINTS = cloud(np.random.default_rng(2), 50)
RIG = ring(3, lens=True)


def same(cameras, atol=1e-3):
    """Whether cameras record points as the rig does, in pixels."""
    np.testing.assert_allclose(record(cameras, POINTS), record(RIG, POINTS), atol=atol)


def test_qualisys(tmp_path):
    """QTM: 64 subpixels, millimetres, camera axes turned by pi about x, distortions without unit."""
    rows = []
    for camera in RIG:
        pin, lens = decompose(camera), camera.lens
        axes, place, k = np.diag([1, -1, -1]) @ pin.rotation, 1000 * pin.position_m, pin.intrinsic * 64
        r = " ".join(f'r{i + 1}{j + 1}="{axes[i, j]:.12f}"' for i in range(3) for j in range(3))
        rows.append(
            f'<camera active="1" calibrated="true" serial="{camera.name}" model="Miqus Video" viewrotation="0">\n'
            f'<fov_video left="0" top="0" right="1279" bottom="1023"/>\n'
            f'<transform x="{place[0]:.9f}" y="{place[1]:.9f}" z="{place[2]:.9f}" {r}/>\n'
            f'<intrinsic focallength="9" sensorMinU="0" sensorMaxU="{1280 * 64 - 1}" sensorMinV="0" '
            f'sensorMaxV="{1024 * 64 - 1}" focalLengthU="{k[0, 0]:.9f}" focalLengthV="{k[1, 1]:.9f}" '
            f'centerPointU="{k[0, 2]:.9f}" centerPointV="{k[1, 2]:.9f}" skew="0" radialDistortion1="{lens.k[0]}" '
            f'radialDistortion2="{lens.k[1]}" radialDistortion3="{lens.k[2]}" tangentalDistortion1="{lens.p[0]}" '
            f'tangentalDistortion2="{lens.p[1]}"/>\n</camera>'
        )
    path = tmp_path / "rig.qca.txt"
    path.write_text(f"<?xml version='1.0'?>\n<calibration><cameras>{''.join(rows)}</cameras></calibration>\n")
    found = read(path)
    assert (found.format, found.unit, found.cameras[0].size_px) == ("qualisys-calibration", "mm", (1280, 1024))
    same(found.cameras)


def test_vicon(tmp_path):
    """Vicon: quaternion world to camera, millimetres, a radial law from recorded to ideal pixels (0.05 px left)."""
    bare = ring(3)
    rows, law = [], (-3e-8, 2e-14)
    for camera in bare:
        pin = decompose(camera)
        q, place, k = Rotation.from_matrix(pin.rotation).as_quat(), 1000 * pin.position_m, pin.intrinsic
        text = [" ".join(f"{x:.12f}" for x in v) for v in (q, place, k[:2, 2])]
        rows.append(
            f'<Camera DEVICEID="{camera.name}" TYPE="Vue_VIDEO" SENSOR_SIZE="1280 1024" '
            f'PIXEL_ASPECT_RATIO="{k[0, 0] / k[1, 1]:.15f}"><KeyFrames><KeyFrame FRAME="0" FOCAL_LENGTH="{k[0, 0]}" '
            f'ORIENTATION="{text[0]}" POSITION="{text[1]}" PRINCIPAL_POINT="{text[2]}" WORLD_ERROR="0.3" '
            f'VICON_RADIAL2="Vicon3Parameter 640 512 {law[0]} {law[1]} 0"/></KeyFrames></Camera>'
        )
    path = tmp_path / "rig.xcp"
    path.write_text(f'<?xml version="1.0"?>\n<Cameras>{"".join(rows)}</Cameras>\n')
    found = read(path)
    assert (found.format, found.camera_names) == ("vicon-calibration", ("cam1", "cam2", "cam3"))
    back = record(found.cameras, POINTS)
    scale = np.array([1.0, 1 / 1.01])  # radii are of square pixels
    off = (back - [640, 512]) * scale
    square = (off**2).sum(axis=-1, keepdims=True)
    ideal = off * (1 + law[0] * square + law[1] * square**2) / scale + [640, 512]
    np.testing.assert_allclose(ideal, record(bare, POINTS), atol=0.05)


def test_easymocap(tmp_path):
    """EasyMocap: intrinsics and extrinsics in two files of OpenCV, read together; the first alone holds lenses."""

    def matrix(name, values):
        v = np.atleast_2d(values)
        data = ", ".join(f"{x:.12f}" for x in v.ravel())
        return f"{name}: !!opencv-matrix\n   rows: {v.shape[0]}\n   cols: {v.shape[1]}\n   dt: d\n   data: [{data}]\n"

    names = "%YAML:1.0\n---\nnames:\n" + "".join(f'   - "{c.name}"\n' for c in RIG)
    inside, outside = names, names
    for c in RIG:
        pin = decompose(c)
        inside += matrix(f"K_{c.name}", pin.intrinsic)
        inside += matrix(f"dist_{c.name}", [[*c.lens.k[:2], *c.lens.p, c.lens.k[2]]])
        outside += matrix(f"R_{c.name}", Rotation.from_matrix(pin.rotation).as_rotvec()[:, None])
        outside += matrix(f"Rot_{c.name}", pin.rotation) + matrix(f"T_{c.name}", pin.translation_m[:, None])
    (tmp_path / "intri.yml").write_text(inside)
    alone = read(tmp_path / "intri.yml")
    assert (len(alone.lenses), len(alone.cameras)) == (3, 0)
    (tmp_path / "extri.yml").write_text(outside)
    for name in ("intri.yml", "extri.yml"):
        same(read(tmp_path / name).cameras)


class _Runs:
    def __reduce__(self):
        return (print, ("a pickle that runs",))


def test_opencap(tmp_path, capsys):
    """OpenCap: a pickle a camera, put together by the folders' names; one that runs something is refused, unrun."""
    paths = []
    for c in RIG:
        pin = decompose(c)
        folder = tmp_path / c.name
        folder.mkdir()
        paths.append(folder / "cameraIntrinsicsExtrinsics.pickle")
        table = {
            "intrinsicMat": pin.intrinsic,
            "distortion": np.array([[*c.lens.k[:2], *c.lens.p, c.lens.k[2]]]),
            "imageSize": np.array([[1024.0], [1280.0]]),
            "rotation": pin.rotation,
            "translation": 1000 * pin.translation_m[:, None],
        }
        paths[-1].write_bytes(pickle.dumps(table))
    whole = joined([read(path) for path in paths])
    assert whole.camera_names == ("cam1", "cam2", "cam3")
    same(whole.cameras)
    paths[0].write_bytes(pickle.dumps({"intrinsicMat": _Runs()}))
    with pytest.raises(FormatError, match="not a camera of OpenCap"):
        read(paths[0])
    assert not capsys.readouterr().out


def openpose(folder, uv, score):
    """A folder of OpenPose's files from (T, K, 2) pixels and (T, K) likelihoods."""
    folder.mkdir(parents=True)
    for t, (points, likely) in enumerate(zip(uv, score, strict=True)):
        flat = np.concatenate([np.nan_to_num(points), likely[:, None]], axis=1).ravel().tolist()
        other = (np.array(flat) * 0.3 + 900).tolist()
        people = [
            {"person_id": [-1], "pose_keypoints_2d": p} for p in (flat, other)[: 1 + t % 2][:: 1 - 2 * (t % 3 == 1)]
        ]
        (folder / f"trial_{t:012d}_keypoints.json").write_text(json.dumps({"version": 1.3, "people": people}))


@pytest.mark.parametrize("sections", ["cam_{}", "Camera_{}_synchronized"])
def test_freemocap(tmp_path, sections):
    """Anipose's keys with the place in the world and metadata beside them; newer files name sections by the cameras."""
    text = []
    for i, camera in enumerate(RIG):
        parts, lens = decompose(camera), camera.lens
        values = {
            "name": f'"Camera_{i}"',
            "size": [1280, 1024],
            "matrix": parts.intrinsic.tolist(),
            "distortions": [lens.k[0], lens.k[1], *lens.p, lens.k[2]],
            "rotation": Rotation.from_matrix(parts.rotation).as_rotvec().tolist(),
            "translation": (-parts.rotation @ parts.position_m).tolist(),
            "world_orientation": parts.rotation.T.tolist(),
            "world_position": parts.position_m.tolist(),
        }
        text += [f"[{sections.format(i)}]", *(f"{key} = {value}" for key, value in values.items()), ""]
    text += ["[metadata]", "charuco_square_size = 51.0", 'date_time_calibrated = "2026-02-06T15:02:56"', ""]
    (tmp_path / "trial_camera_calibration.toml").write_text("\n".join(text))
    found = read(tmp_path / "trial_camera_calibration.toml")
    assert found.format == "anipose-calibration"
    assert found.camera_names == ("Camera_0", "Camera_1", "Camera_2")
    same(found.cameras)


def test_poses_of_mediapipe(tmp_path):
    """MediaPipe's 33 landmarks as Pose2Sim writes them: OpenPose's layout, named as BlazePose names them."""
    uv = np.random.default_rng(5).uniform(100, 200, (4, 33, 2))
    openpose(tmp_path / "cam1_json", uv, np.full((4, 33), 0.7))
    found = read(tmp_path / "cam1_json")
    assert (found.names[0], found.names[16], found.names[32]) == ("nose", "right_wrist", "right_foot_index")
    np.testing.assert_allclose(found.pixels.uv_px[0], uv)
    assert (found.score == 0.7).all()


def test_poses_a_file_a_frame(tmp_path):
    """Two cameras of OpenPose's BODY_25: pixels, likelihoods, names, frame numbers; zeros are gaps; one person only."""
    rng = np.random.default_rng(3)
    uv = 100 + rng.uniform(0, 20, (2, 8, 25, 2)) + np.arange(8)[None, :, None, None]
    score = rng.uniform(0.3, 1, (2, 8, 25))
    uv[0, 3, 4], score[0, 3, 4] = 0.0, 0.0
    for c in range(2):
        openpose(tmp_path / "pose" / f"cam{c + 1}_json", uv[c], score[c])
    found = read(tmp_path / "pose")
    assert found.pixels is not None
    assert found.camera_names == ("cam1_json", "cam2_json")
    assert found.names[:3] == ("nose", "neck", "right_shoulder")
    assert found.frames.tolist() == list(range(8))
    assert np.isnan(found.pixels.uv_px[0, 3, 4]).all()
    keep = np.ones((2, 8, 25), dtype=bool)
    keep[0, 3, 4] = False
    np.testing.assert_allclose(found.pixels.uv_px[keep], uv[keep])
    assert found.score is not None
    np.testing.assert_allclose(found.score[keep], score[keep])
    assert any("one is followed" in text for text in found.findings)
    one = read(tmp_path / "pose" / "cam1_json" / "trial_000000000002_keypoints.json")
    assert (one.format, len(one.frames)) == ("pose-json", 1)


def test_poses_of_mmpose(tmp_path):
    """RTMPose's own list of instances, with likelihoods, in one file for all frames."""
    frames = [
        {"frame_id": t + 1, "instances": [{"keypoints": [[t, 1.0]] * 17, "keypoint_scores": [0.5] * 17}]}
        for t in range(3)
    ]
    (tmp_path / "results.json").write_text(json.dumps({"meta_info": {}, "instance_info": frames}))
    found = read(tmp_path / "results.json")
    assert found.names[5] == "left_shoulder"
    assert found.pixels is not None
    np.testing.assert_allclose(found.pixels.uv_px[0, :, 0], [[0, 1], [1, 1], [2, 1]])
    assert (found.score == 0.5).all()


UNKNOWN = {
    "rats.csv": ("scorer,net,net\nbodyparts,paw,paw\nlikelihoods,x,y\n0,1,2\n", "a table of 3 columns", "deeplabcut"),
    "a.xml": ("<?xml version='1.0'?>\n<Cameras><Camera SIZE='1'/></Cameras>\n", "XML with Cameras", "vicon"),
    "b.json": ('{"fps": 3, "people_count": [1]}\n', "JSON with fps, people_count", "pose-json"),
    "d.txt": ("MARKER_NAMES\ta\tb\nNO_OF_MARKERS\t3\n1\t2\t3\n2\t3\t4\n", "begins", "qualisys-tsv"),
    "e.yml": ("%YAML:1.0\n---\nnames:\n   - '1'\n", "%YAML", "easymocap"),
}


@pytest.mark.parametrize("name", UNKNOWN)
def test_an_unknown_file_is_answered_by_what_it_looks_like(name, tmp_path):
    """One line: what it is, the three nearest formats and among them the right one, not a list of forty."""
    text, says, right = UNKNOWN[name]
    path = tmp_path / name
    path.write_text(text)
    near = [format.name for format in nearest(head(path))]
    assert len(near) == 3
    assert any(right in n for n in near), near
    with pytest.raises(FormatError) as told:
        identify(path)
    assert says in str(told.value)
    assert len(str(told.value)) < 500


def test_a_folder_that_is_no_recording_says_what_is_in_it(tmp_path):
    """Of an empty folder, of one with other files, and of one whose JSON holds nobody, the error says so."""
    (tmp_path / "empty").mkdir()
    (tmp_path / "other").mkdir()
    for name in ("a.mat", "b.csv", "c.txt", "d.txt"):
        (tmp_path / "other" / name).write_text("x")
    (tmp_path / "people").mkdir()
    (tmp_path / "people" / "f_000_keypoints.json").write_text('{"people": []}')
    for name, said in (
        ("empty", "empty: is a folder with nothing in it: give a file"),
        ("other", r"other: is a folder without poses .*in it: a.mat, b.csv, c.txt, ... \(4 in all\): give a file"),
        ("people", "people: a folder is read as JSON files with poses, and no person is found"),
    ):
        with pytest.raises(FormatError, match=said):
            read(tmp_path / name)
