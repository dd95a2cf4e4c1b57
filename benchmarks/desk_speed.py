"""How long the desk takes to answer a correction, and to solve again what it touches, in a long recording.

    python -m benchmarks.desk_speed [--quick] --out DIR

A recording of ``FRAMES`` frames and ``MARKERS`` markers from ``CAMERAS`` cameras, tracked exactly, with gaps in which
one camera sees a marker, is opened by the page and asked over its server as a browser asks. ``table.csv`` has a row for
each kind of correction: seconds until it is on the disk and the frame is drawn again (``answered``), and until what it
touches is solved and the list of places made anew (``solved``): medians and the longest of ``TIMES``, processor time of
the whole process (server and asker) and wall time. ``--quick``: a tenth of the frames.
"""

import argparse
import csv
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any, cast
from urllib.parse import urlsplit

import httpx2
import numpy as np

from mocap.batches.known import Options
from mocap.cameras.camera import record
from mocap.desk.desk import Desk
from mocap.desk.page import desk_page
from mocap.desk.proof import Proof
from mocap.pipeline.recording import of_pixels, with_ideal_pixels
from mocap.records import PixelTracks, Status, marker_tracks
from mocap.web import served
from tests.mocap.rigs import ring

FRAMES, MARKERS, CAMERAS, FPS = 10_000, 34, 4, 500.0
TIMES = 8
COLUMNS: tuple[str, ...] = ("kind", "answered_cpu_s", "answered_s", "solved_cpu_s", "solved_s", "solved_longest_s")


def proof_of(folder: Path, n_frames: int) -> Proof:
    """A trial of many markers, tracked exactly; a tenth of the frames of each is not seen by all but one camera."""
    cameras, t_s, rng = ring(CAMERAS), np.arange(n_frames) / FPS, np.random.default_rng(0)
    turn = rng.uniform(0, 6, (MARKERS, 3))
    xyz = 0.1 * np.sin(2 * np.pi * rng.uniform(0.5, 8, (MARKERS, 3)) * t_s[:, None, None] + turn)
    uv = record(cameras, xyz)
    uv += 0.3 * rng.normal(size=uv.shape)
    seen = (np.arange(n_frames)[:, None] // 25 + np.arange(MARKERS)) % 10 > 0
    uv[1:, ~seen] = np.nan
    names = tuple(f"marker_{m}" for m in range(MARKERS))
    pixels = PixelTracks(names=names, cameras=tuple(c.name for c in cameras), t_s=t_s, uv_px=uv)
    raw = of_pixels(pixels, cameras, name="t", unit="m", pixel_origin="upper-left", calibration_origin="upper-left")
    cov = np.where(seen, 1.0, 25.0)[..., None, None] * 1e-8 * np.eye(3)
    status = np.where(seen, Status.MEASURED, Status.SMOOTHED).astype(np.int8)
    result = SimpleNamespace(
        tracks=marker_tracks(names, t_s, xyz, cov_m2=cov, status=status),
        repaired=np.zeros(seen.shape, dtype=np.int8),
        plane=None,
        report={"pixel_noise_px": {"jitter": 0.3}},
        kinematics={},
        potentials={},
    )
    return Proof(name="t", raw=with_ideal_pixels(raw), result=cast(Any, result), log=folder / "edits.jsonl")


def measured(kind: str, asked: httpx2.Client, path: str, given: list[dict[str, Any]]) -> dict[str, Any]:
    """A row of the table."""
    taken = []
    for what in given:
        stamps = [(time.process_time(), time.perf_counter())]
        frame = what.get("frame", what.get("first", 0))
        for calls in (
            ((path, what), (f"frame?frame={frame}&marker=0", None)),
            (("settle", {}), ("places", None), (f"frame?frame={frame}&marker=0", None)),
        ):
            for to, said in calls:
                (asked.get(to) if said is None else asked.post(to, json=said)).raise_for_status()
            stamps.append((time.process_time(), time.perf_counter()))
        taken.append(np.diff(stamps, axis=0))
    found = np.array(taken)  # (times, answered or solved, processor or wall)
    numbers = [*np.median(found, axis=0).ravel(), found[:, 1, 1].max()]
    return {"kind": kind, **dict(zip(COLUMNS[1:], (f"{x:.3f}" for x in numbers), strict=True))}


def main() -> None:
    """Measure and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    n = FRAMES // 10 if given.quick else FRAMES
    frames = np.linspace(n // 9, n - 200, TIMES).astype(int).tolist()
    with TemporaryDirectory() as place:
        desk = Desk(out=Path(place), trials={}, options=Options(), proof=proof_of(Path(place), n))
        with served(desk_page(desk)) as site:
            origin = "http://" + urlsplit(site.address).netloc
            with httpx2.Client(base_url=site.address, headers={"Origin": origin}, timeout=600) as asked:
                asked.post("settle", json={})
                asked.get("places")
                at = {"camera": 1, "uv_px": [600.0, 500.0]}
                ranges = [{"first": f, "last": f + 30} for f in frames]
                rows = [
                    measured("place", asked, "place", [{**at, "frame": f, "marker": f % MARKERS} for f in frames]),
                    measured("delete 30 frames", asked, "delete", [{"marker": 3, **span} for span in ranges]),
                    measured("exchange 30 frames", asked, "exchange", [{"marker": 5, "other": 8, **s} for s in ranges]),
                    measured("undo", asked, "undo", [{} for _ in frames]),
                ]
    given.out.mkdir(parents=True, exist_ok=True)
    with (given.out / "table.csv").open("w", newline="") as stream:
        table = csv.DictWriter(stream, COLUMNS)
        table.writeheader()
        table.writerows(rows)
    print((given.out / "table.csv").read_text())


if __name__ == "__main__":
    main()
