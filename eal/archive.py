"""Potentials on disk: one npz file with arrays, settings as JSON, and a version."""

import json
import os
import tempfile
import zipfile
import zlib
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, get_args

import numpy as np

from eal import npz
from eal.arrays import LARGEST, Array
from eal.checks import checked_labels, checked_lambda, checked_samples, checked_weights
from eal.composite import CoordinateKernel, LinearKernel, ProductKernel, SumKernel
from eal.fitting import Method
from eal.kernels import GaussianKernel, Kernel, LaplaceKernel, Matern32Kernel, Matern52Kernel, Radial
from eal.plugins import offered
from eal.rotations import RotationKernel
from eal.spectral import FILTERS, Scaling

VERSION = 1  # of our files
ARRAYS = ("samples", "weights", "centres", "root", "eigenvalues")
STORED_ROUNDING = 1e-9
"""Of eigenvalues, which are between 0 and 1: far above that of float64 for thousands of samples."""
_DAMAGE = (
    OSError,
    ValueError,
    KeyError,
    TypeError,
    AttributeError,
    RuntimeError,
    EOFError,
    zipfile.BadZipFile,
    zlib.error,
)
"""What numpy, zipfile, json and constructors raise on files that are cut, changed, or something else."""

_RADIAL: dict[str, type[Radial]] = {
    k.__name__: k for k in (GaussianKernel, LaplaceKernel, Matern32Kernel, Matern52Kernel)
}


class ArchiveError(ValueError):
    """A file is not a potential that this version can read."""


def write(path: Path, *, arrays: dict[str, Array], kernel: Kernel, settings: dict[str, Any]) -> None:
    """Write arrays, kernel and settings; the file appears whole or not at all."""
    text = json.dumps({"version": VERSION, "kernel": kernel_to_dict(kernel), **settings})
    handle, temporary = tempfile.mkstemp(prefix=".potential-", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as stream:
            np.savez(stream, settings=np.array(text), **arrays)  # pyright: ignore[reportArgumentType]
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def read(path: Path) -> dict[str, Any]:
    """Arrays, kernel and settings, as ``EmpiricalPotential`` takes them.

    Raises:
        ArchiveError: the file is not a potential, of another version, or has numbers that no fit gives.
    """
    try:
        with npz.opened(path) as stored:
            settings = json.loads(str(stored["settings"]))
            version = settings.get("version")
            if version == VERSION:
                return _checked({name: stored[name] for name in ARRAYS}, settings)
    except _DAMAGE as error:
        reason = " ".join(str(error).split())
        raise ArchiveError(f"{path}: not a potential written by EmpiricalPotential.save: {reason}") from None
    raise ArchiveError(f"{path}: version {version!r}, but this program reads {VERSION}: fit again")


def _checked(arrays: dict[str, Array], settings: dict[str, Any]) -> dict[str, Any]:
    if odd := [name for name, part in arrays.items() if part.dtype.kind != "f" or (np.abs(part) > LARGEST).any()]:
        raise ValueError(f"{odd[0]} has {arrays[odd[0]].dtype}, expected real numbers up to {LARGEST:g}")
    z = checked_samples(arrays["samples"])
    weights = checked_weights(arrays["weights"], len(z))
    scaling, method = settings["scaling"], settings["method"]
    if scaling not in get_args(Scaling) or method not in get_args(Method):
        raise ValueError(f"scaling {scaling!r} or method {method!r} is not known")
    sizes = (len(arrays["centres"]), len(arrays["eigenvalues"]), z.shape[1])
    for name, shape in (("centres", (sizes[0], sizes[2])), ("root", sizes[:2]), ("eigenvalues", sizes[1:2])):
        if arrays[name].shape != shape or not np.isfinite(arrays[name]).all():
            raise ValueError(f"{name} must be finite numbers of shape {shape}, but has shape {arrays[name].shape}")
    sigma, missing = arrays["eigenvalues"], float(settings["missing"])
    if not (np.abs(sigma - 0.5) <= 0.5 + STORED_ROUNDING).all() or (np.diff(sigma) > STORED_ROUNDING).any():
        raise ValueError("eigenvalues must decrease from 1 or less to 0 or more")
    if not -STORED_ROUNDING <= missing <= 1.0 + STORED_ROUNDING:
        raise ValueError(f"missing is {missing:g}, expected 0 to 1")
    names, units, findings = (settings[name] for name in ("names", "units", "findings"))
    if not all(
        isinstance(part, list) and all(isinstance(one, str) for one in part) for part in (names, units, findings)
    ):
        raise ValueError("names, units and findings must be lists of text")
    checked_labels(names, units, z.shape[1])
    checked_lambda(settings["lam"], float(weights.sum()), scaling)
    return arrays | {
        "kernel": kernel_from_dict(settings["kernel"]),
        "lam": float(settings["lam"]),
        "spectral_filter": FILTERS[settings["spectral_filter"]],
        "scaling": scaling,
        "missing": missing,
        "method": method,
        "names": tuple(names),
        "units": tuple(units),
        "findings": tuple(findings),
    }


@cache
def _radial() -> dict[str, type[Radial]]:
    """Radial kernels by name, with those of other packages (entry points ``eal.kernels``)."""
    return _RADIAL | {one.__name__: one for one in offered("eal.kernels", type).values()}


_MADE: dict[str, type[Kernel]] = {
    k.__name__: k for k in (SumKernel, ProductKernel, CoordinateKernel, LinearKernel, RotationKernel)
}
"""Kernels made of others."""


def kernel_to_dict(kernel: Kernel) -> dict[str, Any]:
    """A kernel as JSON types: its class as ``kind``, and its fields.

    Raises:
        TypeError: not a kernel of this package.
    """
    kind = type(kernel).__name__
    if kind not in _radial() | _MADE or not is_dataclass(kernel):
        raise TypeError(f"{kind} is not a kernel of eal: it cannot be written to a file")
    return {"kind": kind} | {field.name: _to_json(getattr(kernel, field.name)) for field in fields(kernel)}


def _to_json(value: Any) -> Any:
    if isinstance(value, Kernel):
        return kernel_to_dict(value)
    if isinstance(value, tuple):
        return [_to_json(one) for one in value]
    return "inf" if value == np.inf else value


def kernel_from_dict(stored: dict[str, Any]) -> Kernel:
    """The kernel that ``kernel_to_dict`` described.

    Raises:
        ArchiveError: unknown kind.
    """
    kind = (_radial() | _MADE).get(stored["kind"])
    if kind is None:
        raise ArchiveError(f"unknown kernel {stored['kind']!r}: written by a newer version")
    names = [field.name for field in fields(kind)]  # pyright: ignore[reportArgumentType]
    return kind(**{name: _from_json(stored[name]) for name in names})


def _from_json(value: Any) -> Any:
    if isinstance(value, dict):
        return kernel_from_dict(value)
    if isinstance(value, list):
        return tuple(map(_from_json, value))
    return float("inf") if value == "inf" else value
