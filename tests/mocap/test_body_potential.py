"""V_z of a joint between bodies is one on rotations, whatever its axes are."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mocap.errors import MocapError
from mocap.kinematics.records import Kinematics, Quantity
from mocap.tracking.body_potential import body_potential


def six(rotation, shift_m, *, measured=True):
    """Kinematics of a joint with these rotations and translations."""
    turned = rotation.as_euler("ZYX", degrees=True)
    columns = {f"hip_rotation_{axis}_deg": turned[:, n] for n, axis in enumerate("zyx")}
    columns |= {f"hip_translation_{axis}_m": shift_m[:, n] for n, axis in enumerate("xyz")}
    rests = np.full(len(turned), 1 if measured else 2)
    quantities = [
        Quantity(name=n, unit="", what="", kind="joint", markers=(), value=v, sd=0 * v, rests=rests)
        for n, v in columns.items()
    ]
    return Kinematics(recording="r", quantities=tuple(quantities), t_s=np.arange(len(turned)) / 100)


@pytest.fixture
def motion():
    rng = np.random.default_rng(0)
    wide = Rotation.from_rotvec(rng.normal(size=(120, 3)) * [1.2, 0.5, 0.3])
    return wide, 0.01 * rng.normal(size=(120, 3))


@pytest.mark.rare
def test_axes_do_not_matter(motion):
    """With other axes of child and parent V_z has the same values at the same poses; with more whole turns, too."""
    rotation, shift = motion
    one, other = Rotation.random(2, rng=np.random.default_rng(1))
    found = body_potential(six(rotation, shift), "hip", "zyx")
    again = body_potential(six(other * rotation * one, shift), "hip", "zyx")
    asked = Rotation.random(40, rng=np.random.default_rng(2))
    value = found.value(asked.as_rotvec(degrees=True))
    assert np.ptp(value) > 0.5
    np.testing.assert_allclose(again.value((other * asked * one).as_rotvec(degrees=True)), value, atol=1e-4)
    turned = asked.as_rotvec(degrees=True)
    whole = turned * (1 + 360 / np.linalg.norm(turned, axis=1, keepdims=True))
    np.testing.assert_allclose(found.value(whole), value, atol=1e-9)


@pytest.mark.parametrize("translations", [False, True])
def test_low_where_it_was_high_elsewhere(motion, translations):
    """Half of the samples tell where the others are; gradients are slopes, by degree and mm; the map is in degrees."""
    rotation, shift = motion
    half = body_potential(six(rotation[::2], shift[::2]), "hip", "zyx", translations=translations)
    other = body_potential(six(rotation[1::2], shift[1::2]), "hip", "zyx", translations=translations).samples
    away = other + 150 * np.eye(len(half.unit))[1]
    assert np.median(half.value(other)) < 0.6  # 60 samples are few in six coordinates
    assert np.median(half.value(away)) > 0.9
    q, step = other[3], 1e-4 * np.eye(len(half.unit))
    slope = (half.value(q + step) - half.value(q - step)) / 2e-4
    np.testing.assert_allclose(half.gradient(q), slope, atol=1e-7)
    assert half.plot().get_xlabel() == "rotation about x (degrees)"


def test_too_few_measured(motion):
    """Filled frames teach nothing."""
    with pytest.raises(MocapError, match="were measured in 0 frames: a potential needs 30"):
        body_potential(six(*motion, measured=False), "hip", "zyx")
