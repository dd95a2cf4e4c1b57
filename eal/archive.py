"""Potentials on disk: one npz file with arrays, settings as JSON, and a version."""

import json
import os
import tempfile
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from eal import npz
from eal.arrays import Array
from eal.composite import CoordinateKernel, ProductKernel, SumKernel
from eal.kernels import GaussianKernel, Kernel, LaplaceKernel, Matern32Kernel, Matern52Kernel, Radial
from eal.rotations import RotationKernel

VERSION = 1
ARRAYS = ("samples", "weights", "centres", "root", "eigenvalues")

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


def read(path: Path) -> tuple[dict[str, Array], Kernel, dict[str, Any]]:
    """Arrays, kernel and settings.

    Raises:
        ArchiveError: the file is not a potential, or of another version.
    """
    try:
        with npz.opened(path) as stored:
            settings = json.loads(str(stored["settings"]))
            arrays = {name: stored[name] for name in ARRAYS}
    except (OSError, ValueError, KeyError, EOFError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:
        raise ArchiveError(f"{path}: not a potential written by EmpiricalPotential.save: {error}") from None
    if settings.get("version") != VERSION:
        raise ArchiveError(f"{path}: version {settings.get('version')!r}, but this program reads {VERSION}: fit again")
    return arrays, kernel_from_dict(settings["kernel"]), settings


def kernel_to_dict(kernel: Kernel) -> dict[str, Any]:
    """A kernel as JSON types.

    Raises:
        TypeError: not a kernel of this package.
    """
    kind = {"kind": type(kernel).__name__}
    if isinstance(kernel, Radial) and kind["kind"] in _RADIAL:
        return kind | {"beta": kernel.beta}
    if isinstance(kernel, SumKernel):
        return kind | {"parts": [kernel_to_dict(k) for k in kernel.parts], "shares": list(kernel.shares)}
    if isinstance(kernel, ProductKernel):
        return kind | {"parts": [kernel_to_dict(k) for k in kernel.parts]}
    if isinstance(kernel, CoordinateKernel):
        scales = ["inf" if np.isinf(s) else s for s in kernel.scales]
        return kind | {"kernel": kernel_to_dict(kernel.kernel), "scales": scales, "periods": list(kernel.periods)}
    if isinstance(kernel, RotationKernel):
        joints = {"freedoms": list(kernel.freedoms), "scales": list(kernel.scales)}
        return kind | {"kernel": kernel_to_dict(kernel.kernel)} | joints
    raise TypeError(f"{kind['kind']} is not a kernel of eal: it cannot be written to a file")


def kernel_from_dict(stored: dict[str, Any]) -> Kernel:
    """The kernel that ``kernel_to_dict`` described.

    Raises:
        ArchiveError: unknown kind.
    """
    kind = stored["kind"]
    if kind in _RADIAL:
        return _RADIAL[kind](stored["beta"])
    if kind == "SumKernel":
        return SumKernel(tuple(map(kernel_from_dict, stored["parts"])), tuple(stored["shares"]))
    if kind == "ProductKernel":
        return ProductKernel(tuple(map(kernel_from_dict, stored["parts"])))
    if kind == "CoordinateKernel":
        scales = tuple(float(s) for s in stored["scales"])
        return CoordinateKernel(kernel_from_dict(stored["kernel"]), scales, tuple(stored["periods"]))
    if kind == "RotationKernel":
        return RotationKernel(kernel_from_dict(stored["kernel"]), tuple(stored["freedoms"]), tuple(stored["scales"]))
    raise ArchiveError(f"unknown kernel {kind!r}: written by a newer version")
