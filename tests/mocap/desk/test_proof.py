"""What the desk draws over pictures and asks for, on recordings that were tracked in no time."""

import re
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from mocap.cameras.camera import record
from mocap.cameras.origin import PixelOptions
from mocap.desk.places import places
from mocap.desk.proof import Proof
from mocap.kinematics.records import Rests
from mocap.reading.edits import read_edits
from mocap.reading.ideal_pixels import of_pixels
from mocap.records import PixelTracks, Status, marker_tracks
from mocap.tracking.retrack import AROUND
from tests.mocap.rigs import ring

HEIGHT_PX, NOISE_PX = 1024.0, 0.3


def proof_of(folder, n_frames=60, *, lower_left=False, lens=True, hidden=slice(20, 30), sd_m=1e-4):
    """A trial of two markers, tracked exactly; the second is not seen in ``hidden``."""
    cameras, t_s, rng = ring(3, lens=lens), np.arange(n_frames) / 100, np.random.default_rng(0)
    xyz = 0.1 * np.sin(2 * np.pi * t_s[:, None, None] + rng.uniform(0, 6, (2, 3)))
    seen_px = record(cameras, xyz)
    uv = seen_px + NOISE_PX * rng.normal(size=seen_px.shape)
    uv[..., 1] = HEIGHT_PX - uv[..., 1] if lower_left else uv[..., 1]
    uv[:, hidden, 1] = np.nan
    names = ("a", "b")
    pixels = PixelTracks(names=names, cameras=tuple(c.name for c in cameras), t_s=t_s, uv_px=uv)
    corner = "lower-left" if lower_left else "upper-left"
    options = PixelOptions(origin=corner, calibration_origin="upper-left")
    raw = of_pixels(pixels, cameras, name="t", unit="m", options=options)
    seen = np.isfinite(uv[0, ..., 0])
    cov = np.where(seen, 1.0, 25.0)[..., None, None] * sd_m**2 * np.eye(3)
    status = np.where(seen, Status.MEASURED, Status.SMOOTHED).astype(np.int8)
    tracks = marker_tracks(names, t_s, xyz, cov_m2=cov, status=status)
    report = {"pixel_noise_px": {"jitter": NOISE_PX}}
    result = SimpleNamespace(
        tracks=tracks, repaired=np.zeros(seen.shape, dtype=np.int8), plane=None, report=report, kinematics={}
    )
    return Proof(name="t", raw=raw, result=result, log=folder / "edits.jsonl"), seen_px, xyz


@pytest.mark.parametrize("lower_left", [False, True])
@pytest.mark.parametrize("lens", [False, True])
def test_marks_are_where_pictures_show_the_marker(tmp_path, lower_left, lens):
    """Whichever corner the file counts from: clicks, ellipses and lines from above, as pictures have them.

    What is clicked in the picture is kept as the file counts.
    """
    proof, seen_px, _ = proof_of(tmp_path, lower_left=lower_left, lens=lens)
    for c, camera in enumerate(proof.frame(10, 0)["cameras"]):
        mark = camera["markers"][0]
        np.testing.assert_allclose(mark["click"], seen_px[c, 10, 0], atol=5 * NOISE_PX)
        np.testing.assert_allclose(mark["ellipse"][:2], seen_px[c, 10, 0], atol=0.1)
    proof.edit(what="place", frame=25, marker="b", camera="cam1", uv_px=tuple(seen_px[0, 24, 1]))
    kept = read_edits(proof.log)[0].uv_px
    u, v = seen_px[0, 24, 1]
    np.testing.assert_allclose(kept, (u, HEIGHT_PX - v if lower_left else v), atol=1e-9)
    proof.edit(what="place", frame=25, marker="b", camera="cam2", uv_px=tuple(seen_px[1, 24, 1]))
    proof.settle()
    assert proof.frame(24, 1)["status"] == "edited"
    np.testing.assert_allclose(proof.frame(24, 1)["cameras"][0]["markers"][1]["ellipse"][:2], seen_px[0, 24, 1], atol=1)


