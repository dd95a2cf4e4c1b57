"""Our triangulation beside per-point loops, OpenCV, SciPy and aniposelib, with each one's error against the truth.

``python -m benchmarks.triangulation [--quick]``. Pixels are those of the synthetic bat, noise of a human digitiser,
clicks in wrong places and gaps included, with the lens already taken out. Every program sees the same points, loops a
sample of them; the time is per point. Errors are over the points that all of them give. "ratio" is the time over that
of ours which answers the same question: linear, or least reprojection error with covariance.
"""

import argparse
import importlib
import importlib.util
import itertools
import time
import tracemalloc
import warnings
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from mocap.datasets import Digitiser, make_bat
from scipy.optimize import least_squares
from threadpoolctl import threadpool_limits

from benchmarks.timing import interleaved
from eal.arrays import Array
from mocap.cameras.camera import Camera, decompose, project, stacked, undistorted
from mocap.cameras.triangulate import linear, refine, robust

SD_PX = Digitiser().sd_px
LINEAR, REFINED = "ours, linear", "ours, Gauss-Newton + cov"


@dataclass(frozen=True, eq=False, kw_only=True)
class Views:
    """Ideal pixels of points whose truth is known.

    Attributes:
        cameras: The C cameras.
        uv_px: (C, T, M, 2) ideal pixels; NaN where not seen.
        true_m: (T, M, 3) the points.
    """

    cameras: tuple[Camera, ...]
    uv_px: Array
    true_m: Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Method:
    """A program that triangulates.

    Attributes:
        run: (C, K, 2) pixels to (K, 3) points, NaN where it gives none.
        beside: Name of ours that it is compared with.
        points: At most so many points, a loop's sample; None: all.
    """

    run: Callable[[Array], Array]
    beside: str
    points: int | None = None


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="one recording of 120 frames")
    quick = parser.parse_args().quick
    for n_frames, n_cameras in [(120, 4)] if quick else [(540, 4), (540, 8), (540, 30)]:
        table(bat_views(n_frames, n_cameras), quick=quick)
    if importlib.util.find_spec("aniposelib") is None:
        print("\naniposelib is not installed: skipped (.venv/bin/pip install aniposelib)")
    if not quick:
        long_recording(100_000)


def bat_views(n_frames: int, n_cameras: int, *, digitiser: Digitiser | None = None) -> Views:
    """The bat, its lens taken out."""
    bat = make_bat(n_frames=n_frames, n_cameras=n_cameras, digitiser=digitiser)
    return Views(
        cameras=bat.cameras, uv_px=undistorted(bat.cameras, bat.pixels.uv_px), true_m=np.asarray(bat.truth.xyz_m)
    )


