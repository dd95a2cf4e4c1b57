"""The wings of the wind-tunnel twin beside those of the real bat that was recorded there."""

import numpy as np
import pytest

from benchmarks.twins import ANGLES, FLIGHTS, triangulated, wing_angles
from datasets.bats import make_bat_wind_tunnel
from mocap.io.dvproject import read_project
from tests.real_data import real

BETWEEN_FLIGHTS = 18.0
"""Degrees: what single real flights differ by in how far elbows fold (wrists: 26)."""


@pytest.mark.parametrize("joint", ANGLES)
def test_joints_fold_and_extend_as_far_as_the_real_ones(joint):
    """2 %, 50 % and 98 % of the angles of elbow and wrist are as near as single flights are to each other."""
    files = [real("bat_windtunnel_dltdv8", *flight.split("/")) for flight in FLIGHTS]
    flown = [triangulated(read_project(next(path.glob("*dvProject.mat")), fps=700)) for path in files]
    twins = [make_bat_wind_tunnel(seed=seed) for seed in range(3)]
    played = [(twin.truth.names, twin.truth.xyz_m) for twin in twins]
    theirs, ours = (np.nanquantile(wing_angles(found, ANGLES[joint]), [0.02, 0.5, 0.98]) for found in (flown, played))
    np.testing.assert_allclose(ours, theirs, atol=BETWEEN_FLIGHTS)
