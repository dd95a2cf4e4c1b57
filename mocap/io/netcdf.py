"""Datasets as NetCDF, made in memory: a full disk ends the HDF5 library with a segmentation fault.

Written and read with h5py itself, by the rules that NetCDF-4 lays down for HDF5 files (NetCDF User's Guide, "File
format specifications: NetCDF-4"): h5netcdf, which xarray uses, takes 8 ms for each variable and its dimensions, and so
a quarter of the time of a short trial, and most of the time in which a result is read. It reads what is not plain.
"""

from collections.abc import Collection, Mapping
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mocap.documents import damaged
from mocap.errors import FormatError
from mocap.io.apart import CLASSIC_NETCDF, check_bytes
from mocap.schema import Schema, checked

if TYPE_CHECKING:  # xarray takes a fifth of a second, which files of other kinds need not wait for
    import xarray as xr

PACKED = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
NO_VARIABLE = "This is a netCDF dimension but not a netCDF variable.{:10}"
"""Name of the dimension scale of a dimension without coordinates."""
_DIMENSION, _DIMENSIONS = "_Netcdf4Dimid", "_Netcdf4Coordinates"
_INNER = {"CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST", "_NCProperties", _DIMENSION, _DIMENSIONS}
"""Attributes that are of the format, not of what is stored."""


def as_netcdf(dataset: "xr.Dataset", *, packed: bool = False, loose: Collection[str] = ()) -> bytes:
    """The bytes of a NetCDF file, where ``packed`` with variables compressed, but for text and the ``loose`` ones."""
    import h5py
    from xarray.conventions import cf_encoder, encode_dataset_coordinates

    variables, attributes = cf_encoder(*encode_dataset_coordinates(dataset))
    coordinates = sorted(map(str, dataset.coords))  # xarray keeps them in sets: in another order in each process
    numbers = {str(name): i for i, name in enumerate(sorted(dataset.sizes, key=str))}
    written = BytesIO()
    with h5py.File(written, "w", track_order=True) as file:
        scales, others = {}, []
        names = dict.fromkeys((*coordinates, *map(str, variables)))
        for name in sorted(names, key=lambda name: name not in numbers):  # dimensions first
            one = variables[name]
            pack = packed and name in dataset.data_vars and name not in loose and one.size and one.ndim
            data = _write(file, name, one, PACKED if pack else {})
            data.attrs.create(_DIMENSIONS, np.array([numbers[str(dim)] for dim in one.dims], dtype=np.int32))
            if name in numbers:
                scales[name] = _scale(data, name, numbers[name])
            else:
                others.append((data, one.dims))
        for name, number in numbers.items():
            if name not in scales:
                size = dataset.sizes[name]
                data = file.create_dataset(name, (size,), ">f4", maxshape=None if size else (None,), track_order=True)
                scales[name] = _scale(data, NO_VARIABLE.format(size), number)
        for data, dims in others:
            for axis, dim in enumerate(dims):
                data.dims[axis].attach_scale(scales[str(dim)])
        _attributes(file, attributes)
    return written.getvalue()


def _write(file, name: str, variable: "xr.Variable", pack: Mapping[str, Any]):
    """A variable as a dataset of the file; a dimension without entries may grow, as NetCDF has no other."""
    import h5py

    attributes = dict(variable.attrs)
    values = np.asarray(variable.values)
    text = values.dtype.kind in "UO"
    data = file.create_dataset(
        name,
        values.shape,
        h5py.string_dtype() if text else values.dtype,
        values.astype(object) if text else values,
        maxshape=None if values.size else tuple(size or None for size in values.shape),
        fillvalue=attributes.get("_FillValue"),
        track_order=True,
        **({} if text else pack),
    )
    if "_FillValue" in attributes:
        attributes["_FillValue"] = values.dtype.type(attributes["_FillValue"])
    _attributes(data, attributes)
    return data


def _scale(data, title: str, number: int):
    data.attrs.create(_DIMENSION, np.int32(number))
    data.make_scale(title)
    return data


