"""Fills that Qualisys users made in short gaps, beside ours and splines': ``python -m benchmarks.hand_fills``.

Glides of snakes (``datasets.real``: raw and filled by the authors). Every sample that the raw export lacks and the
filled one has is compared; only the raw one is read. The authors' fills are themselves polynomials or relations between
markers that QTM offers, chosen by eye: agreement with them is no truth, but a large difference is a finding.
"""

import argparse
import os
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator
from threadpoolctl import threadpool_limits

from eal.arrays import Array
from mocap.io.registry import read
from mocap.pipeline.job import run_job
from mocap.pipeline.prepare import prepare_tracks
from mocap.records import MarkerTracks
from mocap.skeleton import Skeleton


def spline(kind: type[CubicSpline] | type[PchipInterpolator], tracks: MarkerTracks) -> Array:
    """(T, M, 3) each marker interpolated by itself."""
    out = np.full(tracks.xyz_m.shape, np.nan)
    for m in range(len(tracks.names)):
        seen = np.flatnonzero(tracks.seen[:, m])
        if len(seen) > 3:
            inside = np.arange(seen[0], seen[-1] + 1)
            out[inside, m] = kind(tracks.t_s[seen], tracks.xyz_m[seen, m])(tracks.t_s[inside])
    return out


def ours(tracks: MarkerTracks) -> tuple[Array, Array]:
    """Positions and the square roots of the traces of their covariances."""
    prepared = prepare_tracks(tracks, Skeleton(name="markers only", markers=tracks.names), name="glide")
    run, _ = run_job(prepared, validated=False)
    markers = run.tracked.markers
    return markers.xyz_m, np.sqrt(np.trace(markers.cov_m2, axis1=-2, axis2=-1))


def line(name: str, off_mm: Array) -> str:
    """A row of the table."""
    known = off_mm[np.isfinite(off_mm)]
    rms = np.sqrt(np.mean(known**2))
    middle, most = np.median(known), np.quantile(known, 0.9)
    return f"{name:16}{len(known):6}{middle:9.2f}{most:9.2f}{rms:9.2f}{known.max():9.1f}"


def main() -> None:
    """Print the table, and the largest differences."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("MOCAP_REAL_DATA", beside)))
    folder = parser.parse_args().data / "snake_glide_qualisys"
    found: dict[str, list[Array]] = {"this program": [], "cubic spline": [], "PCHIP": []}
    largest = []
    with threadpool_limits(1):
        for path in sorted(folder.glob("*_filled.tsv")):
            theirs, raw = (read(p).points for p in (path, path.with_name(path.name.replace("_filled", ""))))
            assert theirs is not None
            assert raw is not None
            gone = theirs.seen & ~raw.seen
            xyz, sd = ours(raw)
            fills = (xyz, spline(CubicSpline, raw), spline(PchipInterpolator, raw))
            for name, fill in zip(found, fills, strict=True):
                found[name].append(1e3 * np.linalg.norm(fill - theirs.xyz_m, axis=-1)[gone])
            for (t, m), *off in zip(np.argwhere(gone), *(found[name][-1] for name in found), strict=True):
                largest.append((off[0], path.stem, raw.names[m], t + 1, off[1], off[2], 1e3 * sd[t, m]))
    print(f"{'mm':16}{'n':>6}{'median':>9}{'90 %':>9}{'RMS':>9}{'largest':>9}")
    for name, parts in found.items():
        print(line(name, np.concatenate(parts)))
    print(f"\nlargest: {'trial, marker, frame':30}{'ours':>8}{'cubic':>8}{'PCHIP':>8}{'our sd':>8}")
    for off, trial, marker, frame, cubic, pchip, sd in sorted(largest, reverse=True)[:15]:
        print(f"         {f'{trial} {marker} {frame}':30}{off:8.1f}{cubic:8.1f}{pchip:8.1f}{sd:8.1f}")


if __name__ == "__main__":
    main()
