"""Generator of full beverage cans."""

import math

import numpy as np

from betterbench.sim.assets.authoring import Draft, Turned, disc, generator, grip_across, part, standing
from betterbench.sim.assets.authoring.mesh import Mesh, prism
from betterbench.sim.assets.authoring.paint import CHROME, PALETTE, Canvas, Rgb, jittered, mixed, shaded

# Sizes of cans: name, radius and height [m]. Standard 330 ml, sleek 330 ml, slim 250 ml, and a small one of 200 ml.
SIZES = (("standard", 0.0330, 0.115), ("sleek", 0.0290, 0.130), ("slim", 0.0265, 0.122), ("small", 0.0300, 0.086))
# Prints that a can may have.
DESIGNS = ("wave", "disc", "stripes", "diamond", "halves", "bands")


@generator("can", colors=("red", "silver", "blue", "green", "orange", "yellow", "black", "white"))
def can(rng: np.random.Generator, color: str) -> Draft:
    """Make a full beverage can.

    Cans have a diameter of 66 mm and a height of 115 mm (330 ml), 58 mm and 134 to 146 mm (330 ml, sleek), 53 mm and
    122 to 134 mm (250 ml, slim), or about 60 mm and 86 mm (200 ml). A can consists of 13 g of aluminum and the drink.
    The drink has a density of 1 kg/l and fills 86 % of the can's bounding cylinder.
    """
    size, radius, height = SIZES[int(rng.choice(4, p=(0.4, 0.2, 0.2, 0.2)))]
    height, shoulder = height * rng.uniform(0.960, 1.045), rng.uniform(0.008, 0.019)
    design, shell = str(rng.choice(DESIGNS)), can_shell(radius, height, shoulder)
    shade = jittered(PALETTE[color], rng, amount=0.06)
    angle, top = np.arange(10) * (2.0 * math.pi / 10), shell.heights[-1]
    scale = radius / 0.033

    def on_lid(a: float, b: float, x: float, thickness: float) -> Mesh:
        """Return a flat ellipse on the lid.

        The given sizes apply to a can 66 mm in diameter and are scaled to this can.
        """
        outline = np.stack([x + a * np.cos(angle), b * np.sin(angle), np.zeros(10)], axis=1) * scale
        outline[:, 2] = top - 0.0004
        return prism([outline, outline + np.array([0.0, 0.0, 0.0004 + thickness])])

    return Draft(
        shape="cylinder",
        description=f"A full {color} soda can with a printed label and a pull tab.",
        tags=("can", "soda", "drink", "beverage", "metal"),
        traits=("metal",),
        mass_kg=round(0.013 + 860.0 * math.pi * radius**2 * height, 3),
        material="aluminum",
        parts=(
            part("shell", shell.mesh(), draw_label(rng, shell, shade, design=design), specular=0.7, shininess=0.6),
            part("mouth", on_lid(0.0098, 0.0078, 0.0125, 0.0002), (0.22, 0.22, 0.24), specular=0.3),
            part("tab", on_lid(0.0105, 0.0062, -0.0045, 0.0014), (0.93, 0.94, 0.95), specular=0.8, shininess=0.7),
            part("hole", on_lid(0.0040, 0.0032, -0.0088, 0.0016), (0.30, 0.31, 0.33), specular=0.3),
            *standing(0.515 * radius, (radius, height - 0.006), (0.82 * radius, height)),
        ),
        grasps=(grip_across(height - 0.037, radius, clearance=0.006),),
        regions=(disc("base", radius), disc("top", 0.82 * radius, height)),
        parameters={"radius_m": radius, "height_m": height, "design": design, "size": size},
    )


def can_shell(radius: float, height: float, shoulder: float) -> Turned:
    """Return the shell of a can with the given radius and height [m]: bottom, wall, tapered shoulder, rim and lid."""
    lid, neck = height - 0.0035, 0.82 * radius
    radii = (0.0, 0.75 * radius, radius, radius, neck + 0.0005, neck, neck - 0.0012, neck - 0.002, 0.0)
    return Turned(radii, (0.0, 0.0, 0.0075, height - shoulder, height - 0.0015, height, height, lid, lid))


def draw_label(rng: np.random.Generator, shell: Turned, shade: Rgb, *, design: str) -> Canvas:
    """Draw the texture for one half of a can from its bottom to its lid, with one of the prints in :data:`DESIGNS`."""
    bottom, low, high, rim, lid = (shell.rows[k] for k in (1, 2, 3, 5, 7))
    canvas = shell.canvas(CHROME)
    x, y, width = canvas.x, canvas.y, canvas.width
    printed = canvas.between(low + 0.002, high + 0.004)
    canvas.paint(printed, shade)
    accent = (0.95, 0.95, 0.93) if sum(shade) < 1.9 else (0.72, 0.10, 0.12)
    second = mixed(shade, (0.0, 0.0, 0.0), 0.45)
    span = high - low
    middle = low + 0.52 * span
    if design == "wave":
        wave = middle + 0.16 * span * np.cos(2.0 * math.pi * x / width)
        canvas.paint(printed & (np.abs(y - wave) < 0.10 * span), accent)
        canvas.paint(printed & (np.abs(y - wave + 0.15 * span) < 0.025 * span), second)
    elif design == "disc":
        for u in (0.0, 1.0):
            for share, ink in ((0.64, accent), (0.47, second), (0.24, accent)):
                reach = share * width / math.pi
                canvas.ellipse((u * width, middle), (reach, reach), ink)
        canvas.band(low + 0.06 * span, low + 0.10 * span, accent)
    elif design == "stripes":
        slanted = (y + 0.9 * np.abs(x - width / 2.0)) % (0.40 * span)
        canvas.paint(printed & (slanted < 0.16 * span), accent)
        canvas.paint(printed & (slanted > 0.20 * span) & (slanted < 0.24 * span), second)
    elif design == "halves":
        slant = middle + span * (0.20 + 0.14 * (1.0 - 2.0 * x / width))
        canvas.paint(printed & (y > slant), accent)
        canvas.paint(printed & (np.abs(y - slant) < 0.035 * span), second)
    elif design == "bands":
        canvas.paint(printed & (np.abs(y - low - 0.80 * span) < 0.06 * span), accent)
        canvas.paint(printed & (np.abs(y - low - 0.22 * span) < 0.10 * span), accent)
        canvas.paint(printed & (np.abs(y - low - 0.40 * span) < 0.03 * span), second)
    else:
        for u in (0.0, 0.5, 1.0):
            away = np.abs(x - u * width) / (0.164 * width) + np.abs(y - middle) / (0.34 * span)
            canvas.paint(printed & (away < 1.0), accent)
            canvas.paint(printed & (away < 0.62), second)
    canvas.band(low + 0.002, low + 0.0045, accent)
    canvas.shade(1.0 + 0.05 * np.cos(4.0 * math.pi * x / width + rng.uniform(0.0, 6.0)))
    canvas.shade(np.where(y < bottom, 0.6, 1.0))
    canvas.shade(np.where(canvas.between(rim, lid), 0.80, 1.0))
    canvas.paint(y > lid, shaded(CHROME, 0.93))
    return canvas