def test_a_wrong_place_is_told(tmp_path):
    """A place that the other cameras contradict is kept: they are not believed, and the answer says what is missed."""
    proof, seen_px, _ = proof_of(tmp_path)
    proof.edit(what="place", frame=10, marker="a", camera="cam1", uv_px=tuple(seen_px[0, 9, 0] + 30))
    missed = re.search(r"reprojection error in cam1: (\d+) px", proof.settle())
    assert missed is not None
    assert int(missed[1]) < 42 / 2  # 30 px in both coordinates: 42; of one ray and the motion the ray weighs more
    assert len(read_edits(proof.log)) == 1


def test_long_ranges_are_solved_at_their_ends(tmp_path):
    """A long range that is deleted is gone in the middle; one that is exchanged is so in the tracks, and undone."""
    n = 6 * AROUND
    proof, _, xyz = proof_of(tmp_path, n_frames=n, hidden=slice(0, 0))
    first, last = AROUND, 5 * AROUND
    proof.edit(what="exchange", frame=first + 1, last=last + 1, marker="a", other="b")
    proof.settle()
    middle = n // 2
    np.testing.assert_allclose(proof.tracks.xyz_m[middle], xyz[middle, ::-1])
    proof.edit(what="undo")
    proof.settle()
    np.testing.assert_allclose(proof.tracks.xyz_m, xyz, atol=2e-3)
    proof.edit(what="delete", frame=first + 1, last=last + 1, marker="a")
    proof.settle()
    assert proof.tracks.status[middle, 0] == Status.MISSING
    np.testing.assert_allclose(proof.tracks.xyz_m[middle, 1], xyz[middle, 1])


@pytest.mark.parametrize("hidden", [slice(50, 60), slice(20, 30)])
@pytest.mark.parametrize("clicks", [1, 2])
def test_undo_gives_back_every_bit(tmp_path, hidden, clicks):
    """Of an end that was extrapolated, which one ray does not settle, and of a gap: NaN, covariances and status, too.

    Also of what was solved between, in the reverse order; a click takes no position away that there was.
    """
    proof, seen_px, _ = proof_of(tmp_path, hidden=hidden)
    status = np.array(proof.tracks.status)
    status[hidden, 1] = Status.PREDICTED
    xyz, cov = np.array(proof.tracks.xyz_m), np.array(proof.tracks.cov_m2)
    cov[hidden, 1] *= np.arange(1, 11)[:, None, None]  # the further off the less certain
    xyz[3, 0], cov[3, 0], status[3, 0] = np.nan, np.nan, Status.MISSING  # what there is no position of
    proof.tracks = proof.result.tracks = marker_tracks(("a", "b"), proof.tracks.t_s, xyz, cov_m2=cov, status=status)
    place = proof.places()[0]
    assert (place.marker, place.frame) == (1, hidden.stop - 1)
    states = [proof.tracks]
    for camera in range(clicks):
        where = tuple(seen_px[camera, place.frame, 1].tolist())
        proof.place(camera=camera, frame=place.frame, marker=1, uv_px=where)
        proof.settle()
        states.append(proof.tracks)
    assert np.isfinite(proof.tracks.xyz_m[hidden, 1]).all()
    assert clicks == 1 or proof.tracks.status[place.frame, 1] == Status.MEASURED
    proof.delete(marker=0, first=0, last=6)
    proof.settle()
    while proof.edits and states:
        said = proof.undo()
        proof.settle()
        before = states.pop()
        for name in ("xyz_m", "cov_m2", "status"):
            assert getattr(proof.tracks, name).tobytes() == getattr(before, name).tobytes(), (said, name)
    assert said == "0 corrections kept"
    assert proof.recording is proof.raw


