"""Members as printed springs: a meander between two eyes; of cables and struts one is a slot in which a pin slides.

A meander of N beams of length h across the member, a pitch p = s / N apart, of thickness t and depth b, in a straight
length s: with the force P on its centre line Castigliano's theorem gives, I = b t^3 / 12,

    1 / k = N h^2 (h + 3 p) / (12 E I),    strain = 3 t delta / (N h (h + 3 p)),

the beams bent by P y, the links of length p by P h / 2. Beams that turn by delta / (N h) <= 0.3 stay within this.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eal.arrays import Array
from eal.joint_design import Law, Truss
from mocap.errors import MocapError


class MakeError(MocapError):
    """A truss cannot be printed as asked; the message names the limit that binds."""

    page = "mechanism"


@dataclass(frozen=True, kw_only=True)
class Material:
    """A printed plastic.

    Attributes:
        name: Name.
        young_pa: Young's modulus.
        strain: Strain that a flexure may see again and again.
        density_kg_m3: Density.
    """

    name: str
    young_pa: float
    strain: float
    density_kg_m3: float


MATERIALS = {
    material.name: material
    for material in (
        Material(name="pa12", young_pa=1.65e9, strain=0.020, density_kg_m3=930.0),
        Material(name="petg", young_pa=2.0e9, strain=0.012, density_kg_m3=1270.0),
        Material(name="pla", young_pa=3.0e9, strain=0.008, density_kg_m3=1240.0),
        Material(name="tpu95a", young_pa=2.6e7, strain=0.100, density_kg_m3=1220.0),
    )
}
"""Usual figures of makers' data sheets, the strains well below yield; measure your own for more than a prototype."""


def material(name: str, *, young_mpa: float | None = None, strain: float | None = None) -> Material:
    """A material of the table, with its figures replaced where others are given.

    Raises:
        MakeError: no such name, or a figure that is not positive.
    """
    if name not in MATERIALS:
        raise MakeError(
            f"`material` {name}: give one of {', '.join(MATERIALS)}, with `young_mpa` and `strain` if you know them"
        )
    base = MATERIALS[name]
    young = base.young_pa if young_mpa is None else 1e6 * young_mpa
    allowed = base.strain if strain is None else strain
    if not (young > 0.0 and 0.0 < allowed < 1.0):
        raise MakeError(
            f"`young_mpa` must be above 0 and `strain` in (0, 1), but they are {young / 1e6:g} and {allowed:g}"
        )
    return Material(name=name, young_pa=young, strain=allowed, density_kg_m3=base.density_kg_m3)


PRINTED: tuple[Law, ...] = ("linear", "cable", "strut")
"""Laws that meanders follow."""

MM = 1e-3
ROOT_M = 1.0 * MM  # between an eye and its spring; chosen
SPARE_M = 0.3 * MM
"""What a slot is longer than its pin's way in the region."""

SLIM = 6.0
"""Least width of a meander over its thickness: its beams are slender."""


@dataclass(frozen=True, kw_only=True)
class Printing:
    """What a printer and a bench allow; metres.

    Attributes:
        material: What the springs are of.
        wall_m: Least thickness of any wall.
        gap_m: Least gap between walls, and play of a pin in its hole (a diameter's difference).
        width_m: Widest meander.
        depths_m: Least and greatest depth of a member, across its plane.
        slenderness: Longest rest length of a member that pushes, over its meander's width.
        pin_m: Diameter of pins.
    """

    material: Material
    wall_m: float = 0.8 * MM
    gap_m: float = 0.4 * MM
    width_m: float = 18.0 * MM
    depths_m: tuple[float, float] = (1.2 * MM, 6.0 * MM)
    slenderness: float = 10.0
    pin_m: float = 4.0 * MM

    @property
    def hole_m(self) -> float:
        """Diameter of the hole for a pin."""
        return self.pin_m + self.gap_m

    @property
    def eye_m(self) -> float:
        """Outer radius of an eye."""
        return self.hole_m / 2 + 2.0 * self.wall_m

    @property
    def ends_m(self) -> float:
        """What of a member's length is not meander: two eyes, and a millimetre of root each."""
        return 2.0 * (self.eye_m + ROOT_M)


@dataclass(frozen=True, kw_only=True)
class Flexure:
    """One printed member; metres.

    Attributes:
        law: Linear, cable or strut.
        rest_m: Between its pins at rest; of a cable or strut where its pin comes to the end of the slot.
        slot_m: Length of the slot; 0 without.
        beams: N.
        width_m: H, over the centres of the bends.
        thickness_m: T.
        depth_m: B.
        stiffness_n_m: By the formula at the head of the file.
        strain: Largest strain in the region.
    """

    law: Law
    rest_m: float
    slot_m: float
    beams: int
    width_m: float
    thickness_m: float
    depth_m: float
    stiffness_n_m: float
    strain: float

    def slot_ends_m(self, length_m: Array | float) -> tuple[Array, Array]:
        """Where the slot for the fixed pin begins and ends, from the moving pin, with the pins ``length_m`` apart.

        A cable pulls with the slot's outer end and slides outward when slack, a strut pushes with the inner one.
        """
        if self.law == "cable":
            outer = np.maximum(length_m, self.rest_m)
            return outer - self.slot_m, outer
        inner = np.minimum(length_m, self.rest_m) if self.law == "strut" else np.asarray(length_m)
        return inner, inner + self.slot_m


