"""The arena of two digitisers: peers and judges on clicks whose truth is known."""

from typing import Any, cast

import numpy as np
import pytest

from benchmarks.arena.flights import PAIRS, Flight
from benchmarks.arena.judge import Names, errors, names
from benchmarks.arena.methods import Outcome, authors, butterworth, triangulation
from benchmarks.arena.peers import anipose, kalman_smoother
from mocap.cameras.camera import project, stacked
from mocap.cleaning.swaps import Swap
from tests.mocap.rigs import cloud, ring

N_FRAMES = 120


class Films:
    """What a flight needs of ``Filmed``."""

    def __init__(self, matrices, ideal_px):
        """Keep both."""
        self.matrices, self.ideal_px = matrices, ideal_px


@pytest.fixture(scope="module")
def flight():
    """Sixteen points on a straight way, clicked exactly; two people in every tenth frame, both exactly right.

    Left and right wrists are exchanged in camera 1 from frame 30 to 59.
    """
    matrices = stacked(ring(3))
    body = cloud(np.random.default_rng(0), 16, radius_m=0.1)
    xyz = body + np.linspace([-0.2, 0, 0], [0.2, 0.1, 0.1], N_FRAMES)[:, None]
    uv = project(matrices, xyz)
    left, right = PAIRS[1]
    uv[1, 30:60, left], uv[1, 30:60, right] = uv[1, 30:60, right].copy(), uv[1, 30:60, left].copy()
    people = np.full((2, *xyz.shape), np.nan)
    people[:, ::10] = xyz[::10]
    nobody = cast(Any, None)
    made = Flight(
        name="made",
        recording=cast(Any, Films(matrices, uv)),
        likelihood=np.full(uv.shape[:3], 0.9),
        people=(nobody, nobody),
        people_px=np.full((2, *uv.shape), np.nan),
        people_m=people,
    )
    return made, xyz


def test_the_authors_repair_puts_an_exchanged_camera_right(flight):
    """Triangulation has both wrists off in 30 frames; the repair finds the truth there."""
    made, xyz = flight
    plain, repaired = triangulation(made).xyz_m, authors(made).xyz_m
    wrists = list(PAIRS[1])
    assert np.linalg.norm(plain - xyz, axis=-1)[30:60, wrists].min() > 0.005
    assert np.linalg.norm(repaired - xyz, axis=-1)[30:60, wrists].max() < 1e-4
    others = [m for m in range(16) if m not in wrists]
    np.testing.assert_allclose(plain[:, others], xyz[:, others], atol=1e-9)


def test_judges_count_what_people_can_see(flight):
    """Three judged frames (30, 40, 50) have exchanged clicks; exchanging 35 to 64 is right in two and wrong in one."""
    made, xyz = flight
    left, right = PAIRS[1]
    swap = Swap(a=left, b=right, frames=np.arange(35, 65), camera=1, gain=1.0)
    told = names(made, Outcome(xyz_m=xyz, swaps=(swap,)))
    assert told == Names(pairs=12 * 6, exchanged=0, crossed=3, put_right=3, right=2, wrong=1)
    mirrored = xyz.copy()
    mirrored[:, [left, right]] = xyz[:, [right, left]]
    told = names(made, Outcome(xyz_m=mirrored))
    assert (told.exchanged, told.put_right) == (12, 0)


def test_errors_and_intervals(flight):
    """Points 1 mm off along x, known to 0.6 mm: a distance of 1 mm, and all coordinates inside; known to 0.5: two."""
    made, xyz = flight
    aside = xyz + np.array([1e-3, 0, 0])
    for sd, inside in ((0.6e-3, 1.0), (0.5e-3, 2 / 3)):
        cov = np.broadcast_to(sd**2 * np.eye(3), (*xyz.shape, 3))
        found = errors(Outcome(xyz_m=aside, cov_m2=cov), made.truth_m)
        np.testing.assert_allclose(found.distance_m, 1e-3, atol=1e-9)
        assert len(found.distance_m) == 12 * 16
        assert found.inside.mean() == pytest.approx(inside)
    assert butterworth(made).cov_m2 is None


def test_peers_find_points_that_were_clicked_exactly(flight):
    """A body that moves evenly: nothing to smooth, bones of constant length; 3 % of samples have an exchanged ray."""
    made, xyz = flight
    for peer in (anipose, kalman_smoother):
        off = np.linalg.norm(peer(made).xyz_m - xyz, axis=-1)
        assert np.median(off) < 1e-4
        assert np.quantile(off, 0.9) < 1e-3