def test_a_curve_has_the_cycles_in_its_frames(tmp_path):
    """By what they are of, with their times in seconds; values at so many frames as are wanted, gaps as None."""
    proof, _, _ = proof_of(tmp_path)
    value = np.where(np.arange(60) == 0, np.nan, np.arange(60.0))
    rests = np.full(60, Rests.MEASURED)
    proof.result.kinematics = {
        "q": SimpleNamespace(value=value, low=value - 1, high=value + 1, unit="deg", rests=rests)
    }
    rows = [
        ("wing_beat", "a", 0.1, 0.3, "counted", ""),
        ("wing_beat", "a", 0.3, 0.5, "doubtful", "its end was not seen"),
        ("stride", "b", 0.0, 0.2, "counted", ""),
    ]
    proof.result.cycles = pd.DataFrame(rows, columns=["kind", "of", "start_s", "end_s", "status", "reason"])
    curve = proof.curve("q", points=30)
    assert curve["cycles"] == {"a, wing beat": [[0.1, 0.3], [0.3, 0.5]], "b, stride": [[0.0, 0.2]]}
    assert curve["doubtful"] == {"a, wing beat": {1: "its end was not seen"}}
    assert len(curve["frames"]) == 30
    assert curve["value"] == [None, *curve["frames"][1:]]


def test_a_marker_is_shown_before_and_after_a_correction(tmp_path):
    """The track as it was and as it is, and a spline that is near the truth over the gap, of a sine of 1 Hz.

    Of a measured frame the spline leaves that frame out; at an end, where there is no other side, there is none.
    """
    proof, seen_px, xyz = proof_of(tmp_path)
    truth = 1e3 * xyz[:, 1].T
    found = proof.around(25, 1)
    rows = found["frames"]
    assert (rows[0], rows[-1]) == (max(0, 25 - AROUND), min(59, 25 + AROUND))
    np.testing.assert_allclose(found["before"], truth[:, rows], atol=1e-3)
    spline = np.array(found["spline"], dtype=float)
    inside = (np.array(rows) >= 19) & (np.array(rows) <= 30)
    assert (np.isfinite(spline) == inside).all()
    # of a cubic spline over a gap h: 5/384 h^4 of the fourth derivative, 100 mm (2 pi / s)^4, h 0.11 s
    assert np.nanmax(np.abs(spline - truth[:, rows])) < 5 / 384 * 0.11**4 * 100 * (2 * np.pi) ** 4 + 1e-2
    wrong = seen_px[0, 25, 1] + (30.0, 0.0)
    proof.edit(what="place", frame=26, marker="b", camera="cam1", uv_px=tuple(wrong))
    proof.edit(what="place", frame=26, marker="b", camera="cam2", uv_px=tuple(seen_px[1, 25, 1]))
    proof.settle()
    after = proof.around(25, 1)
    assert after["before"] == found["before"]
    at = rows.index(25)
    assert np.abs(np.array(after["after"])[:, at] - truth[:, 25]).max() > 0.5
    assert np.isfinite(np.array(proof.around(10, 0)["spline"], dtype=float)).any(axis=0).sum() == 3
    assert not np.isfinite(np.array(proof.around(0, 0)["spline"], dtype=float)).any()


def test_two_hypotheses_are_worth_the_square_of_half_their_distance(tmp_path):
    """A sample that was not believed, d from the track: d^2 / 4 and its covariance; a gap: the sum of its own."""
    proof, _, xyz = proof_of(tmp_path)
    status = np.array(proof.tracks.status)
    status[40, 0] = Status.REJECTED
    measured = xyz.copy()
    measured[40, 0, 0] += 0.02
    tracks = marker_tracks(("a", "b"), proof.tracks.t_s, xyz, cov_m2=proof.tracks.cov_m2, status=status)
    none = np.zeros(status.shape, dtype=bool)
    doubted, gap, *_ = places(tracks, measured, none)
    assert (doubted.frame, doubted.marker) == (40, 0)
    assert doubted.worth_m2 == pytest.approx(0.02**2 / 4 + 3e-8)
    assert (gap.marker, gap.first, gap.last) == (1, 20, 29)
    assert gap.worth_m2 == pytest.approx(10 * 3 * 25e-8)
    done = none.copy()
    done[40, 0] = True
    assert places(tracks, measured, done)[0] == gap
