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
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from eal.arrays import Array
from mocap.cameras.camera import decompose, dlt_coefficients, record, stacked
from mocap.cameras.triangulate import project
from mocap.cleaning.triangulate_file import linear_in_blocks
from mocap.errors import MocapError
from mocap.io.contents import FileContents
from mocap.io.dltdv import read_coefficients, write_coefficients
from mocap.io.lines import metres
from mocap.io.registry import identify, read
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


DATA = (
    *(".csv", ".tsv", ".trc", ".c3d", ".h5", ".mat", ".nc", ".nwb", ".parquet", ".xlsx", ".json", ".toml"),
    *(".xml", ".xcp", ".yml", ".yaml", ".pickle", ".npy", ".npz", ".xma", ".txt", ".tab"),
)
"""Ends of names of files that may hold tracks or cameras; images, licences and notes are none."""


def strangers(folder: Path) -> list[dict[str, object]]:
    """A row for each file of strangers below a folder: what it is read as, whose values are right, or the refusal.

    Values are compared, sample by sample, with those of a library that we did not write, where there is one for the
    format and it reads the file; of others the size of what was read is told.
    """
    rows = []
    for path in sorted(path for path in folder.rglob("*") if path.is_file() and path.suffix.lower() in DATA):
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
            row |= {"format": format_of(path), "message": str(error)}
            row["verdict"] = "refused" if row["format"] else "of no format"
            continue
        row |= {"format": found.format, "verdict": "read", "message": f"{len(found.names)} x {len(found.frames)}"}
        compared = theirs(path, found)
        if compared is not None:
            by, same = compared
            row |= {"right_by": by, "verdict": "right" if same else "other values"}
    return rows


def format_of(path: Path) -> str:
    """The format of a file that is refused; empty where it is in none, as a table that says nothing of itself."""
    try:
        found = identify(path).name
    except MocapError:
        return ""
    return "" if found == "csv" else found


def theirs(path: Path, found: FileContents) -> tuple[str, bool] | None:
    """The library that reads a file, too, and whether its numbers are ours; None: there is none, or it fails."""
    peers = {
        "c3d": ("ezc3d", by_ezc3d),
        "sleap-analysis": ("sleap-io", by_sleap_io),
        "deeplabcut-csv": ("pandas", by_pandas),
        "dltdv-xypts": ("pandas", by_pandas),
        "dltdv-xyzpts": ("pandas", by_pandas),
        "vicon-csv": ("pandas", by_pandas),
    }
    peer = peers.get(found.format, ("OpenCV", by_opencv) if found.cameras and found.format != "c3d" else None)
    try:
        same = None if peer is None else peer[1](path, found)
    except (OSError, RuntimeError, ValueError, KeyError, IndexError, ImportError, TypeError):
        return None
    return None if peer is None or same is None else (peer[0], same)


def by_ezc3d(path: Path, found: FileContents) -> bool | None:
    """Positions of C3D, of labels that occur once; where we take (0, 0, 0) as missing it has zeros."""
    import ezc3d

    if found.points is None:
        return None
    file = ezc3d.c3d(str(path))
    labels, scale = file["parameters"]["POINT"]["LABELS"]["value"], metres(path, found.unit or "m")
    own = [m for m, name in enumerate(found.names) if labels.count(name) == 1]
    xyz = np.transpose(file["data"]["points"][:3], (2, 1, 0))[:, [labels.index(found.names[m]) for m in own]]
    mine = found.points.xyz_m[:, own]
    return xyz.shape == mine.shape and np.allclose(mine, xyz * scale, rtol=1e-6, atol=0, equal_nan=True)


def by_sleap_io(path: Path, found: FileContents) -> bool | None:
    """Pixels of SLEAP's HDF5, by track and node."""
    import sleap_io

    if found.pixels is None:
        return None
    labels = sleap_io.load_file(str(path))
    array = labels.numpy()  # frames, tracks, nodes, 2
    first = int(min(frame.frame_idx for frame in labels.labeled_frames))
    mine = found.pixels.uv_px[0].reshape(len(found.frames), array.shape[1], -1, 2)
    rows = np.isfinite(mine).any(axis=(1, 2, 3))
    array = array[first:] if len(array) != len(mine) else array
    return array.shape[2:] == mine.shape[2:] and np.allclose(mine[rows], array[: len(mine)][rows], equal_nan=True)


