"""What to look at, as SLEAP's Label QC lists it: its columns, read among our own places and written of them."""

import numpy as np
import pandas as pd
import pytest

from mocap.desk.label_qc import COLUMNS, LABEL_QC, read_label_qc, write_label_qc
from mocap.desk.places import Place
from mocap.errors import FormatError
from tests.mocap.desk.test_proof import proof_of

WORTH = np.array([[1.0, 4.0], [9.0, 2.0], [np.nan, 3.0]]) * 1e-6


def table(path, *rows):
    """As ``QCResults.to_dataframe`` of SLEAP 1.6.4 has it, with one of its features."""
    frame = pd.DataFrame([(*row, 2.5) for row in rows], columns=[*COLUMNS, "max_edge_zscore"])
    frame.to_csv(path, index=False)
    return path


def test_what_sleap_flags_stands_by_what_it_settles(tmp_path):
    """Above its threshold, each image once, at the marker that is least settled there, the largest error first."""
    path = table(
        tmp_path / LABEL_QC,
        (1, 0, 0, 0.95, "high", "Unusual edge length"),
        (0, 1, 0, 0.71, "medium", "Likely L/R swap"),
        (0, 1, 1, 0.99, "high", "Unusual scale"),
        (0, 2, 0, 0.69, "medium", "Unusual scale"),
    )
    found = read_label_qc(path, WORTH, cameras=2)
    assert [(p.camera, p.frame, p.marker, p.worth_m2) for p in found] == [(0, 1, 0, 9e-6), (1, 0, 1, 4e-6)]
    assert [p.why for p in found] == ["SLEAP: likely l/r swap (0.71)", "SLEAP: unusual edge length (0.95)"]


def test_what_is_written_is_read(tmp_path):
    """A place of all cameras is a line of each; the order is kept by the scores."""
    path = tmp_path / LABEL_QC
    places = [
        Place(frame=1, marker=0, first=1, last=1, worth_m2=9e-6, why="not seen for 3 frames"),
        Place(frame=0, marker=1, first=0, last=0, worth_m2=8e-6, why="click it in b", camera=1),
        Place(frame=2, marker=1, first=2, last=2, worth_m2=3e-6, why="digitised, but uncertain"),
    ]
    write_label_qc(path, places, ["nose", "tail"], cameras=2)
    listed = pd.read_csv(path)
    assert tuple(listed.columns[:6]) == COLUMNS
    assert listed["video_idx"].tolist() == [0, 1, 1, 0, 1]
    assert listed["score"].tolist() == [1, 1, 0.8889, 0.3333, 0.3333]
    assert listed["confidence"].tolist() == ["high"] * 3 + ["low"] * 2
    found = read_label_qc(path, WORTH, cameras=2)
    assert [(p.frame, p.camera) for p in found] == [(1, 0), (1, 1), (0, 1)]


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        ([(2, 0, 0, 0.9, "high", "x")], "line 2: video 2, frame 0; the recording has 2 and 3"),
        ([(0, 0, 0, 0.9, "high", "x"), (0, 3, 0, 0.1, "low", "x")], "line 3: video 0, frame 3"),
        ([(0, "a", 0, 0.9, "high", "x")], "line 2: no numbers"),
    ],
)
def test_a_table_of_other_videos_is_refused(tmp_path, rows, told):
    """With its line."""
    with pytest.raises(FormatError, match=told):
        read_label_qc(table(tmp_path / LABEL_QC, *rows), WORTH, cameras=2)


def test_another_table_is_refused(tmp_path):
    """With the column that it lacks."""
    (tmp_path / LABEL_QC).write_text("frame,score\n1,0.9\n")
    with pytest.raises(FormatError, match="no column video_idx"):
        read_label_qc(tmp_path / LABEL_QC, WORTH, cameras=2)


def test_the_desk_lists_them_among_its_own(tmp_path):
    """The gap, which a click settles most, stays first; a frame that both name is one line with both reasons."""
    proof, _, _ = proof_of(tmp_path)
    own = proof.places()
    alone = next(f for f in range(60) if f not in {p.frame for p in own})
    table(
        tmp_path / LABEL_QC,
        (0, own[0].frame, 0, 0.9, "high", "Unusual scale"),
        (2, alone, 0, 0.8, "high", "Isolated node"),
    )
    both = proof.places()
    assert len(both) == len(own) + 1
    assert both[0].why == f"{own[0].why}; SLEAP: unusual scale (0.90)"
    (added,) = [p for p in both if p.frame == alone]
    assert (added.camera, added.why) == (2, "SLEAP: isolated node (0.80)")
    worth = [p.worth_m2 for p in both]
    assert worth == sorted(worth, reverse=True)
