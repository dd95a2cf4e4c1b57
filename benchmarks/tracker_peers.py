"""Whole commands beside what a user would run in their place, in seconds of the processor of one run.

aniposelib's ``optim_points`` (Karashchuk et al. 2021, Cell Reports 36, 109730) optimises the same points; it gives no
intervals, and its imports and compilation are not counted. It is installed into ``.venv-anipose``. Its cameras have no
skew: they are the nearest without, and every pixel is where such a camera sees the point, plus what the ray erred by.
It starts from the linear triangulation of these.
filterpy's Kalman filter and Rauch-Tung-Striebel smoother of each marker take the place of our passes in ``mocap track
--model constant_velocity``: reading, cleaning and writing are the same.
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from filterpy.kalman import KalmanFilter
from numpy.typing import NDArray

import mocap
from eal.arrays import Array
from mocap.cameras.triangulate import linear, project
from mocap.recording import Recording

ROOT = Path(__file__).resolve().parents[1]
FOLDER, VERSION = ROOT / ".venv-anipose", "0.8.0"
ONE = {"MOCAP_JOBS": "1", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""One process, one BLAS thread."""
BONES = 6
"""So many pairs of markers keep their distance: those that vary least, as a user names them."""


def spent(command: Sequence[str | Path]) -> tuple[float, float, str]:
    """Seconds of the processor of a command and its children, seconds on the wall, and what it printed."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(
        [str(word) for word in command], cwd=ROOT, env=_as_users_run(), capture_output=True, text=True, check=False
    )
    wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise RuntimeError(f"{' '.join(map(str, command))}: {done.stderr[-2000:]}")
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, wall, done.stdout


def _as_users_run() -> dict[str, str]:
    """One process, and modules that are compiled once: some environments have Python write none."""
    return {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"} | ONE


def installed() -> Path:
    """The interpreter that has aniposelib; it is installed where it is not there."""
    python = FOLDER / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    if not list(FOLDER.glob(f"**/aniposelib-{VERSION}.dist-info/RECORD")):
        subprocess.run([sys.executable, "-m", "venv", FOLDER], check=True)
        pip = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        subprocess.run([*pip, f"aniposelib=={VERSION}"], check=True)
    return python


def stiffest(xyz_m: Array) -> list[list[int]]:
    """Pairs of markers whose distance varies least, of those that are seen together in half of the frames."""
    pairs = []
    for a in range(xyz_m.shape[1]):
        for b in range(a):
            length = np.linalg.norm(xyz_m[:, a] - xyz_m[:, b], axis=-1)
            length = length[np.isfinite(length)]
            if len(length) > len(xyz_m) / 2:
                pairs.append((float(length.std() / length.mean()), b, a))
    return [[b, a] for _, b, a in sorted(pairs)[:BONES]]


def problem(recording: Recording) -> dict[str, NDArray]:
    """A recording as ``anipose_runner`` takes it, from the first to the last frame with a point."""
    points, seen = recording.xyz_m, recording.data["ideal"].to_numpy()
    frames = np.flatnonzero(np.isfinite(points[..., 0]).any(axis=1))
    some = slice(int(frames[0]), int(frames[-1]) + 1)
    xyz, seen = points[some], seen[:, some]
    matrices = np.stack([camera.matrix for camera in recording.cameras])
    erred = seen - project(matrices, xyz)
    inner, rvec, tvec = [], [], []
    for matrix in matrices:
        whole, turn, centre = cv2.decomposeProjectionMatrix(matrix)[:3]
        whole = whole / whole[2, 2]
        whole[0, 1] = 0.0
        inner.append(whole)
        rvec.append(cv2.Rodrigues(turn)[0][:, 0])
        tvec.append(-1e3 * turn @ (centre[:3, 0] / centre[3, 0]))
    poses = [np.column_stack([cv2.Rodrigues(r)[0], t / 1e3]) for r, t in zip(rvec, tvec, strict=True)]
    without_skew = np.stack([whole @ pose for whole, pose in zip(inner, poses, strict=True)])
    uv = project(without_skew, xyz) + erred
    return {
        "uv_px": uv,
        "xyz_mm": 1e3 * linear(without_skew, uv),
        "bones": np.array(stiffest(xyz)),
        "matrix": np.stack(inner),
        "rvec": np.stack(rvec),
        "tvec_mm": np.stack(tvec),
    }


def anipose(recording: Recording) -> dict[str, float | str]:
    """What ``anipose_runner`` prints of a recording, and ``whole_s``, with imports and compilation."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "problem.npz"
        np.savez(path, **problem(recording))
        cpu, _, printed = spent([installed(), Path(__file__).with_name("anipose_runner.py"), path])
        return {**json.loads(printed.splitlines()[-1]), "whole_s": cpu}


def kalman(xyz_m: Array, dt_s: float) -> float:
    """Seconds of the processor of a filter and a smoother of each marker, from its first to its last sample."""
    start = time.process_time()
    for track in xyz_m.swapaxes(0, 1):
        at = np.flatnonzero(np.isfinite(track[:, 0]))
        if not len(at):
            continue
        one = KalmanFilter(dim_x=6, dim_z=3)
        one.F = np.kron([[1.0, dt_s], [0.0, 1.0]], np.eye(3))
        one.H = np.eye(3, 6)
        one.Q = 1e3 * np.kron([[dt_s**3 / 3, dt_s**2 / 2], [dt_s**2 / 2, dt_s]], np.eye(3))
        one.R, one.P = 1e-6 * np.eye(3), np.eye(6)
        one.x = np.concatenate([track[at[0]], np.zeros(3)])
        seen = track[at[0] : at[-1] + 1]
        taken = np.empty(len(seen), dtype=object)  # of such a list NumPy 2.2 cannot tell the length
        taken[:] = [z if np.isfinite(z[0]) else None for z in seen]
        means, covs, _, _ = one.batch_filter(taken)
        one.rts_smoother(means, covs)
    return time.process_time() - start


def passes(arguments: Sequence[str]) -> None:
    """Print the seconds of ``mocap ARGUMENTS`` that our passes take, and what filterpy takes in their place."""
    from mocap.filters.models import base

    from mocap.cli.main import main

    taken, shown, smooth = [0.0], [], base.smooth

    def timed(*given: object, **options: object) -> object:
        start = time.process_time()
        found = smooth(*given, **options)
        taken[0] += time.process_time() - start
        shown.append(given)
        return found

    base.smooth = timed
    sys.argv = ["mocap", *arguments]
    try:
        main()
    except SystemExit as ended:
        if ended.code:
            raise
    _, seen, t_s = shown[-1]
    theirs = kalman(seen.xyz_m, float(np.median(np.diff(t_s))))
    print(json.dumps({"passes": len(shown), "ours_s": taken[0], "theirs_s": theirs}))


def read(table: Path, calibration: Path, fps: float) -> Recording:
    """A recording of pixels, with the points that ``mocap.clean`` believes."""
    return mocap.clean(mocap.read(table, calibration=calibration, fps=fps))


def two_frames(table: Path, path: Path) -> None:
    """The two rows on end of a table that have most numbers, below its title."""
    title, *rows = table.read_text(encoding="utf-8").splitlines()
    known = np.array([sum(cell not in ("", "NaN", "nan") for cell in row.split(",")) for row in rows])
    first = int(np.argmax(known[1:] + known[:-1]))
    path.write_text("\n".join([title, *rows[first : first + 2]]) + "\n", encoding="utf-8")


if __name__ == "__main__":
    passes(sys.argv[1:])
