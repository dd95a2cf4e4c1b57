"""Tables of stated deviations: what single recordings spread by, beside what they are together."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from mocap.filters.velocities import without_rates

from benchmarks.deviations import cells, true_motion
from mocap.kinematics.points import rate_points_for
from mocap.skeleton import Skeleton


def test_single_recordings_are_told_beside_all_together():
    """Eleven recordings of z 0.5 to 1.5: together the root mean square, singly the quantiles, six within 0.7 to 1.4."""
    z = np.linspace(0.5, 1.5, 11)
    table = pd.DataFrame(
        {"recording": [f"bat {i}" for i in range(11)], "quantity": "velocity", "kind": "measured", "n": 100, "z": z}
    ).assign(inside=0.95)
    found = cells(table).set_index("animal").loc["all"]
    assert found.z == pytest.approx(np.sqrt(np.mean(z**2)))
    np.testing.assert_allclose(found[["z_10", "z_50", "z_90"]].astype(float), [0.6, 1.0, 1.4])
    assert found.right == ((z >= 0.7) & (z <= 1.4)).sum()


@pytest.mark.parametrize("stated", [True, False])
def test_what_falls_has_its_true_acceleration(stated):
    """Of a model that states accelerations they are compared with 9.81 downwards, not with themselves."""
    t_s, skeleton, fall = np.arange(30) / 100, Skeleton(markers=("a", "b")), np.array([0.0, 0.0, -9.81])
    points = rate_points_for(skeleton.markers, skeleton, n_frames=30).names
    shape = (30, len(points), 3)

    def scene(at):
        fallen = 0.5 * fall * np.asarray(at)[:, None, None] ** 2
        return SimpleNamespace(xyz_m=np.array([[0.1, 0, 0], [0, 0.2, 0]]) + fallen)

    spread = np.tile(np.eye(3), (*shape[:2], 1, 1))
    motion = without_rates(points, t_s, np.zeros(shape), spread, np.ones(shape[:2], dtype=bool))
    if stated:
        motion = replace(motion, acceleration_m_s2=np.full(shape, 7.0), acceleration_cov=spread.astype(np.float32))
    found = true_motion(scene, motion, skeleton)
    np.testing.assert_allclose(found.velocity_m_s, np.broadcast_to(fall * t_s[:, None, None], shape), atol=1e-9)
    if stated:
        np.testing.assert_allclose(found.acceleration_m_s2, np.broadcast_to(fall, shape), atol=1e-6)
    else:
        assert found.acceleration_m_s2 is None
