"""Proof-reading of a recording from one camera, tracked with a learned model."""

import cv2
import numpy as np

import mocap
from mocap.desk.proof import open_proof
from mocap.reading.edits import read_edits
from tests.filters.flapping_trials import NAMES, filmed, flapping
from tests.mocap.test_track_one_camera import files, learned, read

__all__ = ["files", "learned"]  # fixtures


def test_its_film_is_shown_with_predicted_ellipses(files, learned, tmp_path):
    """Its film is found; the 95 % ellipse of a tip that is hidden for 20 frames holds its true pixel in 17 or more.

    A correction is kept, and the answer says who solves it: one ray alone settles nothing.
    """
    true_px = filmed(flapping(9), np.random.default_rng(0))[0]
    tip, size = NAMES.index("tip_l"), np.ceil(np.nanmax(true_px, axis=(0, 1)) + 20).astype(int)
    (tmp_path / "film").mkdir()
    for frame in range(len(true_px)):
        picture = np.full(size[::-1], frame % 200, dtype=np.uint8)
        cv2.imwrite(str(tmp_path / "film" / f"{frame:04d}.png"), picture)
    recording = read(files)
    proof = open_proof("film", recording, mocap.track(recording, model=learned), tmp_path / "edits.jsonl")
    assert proof.info()["films"]
    assert (proof.picture(0, 60) == 60).all()
    inside = 0
    for frame in range(50, 70):
        (camera,) = proof.frame(frame, tip)["cameras"]
        mark = camera["markers"][tip]
        assert mark["click"] is None
        u, v, long, short, turn = mark["ellipse"]
        away = true_px[frame, tip] - (u, v)
        along = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]) @ away
        inside += bool(np.sum((along / (long, short)) ** 2) <= 1)
    assert inside >= 17
    proof.place(camera=0, frame=60, marker=tip, uv_px=tuple(true_px[60, tip].tolist()))
    assert "when the trial is tracked again" in proof.settle()
    assert [edit.frame for edit in read_edits(proof.log)] == [61]
