"""The wings of the wind-tunnel twin beside those of the real bat that was recorded there."""

import numpy as np
import pytest
from mocap.datasets.bats import make_bat_wind_tunnel

from mocap.cameras.camera import stacked, undistorted
from mocap.cameras.triangulate import linear
from mocap.io.dvproject import read_project
from tests.real_data import real

POINTS = {
    **{"t3L": "d3_tip_l", "wstL": "wrist_l", "t5L": "d5_tip_l", "elbL": "elbow_l", "shdL": "shoulder_l"},
    **{"ankL": "ankle_l", "nl": "snout", "str": "sternum", "lmb": "pelvis", "shdR": "shoulder_r", "ankR": "ankle_r"},
    **{"elbR": "elbow_r", "wstR": "wrist_r", "t5R": "d5_tip_r", "t3R": "d3_tip_r"},
}
"""What pt1, pt2, ... of the wind-tunnel projects are, and the twin's markers nearest to them."""

FLIGHTS = ("078A3/F2", "078A3/F3", "078A3/F5")
ANGLES = {
    "elbow (shoulder, elbow, wrist)": ("shoulder", "elbow", "wrist"),
    "wrist (elbow, wrist, tip of digit III)": ("elbow", "wrist", "d3_tip"),
    "wrist (elbow, wrist, tip of digit V)": ("elbow", "wrist", "d5_tip"),
}

BETWEEN_FLIGHTS = 18.0
"""Degrees: what single real flights differ by in how far elbows fold (wrists: 26)."""


def triangulated(project):
    """Markers of a wind-tunnel project as the twin names them, and where their rays meet: (T, 15, 3) in metres."""
    uv = undistorted(project.cameras, project.pixels.uv_px, iterations=3)
    return tuple(POINTS.values()), linear(stacked(project.cameras), uv)


def wing_angles(found, names):
    """Angles at the second of three markers in degrees, both sides, all frames."""
    values = []
    for markers, xyz_m in found:
        for side in "lr":
            a, b, c = (xyz_m[:, list(markers).index(f"{name}_{side}")] for name in names)
            u, v = a - b, c - b
            cosine = np.sum(u * v, axis=-1) / np.linalg.norm(u, axis=-1) / np.linalg.norm(v, axis=-1)
            values.append(np.degrees(np.arccos(cosine)))
    return np.concatenate(values)


@pytest.mark.parametrize("joint", ANGLES)
def test_joints_fold_and_extend_as_far_as_the_real_ones(joint):
    """2 %, 50 % and 98 % of the angles of elbow and wrist are as near as single flights are to each other."""
    files = [real("bat_windtunnel_dltdv8", *flight.split("/")) for flight in FLIGHTS]
    flown = [triangulated(read_project(next(path.glob("*dvProject.mat"))).with_rate(700)) for path in files]
    twins = [make_bat_wind_tunnel(seed=seed) for seed in range(3)]
    played = [(twin.truth.names, twin.truth.xyz_m) for twin in twins]
    theirs, ours = (np.nanquantile(wing_angles(found, ANGLES[joint]), [0.02, 0.5, 0.98]) for found in (flown, played))
    np.testing.assert_allclose(ours, theirs, atol=BETWEEN_FLIGHTS)
