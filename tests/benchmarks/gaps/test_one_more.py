"""The rule that one true thing more makes no gap worse: what is drawn, and which cells break it."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from benchmarks.gaps.method import Film, Trial
from benchmarks.gaps.one_more import ROWS, cameras, cells_of, table, without_camera
from benchmarks.gaps.protocol import Outcome, Score
from mocap.records import PixelTracks
from tests.mocap.rigs import ring

NAMES = ("a", "b")


def draws(changes, *, z=1.0, less_z=1.0):
    """Rows of one cell, an error of 1 mm without and of exp(change) with something."""
    rows = [("made", "t", seed, "trial", "limb", 10, 1.0, np.exp(d), less_z, z) for seed, d in enumerate(changes)]
    return pd.DataFrame(rows, columns=list(ROWS))


@pytest.mark.parametrize(
    ("changes", "z", "less_z", "breaks"),
    [
        ([0.2, 0.3, 0.25], 1.0, 1.0, True),
        ([-0.2, 0.3, 0.02], 1.0, 1.0, False),
        ([-0.2, -0.3, -0.1], 1.5, 1.0, True),
        ([-0.2, -0.3, -0.1], 1.5, 1.6, False),
        ([0.2], 1.0, 1.0, False),
    ],
)
def test_a_cell_breaks_the_rule(changes, z, less_z, breaks):
    """Worse by more than its standard error, or z leaves 0.7 to 1.4; one draw has no standard error."""
    row = table(draws(changes, z=z, less_z=less_z)).iloc[0]
    assert row["breaks"] == breaks
    assert row["change_%"] == pytest.approx(100 * (np.exp(np.mean(changes)) - 1))


def test_kinds_of_gaps_that_both_have_are_compared():
    """Of two kinds one is not filled with the thing: one row."""
    scores = [
        Score(scenario="limb", gap=gap, rays=0, samples=3, rmse_mm=mm, coverage95=1.0, z=1.0, nll=0.0)
        for gap, mm in ((10, 2.0), (25, 4.0), (25, 3.0))
    ]
    less = Outcome(scores=tuple(scores[:2]), seconds=1.0, frames=1)
    more = Outcome(scores=tuple(scores[2:]), seconds=1.0, frames=1)
    (row,) = cells_of("ray", less, more)
    assert (row["gap"], row["less_mm"], row["more_mm"]) == (25, 4.0, 3.0)


def test_a_camera_is_taken_away():
    """Its pixels and itself; positions that are compared with stay."""
    t_s, rig = np.arange(4) / 100, ring(3)
    uv = np.arange(48.0).reshape(3, 4, 2, 2)
    pixels = PixelTracks(names=NAMES, cameras=tuple(c.name for c in rig), t_s=t_s, uv_px=uv)
    film = Film(pixels=pixels, cameras=rig, pixel_origin="upper-left", calibration_origin="upper-left")
    xyz = np.zeros((4, 2, 3))
    trial = Trial(name="t", names=NAMES, t_s=t_s, xyz_m=xyz, sd_m=np.ones(2), trunk=NAMES, limbs=(), film=film)
    fewer = without_camera(trial, SimpleNamespace(integers=lambda _most: 1))  # type: ignore[arg-type]
    assert fewer.film is not None
    assert cameras(fewer) == 2
    np.testing.assert_array_equal(fewer.film.pixels.uv_px, uv[[0, 2]])
    assert fewer.film.pixels.cameras == tuple(c.name for c in fewer.film.cameras)
    np.testing.assert_array_equal(fewer.xyz_m, xyz)
