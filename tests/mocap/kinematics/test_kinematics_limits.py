"""Each threshold of the kinematics, with a case just below and one just above it."""

from types import SimpleNamespace

import numpy as np
import pytest

from mocap.errors import MocapError
from mocap.kinematics import cycles, functional
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


class Found(dict):
    """Quantities over time by name; a body that does not move."""

    recording = "made"

    def __init__(self, t_s, **values):
        """All of them known to a thousandth, measured."""
        super().__init__()
        self.t_s = t_s
        for name, value in (dict.fromkeys(["body_x_m", "body_y_m", "body_z_m"], np.zeros(len(t_s))) | values).items():
            rests = np.ones(len(t_s), dtype=np.int8)
            self[name] = SimpleNamespace(value=value, sd=np.full(len(t_s), 1e-3), rests=rests)


def measured(names, n_frames):
    """A motion of which all samples were measured, and its skeleton."""
    names = list(names)
    motion = SimpleNamespace(names=names, index=names.index, measured=np.ones((n_frames, len(names)), dtype=bool))
    return motion, SimpleNamespace(measures=SimpleNamespace(strokes={"w": ("a", "b")}, chain=(), up="z"))


def beats(stroke, rate):
    """Beats of a stroke, at 100 frames a second."""
    rate = np.array(rate, dtype=float)
    values = {"w_stroke_deg": np.array(stroke, dtype=float), "w_stroke_rate_deg_s": rate}
    return cycles.wing_beats(Found(np.arange(len(rate)) / 100, **values), "w", *measured("ab", len(rate)))


@pytest.mark.parametrize(("share", "n"), [(0.2, 2), (0.29, 3)])
def test_a_stroke_turns_where_it_goes_on_by_a_quarter_of_its_range(share, n):
    """From the 5th to the 95th percentile, of ramps from 0 to 10 nine tenths."""
    back = 10 - share * 9
    stroke = np.interp(np.arange(801), 100 * np.arange(9), [0, 10, 0, 10, back, 10, 0, 10, 0])
    assert len(beats(stroke, np.append(np.diff(stroke), 0.0))) == n


@pytest.mark.parametrize(("frames", "n"), [(7, 0), (8, 1)])
def test_a_stroke_of_seven_frames_has_no_beats(frames, n):
    assert len(beats([10, 10, 0, 0, 10, 10, 0, 0][:frames], [1, -1, -1, 1, 1, -1, -1, -1][:frames])) == n


def footing(*, still=20, pace=1.0, slow=0.0, noise=0.0, heights=(0.0,), swing=3.0):
    """Footfalls of a foot that stands in so many frames, at heights in turn, and swings above them in others."""
    n = still + 20
    speed = np.full((n, 2), 2.0 * pace)
    speed[:, 1] = pace
    speed[10 : 10 + still, 0] = slow
    xyz = np.zeros((n, 2, 3))
    xyz[:, 0, 0] = np.arange(n)
    xyz[:, 0, 2] = swing
    xyz[10 : 10 + still, 0, 2] = np.resize(heights, still)
    own = np.tile(np.diag([0.0] * 3 + [noise**2] * 3), (n, 2, 1, 1))
    motion = SimpleNamespace(
        names=("foot", "body"), index=("foot", "body").index, t_s=np.arange(n) / 100, xyz_m=xyz, own=own,
        velocity_m_s=speed[..., None] * [1.0, 0, 0],
    )  # fmt: skip
    found = cycles.footfalls(motion, SimpleNamespace(measures=SimpleNamespace(feet=("foot",), up="z", ground="plane")))
    return 0 if found is None else int(found.stance.sum())


UNEVEN = [-0.1] * 8 + [0.0] * 3 + [0.1] * 5
"""Heights whose median is 0, and of whose sizes it is 0.1."""


