"""What to look at, exchanged with SLEAP's Label QC (version 1.6), which exports a table of its scores.

Both state: which camera, frame and animal, a score between 0 and 1, and what is the matter. SLEAP scores an animal in
an image, this program a marker by what a correction of it settles: theirs get the least settled marker of the frame.
"""

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from eal.arrays import Array
from mocap.desk.places import MOST, Place
from mocap.documents import regular_bytes
from mocap.errors import FormatError

LABEL_QC = "qc_results.csv"
"""As SLEAP calls its export; lying beside the corrections of a trial it is read."""
COLUMNS = ("video_idx", "frame_idx", "instance_idx", "score", "confidence", "top_issue")
FLAGGED = 0.7
"""SLEAP's own threshold of ``QCResults.get_flagged``."""
_LEVELS = ((0.8, "high"), (0.5, "medium"), (0.0, "low"))
"""SLEAP's confidence, of scores above."""


def write_label_qc(path: Path, places: Sequence[Place], names: Sequence[str], *, cameras: int) -> None:
    """Write places as SLEAP lists them, the first with the score 1; the marker and the expected error are added.

    Args:
        path: The table.
        places: What is to be looked at, the most useful first.
        names: The markers.
        cameras: How many; each is a video of SLEAP's. A place of all cameras is a line of each.
    """
    most = max((place.worth_m2 for place in places), default=1.0) or 1.0
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow([*COLUMNS, "marker", "expected_error_mm"])
        for place in places:
            score = place.worth_m2 / most
            level = next(said for least, said in _LEVELS if score > least or least == 0.0)
            why, error = f"{names[place.marker]}: {place.why}", f"{1e3 * place.worth_m2**0.5:.3g}"
            for camera in range(max(cameras, 1)) if place.camera is None else [place.camera]:
                table.writerow([camera, place.frame, 0, f"{score:.4f}", level, why, names[place.marker], error])


def read_label_qc(path: Path, unsettled_m2: Array, *, cameras: int) -> list[Place]:
    """What SLEAP flagged, each frame of a camera once, as places of the marker that is least settled there.

    Args:
        path: Its table.
        unsettled_m2: (T, M) as of ``mocap.desk.places.unsettled``.
        cameras: How many there are.

    Raises:
        FormatError: it is another table, or of other videos.
    """
    table = csv.DictReader(regular_bytes(path).decode("utf-8-sig", errors="replace").splitlines())
    if lost := [column for column in COLUMNS if column not in (table.fieldnames or ())]:
        raise FormatError(f"{path.name}: no column {lost[0]}; expected what SLEAP's Label QC exports")
    found: dict[tuple[int, int], Place] = {}
    worth = np.nan_to_num(unsettled_m2)
    for number, row in enumerate(table, start=2):
        try:
            camera, frame, score = int(row["video_idx"]), int(row["frame_idx"]), float(row["score"])
        except (TypeError, ValueError):
            raise FormatError(f"{path.name}: line {number}: no numbers of a video, a frame and a score") from None
        if not 0 <= frame < len(worth) or not 0 <= camera < max(cameras, 1):
            raise FormatError(
                f"{path.name}: line {number}: video {camera}, frame {frame}; the recording has {max(cameras, 1)} and "
                f"{len(worth)}, counted from 0: it is of other videos"
            )
        if score >= FLAGGED and (camera, frame) not in found:
            m = int(np.argmax(worth[frame]))
            why = f"SLEAP: {str(row['top_issue'])[:80].lower()} ({score:.2f})"
            one = Place(frame=frame, marker=m, first=frame, last=frame, worth_m2=float(worth[frame, m]), why=why)
            found[camera, frame] = one if cameras < 1 else Place(**{**vars(one), "camera": camera})
    return sorted(found.values(), key=lambda place: -place.worth_m2)[:MOST]
