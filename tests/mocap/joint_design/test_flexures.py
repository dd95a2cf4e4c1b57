"""Printed springs: the meander's formula beside a frame of beams, and what cannot be printed is named."""

import numpy as np
import pytest

from eal.joint_design import Truss
from mocap.joint_design.flexure import (
    MATERIALS,
    MM,
    Flexure,
    MakeError,
    Printing,
    all_forms,
    energy_range,
    forms,
    material,
    shaped,
)
from mocap.joint_design.solid import keeps_wall, meander_line, member_outline
from tests.reference.frame import frame_response

PRINTING = Printing(material=MATERIALS["pa12"])


def truss(rest, laws, stiffness):
    m = len(rest)
    return Truss(
        fixed_m=np.arange(2 * m).reshape(m, 2) * 0.02,
        internal_m=np.empty((0, 2)),
        ends=np.column_stack([np.arange(m), np.full(m, m)]),
        rest_m=np.array(rest),
        stiffness_n_m=np.array(stiffness),
        laws=tuple(laws),
    )


@pytest.mark.parametrize("law", ["linear", "cable", "strut"])
def test_stiffness_and_strain_are_those_of_a_frame_of_beams(law):
    """The frame also stretches its beams, (t/h)^2 of the compliance, and the first beams are half ones: within 3 %.

    Strain: the formula has the moment P h / 2 in the bends, which the frame has in all but the roots: within 3 %.
    """
    low, high = {"linear": (0.05, 0.075), "cable": (0.04, 0.075), "strut": (0.05, 0.09)}[law]
    one = truss([0.06], [law], [1.0])
    (found,) = all_forms(one, np.array([[low, high]]), PRINTING)
    energy = np.sqrt(np.prod(energy_range([found], one.stiffness_n_m)))
    (flexure,) = shaped([found], one.stiffness_n_m * energy, PRINTING)
    assert flexure.stiffness_n_m == pytest.approx(energy, rel=1e-6)
    points = meander_line(flexure, flexure.rest_m, PRINTING)[1:-1]
    travel, strain = frame_response(
        points,
        young_pa=PRINTING.material.young_pa,
        depth_m=flexure.depth_m,
        thickness_m=flexure.thickness_m,
        force_n=1.0,
    )
    assert 1.0 / travel == pytest.approx(flexure.stiffness_n_m, rel=0.03)
    assert strain * flexure.stiffness_n_m * found.travel_m == pytest.approx(flexure.strain, rel=0.03)
    assert flexure.strain <= PRINTING.material.strain * (1 + 1e-9)


def test_slots_let_cables_go_slack_and_struts_part():
    """The fixed pin is always in the slot: at its outer end when a cable pulls, at its inner when a strut pushes."""
    shape = {"beams": 6, "width_m": 8 * MM, "thickness_m": MM, "depth_m": 2 * MM, "stiffness_n_m": 1.0, "strain": 0.0}
    cable = Flexure(law="cable", rest_m=0.05, slot_m=0.02, **shape)
    strut = Flexure(law="strut", rest_m=0.05, slot_m=0.02, **shape)
    for length in (0.032, 0.05, 0.06):
        inner, outer = cable.slot_ends_m(length)
        assert inner <= length <= outer
        assert (outer == length) == (length >= 0.05)
    for length in (0.04, 0.05, 0.065):
        inner, outer = strut.slot_ends_m(length)
        assert inner <= length <= outer
        assert (inner == length) == (length <= 0.05)


def test_outlines_keep_their_walls():
    """A member's outline has no neck under its wall; one of half the thickness is told apart."""
    shape = {"beams": 6, "width_m": 10 * MM, "depth_m": 2 * MM, "stiffness_n_m": 1.0, "strain": 0.0}
    for thickness, holds in ((0.8 * MM, True), (0.4 * MM, False)):
        flexure = Flexure(law="strut", rest_m=0.05, slot_m=0.02, thickness_m=thickness, **shape)
        assert keeps_wall(member_outline(flexure, 0.05, PRINTING), 0.8) == holds


@pytest.mark.parametrize(
    ("rest", "low", "high", "law", "says"),
    [
        (0.03, 0.012, 0.04, "linear", "too little room for a meander"),
        (0.05, 0.022, 0.30, "linear", "`width_mm` allows"),
        (0.05, 0.04, 0.06, "tape", "law 'tape'"),
    ],
)
def test_what_cannot_be_printed_says_what_binds(rest, low, high, law, says):
    with pytest.raises(MakeError, match=says):
        forms(rest, low, high, law, PRINTING, name="member 1")


def test_members_whose_stiffnesses_are_too_far_apart_are_named():
    """A million to one: no energy suits both, and both are named."""
    both = truss([0.06, 0.06], ["linear", "linear"], [1.0, 1e6])
    found = all_forms(both, np.array([[0.05, 0.07]] * 2), PRINTING)
    with pytest.raises(MakeError, match=r"member 2 .* member 1 "):
        energy_range(found, both.stiffness_n_m)


def test_materials_are_checked():
    with pytest.raises(MakeError, match="pa12, petg"):
        material("wood")
    with pytest.raises(MakeError, match="strain"):
        material("pla", strain=2.0)