@pytest.mark.parametrize(
    ("given", "stands"),
    [
        ({"slow": 0.045}, 20),  # a twentieth of the body's speed
        ({"slow": 0.055}, 0),
        ({"slow": 0.14, "noise": 0.1}, 20),  # or 1.5 deviations
        ({"slow": 0.16, "noise": 0.1}, 0),
        ({"still": 9}, 0),  # ten frames show the ground
        ({"still": 11}, 11),
        ({"heights": [0.0] * 14 + [1.4] * 6}, 20),  # half of the height of a swing
        ({"heights": [0.0] * 14 + [1.6] * 6}, 14),
        ({"heights": [*UNEVEN, *[0.36] * 4], "swing": 0.3}, 20),  # or four deviations of slow feet
        ({"heights": [*UNEVEN, *[0.44] * 4], "swing": 0.3}, 16),
        ({"heights": [0.0] * 12 + [1.6] * 5 + [0.0] * 3}, 20),  # it never overtakes the body in between
    ],
)
def test_when_a_foot_stands(given, stands):
    assert footing(**given) == stands


def test_a_foot_that_overtakes_the_body_has_swung():
    """Three frames between two contacts in which it is faster; of two frames they are closed, and contacts are none."""
    pace = np.ones(40)

    def stance(swings, contact=10):
        speed = np.full((40, 2), 0.0)
        speed[:, 1] = pace
        speed[:10, 0] = speed[30:, 0] = speed[10 + contact : 20 + swings, 0] = 2.0
        motion = SimpleNamespace(
            names=("foot", "body"), index=("foot", "body").index, t_s=np.arange(40) / 100, xyz_m=np.zeros((40, 2, 3)),
            own=np.zeros((40, 2, 6, 6)), velocity_m_s=speed[..., None] * [1.0, 0, 0],
        )  # fmt: skip
        own = SimpleNamespace(measures=SimpleNamespace(feet=("foot",), up="z", ground="plane"))
        return int(cycles.footfalls(motion, own).stance.sum())

    assert (stance(2), stance(3), stance(4)) == (20, 17, 16)
    assert (stance(2, 2), stance(2, 3)) == (8, 11)


@pytest.mark.parametrize(("start", "n"), [(2, 1), (3, 2)])
def test_a_contact_from_the_third_frame_on_may_have_begun_before(start, n):
    stance = np.zeros((40, 1), dtype=bool)
    for first in (start, 15, 30):
        stance[first : first + 5] = True
    t_s = np.arange(40) / 100
    steps = cycles.Footfalls(feet=("f",), t_s=t_s, stance=stance, height_m=np.zeros((40, 1)))
    assert len(cycles.strides(Found(t_s), steps, *measured("f", 40))) == n


@pytest.mark.parametrize(("markers", "frames", "waves"), [(3, 60, False), (4, 60, True), (4, 15, False), (4, 17, True)])
def test_a_wave_is_seen_by_four_markers_in_sixteen_frames(markers, frames, waves):
    """A wave of eight frames that travels down a chain."""
    t, names = np.arange(frames), [f"c{k}" for k in range(markers)]
    xyz = np.zeros((frames, markers, 3))
    xyz[..., 0] = -np.arange(markers)
    xyz[..., 1] = 0.1 * np.sin(2 * np.pi * (t[:, None] / 8 - np.arange(markers) / 8))
    motion, skeleton = measured(names, frames)
    motion.xyz_m, motion.t_s, skeleton.measures.chain = xyz, t / 100, names
    assert bool(cycles.undulations(Found(t / 100), motion, skeleton)) == waves


@pytest.mark.parametrize(("frames", "known"), [(3, False), (4, True)])
def test_a_cycle_of_four_frames_has_a_curve(frames, known):
    row = SimpleNamespace(start_s=0.0, end_s=float(frames - 1))
    assert (cycles._curve(np.arange(10.0), np.arange(10.0), row, np.linspace(0, 1, 5)) is not None) == known
