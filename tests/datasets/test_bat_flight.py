"""The turning bat against mechanics: path, speed, energy, bank."""

import numpy as np
from mocap.datasets import make_bat
from mocap.datasets.bats import laps
from scipy.integrate import solve_ivp

GRAVITY_M_S2 = 9.81


def test_the_path_is_the_integral_of_speed_along_the_course():
    """SciPy's DOP853 on the velocity, and a lap that ends where it began."""
    t_s = np.linspace(0, 1.3, 40)

    def velocity(t, _):
        path = laps(np.array([t]))
        return path.speed_m_s[0] * np.array([np.cos(path.course_rad[0]), np.sin(path.course_rad[0])])

    start = laps(t_s[:1]).position_m[0, :2]
    found = solve_ivp(velocity, (0, 1.3), start, t_eval=t_s, method="DOP853", rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(laps(t_s).position_m[:, :2], found.y.T, atol=1e-11)
    np.testing.assert_allclose(laps(np.array([1.3])).position_m[0], laps(t_s[:1]).position_m[0], atol=1e-14)


def test_course_rate_energy_and_centripetal_force():
    """The rate is the derivative of the course; kinetic and potential energy add up to one number."""
    t_s = np.linspace(0, 1.3, 2001)
    path = laps(t_s)
    # central differences of a function with |third derivative| < 300: h^2 / 6 x 300 = 2e-5
    slope = np.gradient(path.course_rad, t_s)
    np.testing.assert_allclose(slope[1:-1], path.turning_rad_s[1:-1], atol=5e-5)
    energy = path.speed_m_s**2 / 2 + GRAVITY_M_S2 * path.position_m[:, 2]
    np.testing.assert_allclose(energy, energy[0], rtol=1e-12)
    # Windes et al. 2020: from 2.0 to 0.5 m/s, bank 20 to 40 degrees, some 0.2 m of height
    bank = np.degrees(np.arctan(path.speed_m_s * path.turning_rad_s / GRAVITY_M_S2))
    assert 35 < bank.max() < 40
    assert 0.5 < path.speed_m_s.min() < 0.8
    assert 0.15 < np.ptp(path.position_m[:, 2]) < 0.3


def test_a_turning_bat_banks_into_its_turn_and_points_along_its_path():
    """Seeds turn to both sides; the wing inside the turn is low, and the head leads the path by some degrees."""
    sides, leads = set(), []
    for seed in range(6):
        recording = make_bat(seed=seed, manoeuvre="turn", n_cameras=2, n_frames=312, skin_m=0)
        index = {name: m for m, name in enumerate(recording.truth.names)}
        xyz = recording.truth.xyz_m
        body = xyz[:, index["sternum"]]
        velocity = np.gradient(body, 1 / recording.fps, axis=0)[:, :2]
        course = np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))
        # the body's x axis from three markers of its plane of symmetry, of which none need lie on it
        low, high = (xyz[:, index[name]] - xyz[:, index["pelvis"]] for name in ("sternum", "back"))
        ahead = low / 0.0265 + high / 0.008
        heading = np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0]))
        side = np.sign(course[-1] - course[0])
        sides.add(side)
        assert abs(abs(course[-1] - course[0]) - 2 * np.pi) < 0.3
        lead = side * np.angle(np.exp(1j * (heading - course)))
        leads.append(np.degrees(lead.mean()))
        left_high = (xyz[:, index["shoulder_l"]] - xyz[:, index["shoulder_r"]])[:, 2]
        assert (side * left_high).mean() < 0
    assert sides == {-1.0, 1.0}
    # the mean turning rate of 4.8 rad/s for 30 ms is 8 degrees; weave and yaw wander by some 3 degrees a lap
    assert abs(np.mean(leads) - 8) < 3
    assert min(leads) > 0