def _attributes(place, attributes: Mapping[Any, Any]) -> None:
    for name, value in attributes.items():
        place.attrs[name] = value if isinstance(value, str) else np.atleast_1d(value)


def _plain(path: Path) -> "xr.Dataset | None":
    """A file of numbers and text along named dimensions, as xarray decodes it; None: there is more in it, or less."""
    import h5py
    import xarray as xr
    from xarray.conventions import decode_cf_variables

    try:
        with h5py.File(path, "r") as file:
            check_bytes(path, sum(one.size * one.dtype.itemsize for one in file.values()), "its variables")
            found = {name: one for name, data in file.items() if (one := _variable(file, name, data)) is not None}
            decoded, attributes, coordinates = decode_cf_variables(found, _plain_attributes(file))
        return xr.Dataset(decoded, attrs=attributes).set_coords(coordinates & decoded.keys()).load()
    except FormatError:
        raise
    except Exception:  # whatever is wrong with it, xarray tells
        return None


def _variable(file: Any, name: str, data: Any) -> "xr.Variable | None":
    """A variable as it is stored; None: a dimension without coordinates."""
    import h5py
    import xarray as xr

    label = data.attrs.get("NAME") if data.attrs.get("CLASS") == b"DIMENSION_SCALE" else None
    if label is not None and label.startswith(NO_VARIABLE[:20].encode()):
        return None
    text = h5py.check_string_dtype(data.dtype)
    if text.length is not None if text else data.dtype.kind not in "iuf":
        raise ValueError(f"{name}: other entries than numbers and text")
    if label is not None:
        (dims,) = [(name,) for _ in data.shape]
    else:
        links = data.attrs["DIMENSION_LIST"] if data.ndim else ()
        dims = tuple(h5py.h5r.get_name(link[-1], file.id).decode().removeprefix("/") for link in links)
    values = np.asarray(data.asstr()[()], dtype=object) if text else data[()]
    return xr.Variable(dims, values, _plain_attributes(data), {"dtype": str} if text else {})


def _plain_attributes(place: Any) -> dict[str, Any]:
    """What ``_attributes`` writes; a list of one number is a number."""
    found = {}
    for name in place.attrs.keys() - _INNER:
        value = place.attrs[name]
        if not isinstance(value, str) and np.asarray(value).dtype.kind not in "iuf":
            raise ValueError(f"{name}: neither a number nor text")
        found[name] = value[0] if isinstance(value, np.ndarray) and len(value) == 1 else value
    return found


def read_netcdf(path: Path, *, again: str) -> "xr.Dataset":
    """A dataset in memory.

    Raises:
        FormatError: it cannot be read (``again`` says what to do), or announces more than a file of its size can hold.
    """
    import xarray as xr

    with damaged(f"{path}: cannot be read as NetCDF", again):
        with path.open("rb") as stream:
            classic = stream.read(4) in CLASSIC_NETCDF
        plain = None if classic else _plain(path)
        if plain is not None:
            return plain
        with xr.open_dataset(path, engine="scipy" if classic else "h5netcdf") as file:
            check_bytes(path, sum(one.nbytes for one in file.variables.values()), "its variables")
            return file.load()


def variables(
    where: str, dataset: "xr.Dataset", schema: Schema, *, sizes: dict[str, int] | None = None, again: str
) -> dict[str, Any]:
    """``mocap.schema.checked`` of variables, their axes in the order of the schema, which names the dimensions.

    Raises:
        FormatError: a variable is missing, has other dimensions, or is not as its schema says.
    """
    found = {}
    for name in schema.keys() & set(map(str, dataset.variables)):
        dims, shape = dataset[name].dims, schema[name].shape
        if set(dims) != set(shape):
            raise FormatError(f"{where}: {name} has dimensions {dims}, expected {shape}: {again}")
        found[name] = dataset[name].transpose(*shape).values
    return checked(where, found, schema, sizes=sizes, again=again)
