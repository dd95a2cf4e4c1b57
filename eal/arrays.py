"""Arrays as records keep them: copied, read-only; and the checks that every entry point makes, each once."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.floating[Any]]
"""Real numbers; records keep them as float64."""

LARGEST = 1e19
"""No number of a file of ours is larger: its square is one of single precision. Chosen."""
Z95 = 1.959964
"""Half width of a 95 % interval in standard deviations."""


def read_only(value: ArrayLike) -> Array:
    """A read-only float64 copy."""
    array = np.array(value, dtype=np.float64)
    array.flags.writeable = False
    return array


def frozen(name: str, value: ArrayLike, shape: tuple[int | None, ...], *, dtype: type = np.float64) -> NDArray:
    """A read-only copy of ``value`` whose shape is ``shape`` (None: any length).

    Raises:
        ValueError: the shape differs; the message names the array and both shapes.
    """
    array = np.array(value, dtype=dtype)
    if array.ndim != len(shape) or any(n is not None and n != m for n, m in zip(shape, array.shape, strict=True)):
        expected = "(" + ", ".join("any" if n is None else str(n) for n in shape) + ")"
        raise ValueError(f"{name} must have shape {expected}, but has {array.shape}")
    array.flags.writeable = False
    return array


def increasing(name: str, t_s: NDArray) -> None:
    """Check that times increase strictly.

    Raises:
        ValueError: they do not; the message names the first offender.
    """
    bad = np.flatnonzero(~(np.diff(t_s) > 0))
    if len(bad):
        i = int(bad[0]) + 1
        raise ValueError(f"{name} must increase, but {name}[{i}] = {t_s[i]:g} s follows {t_s[i - 1]:g} s")


def unique(kind: str, names: tuple[str, ...]) -> None:
    """Check that names are unique.

    Raises:
        ValueError: one appears twice.
    """
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise ValueError(f"{kind} {name!r} appears twice: {kind} names must be unique")
        seen.add(name)


def true_runs(mask: NDArray) -> list[tuple[int, int]]:
    """Start and stop of every run of True in a (T,) mask."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(int), [0]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def varying(xyz_m: Array) -> NDArray[np.bool_]:
    """(3,) axes along which positions (..., 3) are not all one number: two of points in a plane z = 0.

    All three where nothing varies.
    """
    flat = xyz_m.reshape(-1, 3)
    flat = flat[np.isfinite(flat).all(axis=1)]
    axes = np.ptp(flat, axis=0) > 0 if len(flat) else np.ones(3, dtype=bool)
    return axes if axes.any() else np.ones(3, dtype=bool)


def positive(name: str, value: float, unit: str = "") -> float:
    """A finite number above zero.

    Raises:
        ValueError: it is not; the message names it.
    """
    number = float(value)
    if not (np.isfinite(number) and number > 0.0):
        raise ValueError(f"{name} must be a finite number above 0{unit and ' ' + unit}, but is {value!r}")
    return number


def points(name: str, value: ArrayLike, dimension: int) -> Array:
    """Configurations as (..., d) float64.

    Raises:
        ValueError: the last axis is not the d coordinates.
    """
    array = np.asarray(value, dtype=np.float64)
    if array.ndim == 0 or array.shape[-1] != dimension:
        raise ValueError(
            f"{name} must have {dimension} coordinates on its last axis, but has shape {array.shape}: "
            "the potential was learned on samples of that dimension"
        )
    return array


def short_repr(self: Any) -> str:
    """A line on a dataclass: arrays by their shape, what holds many things by how many; for ``__repr__ =``."""
    return f"{type(self).__name__}({', '.join(f'{f.name}={_short(getattr(self, f.name))}' for f in fields(self))})"


def _short(value: object) -> str:
    if isinstance(value, np.ndarray):
        return f"<array {'x'.join(map(str, value.shape))}>"
    if isinstance(value, Mapping | tuple | list) and (len(value) > 3 or len(repr(value)) > 80):
        return f"<{type(value).__name__} of {len(value)}>"
    text = repr(value)
    return text if len(text) <= 80 else f"<{type(value).__name__}>"


def skew(v: Array) -> Array:
    """(..., 3, 3) matrices of the cross product with (..., 3) vectors."""
    out = np.zeros((*v.shape, 3))  # by assignment: a fifth of the time of np.stack
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -z, y, -x
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = z, -y, x
    return out


def cross(a: Array, b: Array) -> Array:
    """(..., 3) cross products, without what NumPy's spends on checks."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)
