"""Materials for printed flexures."""

from dataclasses import dataclass

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
