"""Joints designed from potentials: trusses whose strain energy U(q) is V_z(q), EAL paper, section 2.3.

A potential and limits come in. A truss, its errors and its motion go out. It touches no file.
"""

from eal.joint_design.design import GOAL, Design, design_truss
from eal.joint_design.equilibrium import Equilibria, equilibria
from eal.joint_design.laws import DesignError, Law
from eal.joint_design.measures import LEVELS, Fit, Tolerance, measure, potential_doubt, tolerance_study
from eal.joint_design.path import Followed, Snap, follow, over_grid
from eal.joint_design.release import Release, recorded_velocities, release, truss_penalty
from eal.joint_design.target import Limits, Target, make_target
from eal.joint_design.truss import Truss, member_forces

__all__ = [
    "GOAL",
    "LEVELS",
    "Design",
    "DesignError",
    "Equilibria",
    "Fit",
    "Followed",
    "Law",
    "Limits",
    "Release",
    "Snap",
    "Target",
    "Tolerance",
    "Truss",
    "design_truss",
    "equilibria",
    "follow",
    "make_target",
    "measure",
    "member_forces",
    "over_grid",
    "potential_doubt",
    "recorded_velocities",
    "release",
    "tolerance_study",
    "truss_penalty",
]
