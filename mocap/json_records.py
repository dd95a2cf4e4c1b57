"""Frozen records as JSON and back, by the annotations of their fields: what parts of a recording are in files.

Numbers keep all their digits (Python's JSON writes the shortest that is the same; NaN and Infinity as Python does).
"""

import types
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from mocap.errors import FormatError

R = TypeVar("R")
AGAIN = "track again"


def plain(value: Any) -> Any:
    """A record, or what its fields hold, as JSON has it: arrays as nested lists, records as tables by their fields."""
    if is_dataclass(value) and not isinstance(value, type):
        return {one.name: plain(getattr(value, one.name)) for one in fields(value)}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(key): plain(one) for key, one in value.items()}
    if isinstance(value, tuple | list):
        return [plain(one) for one in value]
    if isinstance(value, Enum):
        return value.value
    return str(value) if isinstance(value, Path) else value


def record(kind: type[R], entries: Any, where: str) -> R:
    """A record of this class, of what ``plain`` made of one; fields that are not there have their defaults.

    Raises:
        FormatError: an entry is missing, unknown, or no value of its field's type; ``where`` begins the message.
    """
    if not isinstance(entries, dict):
        raise _wrong(where, "a table", entries)
    hints = _hints(kind)
    if unknown := entries.keys() - hints.keys():
        raise FormatError(f"{where}: has {min(map(str, unknown))}, which is not known: {AGAIN}")
    values = {name: _value(hints[name], entry, f"{where}: {name}") for name, entry in entries.items()}
    try:
        return kind(**values)
    except (TypeError, ValueError) as error:
        raise FormatError(f"{where}: {error}: {AGAIN}") from None


@cache
def _hints(kind: type) -> dict[str, Any]:
    """Annotations of its fields."""
    hints = get_type_hints(kind)
    return {one.name: hints[one.name] for one in fields(kind)}  # type: ignore[arg-type]


def _wrong(where: str, expected: str, found: Any) -> FormatError:
    return FormatError(f"{where}: is {str(found)[:40]!r}, expected {expected}: {AGAIN}")


def _value(hint: Any, entry: Any, where: str) -> Any:
    """A value of this type."""
    hint = _without_alias(hint)
    origin, args = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return _value(args[0], entry, where)
    if origin in (Union, types.UnionType):
        if entry is None and type(None) in args:
            return None
        return _value(next(one for one in args if one is not type(None)), entry, where)
    if origin is Literal:
        if entry not in args:
            raise _wrong(where, " or ".join(map(str, args)), entry)
        return entry
    if origin is np.ndarray:
        return _array(args[1], entry, where)
    if origin is tuple:
        if not isinstance(entry, list) or (args[-1] is not Ellipsis and len(entry) != len(args)):
            raise _wrong(where, "a list" if args[-1] is Ellipsis else f"a list of {len(args)}", entry)
        kinds = [args[0]] * len(entry) if args[-1] is Ellipsis else args
        return tuple(_value(kind, one, f"{where}[{i}]") for i, (kind, one) in enumerate(zip(kinds, entry, strict=True)))
    if origin is not None and issubclass(origin, Mapping):
        if not isinstance(entry, dict):
            raise _wrong(where, "a table", entry)
        return {key: _value(args[1], one, f"{where}: {key}") for key, one in entry.items()}
    if is_dataclass(hint):
        return record(hint, entry, where)  # type: ignore[type-var]
    if hint in (Any, object):
        return entry
    return _scalar(hint, entry, where)


def _without_alias(hint: Any) -> Any:
    """What a type's alias stands for: ``NDArray`` is one (``type NDArray[...] = ...``) in NumPy 2.5 on Python 3.12."""
    origin = get_origin(hint)
    meant = getattr(hint if origin is None else origin, "__value__", None)
    if meant is None or isinstance(hint, type):  # a class may have such an attribute of its own
        return hint
    return _without_alias(meant if origin is None else meant[get_args(hint)])


def _scalar(kind: Any, entry: Any, where: str) -> Any:
    """A number, a truth, a text, a path or a member of an enumeration."""
    if issubclass(kind, Enum):
        if entry not in {one.value for one in kind}:
            raise _wrong(where, f"one of {kind.__name__}", entry)
        return kind(entry)
    if kind is Path and isinstance(entry, str):
        return Path(entry)
    number = isinstance(entry, int | float) and not isinstance(entry, bool)
    if kind is float and number:
        return float(entry)
    if kind in (int, bool, str) and type(entry) is kind:
        return entry
    words = {float: "a number", int: "a whole number", bool: "true or false", str: "text", Path: "a file"}
    raise _wrong(where, words.get(kind, kind.__name__), entry)


def _array(dtype: Any, entry: Any, where: str) -> Any:
    """An array; whole numbers where the field's are."""
    kind = get_args(dtype)[0]
    whole = isinstance(kind, type) and issubclass(kind, np.integer)
    try:
        found = np.array(entry, dtype=np.float64)
    except (TypeError, ValueError):
        raise _wrong(where, "numbers", entry) from None
    if whole and not (np.isfinite(found).all() and (found == np.round(found)).all()):
        raise _wrong(where, "whole numbers", entry)
    found = found.astype(np.int64) if whole else found
    found.setflags(write=False)
    return found
