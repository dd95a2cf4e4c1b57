"""DLTdv CSV read and triangulated, ours beside a plain per-frame loop: ``python -m benchmarks.importers``.

A made recording (34 markers, 4 cameras, a tenth of the samples missing) is written as DLTdv writes it. The peer does
what DLTdv's own code does, frame by frame and point by point, in plain Python and NumPy: it splits the lines of the
file, solves each point's linear equations by least squares and takes their residual (Hedrick 2008); ours takes points
and residuals too. Both run here, in turn, on the same file; the ratio is of processor seconds for a frame, which other
work on the machine disturbs less than the clock. Memory is what the process's peak grows by while ours reads and
triangulates, over the size of the pixel and point arrays.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from eal.arrays import Array
from mocap.cameras.camera import dlt_coefficients, stacked
from mocap.cameras.triangulate import project
from mocap.cleaning.triangulate_file import linear_in_blocks
from mocap.errors import MocapError
from mocap.io.dltdv import read_coefficients, write_coefficients
from mocap.io.lines import metres
from mocap.io.registry import read
from tests.mocap.rigs import ring

MARKERS, CAMERAS = 34, 4


def make(path: Path, frames: int) -> None:
    """Write ``xypts.csv`` and ``dltCoefs.csv`` of points that wander in a cube before a ring of cameras."""
    rng = np.random.default_rng(0)
    cameras = ring(CAMERAS)
    write_coefficients(path.with_name("dltCoefs.csv"), cameras)
    header = [f"pt{m + 1}_cam{c + 1}_{a}" for m in range(MARKERS) for c in range(CAMERAS) for a in "XY"]
    with path.open("w") as stream:
        stream.write(",".join(header) + "\n")
        for start in range(0, frames, 5000):
            xyz = rng.uniform(-0.3, 0.3, (min(5000, frames - start), MARKERS, 3))
            uv = project(stacked(cameras), xyz) + rng.normal(0, 0.5, (CAMERAS, *xyz.shape[:2], 2))
            uv[rng.random(uv.shape[:3]) < 0.1] = np.nan
            rows = np.transpose(uv, (1, 2, 0, 3)).reshape(len(xyz), -1)
            pd.DataFrame(rows).to_csv(stream, header=False, index=False, float_format="%.6f", na_rep="NaN")


def ours(path: Path) -> Array:
    """Points by the project's reader and triangulation."""
    matrices = stacked(read_coefficients(path.with_name("dltCoefs.csv")))
    pixels = read(path).pixels
    assert pixels is not None
    return linear_in_blocks(matrices, pixels.uv_px)[0]


def peer(path: Path, frames: int) -> tuple[Array, Array]:
    """Points and residuals of the first frames, one after the other, as dlt_reconstruct.m finds them."""
    c = np.stack([dlt_coefficients(camera) for camera in read_coefficients(path.with_name("dltCoefs.csv"))], axis=1)
    xyz, rmse = np.full((frames, MARKERS, 3), np.nan), np.full((frames, MARKERS), np.nan)
    with path.open() as stream:
        stream.readline()
        for t in range(frames):
            row = np.array([float(cell) for cell in stream.readline().split(",")]).reshape(MARKERS, CAMERAS, 2)
            for m in range(MARKERS):
                seen = np.flatnonzero(~np.isnan(row[m, :, 0]))
                if len(seen) < 2:
                    continue
                u, v = row[m, seen, 0], row[m, seen, 1]
                a, b = np.zeros((2 * len(seen), 3)), np.zeros(2 * len(seen))
                for k in range(3):
                    a[::2, k] = u * c[8 + k, seen] - c[k, seen]
                    a[1::2, k] = v * c[8 + k, seen] - c[4 + k, seen]
                b[::2], b[1::2] = c[3, seen] - u, c[7, seen] - v
                xyz[t, m] = np.linalg.lstsq(a, b, rcond=None)[0]
                rmse[t, m] = np.sqrt(np.sum((b - a @ xyz[t, m]) ** 2) / (len(b) - 3))
    return xyz, rmse


