"""Materials of objects, with their friction, their density and the sources of these values.

A friction coefficient describes a pair of surfaces in contact, but MuJoCo stores one coefficient per surface and uses
the larger of the two. The coefficient of a material here is for contact with itself or with a painted or laminated
table top. The table's coefficient, 0.5, does not exceed any of these, so MuJoCo uses the object's coefficient. The
coefficient of the gripper's rubber pads is 1.2, which is higher than that of any material. A grasp therefore holds all
objects equally well.

Published values of dry static friction differ by up to 50 %. The values here are inside the published ranges and are
rounded to 0.05:

* metals, glass, wood: Oberg et al., *Machinery's Handbook*, and the table "Friction and Friction Coefficients" of The
  Engineering ToolBox: steel on steel 0.5 to 0.8, aluminum on steel 0.61, glass on glass 0.9 to 1.0 and on metal 0.5 to
  0.7, wood on wood 0.25 to 0.6, rubber on cardboard 0.5 to 0.8, rubber on dry hard floor 0.6 to 0.9;
* plastics against themselves (designers' tables): polypropylene 0.35 to 0.45, polystyrene 0.45 to 0.60, polycarbonate
  0.40 to 0.65, ABS 0.60 to 0.75, PMMA 0.60 to 0.70;
* paper and board against themselves, by the methods ISO 15359 and TAPPI T 549: 0.4 to 0.7 if uncoated;
* fruit: Puchalski and Brusewitz, "Relative humidity and wetting affect friction between apple and flat surfaces",
  *International Agrophysics* 16 (2002): 0.3 to 0.7 on wood, steel and plastic, depending on the kind of fruit and its
  moisture;
* other food, soap and sponge: there is no common table, so the values are estimated by comparison, as ``reason``
  explains.

The torsional coefficient [m] is the sliding coefficient times two thirds of the radius of a 15 mm contact patch, as for
the gripper pads: a flat object resists being turned about the vertical axis as much as being pushed. The rolling
coefficient [m] is 1 mm for soft and 0.5 mm for hard materials: half the width of the flattened contact. Densities
[kg/m^3] are handbook values for the solid material. The densities of food and foam include the pores and are estimates
to within 10 %.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from betterbench.errors import UnknownNameError
from betterbench.geometry import Vector

_PATCH_RADIUS_M = 0.015
_SOFT_M, _HARD_M = 0.001, 0.0005


@dataclass(frozen=True, slots=True)
class Material:
    """Material of an object.

    Attributes:
        sliding: Coefficient of sliding friction against the same material or a table.
        density: Density of the solid material [kg/m^3].
        soft: Whether the material is soft and yields at contacts.
        reason: Where the coefficient of sliding friction comes from.
    """

    name: str
    sliding: float
    density: float
    soft: bool
    reason: str

    @property
    def friction(self) -> Vector:
        """Sliding, torsional [m] and rolling [m] friction coefficients for a collision part."""
        torsional = round(2.0 / 3.0 * _PATCH_RADIUS_M * self.sliding, 5)
        return (self.sliding, torsional, _SOFT_M if self.soft else _HARD_M)


_ALL = (
    Material("ceramic", 0.60, 2400.0, False, "glazed, between glass on glass and glass on metal; the foot is unglazed"),
    Material("glass", 0.60, 2500.0, False, "glass on metal and on wood 0.5 to 0.7"),
    Material("steel", 0.55, 7850.0, False, "steel on steel 0.5 to 0.8, on wood 0.2 to 0.6"),
    Material("aluminum", 0.60, 2700.0, False, "aluminum on steel 0.61; a can is lacquered"),
    Material("plastic", 0.50, 1050.0, False, "housings of ABS, polystyrene, polypropylene: middle of 0.35 to 0.75"),
    Material("rubber", 0.90, 1200.0, True, "rubber on dry hard ground 0.6 to 0.9; the feet of appliances"),
    Material("wood", 0.50, 700.0, False, "beech, painted: wood on wood 0.25 to 0.6"),
    Material("paper", 0.60, 800.0, True, "uncoated paper on itself 0.4 to 0.7"),
    Material("cardboard", 0.55, 690.0, True, "board on itself 0.4 to 0.6"),
    Material("bread", 0.75, 250.0, True, "rough dry crumb: above paper, below rubber"),
    Material("meat", 0.80, 1000.0, True, "a seared, moist patty sticks more than bread does"),
    Material("cheese", 0.80, 1080.0, True, "moist and soft: clings as meat does"),
    Material("leaf", 0.70, 950.0, True, "a fresh leaf: wetted fruit skin 0.5 to 0.7"),
    Material("fruit", 0.55, 850.0, True, "skin of apples on wood and plastic 0.3 to 0.7"),
    Material("soap", 0.50, 1050.0, False, "a dry bar of pressed soap: as smooth plastic"),
    Material("sponge", 0.85, 60.0, True, "open foam: near rubber, its pores catch"),
)

MATERIALS: Mapping[str, Material] = {material.name: material for material in _ALL}
"""The materials by name."""


def material(name: str) -> Material:
    """Return the material with the given name.

    Raises:
        UnknownNameError: If there is no such material.
    """
    try:
        return MATERIALS[name]
    except KeyError:
        raise UnknownNameError("material", name, MATERIALS) from None