def by_pandas(path: Path, found: FileContents) -> bool | None:
    """All numbers of a table, in the order of its columns, by pandas' reader."""
    tracks = found.pixels if found.points is None else found.points
    if tracks is None:
        return None
    skip, first = {"deeplabcut-csv": (3, 1), "vicon-csv": (5, 2)}.get(found.format, (1, 0))
    axes = 2 if found.points is None else 3
    table = pd.read_csv(path, header=None, skiprows=skip, low_memory=False).iloc[:, first:]
    values = table.apply(pd.to_numeric, errors="coerce").dropna(how="all", axis=1).to_numpy(dtype=float)
    if found.format == "deeplabcut-csv":
        values = values.reshape(len(values), -1, 3)[..., :2].reshape(len(values), -1)
    if found.points is None:
        mine = np.transpose(found.pixels.uv_px, (1, 2, 0, 3)) if found.pixels is not None else np.zeros(0)
    else:
        mine = found.points.xyz_m / found.length_m(path)
    mine = mine.reshape(len(found.frames), -1)
    mine = mine[:, np.isfinite(mine).any(axis=0)]
    whole = np.isfinite(values).reshape(len(values), -1, axes).all(axis=-1) if values.shape[1] % axes == 0 else None
    if whole is not None:
        values = np.where(np.repeat(whole, axes, axis=1), values, np.nan)
    return values.shape == mine.shape and np.allclose(values, mine, rtol=1e-9, atol=1e-12, equal_nan=True)


def by_opencv(path: Path, found: FileContents) -> bool | None:
    """Pixels of points before cameras with lenses, as OpenCV distorts what their matrices project.

    A lens has its own focal length and centre. Where they are those of the matrix, and the world is not mirrored,
    OpenCV projects from rotation and position. Of DLT coefficients (easyWand, dvProject) they are others, to 20 px, and
    worlds are mirrored, which no rotation is: there the matrix projects to ideal pixels, whose rays OpenCV distorts.
    """
    import cv2

    del path
    rng, same = np.random.default_rng(0), []
    for camera in found.cameras:
        pin, lens = decompose(camera), camera.lens
        if lens is None:
            continue
        ahead = rng.uniform(-0.2, 0.2, (50, 3)) + np.array([0, 0, 1])
        xyz = (ahead * np.linalg.norm(pin.position_m) - pin.rotation @ -pin.position_m) @ pin.rotation
        one = np.allclose(pin.intrinsic, lens.intrinsic, rtol=1e-9, atol=1e-6) and np.linalg.det(pin.rotation) > 0
        if one:
            seen, turn, at = xyz, cv2.Rodrigues(pin.rotation)[0], -pin.rotation @ pin.position_m
        else:
            ideal = np.column_stack([xyz, np.ones(len(xyz))]) @ camera.matrix.T
            seen, turn, at = ideal @ np.linalg.inv(lens.intrinsic).T, np.zeros(3), np.zeros(3)
            seen = seen / seen[:, 2:]
        projected = cv2.fisheye.projectPoints if lens.model == "fisheye" else cv2.projectPoints
        uv, _ = projected(seen[:, None], turn, at, lens.intrinsic, lens.coefficients)
        same.append(np.allclose(record([camera], xyz)[0], uv[:, 0], atol=1e-6))
    return all(same) if same else None


def corpus(folder: Path, out: Path, each: int) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Tables of the sound files below a folder, and of mutants of those of which there are slips."""
    from benchmarks.silent import SLIPS, slips

    rows, done = [], Counter[str]()
    for path in sorted(folder.rglob("*.csv")):
        try:
            found = read(path)
        except MocapError:
            continue
        if found.format in SLIPS and done[found.format] < 8 and path.stat().st_size < 1_500_000:
            done[found.format] += 1
            rows += list(slips(path, found, each, out))
    return pd.DataFrame(strangers(folder)), pd.DataFrame(rows)


def told(files: pd.DataFrame, mutants: pd.DataFrame) -> str:
    """The counts that are to be 0, and what they are of."""
    refused = files[files["verdict"] == "refused"]
    of_none = int((files["verdict"] == "of no format").sum())
    lines = [f"{len(files)} files, {of_none} of them in no known format: of the others {len(refused)} refused"]
    lines += ["  " + str(row["message"])[:150] for row in refused.to_dict("records")]
    for by, own in files[files["right_by"] != ""].groupby("right_by"):
        lines.append(f"  {by}: {(own['verdict'] == 'right').sum()} of {len(own)} have its values")
    if len(mutants):
        silent = mutants["visible"] & ~mutants["told"]
        lines.append(
            f"{len(mutants)} mutants, {mutants['visible'].sum()} of which a check can see: {silent.sum()} in silence"
        )
        for (format, kind), own in mutants.groupby(["format", "kind"]):
            lost = (own["visible"] & ~own["told"]).sum()
            lines.append(f"  {format}, {kind}: {len(own)}, visible {own['visible'].sum()}, in silence {lost}")
    return "\n".join(lines)


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
    parser.add_argument("--corpus", type=Path, help="folder of sound files: read, compared, and mutants of them")
    parser.add_argument("--each", type=int, default=3, help="mutants of each kind of slip and file")
    parser.add_argument("--out", type=Path, help="folder for table.csv")
    options = parser.parse_args(arguments)
    if options.corpus is not None:
        with tempfile.TemporaryDirectory() as beside:
            files, mutants = corpus(options.corpus, options.out or Path(beside), options.each)
        print(told(files, mutants))
        written(files, options.out)
        if options.out is not None:
            mutants.to_csv(options.out / "mutants.csv", index=False)
        return
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
