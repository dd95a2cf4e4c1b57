"""Gaps that people filled by hand, filled by this program and by splines: ``python -m benchmarks.hand_fills``.

Glides of snakes, raw and as their authors filled them in Qualisys. Only the raw file is read; every sample that it
lacks and the filled one has is compared. The authors' fills are polynomials, or relations between markers, chosen by
eye: agreement with them is no ground truth.
"""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from mocap.datasets.real import real_path
from mocap.filters.interpolate import interpolated

import mocap
from eal.arrays import Array

SET = "snake_glide_qualisys"


def off_mm(raw_file: Path) -> dict[str, Array]:
    """Distances (n,) from the authors' fills of a glide, by method."""
    raw, theirs = (mocap.read(file) for file in (raw_file, raw_file.with_stem(f"{raw_file.stem}_filled")))
    measured, filled = raw.tracks.xyz_m, theirs.tracks.xyz_m
    gone = np.isnan(measured[..., 0]) & np.isfinite(filled[..., 0])
    tracked = mocap.track(raw, progress=lambda _stage, _share: None)
    position = tracked.markers.position.isel(individual=0).sel(keypoint=list(raw.tracks.names))
    fills = {"this program": position.transpose("time", "keypoint", "space").values}
    fills["cubic spline"] = interpolated(measured, raw.tracks.t_s, kind="cubic")
    return {name: 1000 * np.linalg.norm(fill - filled, axis=-1)[gone] for name, fill in fills.items()}


def table(parts: Sequence[Mapping[str, Array]]) -> str:
    """A row a method: samples, median, 90th percentile, RMS, largest, all in mm."""
    lines = [f"{'mm':14}{'n':>6}{'median':>9}{'90 %':>9}{'RMS':>9}{'largest':>9}"]
    for name in parts[0]:
        off = np.concatenate([part[name] for part in parts])
        off = off[np.isfinite(off)]
        numbers = (np.median(off), np.quantile(off, 0.9), np.sqrt(np.mean(off**2)), off.max())
        lines.append(f"{name:14}{len(off):6}" + "".join(f"{number:9.2f}" for number in numbers))
    return "\n".join(lines)


def main() -> None:
    """Track all glides and print the table."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    raw = sorted(file for file in real_path(SET).glob("*.tsv") if not file.stem.endswith("_filled"))
    print(table([off_mm(file) for file in raw]))


if __name__ == "__main__":
    main()
