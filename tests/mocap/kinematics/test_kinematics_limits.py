"""Each threshold of the kinematics, with a case just below and one just above it."""

import numpy as np
import pytest

from mocap.errors import MocapError
from mocap.kinematics import functional
from mocap.kinematics.delta import Naming, Points, with_rates
from mocap.kinematics.functional import pose_of
from tests.mocap.kinematics.body_motions import NAMES, moving
from tests.mocap.kinematics.test_functional import jointed


def poses(n_frames, slip_m=0.0):
    """Of two bodies that a ball joins."""
    motion, *_ = jointed("ball", noise_m=1e-4, slip_m=slip_m, seed=0, n_frames=n_frames)
    return pose_of(motion, NAMES[:5]), pose_of(motion, NAMES[5:])


@pytest.mark.parametrize(("n_frames", "enough"), [(37, False), (43, True)])
def test_a_joint_is_found_of_forty_frames(n_frames, enough):
    """Two for each of the twenty parts that are left out in turn."""
    if enough:
        functional.functional_joint(*poses(n_frames), "ball")
    else:
        with pytest.raises(MocapError, match="needs 40 at least"):
            functional.functional_joint(*poses(n_frames), "ball")


@pytest.mark.parametrize(("n_frames", "slip_m", "parts"), [(400, 0.0, 20), (44, 3e-2, 6)])
def test_twenty_parts_are_left_out_in_turn_and_six_where_errors_last(monkeypatch, n_frames, slip_m, parts):
    """Noise of 400 frames, and slips of 30 mm that last for a third of 44 frames."""
    fitted, fit = [], functional._fit
    monkeypatch.setattr(functional, "_fit", lambda *given: fitted.append(given) or fit(*given))
    functional.functional_joint(*poses(n_frames, slip_m), "ball")
    assert len(fitted) == 1 + parts


def test_slopes_are_of_steps_of_a_ten_thousandth():
    """A cube has no slope at 0; central differences give the square of the step, the root mean square distance."""
    ends = np.tile([[0.0, 0.1, 0], [0.0, -0.1, 0]], (3, 1, 1))
    size = 0.1 / np.sqrt(3)
    points = Points.of(moving(ends, np.arange(3) / 100, NAMES[:2], 1e-3), NAMES[:2])
    points.cov[:] = np.eye(12)
    (found,) = with_rates(
        points, lambda x: (x[:, 0, 0] - x[:, 1, 0]) ** 3, Naming("cube", "m3", "a cube", "length"), rates=False
    )
    np.testing.assert_allclose(found.sd, np.sqrt(2) * (1e-4 * size) ** 2, rtol=1e-6)
