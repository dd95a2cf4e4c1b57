"""Laws of members: unit stiffness at rest, the right force, one-sided members one-sided."""

import numpy as np
import pytest
from scipy.integrate import quad

from eal.joint_design import DesignError
from eal.joint_design.laws import LAWS, TAPE_STRAIN, energy_and_slope


def at(law, s):
    s = np.asarray(s, dtype=float)
    return tuple(part[..., 0] for part in energy_and_slope(s[..., None], (law,)))


@pytest.mark.parametrize("law", LAWS)
def test_at_rest_a_member_has_no_energy_no_force_and_unit_stiffness(law):
    """The slope over a strain of 1e-5 is 1 up to the third derivative of w, below 3 in every law: 3e-5."""
    w, slope = at(law, [1.0])
    assert abs(w[0]) < 1e-15
    assert abs(slope[0]) < 1e-15
    step = -1e-5 if law == "strut" else 1e-5
    assert at(law, [1 + step])[1][0] / step == pytest.approx(1.0, abs=3e-5)


def test_neo_hookean_energy_is_the_work_of_its_stress():
    """SciPy integrates the nominal stress of an incompressible bar, (s - 1/s^2) E / 3, to 1e-8."""
    for s in (0.4, 0.8, 1.7, 2.5):
        work = quad(lambda x: (x - x**-2) / 3, 1.0, s)[0]
        assert at("neo_hookean", [s])[0][0] == pytest.approx(work, abs=1e-8)


def test_cables_only_pull_and_struts_only_push():
    """A cable and a strut in parallel are one linear spring; each has no force on its slack side."""
    s = np.linspace(0.3, 2.0, 35)
    cable, strut, linear = (at(law, s)[1] for law in ("cable", "strut", "linear"))
    assert (cable >= 0).all()
    assert (cable[s < 1] == 0).all()
    assert (strut <= 0).all()
    assert (strut[s > 1] == 0).all()
    np.testing.assert_allclose(cable + strut, linear, atol=1e-15)


def test_a_tape_spring_peaks_and_falls():
    """Its force rises to a peak near the strain of the peak, falls after it, and keeps its sign: it snaps in series."""
    e = np.linspace(1e-3, 1.0, 2000)
    force = at("tape", 1 + e)[1]
    peak = e[np.argmax(force)]
    assert 0.8 * TAPE_STRAIN < peak < 1.6 * TAPE_STRAIN
    assert force[-1] < 0.7 * force.max()
    assert (force > 0).all()
    np.testing.assert_allclose(at("tape", 1 - e[e < 0.9])[1], -force[e < 0.9], atol=1e-14)


def test_an_unknown_law_is_named():
    with pytest.raises(DesignError, match="'rope'"):
        energy_and_slope(np.ones(1), ("rope",))
