"""Building blocks for writing assets: solids, meshes, textures, grasps and regions (see docs/adding-an-asset.md).

A generator is one decorated function that returns a :class:`Draft`. From the draft, the registry derives everything
else that scenes, experts and predicates need.
"""

from betterbench.sim.assets.authoring.ceramics import glazed
from betterbench.sim.assets.authoring.draft import Draft, block, centered, disc, grip, grip_across, part, zone
from betterbench.sim.assets.authoring.materials import MATERIALS, Material, material
from betterbench.sim.assets.authoring.mesh import (
    ABOVE,
    FRONT,
    Mesh,
    box,
    loft,
    mapped,
    merge,
    prism,
    rod,
    slab,
    span,
    sweep,
)
from betterbench.sim.assets.authoring.paint import PALETTE, Canvas, Rgb, jittered, mixed, shaded, uniforms
from betterbench.sim.assets.authoring.registry import generator, generator_of, unregister
from betterbench.sim.assets.authoring.solids import (
    flared_walls,
    foot_square,
    leaning_box,
    open_box,
    ring_of_boards,
    round_wall,
    solid_box,
    solid_span,
    spheroid,
    standing,
    surfaced,
    upright_cylinder,
)
from betterbench.sim.assets.authoring.turned import Turned

__all__ = [
    "ABOVE",
    "FRONT",
    "MATERIALS",
    "PALETTE",
    "Canvas",
    "Draft",
    "Material",
    "Mesh",
    "Rgb",
    "Turned",
    "block",
    "box",
    "centered",
    "disc",
    "flared_walls",
    "foot_square",
    "generator",
    "generator_of",
    "glazed",
    "grip",
    "grip_across",
    "jittered",
    "leaning_box",
    "loft",
    "mapped",
    "material",
    "merge",
    "mixed",
    "open_box",
    "part",
    "prism",
    "ring_of_boards",
    "rod",
    "round_wall",
    "shaded",
    "slab",
    "solid_box",
    "solid_span",
    "span",
    "spheroid",
    "standing",
    "surfaced",
    "sweep",
    "uniforms",
    "unregister",
    "upright_cylinder",
    "zone",
]
