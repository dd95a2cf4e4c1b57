"""Files that are known and not read: each is named for what it is, and what it says to export is read."""

import zipfile

import numpy as np
import pandas as pd
import pytest

from mocap.errors import FormatError
from mocap.io.registry import identify, read

KALMAN = ("obj_id", "frame", "timestamp", "x", "y", "z", "xvel", "yvel", "zvel", "P00", "P11", "P22")


def tracked():
    """Two objects over six frames, as Flydra and Braid store them: a row for each object and frame."""
    rng = np.random.default_rng(0)
    rows = [(o, f, 1.5e9 + f / 100, *rng.normal(size=9)) for f in range(100, 106) for o in (7, 9)]
    return pd.DataFrame(rows, columns=list(KALMAN))


def test_jabs(tmp_path):
    """A file that sleap-io writes for JABS is no unknown HDF5."""
    sio = pytest.importorskip("sleap_io")
    jabs = pytest.importorskip("sleap_io.io.jabs")
    skeleton, track = jabs.JABS_DEFAULT_SKELETON, sio.Track("1")
    video = sio.Video(filename="a.mp4", backend_metadata={"shape": (4, 100, 100, 1)}, open_backend=False)
    points = np.arange(2.0 * len(skeleton.nodes)).reshape(-1, 2)
    known = {"skeleton": skeleton, "point_scores": np.ones(len(points)), "score": 1.0, "track": track}
    frames = [
        sio.LabeledFrame(video=video, frame_idx=t, instances=[sio.PredictedInstance.from_numpy(points + t, **known)])
        for t in range(4)
    ]
    labels = sio.Labels(frames, videos=[video], skeletons=[skeleton], tracks=[track])
    labels.provenance["filename"] = ""
    sio.save_jabs(labels, 4, str(tmp_path))
    path = next(tmp_path.rglob("*.h5"))
    assert identify(path).name == "jabs"
    with pytest.raises(FormatError, match=r"poses of JABS .* export them as NWB .*convert-to-nwb"):
        read(path)


def test_flydra(tmp_path):
    """A file that PyTables writes as Flydra does is named; the table that is to be exported in its place is read."""
    tables = pytest.importorskip("tables")
    path, table = tmp_path / "DATA20101208.h5", tracked()
    with tables.open_file(str(path), "w") as file:
        file.create_table("/", "kalman_estimates", table.to_records(index=False))
        file.create_table("/", "data2d_distorted", np.zeros(2, dtype=[("camn", "u2"), ("frame", "i8"), ("x", "f4")]))
    assert identify(path).name == "flydra"
    with pytest.raises(FormatError, match=r"tracks of Flydra .*<obj_id>_x, <obj_id>_y, <obj_id>_z"):
        read(path)
    wide = table.pivot(index="frame", columns="obj_id", values=["x", "y", "z"]).swaplevel(axis=1).sort_index(axis=1)
    wide.columns = [f"{name}_{axis}" for name, axis in wide.columns]
    wide.to_csv(tmp_path / "flies.csv")
    found = read(tmp_path / "flies.csv")
    assert found.names == ("7", "9")
    assert found.frames[0] == 100
    assert found.points is not None
    one = table[table.obj_id == 9][["x", "y", "z"]].to_numpy()
    np.testing.assert_allclose(found.points.xyz_m[:, 1], one, atol=1e-12)


def test_braid(tmp_path):
    """Its archive, and its tables of positions and detections outside it, are named; another archive is not."""
    text = tracked().to_csv(index=False)
    for name in ("20191125_093257.braidz", "other.zip"):
        with zipfile.ZipFile(tmp_path / name, "w") as archive:
            archive.writestr("data2d_distorted.csv.gz" if name.endswith("braidz") else "data.csv", "x")
    (tmp_path / "kalman_estimates.csv").write_text(text)
    (tmp_path / "data2d_distorted.csv").write_text("camn,frame,timestamp,cam_received_timestamp,x,y\n0,1,1.5,1.5,3,4\n")
    for name in ("20191125_093257.braidz", "kalman_estimates.csv", "data2d_distorted.csv"):
        with pytest.raises(FormatError, match="a recording of Braid"):
            read(tmp_path / name)
    with pytest.raises(FormatError, match="ZIP archive"):
        read(tmp_path / "other.zip")