@dataclass(frozen=True, eq=False, kw_only=True)
class Forms:
    """All meanders that one member could be, each for any stiffness between two.

    Attributes:
        beams: (K,) N.
        thickness_m: (K,) t.
        pitch_m: (K,) p.
        narrow_m: (K,) least h: what strain, turn, slenderness and thickness ask for, and not below the pitch.
        low_n_m: (K,) least stiffness: widest, least depth.
        high_n_m: (K,) greatest stiffness: narrowest, greatest depth.
        travel_m: Largest change of length from rest.
        slot_m: Slot.
        rest_m: Rest length.
        law: Law.
    """

    beams: Array
    thickness_m: Array
    pitch_m: Array
    narrow_m: Array
    low_n_m: Array
    high_n_m: Array
    travel_m: float
    slot_m: float
    rest_m: float
    law: Law


def meander_stiffness(
    young_pa: float, depth_m: Array, thickness_m: Array, beams: Array, h_m: Array, p_m: Array
) -> Array:
    """K = E b t^3 / (N h^2 (h + 3 p)) in N/m; arrays that broadcast."""
    return young_pa * depth_m * thickness_m**3 / (beams * h_m**2 * (h_m + 3.0 * p_m))


def meander_strain(travel_m: Array, thickness_m: Array, beams: Array, h_m: Array, p_m: Array) -> Array:
    """Largest strain 3 t delta / (N h (h + 3 p)), in the bends; arrays that broadcast."""
    return 3.0 * thickness_m * travel_m / (beams * h_m * (h_m + 3.0 * p_m))


def forms(rest_m: float, least_m: float, most_m: float, law: Law, printing: Printing, *, name: str) -> Forms:
    """Meanders for a member that is ``rest_m`` long at rest and from ``least_m`` to ``most_m`` long in the region.

    Raises:
        MakeError: there is none; the message names the limit that binds.
    """
    if law not in PRINTED:
        raise MakeError(
            f"{name} has the law '{law}', but printed meander springs can only follow "
            f"{', '.join(PRINTED)}: give these as `laws`"
        )
    squeeze, pull = max(rest_m - least_m, 0.0), max(most_m - rest_m, 0.0)
    slot = {"cable": squeeze + SPARE_M, "strut": pull + SPARE_M}.get(law, 0.0)
    room = rest_m - printing.ends_m - (slot if law == "cable" else 0.0)
    travel = max(0.0 if law == "cable" else squeeze, 0.0 if law == "strut" else pull, 1e-9)
    squeeze = 0.0 if law == "cable" else squeeze
    t = np.arange(printing.wall_m, 4.01 * printing.wall_m, 0.125 * printing.wall_m)[:, None]
    n = np.arange(2.0, 61.0)[None]
    p = np.broadcast_to(room / n, (len(t), n.shape[1]))
    fits = p - squeeze / n >= t + printing.gap_m
    if not fits.any():
        needed = printing.ends_m + max(rest_m - least_m, 0.0) + 2.0 * (printing.wall_m + printing.gap_m)
        raise MakeError(
            f"{name} is {rest_m / MM:.1f} mm long at rest and would need {needed / MM:.1f} mm for its eyes, its "
            "contraction and two beams: there is too little room for a meander spring; give a greater `size_mm` or "
            "less `contraction`"
        )
    # the positive root of h (h + 3 p) = 3 t delta / (N strain)
    bent = 3.0 * t * travel / (n * printing.material.strain)
    by_strain = 0.5 * (np.sqrt(9.0 * p**2 + 4.0 * bent) - 3.0 * p)
    by_turn = travel / (n * 0.3)
    by_slenderness = 0.0 if law == "cable" else rest_m / printing.slenderness
    narrow = np.maximum(np.maximum(by_strain, by_turn), np.maximum(np.maximum(by_slenderness, SLIM * t), p))
    possible = fits & (narrow <= printing.width_m)
    if not possible.any():
        binding = {
            "allowed strain": by_strain,
            "rotation of its beams": by_turn,
            "slenderness": by_slenderness + 0.0 * p,
            "wall": SLIM * t + 0.0 * p,
            "pitch": p,
        }
        which = max(binding, key=lambda key: float(np.where(fits, binding[key], np.inf).min()))
        raise MakeError(
            f"{name} travels {travel / MM:.1f} mm: the {which} requires a meander "
            f"{np.where(fits, narrow, np.inf).min() / MM:.1f} mm wide, but `width_mm` allows {printing.width_m / MM:g}"
        )
    n, t = (np.broadcast_to(part, p.shape)[possible] for part in (n, t))
    p, narrow = p[possible], narrow[possible]
    young, (shallow, deep) = printing.material.young_pa, printing.depths_m
    return Forms(
        beams=n,
        thickness_m=t,
        pitch_m=p,
        narrow_m=narrow,
        low_n_m=meander_stiffness(young, np.array(shallow), t, n, np.array(printing.width_m), p),
        high_n_m=meander_stiffness(young, np.array(deep), t, n, narrow, p),
        travel_m=travel,
        slot_m=slot,
        rest_m=rest_m,
        law=law,
    )


