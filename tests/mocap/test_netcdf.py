"""NetCDF files that we write are those that xarray's own writer, an independent program, writes."""

from io import BytesIO

import h5py
import numpy as np
import pytest
import xarray as xr

from mocap.errors import FormatError
from mocap.io.netcdf import _plain, as_netcdf, read_netcdf
from mocap.io.registry import identify

RNG = np.random.default_rng(0)
DATASETS = {
    "poses": xr.Dataset(
        {
            "position": (("time", "space", "keypoint"), RNG.normal(size=(40, 3, 5)), {"units": "m"}),
            "used": (("time", "keypoint"), RNG.random((40, 5)) < 0.5),
            "code": (("time", "keypoint"), RNG.integers(0, 5, (40, 5)).astype(np.int8), {"flag_values": np.arange(5)}),
            "meaning": ("keypoint", ["a", "", "längs", "µ", "b c"]),
            "whole": ((), 3.5),
        },
        coords={
            "time": ("time", np.arange(40) / 240, {"units": "s"}),
            "frame": ("time", np.arange(1, 41)),
            "keypoint": list("abcde"),
        },
        attrs={"fps": 240.0, "words": "x\ny", "numbers": np.array([1.5, np.nan])},
    ),
    "without cameras": xr.Dataset({"px": (("view", "time", "uv"), np.zeros((0, 4, 2))), "nis": ("time", np.arange(4))}),
    "one of each": xr.Dataset({"a": (("x", "y"), np.full((1, 1), np.nan, dtype=np.float32))}, coords={"x": ["only"]}),
    "empty": xr.Dataset(attrs={"header": "{}"}),
}


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("dataset", DATASETS.values(), ids=DATASETS)
def test_it_reads_as_what_xarray_writes(dataset, packed, tmp_path):
    """Names, dimensions, values, types, attributes and which dimensions may grow are the same to the bit."""
    dataset.to_netcdf(tmp_path / "theirs.nc", engine="h5netcdf")
    ours, theirs = (
        xr.open_dataset(BytesIO(written), engine="h5netcdf").load()
        for written in (as_netcdf(dataset, packed=packed), (tmp_path / "theirs.nc").read_bytes())
    )
    assert ours.identical(theirs)
    assert ours.sizes == theirs.sizes
    assert ours.encoding.get("unlimited_dims") == theirs.encoding.get("unlimited_dims")
    for name, variable in ours.variables.items():
        assert variable.dtype == theirs[name].dtype
        assert variable.encoding.get("_FillValue") is None or np.isnan(variable.encoding["_FillValue"])
        assert ("_FillValue" in variable.encoding) == ("_FillValue" in theirs[name].encoding)
    assert list(ours.variables) or not dataset.variables


@pytest.mark.parametrize("dataset", DATASETS.values(), ids=DATASETS)
def test_we_read_what_xarray_reads(dataset, tmp_path):
    """What either writes: the same names in the same order, dimensions, values, types and attributes, coordinates."""
    (tmp_path / "ours.nc").write_bytes(as_netcdf(dataset, packed=True))
    dataset.to_netcdf(tmp_path / "theirs.nc", engine="h5netcdf")
    for path in tmp_path.iterdir():
        ours, theirs = _plain(path), xr.open_dataset(path, engine="h5netcdf").load()
        assert ours is not None
        assert ours.identical(theirs)
        assert (list(ours.data_vars), list(ours.coords)) == (list(theirs.data_vars), list(theirs.coords))
        for name, variable in ours.variables.items():
            assert variable.dtype == theirs[name].dtype
            assert {k: type(v) for k, v in variable.attrs.items()} == {
                k: type(v) for k, v in theirs[name].attrs.items()
            }


def test_what_is_not_plain_is_left_to_xarray(tmp_path):
    """Groups, entries of other kinds, and dimensions without names; half a file is an error."""
    path = tmp_path / "odd.nc"
    whole = as_netcdf(DATASETS["poses"])
    for change in (
        lambda file: file.create_group("more"),
        lambda file: file.create_dataset("letters", data=np.array([b"ab"])),
        lambda file: file["position"].attrs.create("kinds", np.array([b"a", b"b"])),
        lambda file: file["position"].attrs.__delitem__("DIMENSION_LIST"),
    ):
        path.write_bytes(whole)
        with h5py.File(path, "r+") as file:
            change(file)
        assert _plain(path) is None
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(FormatError, match=r"odd\.nc: cannot be read as NetCDF .*: again"):
        read_netcdf(path, again="again")


def test_what_would_fill_the_memory_is_not_unpacked(tmp_path):
    """A gigabyte of nothing, announced by a file of some kilobytes."""
    with h5py.File(tmp_path / "bomb.nc", "w") as file:
        file.create_dataset("time", (1 << 27,), "f8", chunks=(1 << 20,)).make_scale("time")
    with pytest.raises(FormatError, match=r"bomb\.nc: its variables would take 1\.07 GB"):
        _plain(tmp_path / "bomb.nc")


def test_the_same_dataset_is_the_same_bytes():
    """A result depends on its content alone: no times, no addresses."""
    assert as_netcdf(DATASETS["poses"], packed=True) == as_netcdf(DATASETS["poses"], packed=True)


def test_a_classic_file_that_is_cut_or_foreign_is_refused(tmp_path):
    """By what is wrong with it: half of one that xarray wrote by SciPy, and one of other variables."""
    whole, cut = tmp_path / "whole.nc", tmp_path / "cut.nc"
    xr.Dataset({"depth": ("time", np.arange(500.0))}).to_netcdf(whole, engine="scipy")
    cut.write_bytes(whole.read_bytes()[:1000])
    with pytest.raises(FormatError, match="a NetCDF file with depth: not a known format"):
        identify(whole)
    with pytest.raises(FormatError, match=r"cut\.nc: cannot be read as NetCDF .*copy or export it again"):
        identify(cut)
