"""What a record that is read back must hold: a table of its entries, and the one function that checks them.

A record is a mapping of names to arrays, or to what JSON and TOML have in their place: a model's archive, the variables
of a run, the header of either, a click. Sizes have names, which all entries of a record share.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eal.arrays import LARGEST
from mocap.errors import FormatError

POSITIVE = np.nextafter(0.0, 1.0)
"""``least`` of what must be above 0."""
_CONTROLS = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")
"""Characters that no name has: controls but for tabs and line ends (which our tables escape), those that turn the
direction of text, and halves of characters."""
_TYPES: dict[str, tuple[type, ...]] = {"f": (int, float), "i": (int,), "b": (bool,), "s": (str,)}
_KINDS = {"f": "f", "i": "iu", "b": "b", "s": "UO"}
_WORDS = {"f": "real numbers", "i": "whole numbers", "b": "true or false", "s": "text"}


@dataclass(frozen=True, kw_only=True)
class Entry:
    """What one entry of a record must be.

    Attributes:
        kind: ``f`` real, ``i`` whole, ``b`` truth, ``s`` text.
        shape: A number, a name of a size, several numbers of which it is one, or None (any) for each axis.
        least: Least number.
        most: Greatest number; the name of a size: below that size.
        missing: Whether numbers may be missing (NaN): None: not; else over so many last axes all or none are.
        rising: Whether numbers increase along the first axis.
        unique: Whether no text appears twice.
        covariance: Whether the last two axes are covariance matrices.
        words: Texts that it may be; empty: any.
        among: Entry before it, of which every text must be one; empty: any.
        there: Entry before it; numbers must be there wherever that one's are; empty: need not.
        filled: Whether every axis must be at least one long, and a number somewhere.
        needed: Whether it must be there.
    """

    kind: str = "f"
    shape: tuple[int | str | tuple[int, ...] | None, ...] = ()
    least: float = -LARGEST
    most: float | str = LARGEST
    missing: int | None = None
    rising: bool = False
    unique: bool = False
    covariance: bool = False
    words: tuple[str, ...] = ()
    among: str = ""
    there: str = ""
    filled: bool = False
    needed: bool = True


Schema = Mapping[str, Entry]
"""The entries of a record by name."""


def names(size: str | None = None, *, among: str = "", filled: bool = False, needed: bool = True) -> Entry:
    """The entry of a list of names, of which none appears twice."""
    return Entry(kind="s", shape=(size,), unique=True, among=among, filled=filled, needed=needed)


def checked(
    where: str, found: Any, schema: Schema, *, sizes: dict[str, int] | None = None, again: str
) -> dict[str, Any]:
    """The entries of a record as arrays, each as its schema says; others are left out.

    Args:
        where: File, and place in it, for messages.
        found: The record.
        schema: What it must hold.
        sizes: Sizes that are known by name; those that are found are added.
        again: What to do where it is not so.

    Raises:
        FormatError: an entry is missing, or not as described; the message names it.
    """
    if not isinstance(found, Mapping):
        raise FormatError(f"{where}: is {type(found).__name__}, expected entries by name: {again}")
    sizes = {} if sizes is None else sizes
    out = {}
    for name, entry in schema.items():
        if name not in found or (found[name] is None and not entry.needed):
            if entry.needed:
                raise FormatError(f"{where}: {name!r} is missing: {again}")
            continue
        try:
            out[name] = _entry(found[name], entry, sizes, out)
        except ValueError as error:
            raise FormatError(f"{where}: {name} {error}: {again}") from None
    return out


def tables(where: str, found: Any, schema: Schema, *, again: str) -> list[dict[str, Any]]:
    """``checked`` of each record of a list; each has sizes of its own.

    Raises:
        FormatError: it is no list, or as of ``checked``.
    """
    if not isinstance(found, list):
        raise FormatError(f"{where} is {type(found).__name__}, expected a list: {again}")
    return [checked(f"{where}[{i}]", one, schema, again=again) for i, one in enumerate(found)]


def _entry(value: Any, entry: Entry, sizes: dict[str, int], before: Mapping[str, NDArray[Any]]) -> NDArray[Any]:
    array = _array(value, entry.kind)
    if isinstance(value, list | tuple) and not value:
        array = array.reshape(0, *(n if isinstance(n, int) else 0 for n in entry.shape[1:]))  # of no rows
    if not array.ndim and entry.shape:
        raise ValueError(f"is {repr(value)[:60]}, expected a list of {_WORDS[entry.kind]}")
    expected = tuple(sizes.get(n, n) if isinstance(n, str) else n for n in entry.shape)
    fits = [
        n is None or isinstance(n, str) or (m in n if isinstance(n, tuple) else m == n)
        for n, m in zip(expected, array.shape, strict=False)
    ]
    if array.ndim != len(expected) or not all(fits):
        raise ValueError(f"has shape {array.shape}, expected {_shown(expected)}")
    sizes |= {name: m for name, m in zip(entry.shape, array.shape, strict=True) if isinstance(name, str)}
    if entry.filled and not array.size:
        raise ValueError("is empty")
    if entry.kind == "s":
        _check_text(array.ravel().tolist(), entry, before.get(entry.among))
    elif array.size and entry.kind != "b":
        _check_numbers(array, entry, sizes)
    if entry.there in before:
        other = before[entry.there]
        shared = min(array.ndim, other.ndim)
        own, its = (np.isnan(part).any(axis=tuple(range(shared, part.ndim))) for part in (array, other))
        lacks = np.asarray(own & ~its)
        if lacks.any():
            raise ValueError(f"is missing{_at(lacks)}, where {entry.there} is not")
    return array


def _array(value: Any, kind: str) -> NDArray[Any]:
    """An array of a kind; what JSON and TOML have becomes one.

    Raises:
        ValueError: its values are of another kind, or its lists are ragged.
    """

    def wrong() -> ValueError:  # made where it is raised: the text of an array takes longer than all checks of it
        return ValueError(f"is {repr(value)[:60]}, expected {_WORDS[kind]}")

    stored = isinstance(value, np.ndarray | np.generic)
    array = np.asarray(value) if stored else _objects(value)
    if stored and array.dtype.kind not in _KINDS[kind]:
        raise ValueError(f"has {array.dtype}, expected {_WORDS[kind]}")
    if array.dtype.kind == "O":
        types = _TYPES[kind]
        if not all(isinstance(one, types) and (kind == "b") == isinstance(one, bool) for one in array.ravel()):
            raise wrong()
    try:
        return array.astype({"f": array.dtype if stored else float, "i": np.int64, "b": bool, "s": object}[kind])
    except (OverflowError, ValueError, UnicodeError):
        raise wrong() from None


def _objects(value: Any) -> NDArray[np.object_]:
    """What JSON and TOML have as an array of objects; lists that are ragged stay objects in it."""
    if not isinstance(value, list | tuple):
        array = np.empty((), dtype=object)
        array[()] = value
        return array
    try:
        return np.array(value, dtype=object)
    except ValueError:
        raise ValueError("has lists of different lengths") from None


def _check_text(texts: list[str], entry: Entry, known: NDArray[Any] | None) -> None:
    among = set() if known is None else set(known.ravel().tolist())
    for text in texts:
        if not text and entry.unique:
            raise ValueError("has a name without letters")
        if _CONTROLS.search(text):
            raise ValueError(f"has the name {text!r}, which contains control characters")
        if entry.words and text not in entry.words:
            raise ValueError(f"is {text!r}, expected {' or '.join(entry.words)}")
        if known is not None and text not in among:
            raise ValueError(f"has {text!r}, which is not in {entry.among}")
    if entry.unique and len(set(texts)) != len(texts):
        raise ValueError(f"has {max(texts, key=texts.count)!r} twice")


def _check_numbers(array: NDArray[Any], entry: Entry, sizes: Mapping[str, int]) -> None:
    missing = np.isnan(array) if entry.kind == "f" else np.zeros(array.shape, dtype=bool)
    if missing.any():
        if entry.missing is None:
            raise ValueError(f"is not a number{_at(missing)}")
        if entry.filled and missing.all():
            raise ValueError("is missing everywhere")
        together = tuple(range(array.ndim - entry.missing, array.ndim))
        some = np.asarray(missing.any(axis=together) & ~missing.all(axis=together))
        if some.any():
            raise ValueError(f"is missing in part{_at(some)}")
    most = sizes[entry.most] - 1 if isinstance(entry.most, str) else entry.most
    outside = ~missing & ~((array >= entry.least) & (array <= most))
    if outside.any():
        value = array[tuple(np.argwhere(outside)[0])]
        raise ValueError(f"is {value:.6g}{_at(outside)}, expected {_range(entry.least, most)}")
    if entry.rising and not (np.diff(array, axis=0) > 0).all():
        falls = np.append(False, ~(np.diff(array) > 0))
        raise ValueError(f"does not increase{_at(falls)}")
    if entry.covariance:
        wrong = not_covariances(array) & ~missing.any(axis=(-1, -2))
        if wrong.any():
            raise ValueError(f"is no covariance{_at(wrong)}: not symmetric, or not positive definite")


def not_covariances(matrices: NDArray[Any]) -> NDArray[np.bool_]:
    """(...) True where (..., n, n) matrices are not symmetric, or have a negative variance in some direction.

    To the rounding of single precision, in which joint covariances are stored: of the correlations, which are free of
    units, n (n + 1) / 2 numbers move an eigenvalue by 6e-8 n at most each way.
    """
    n = matrices.shape[-1]
    flat = np.nan_to_num(matrices.reshape(-1, n, n).astype(np.float64))
    variance = np.diagonal(flat, axis1=1, axis2=2)
    sd = np.sqrt(np.maximum(variance, 0.0))
    scale = np.where(sd > 0, sd, 1.0)
    unit = flat / scale[:, :, None] / scale[:, None, :]
    skew = np.abs(unit - np.swapaxes(unit, 1, 2)) > _ROUNDING
    wrong = np.asarray((variance < 0).any(axis=1) | skew.any(axis=(1, 2)))
    try:
        np.linalg.cholesky(unit[~wrong] + n * _ROUNDING * np.eye(n))  # one call for all that are good
    except np.linalg.LinAlgError:
        wrong[~wrong] = np.linalg.eigvalsh(unit[~wrong])[:, 0] < -n * _ROUNDING
    return wrong.reshape(matrices.shape[:-2])


_ROUNDING = 1e-6
"""Ten roundings of single precision, as filters multiply several matrices that each round."""


def _at(where: NDArray[np.bool_]) -> str:
    place = np.argwhere(where)
    return f" at [{', '.join(map(str, place[0]))}]" if where.ndim and len(place) else ""


def _range(least: float, most: float) -> str:
    if least == POSITIVE:
        return "a number above 0"
    return f"{least:g} to {most:g}"


def _shown(shape: Iterable[object]) -> str:
    return "(" + ", ".join("any" if n is None else str(n) for n in shape) + ")"
