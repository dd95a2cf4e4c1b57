"""A result of the format before is read for one release: one of this format, its header as that version wrote it."""

import json

import numpy as np
import pytest
from mocap.datasets import make_bat

import mocap
from mocap.io.netcdf import as_netcdf, read_netcdf
from mocap.json_records import plain
from mocap.results.earlier import WITHOUT_PARTS


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """A result, and its folder as the version before would have written it."""
    folder = tmp_path_factory.mktemp("earlier") / "out"
    film = make_bat(seed=3, n_frames=40, n_cameras=3)
    given = {"names": film.pixels.names, "fps": film.fps, "unit": "m", "skeleton": film.skeleton}
    read = mocap.from_pixels(film.pixels.uv_px, film.cameras, **given)
    result = mocap.track(read, model="constant_velocity", validate=False)
    result.save(folder)
    file = folder / "recording.nc"
    data = read_netcdf(file, again="again")
    header = json.loads(data.attrs["header"])
    parts = header.pop("parts")
    del header["source"]
    told = [plain(one) for one in result.findings]
    header |= {"format": WITHOUT_PARTS, "findings": told, "potentials": parts["potentials"]}
    data = data.drop_vars("unknown", errors="ignore").assign_attrs(header=json.dumps(header))
    file.write_bytes(as_netcdf(data, packed=True))
    return result, folder


@pytest.mark.rare
def test_a_result_of_the_format_before_is_read(both):
    """Data, potentials, findings and report are those that were saved; it is saved as one of this format."""
    result, folder = both
    found = mocap.load(folder)
    np.testing.assert_array_equal(found.data["position"], result.data["position"])
    np.testing.assert_array_equal(found.motion.velocity_m_s, result.motion.velocity_m_s)
    assert found.potentials.keys() == result.potentials.keys()
    assert {one.text for one in found.findings} == {one.text for one in result.findings}
    assert found.report == json.loads((folder / "report.json").read_text(encoding="utf-8"))
    found.save(folder.parent / "new")
    assert mocap.load(folder.parent / "new").findings == found.findings


def test_it_is_not_tracked_again(both):
    """Its positions are smoothed: taken for measured ones, their errors would be counted as independent."""
    with pytest.raises(mocap.MocapError, match="was tracked already"):
        mocap.track(mocap.load(both[1]))


def test_what_is_older_is_refused(both, tmp_path):
    """By the name of its format."""
    data = read_netcdf(both[1] / "recording.nc", again="again")
    header = json.loads(data.attrs["header"]) | {"format": "eal-mocap run 2"}
    for name in ("markers.nc", "skeleton.toml", "report.json", "report.md"):
        (tmp_path / name).write_bytes((both[1] / name).read_bytes())
    (tmp_path / "recording.nc").write_bytes(as_netcdf(data.assign_attrs(header=json.dumps(header)), packed=True))
    with pytest.raises(mocap.MocapError, match=r"run 2, expected .*: track again"):
        mocap.load(tmp_path)
