"""``lenses.toml``: lenses of cameras without their places, with the covariance of what was fitted.

It is a calibration of Anipose (so that other programs read its lenses) in which every camera stands at the origin, and
each section has two more keys: ``free``, places among fx, fy, cx, cy and the distortions, and ``covariance``.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mocap.cameras.camera import KnownLens, pinhole_camera, pinhole_lens
from mocap.errors import FormatError
from mocap.io.anipose import camera_sections, read_calibration, write_calibration
from mocap.schema import Entry, checked

NAME = "lenses.toml"


def write_lenses(path: Path, lenses: Sequence[KnownLens]) -> None:
    """Write lenses.

    Raises:
        FormatError: one has no picture size.
    """
    cameras = [
        pinhole_camera(
            known.name,
            intrinsic=known.lens.intrinsic,
            rotation=np.eye(3),
            translation_m=np.zeros(3),
            lens=known.lens,
            size_px=known.size_px,
        )
        for known in lenses
    ]
    write_calibration(path, cameras)
    text = path.read_text(encoding="utf-8")
    for i, known in enumerate(lenses):
        more = f"free = {list(known.free)}\ncovariance = {known.cov.tolist()}\n"
        text = text.replace(f"[cam_{i}]\n", f"[cam_{i}]\n{more}")
    path.write_text(text, encoding="utf-8", newline="")


def read_lenses(path: Path) -> tuple[KnownLens, ...]:
    """Lenses of ``lenses.toml``, of any ``calibration.toml``, or of a folder that holds one of them.

    Raises:
        FormatError: there is none, or its covariance does not belong to it.
    """
    if path.is_dir():
        inside = [path / n for n in (NAME, "calibration.toml") if (path / n).is_file()]
        if not inside:
            raise FormatError(f"{path}: contains no {NAME} and no calibration.toml: give the lenses' file")
        path = inside[0]
    cameras = read_calibration(path)
    out = []
    for camera, (_, section) in zip(cameras, camera_sections(path), strict=True):
        lens = pinhole_lens(camera) if camera.lens is None else camera.lens
        again = f"its covariance is not that of its {lens.model} lens: calibrate the lenses again"
        schema = {
            "free": Entry(kind="i", shape=("free",), least=0, most=3 + lens.n_coefficients, rising=True, needed=False),
            "covariance": Entry(shape=("free", "free"), covariance=True, needed=False),
        }
        found = checked(f"{path.name}: camera {camera.name!r}", section, schema, again=again)
        free = tuple(found["free"].tolist()) if "free" in found else ()
        cov = found.get("covariance", np.zeros((0, 0)))
        if len(cov) != len(free):
            raise FormatError(f"{path.name}: camera {camera.name!r}: {again}")
        out.append(KnownLens(name=camera.name, lens=lens, size_px=camera.size_px, free=free, cov=cov))
    return tuple(out)
