"""Generator of coffee machines, which have a marked ring on their drip tray."""

import numpy as np

from betterbench.sim.assets.authoring import Draft, disc, generator, merge, part, rod, solid_span, span, zone
from betterbench.sim.assets.authoring.fittings import gauge, grille, outlet, panel, ring_mark, steam_wand, water_tank
from betterbench.sim.assets.authoring.paint import PALETTE, jittered, uniforms

_TRAY, _RING = 0.0115, 0.0425  # height of the tray, radius of the ring on it [m]


@generator("coffee_machine", colors=("black", "silver", "cream", "red", "blue"))
def coffee_machine(rng: np.random.Generator, color: str) -> Draft:
    """Make a C-shaped coffee machine of 3.5 kg whose front faces +x. It is a fixture and cannot be grasped.

    A mug is put down on the ring with its handle toward +x. The nozzle is 19 mm behind the center of the ring, and 126
    mm above the tray.
    """
    width, wall_depth, reach, height = uniforms(rng, (0.176, 0.212), (0.084, 0.098), (0.078, 0.082), (0.262, 0.296))
    more, tray, short, head = uniforms(rng, (0.006, 0.030), (0.120, 0.150), (0.009, 0.011), (0.025, 0.0295))
    tip, under, side, tray_side = _TRAY + 0.126, _TRAY + 0.138, width / 2, tray / 2
    deep, top = reach + 0.0490, under + rng.uniform(0.046, 0.058)
    face, corner = str(rng.choice(["gauge", "display"])), float(rng.choice([0.010, 0.022]))
    mark, shade = PALETTE["yellow"] if rng.random() < 0.5 else (0.35, 0.88, 0.22), jittered(PALETTE[color], rng)
    dark = (0.13, 0.13, 0.14) if sum(shade) > 0.6 else (0.20, 0.20, 0.22)
    front = 0.5 * (wall_depth + deep)
    wall, back, tank, tank_top = front - deep, -front, 0.030 - front, height + more
    ring, start, end, nozzle = wall + reach, wall - 0.004, wall + reach - short, wall + reach - 0.019
    beak_x, beak_y = (start, start + 0.72 * (end - start), end - 0.004, end), (head, head, head - 0.001, head - 0.005)
    beak_z = (under, under, under, under + 0.004), (top, top - 0.002, top - 0.010, top - 0.014)
    beak = rod(list(zip(beak_x, beak_y, *beak_z, strict=True)), chamfer=0.006, crease_degrees=38.0)
    drip = span((wall - 0.010, front), tray_side, (0.0, _TRAY), bevel=0.0018, corner=0.022, steps=2)
    housing = [span((tank, wall), side, (0.006, height), bevel=0.006, corner=corner), beak]
    split, panel_z, dial_z = top / height - 0.02, (0.031, height - 0.019), 0.5 * (top + height) + 0.004
    sizes: dict[str, float | str] = {"width_m": width, "depth_m": 2 * front, "height_m": height, "ring_reach_m": reach}
    return Draft(
        shape="irregular",
        description=f"A {color} coffee machine with a {face}, a water tank and a marked ring on its drip tray.",
        tags=("coffee machine", "espresso machine", "coffee maker", "appliance", "fixture"),
        traits=(
            "appliance",
            "fixture",
        ),
        mass_kg=3.5,
        material="plastic",
        parts=(
            part("housing", merge(housing), shade, specular=0.45, shininess=0.5),
            solid_span((back, wall), side, (0.0, height)),
            solid_span((back, tank), 0.44 * width, (height, tank_top)),
            part("tray", merge([drip, span((back, wall), side - 0.002, (0.0, 0.008))]), dark),
            solid_span((wall, front), tray_side, (0.0, _TRAY)),
            solid_span((wall, end), head, (under, top)),
            water_tank((back + 0.0005, tank - 0.0005), 0.44 * width, (0.012, tank_top)),
            panel(rng, wall, 0.40 * width, panel_z, shade, trim=dark, split=split, display=face == "display"),
            grille((wall + 0.008, front - 0.008), tray_side - 0.009, _TRAY, slots=13.0),
            ring_mark(_RING, 0.0065, ring, _TRAY, mark),
            *outlet(nozzle, tip, under),
            gauge(rng, 0.0205, wall + 0.001, dial_z) if face == "gauge" else steam_wand(wall, 0.36 * width, under),
        ),
        regions=(
            disc("ring", _RING, _TRAY, x=ring),
            zone("spout", 0.5 * (end - wall), head, 0.5 * (tip + top), x=0.5 * (wall + end), half_z=0.5 * (top - tip)),
        ),
        parameters={**sizes, "nozzle_behind_ring_m": 0.019, "face": face},
    )
