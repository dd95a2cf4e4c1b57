"""NetCDF files that we write are those that xarray's own writer, an independent program, writes."""

from io import BytesIO

import numpy as np
import pytest
import xarray as xr

from mocap.io.netcdf import as_netcdf

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


def test_the_same_dataset_is_the_same_bytes():
    """A result depends on its content alone: no times, no addresses."""
    assert as_netcdf(DATASETS["poses"], packed=True) == as_netcdf(DATASETS["poses"], packed=True)
