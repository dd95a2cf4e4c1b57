"""Pickles of other programs, of which nothing is run: numbers, texts, arrays, lists and dictionaries."""

import io
import pickle
from typing import Any

_ARRAYS = ("_reconstruct", "ndarray", "dtype", "scalar", "_frombuffer")
"""What NumPy names in the pickle of an array."""


class _Inert(dict):
    """Stands for whatever else a pickle names; it runs nothing, and keeps nothing."""

    def __init__(self, *_given: Any, **_more: Any) -> None:
        super().__init__()

    def _nothing(self, *_given: Any) -> "_Inert":
        return _Inert()

    __setstate__ = __call__ = append = extend = _nothing


class _Plain(pickle.Unpickler):
    inert = False

    def find_class(self, module: str, name: str) -> Any:
        if module.split(".")[0] == "numpy" and name in _ARRAYS:
            return super().find_class(module, name)
        if self.inert:
            return _Inert
        raise pickle.UnpicklingError(f"{module}.{name} is neither a number, a text nor an array")


def plain_pickle(data: bytes, *, inert: bool = False) -> Any:
    """What a pickle holds.

    Args:
        data: The pickle.
        inert: Whether other objects in it are passed over; else they are refused.

    Raises:
        Exception: a damaged pickle raises whatever it likes; ``pickle.UnpicklingError``: it holds another object.
    """
    unpickler = _Plain(io.BytesIO(data))
    unpickler.inert = inert
    return unpickler.load()