def methods(cameras: tuple[Camera, ...], *, sample: int) -> dict[str, Method]:
    """All programs; the loops do ``sample`` points."""
    matrices = stacked(cameras)
    found = {
        LINEAR: Method(run=lambda uv: linear(matrices, uv), beside=LINEAR),
        REFINED: Method(run=lambda uv: refine(matrices, uv, linear(matrices, uv), sd_px=SD_PX)[0], beside=REFINED),
        "ours, robust + cov": Method(run=lambda uv: robust(matrices, uv[:, :, None]).xyz_m[:, 0], beside=REFINED),
        "NumPy lstsq loop (DLTdv's way)": Method(run=lambda uv: lstsq_loop(matrices, uv), beside=LINEAR, points=sample),
        "OpenCV, loop over points": Method(run=lambda uv: opencv_loop(matrices, uv), beside=LINEAR, points=sample),
        "OpenCV, pairs of cameras, median": Method(run=lambda uv: opencv_pairs(matrices, uv), beside=LINEAR),
        "SciPy least_squares loop": Method(
            run=lambda uv: scipy_loop(matrices, uv, linear(matrices, uv)), beside=REFINED, points=max(sample // 5, 20)
        ),
    }
    if importlib.util.find_spec("aniposelib") is not None:
        found["aniposelib"] = Method(run=aniposelib(cameras, fast=False), beside=LINEAR)
        found["aniposelib, fast"] = Method(run=aniposelib(cameras, fast=True), beside=LINEAR)
    return found


def table(views: Views, *, quick: bool) -> None:
    """Time and error of all programs on one recording."""
    uv = views.uv_px.reshape(len(views.uv_px), -1, 2)
    twice = np.flatnonzero(np.isfinite(uv[..., 0]).sum(axis=0) >= 2)
    uv, truth = uv[:, twice], views.true_m.reshape(-1, 3)[twice]
    order = np.random.default_rng(0).permutation(len(truth))  # a loop's sample is a fair one
    uv, truth = uv[:, order], truth[order]
    programs = methods(views.cameras, sample=300 if quick else 2000)
    inputs = {name: np.ascontiguousarray(uv[:, : p.points]) for name, p in programs.items()}
    with threadpool_limits(1):
        results = {name: p.run(inputs[name]) for name, p in programs.items()}
        times = interleaved(
            {name: (lambda p=p, x=inputs[name]: p.run(x)) for name, p in programs.items()},
            repeats=3 if quick else 7,
            budget_s=1 if quick else 4,
        )
    per_point = {name: 1e6 * times[name].median_s / inputs[name].shape[1] for name in programs}
    shortest = min(map(len, results.values()))
    common = np.isfinite([r[:shortest, 0] for r in results.values()]).all(axis=0)
    n_cameras, n_frames, n_markers = views.uv_px.shape[:3]
    print(f"\n{n_frames} frames x {n_markers} markers x {n_cameras} cameras, errors of {common.sum()} points")
    columns = ("points", "us / point", "spread", "ratio", "median mm", "rms mm", "worst mm")
    print(f"{'':<36}" + "".join(f"{c:>11}" for c in columns))
    for name, program in programs.items():
        error = 1e3 * np.linalg.norm((results[name][:shortest] - truth[:shortest])[common], axis=1)
        print(
            f"{name:<36}{inputs[name].shape[1]:>11}{per_point[name]:>11.2f}{times[name].spread:>11.0%}"
            f"{per_point[name] / per_point[program.beside]:>11.1f}"
            f"{np.median(error):>11.3f}{np.sqrt(np.mean(error**2)):>11.3f}{error.max():>11.2f}"
        )


def long_recording(n_frames: int) -> None:
    """A long recording with 4 cameras: the flight of 500 frames over and over, with its memory."""
    views = bat_views(500, 4)
    matrices = stacked(views.cameras)
    uv = np.tile(views.uv_px, (1, -(-n_frames // 500), 1, 1))[:, :n_frames]
    print(f"\n{n_frames} frames x {uv.shape[2]} markers x 4 cameras, pixels {uv.nbytes / 2**20:.0f} MiB")
    print(f"{'':<36}{'seconds':>11}{'us / point':>11}{'peak MiB':>11}")

    def line(name: str, call: Callable[[], Array]) -> Array:
        tracemalloc.start()
        start = time.perf_counter()
        with threadpool_limits(1):
            result = call()
        seconds = time.perf_counter() - start
        peak = tracemalloc.get_traced_memory()[1] / 2**20
        tracemalloc.stop()
        print(f"{name:<36}{seconds:>11.2f}{1e6 * seconds / (n_frames * uv.shape[2]):>11.2f}{peak:>11.0f}")
        return result

    xyz = line(LINEAR, lambda: linear(matrices, uv))
    line("ours, Gauss-Newton + cov, from there", lambda: refine(matrices, uv, xyz, sd_px=SD_PX)[0])
    line("ours, robust + cov", lambda: robust(matrices, uv).xyz_m)


def lstsq_loop(matrices: Array, uv: Array) -> Array:
    """Point by point, the linear least squares of DLTdv with NumPy.

    Args:
        matrices: (C, 3, 4) projections.
        uv: (C, K, 2) ideal pixels.
    """
    scaled = matrices / matrices[:, 2:, 3:]
    out = np.full((uv.shape[1], 3), np.nan)
    for i in range(uv.shape[1]):
        seen = np.isfinite(uv[:, i, 0])
        p = scaled[seen]
        rows = (p[:, :2] - uv[seen, i, :, None] * p[:, 2:]).reshape(-1, 4)
        out[i] = np.linalg.lstsq(rows[:, :3], -rows[:, 3], rcond=None)[0]
    return out


def opencv_loop(matrices: Array, uv: Array) -> Array:
    """Point by point, the median over pairs of cameras of ``cv2.triangulatePoints``, which takes two views only."""
    out = np.full((uv.shape[1], 3), np.nan)
    for i in range(uv.shape[1]):
        seen = np.flatnonzero(np.isfinite(uv[:, i, 0]))
        found = []
        for a, b in itertools.combinations(seen, 2):
            x = cv2.triangulatePoints(matrices[a], matrices[b], uv[a, i], uv[b, i])[:, 0]
            found.append(x[:3] / x[3])
        out[i] = np.median(found, axis=0)
    return out


def opencv_pairs(matrices: Array, uv: Array) -> Array:
    """As ``opencv_loop`` with all points of a pair of cameras at once."""
    found = np.full((len(uv) * (len(uv) - 1) // 2, uv.shape[1], 3), np.nan)
    for row, (a, b) in zip(found, itertools.combinations(range(len(uv)), 2), strict=True):
        both = np.isfinite(uv[[a, b], :, 0]).all(axis=0)
        if both.any():
            x = cv2.triangulatePoints(matrices[a], matrices[b], uv[a, both].T, uv[b, both].T)
            row[both] = (x[:3] / x[3]).T
    return np.nanmedian(found, axis=0)


def scipy_loop(matrices: Array, uv: Array, start: Array) -> Array:
    """Point by point, the least reprojection error by Levenberg and Marquardt from (K, 3) ``start``."""
    out = np.full_like(start, np.nan)
    for i in range(len(start)):
        seen = np.isfinite(uv[:, i, 0])
        p, pixels = matrices[seen], uv[seen, i]
        out[i] = least_squares(
            lambda x, p=p, pixels=pixels: (project(p, x) - pixels).ravel(),
            start[i],
            method="lm",
            x_scale=1e-3,
            xtol=1e-12,
            ftol=1e-12,
        ).x
    return out


def aniposelib(cameras: tuple[Camera, ...], *, fast: bool) -> Callable[[Array], Array]:
    """Its ``CameraGroup.triangulate`` on the same ideal pixels; without ``fast``, a batched SVD by JAX on all cores."""
    module = importlib.import_module("aniposelib.cameras")
    pinholes = [decompose(c) for c in cameras]
    group = module.CameraGroup(
        [
            module.Camera(matrix=p.intrinsic, rvec=cv2.Rodrigues(p.rotation)[0].ravel(), tvec=p.translation_m)
            for p in pinholes
        ]
    )

    def run(uv: Array) -> Array:
        rays = np.empty_like(uv)
        for out, pixels, p in zip(rays, uv, pinholes, strict=True):
            k = p.intrinsic
            out[:, 1] = (pixels[:, 1] - k[1, 2]) / k[1, 1]
            out[:, 0] = (pixels[:, 0] - k[0, 2] - k[0, 1] * out[:, 1]) / k[0, 0]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # its median over pairs that see nothing
            return np.asarray(group.triangulate(rays, undistort=False, fast=fast))

    return run


if __name__ == "__main__":
    main()