def all_forms(truss: Truss, lengths_m: Array, printing: Printing) -> list[Forms]:
    """Meanders for each member of a truss at printed size.

    Args:
        truss: Its rest lengths and laws.
        lengths_m: (m, 2) least and greatest length of each member in the region.
        printing: Limits.

    Raises:
        MakeError: a member has none.
    """
    return [
        forms(float(rest), float(low), float(high), law, printing, name=f"member {i + 1}")
        for i, (rest, (low, high), law) in enumerate(zip(truss.rest_m, lengths_m, truss.laws, strict=True))
    ]


def energy_range(found: Sequence[Forms], stiffness: Array) -> tuple[float, float]:
    """Energies at V = 1, in J, for which every member has a meander.

    Args:
        found: Meanders by member.
        stiffness: (m,) stiffnesses at 1 J.

    Raises:
        MakeError: no energy suits all; the message names the two members that disagree.
    """
    low = np.array([f.low_n_m.min() for f in found]) / stiffness
    high = np.array([f.high_n_m.max() for f in found]) / stiffness
    if low.max() > high.min():
        stiff, soft = int(np.argmin(high)), int(np.argmax(low))
        raise MakeError(
            f"member {stiff + 1} is stiff enough within its allowable strain only up to {high[stiff] / MM:.3g} mJ "
            f"at V = 1, and member {soft + 1} is soft enough within `width_mm` and the wall only down to "
            f"{low[soft] / MM:.3g} mJ: no energy suits both; give a wider `width_mm`, a thinner `wall_mm` or a "
            "material of more `strain`"
        )
    return float(low.max()), float(high.min())


def shaped(found: Sequence[Forms], stiffness_n_m: Array, printing: Printing) -> list[Flexure]:
    """The narrowest meander of the stiffness that each member must have; see ``energy_range``."""
    return [_narrowest(f, float(k), printing) for f, k in zip(found, stiffness_n_m, strict=True)]


def _narrowest(found: Forms, stiffness_n_m: float, printing: Printing) -> Flexure:
    young = printing.material.young_pa
    fits = (found.low_n_m <= stiffness_n_m * (1 + 1e-9)) & (found.high_n_m >= stiffness_n_m * (1 - 1e-9))
    n, t, p, h = (part[fits] for part in (found.beams, found.thickness_m, found.pitch_m, found.narrow_m))
    if not len(n):
        raise MakeError(
            f"no meander spring has {stiffness_n_m:.3g} N/m: it falls between two possible numbers of beams; change "
            "`energy_mj`"
        )
    # as narrow as it may be, less deep; where that is too shallow, the least depth and wider
    b = stiffness_n_m * n * h**2 * (h + 3.0 * p) / (young * t**3)
    shallow = b < printing.depths_m[0]
    wide = np.array([_width(stiffness_n_m, young * printing.depths_m[0], *row) for row in zip(t, n, p, strict=True)])
    h, b = np.where(shallow, wide, h), np.maximum(b, printing.depths_m[0])
    best = int(np.argmin(h * (1.0 + b / printing.depths_m[1])))
    return Flexure(
        law=found.law,
        rest_m=found.rest_m,
        slot_m=found.slot_m,
        beams=int(n[best]),
        width_m=float(h[best]),
        thickness_m=float(t[best]),
        depth_m=float(b[best]),
        stiffness_n_m=float(meander_stiffness(young, b[best], t[best], n[best], h[best], p[best])),
        strain=float(meander_strain(np.array(found.travel_m), t[best], n[best], h[best], p[best])),
    )


def _width(k: float, young_depth: float, t: float, n: float, p: float) -> float:
    """The h of h^2 (h + 3 p) = E b t^3 / (N k): the only positive root."""
    roots = np.roots([1.0, 3.0 * p, 0.0, -young_depth * t**3 / (n * k)])
    return float(roots[np.isreal(roots) & (roots.real > 0)].real[0])
