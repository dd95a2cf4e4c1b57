"""Datasets as NetCDF, made in memory: a full disk ends the HDF5 library with a segmentation fault."""

import sys
from collections.abc import Mapping
from contextlib import nullcontext
from typing import Any

import xarray as xr


def as_netcdf(dataset: xr.Dataset, *, encoding: Mapping[str, Any] | None = None) -> bytes:
    """The bytes of a NetCDF file.

    Where a Dask client is connected xarray asks its cluster for a lock by the name of the file, of which there is none:
    it is told that nothing is distributed.

    Args:
        dataset: What to write.
        encoding: Of each variable, as xarray takes it.
    """
    dask = sys.modules.get("dask")
    with nullcontext() if dask is None else dask.config.set(scheduler="synchronous"):
        return bytes(dataset.to_netcdf(engine="h5netcdf", encoding=encoding))
