"""Whether two results are the same, in all that they hold and answer."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cached_property

import numpy as np
import pandas as pd
import xarray as xr

from mocap.cameras.lens import Lens
from mocap.errors import MocapError
from mocap.results.stored import PARTS

NOT_KEPT = {"folder", "file", "inputs", "source", "plot", "parts"}
"""Properties that are compared by their own fields; and where files lie, which results do not tell, but their names."""


def same(a, b, where):
    """Two values are the same to the last digit, and all that they hold."""
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        np.testing.assert_array_equal(b, a, err_msg=where)
    elif isinstance(a, xr.Dataset | xr.DataArray):
        xr.testing.assert_identical(b, a)
    elif isinstance(a, pd.DataFrame):
        pd.testing.assert_frame_equal(b, a)
    elif is_dataclass(a) and not isinstance(a, Lens):
        assert type(a) is type(b), where
        for one in fields(a):
            same(getattr(a, one.name), getattr(b, one.name), f"{where}.{one.name}")
    elif isinstance(a, Mapping):
        assert list(a) == list(b), where
        for key in a:
            same(a[key], b[key], f"{where}[{key}]")
    elif isinstance(a, list | tuple):
        assert len(a) == len(b), where
        for i, (one, other) in enumerate(zip(a, b, strict=True)):
            same(one, other, f"{where}[{i}]")
    else:
        assert a == b or (a != a and b != b), where


def public(kind):
    """Names of the properties of a class."""
    own = {name: one for base in kind.__mro__ for name, one in vars(base).items()}
    found = {name for name, one in own.items() if isinstance(one, property | cached_property)}
    return sorted(name for name in found - NOT_KEPT if not name.startswith("_"))


def answer(result, name):
    """What a property says, or why it says nothing."""
    try:
        return getattr(result, name)
    except MocapError as error:
        return str(error)


def same_result(saved, loaded):
    """All parts, what was given, and every public property."""
    assert set(loaded.parts) == set(saved.parts) <= set(PARTS.values())
    for name in public(type(saved)):
        same(answer(saved, name), answer(loaded, name), name)
    for kind in saved.parts:
        same(saved[kind], loaded[kind], kind.__name__)
    same(saved.source.by_names(), loaded.source.by_names(), "source")
    same(saved.summary(), loaded.summary(), "summary")