def _measure(path: str) -> None:
    """In a process of its own: seconds and megabytes of ours, and the points beside the file."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    cpu, wall = time.process_time(), time.perf_counter()
    xyz = ours(Path(path))
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    np.save(Path(path).with_name("xyz.npy"), xyz)
    print(cpu, wall, grown)


def strangers(folder: Path) -> list[dict[str, object]]:
    """A row for each file of strangers below a folder: what it is read as, whose values are right, or the refusal.

    C3D is compared with ezc3d, sample by sample, where that reads it; of others the size of what was read is told.
    """
    import ezc3d

    rows = []
    for path in sorted(path for path in folder.rglob("*") if path.is_file() and path.suffix not in (".py", ".md")):
        row: dict[str, object] = {
            "file": path.name,
            "whose": path.parent.name,
            "format": "",
            "right_by": "",
            "message": "",
        }
        rows.append(row)
        try:
            found = read(path)
        except MocapError as error:
            row |= {"verdict": "refused", "message": str(error)}
            continue
        row |= {"format": found.format, "verdict": "read", "message": f"{len(found.names)} x {len(found.frames)}"}
        if found.format != "c3d" or found.points is None:
            continue
        try:
            theirs = ezc3d.c3d(str(path))
        except (OSError, RuntimeError, ValueError):
            continue
        labels, scale = theirs["parameters"]["POINT"]["LABELS"]["value"], metres(path, found.unit or "m")
        own = [m for m, name in enumerate(found.names) if labels.count(name) == 1]
        xyz = np.transpose(theirs["data"]["points"][:3], (2, 1, 0))[:, [labels.index(found.names[m]) for m in own]]
        same = xyz.shape == found.points.xyz_m[:, own].shape and np.allclose(
            found.points.xyz_m[:, own], xyz * scale, rtol=1e-6, atol=0, equal_nan=True
        )
        row |= {"right_by": "ezc3d", "verdict": "right" if same else "other values"}
    return rows


def written(table: pd.DataFrame, folder: Path | None) -> None:
    """``table.csv`` in the folder, if there is one."""
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        table.to_csv(folder / "table.csv", index=False)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run both and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=100_000)
    parser.add_argument("--peer-frames", type=int, default=3000, help="frames that the peer does")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--strangers", type=Path, help="folder of other people's files: read only these")
    parser.add_argument("--out", type=Path, help="folder for table.csv")
    options = parser.parse_args(arguments)
    if options.strangers is not None:
        table = pd.DataFrame(strangers(options.strangers))
        print(table.to_string(index=False, max_colwidth=70))
        print(table["verdict"].value_counts().to_string())
        written(table, options.out)
        return
    frames, few = (2000, 200) if options.quick else (options.frames, min(options.peer_frames, options.frames))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "made_xypts.csv"
        make(path, frames)
        command = [sys.executable, "-c", f"from benchmarks.importers import _measure; _measure({str(path)!r})"]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        cpu, wall, grown = map(float, done.stdout.split())
        xyz = np.load(path.with_name("xyz.npy"))
        start = time.process_time()
        theirs, _ = peer(path, few)
        slow = time.process_time() - start
        off = np.nanmax(np.abs(theirs - xyz[:few]))
        assert np.array_equal(np.isnan(theirs), np.isnan(xyz[:few]))
        size = (xyz.nbytes + frames * MARKERS * CAMERAS * 2 * 8) / 2**20
        both = {"ours": (frames, cpu), "per-frame loop": (few, slow)}
        rows = [dict(reader=name, frames=n, cpu_s=s, us_a_frame=1e6 * s / n) for name, (n, s) in both.items()]
        written(pd.DataFrame(rows), options.out)
        print(f"{frames} frames x {MARKERS} markers x {CAMERAS} cameras, {path.stat().st_size / 2**20:.0f} MB")
        print(f"{'':24}{'frames':>8}{'processor s':>13}{'us a frame':>12}")
        print(f"{'ours':24}{frames:8}{cpu:13.2f}{1e6 * cpu / frames:12.1f}   ({wall:.1f} s by the clock)")
        print(f"{'per-frame loop':24}{few:8}{slow:13.2f}{1e6 * slow / few:12.1f}")
        print(f"ratio {slow / few / (cpu / frames):.1f}; points agree to {off:.1e} m")
        print(f"memory grew by {grown:.0f} MB, {grown / size:.1f} times the arrays ({size:.0f} MB)")


if __name__ == "__main__":
    main()
