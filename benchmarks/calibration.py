"""Calibration beside OpenCV and easyWand, on the real sets: ``python -m benchmarks.calibration``.

Boards are found in the pictures once; OpenCV is given the same corners. The same numbers are compared: root mean square
error of the corners, in pixels, and the wand's score on wands that the fit saw, and on others.
"""

import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.io import loadmat

from mocap.calibration.board_rig import calibrate_boards
from mocap.calibration.boards import Board, Charuco, Checkerboard
from mocap.calibration.detect import BoardViews, detect
from mocap.calibration.pictures import pictures_of
from mocap.calibration.wand import MOVES, calibrate_wand, wand_lengths, wand_score
from mocap.io.easywand import read_easywand

FOLDER = Path(os.environ.get("MOCAP_REAL_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
BOARDS: dict[str, Board] = {
    "checkerboard_stereo_pair": Checkerboard(columns=9, rows=6, square_m=0.02379),
    "mouse_charuco_4cam": Charuco(columns=8, rows=11, square_m=0.024, marker_m=0.01875, dictionary="DICT_4X4_1000"),
}
WANDS = (
    "bat_cave_dltdv7/2018-07-28_wand_and_detections/video_calibration_data/round3_2018-07-28_easyWandData.mat",
    "bat_windtunnel_dltdv8/windtunnelCalibration2/extrinsicCalib_20230228_easyWandData.mat",
)


def opencv(views: Mapping[str, BoardViews], board: Board) -> tuple[float, float]:
    """``calibrateMultiview``, Brown's five coefficients, on all boards seen whole: root mean square error, seconds."""
    local = board.points().astype(np.float32)
    stems = sorted(set().union(*(v.corners for v in views.values())))
    none = np.full((len(local), 2), -1, np.float32)
    pixels, mask = [], np.zeros((len(views), len(stems)), np.uint8)
    for i, view in enumerate(views.values()):
        whole = [stem in view.corners and len(view.corners[stem].ids) == len(local) for stem in stems]
        mask[i] = whole
        pixels.append(
            [view.corners[t].uv_px.astype(np.float32) if w else none for t, w in zip(stems, whole, strict=True)]
        )
    sizes = [v.size_px for v in views.values()]
    models = np.zeros((len(views), 1), np.uint8)
    start = time.perf_counter()
    multiview: Any = cv2.calibrateMultiview
    rms, *_ = multiview([local] * len(stems), pixels, sizes, mask, models, None, None, None, None)
    return float(rms), time.perf_counter() - start


def boards() -> None:
    """Rigs from pictures."""
    print("| set | boards found | ours px | lenses | s | OpenCV calibrateMultiview px | s | ours / OpenCV |")
    print("|---|---|---|---|---|---|---|---|")
    for name, board in BOARDS.items():
        start = time.perf_counter()
        printed, views = detect(pictures_of(FOLDER / name), board)
        detected = time.perf_counter() - start
        start = time.perf_counter()
        found = calibrate_boards(views, printed)
        seconds = time.perf_counter() - start
        try:
            theirs, their_seconds = opencv(views, printed)
        except cv2.error as error:
            theirs, their_seconds = float("nan"), float("nan")
            print(f"(OpenCV: {str(error).splitlines()[0]})")
        count = ", ".join(f"{len(v.corners)} of {len(v.corners) + len(v.missed)}" for v in views.values())
        lenses = ", ".join(i.choice for i in found.intrinsics)
        print(
            f"| {name} | {count} ({detected:.0f} s) | {found.rms_px:.3f} | {lenses} | {seconds:.1f} | {theirs:.3f} | "
            f"{their_seconds:.1f} | {found.rms_px / theirs:.2f} |"
        )


def wands() -> None:
    """Wand scores: easyWand's, which saw all wands; ours on the same, and on wands held out in eighths."""
    print("\n| set | wands | easyWand | ours, same wands | ours, held out | free | s | held out / easyWand |")
    print("|---|---|---|---|---|---|---|---|")
    for name in WANDS:
        wand = read_easywand(FOLDER / name)
        removed = loadmat(FOLDER / name, simplify_cells=True)["easyWandData"]["rmpts"].any(axis=1)
        pixels = np.where(removed[None, :, None, None], np.nan, wand.wand_px)
        theirs = wand_score(wand_lengths(wand.cameras, pixels))
        for moves in MOVES:
            start = time.perf_counter()
            found = calibrate_wand(
                wand.lenses, wand.sizes_px, pixels, wand.background_px, length_m=wand.wand_length, moves=moves
            )
            print(
                f"| {name.split('/')[0]} | {found.wands} | {theirs:.3f} | {found.score:.3f} | "
                f"{found.held_out_score:.3f} | {moves} | {time.perf_counter() - start:.1f} | "
                f"{found.held_out_score / theirs:.2f} |"
            )


def main() -> None:
    """Print both tables."""
    boards()
    wands()


if __name__ == "__main__":
    main()
