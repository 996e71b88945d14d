"""Full beverage cans."""

import math

import numpy as np

from betterbench.assets.authoring import Draft, Turned, disc, generator, grip_across, part, standing
from betterbench.assets.authoring.mesh import Mesh, prism
from betterbench.assets.authoring.paint import CHROME, PALETTE, Canvas, Rgb, jittered, mixed, shaded

# Radius of the standard 330 ml can [m].
CAN_RADIUS = 0.033
# Prints that a can may have.
DESIGNS = ("wave", "disc", "stripes", "diamond")


@generator("can", colors=("red", "silver", "blue", "green", "orange", "yellow", "black", "white"))
def can(rng: np.random.Generator, color: str) -> Draft:
    """Make a full beverage can.

    The standard 330 ml can has a diameter of 66 mm, a height of 115 mm and weighs 0.35 kg when full (13 g of aluminum
    and 0.33 l of drink).
    """
    height, shoulder, design = rng.uniform(0.1125, 0.1175), rng.uniform(0.010, 0.013), str(rng.choice(DESIGNS))
    shell, shade = can_shell(height, shoulder), jittered(PALETTE[color], rng, amount=0.06)
    angle, top = np.arange(10) * (2.0 * math.pi / 10), shell.heights[-1]

    def on_lid(a: float, b: float, x: float, thickness: float) -> Mesh:
        """Return a flat ellipse on the lid."""
        outline = np.stack([x + a * np.cos(angle), b * np.sin(angle), np.full(10, top - 0.0004)], axis=1)
        return prism([outline, outline + np.array([0.0, 0.0, 0.0004 + thickness])])

    return Draft(
        shape="cylinder",
        description=f"A full {color} soda can with a printed label and a pull tab.",
        tags=("can", "soda", "drink", "beverage", "metal"),
        mass_kg=0.35,
        parts=(
            part("shell", shell.mesh(), draw_label(rng, shell, shade, design=design), specular=0.7, shininess=0.6),
            part("mouth", on_lid(0.0088, 0.0068, 0.0125, 0.0002), (0.36, 0.37, 0.39), specular=0.3),
            part("tab", on_lid(0.0095, 0.0058, -0.0035, 0.0014), (0.86, 0.87, 0.88), specular=0.8, shininess=0.7),
            part("hole", on_lid(0.0034, 0.0028, -0.0078, 0.0016), (0.42, 0.43, 0.45), specular=0.3),
            *standing(0.0170, (CAN_RADIUS, height - 0.006), (0.027, height)),
        ),
        grasps=(grip_across(height - 0.037, CAN_RADIUS, clearance=0.006),),
        regions=(disc("base", CAN_RADIUS), disc("top", 0.027, height)),
        parameters={"radius_m": CAN_RADIUS, "height_m": height, "design": design},
    )


def can_shell(height: float, shoulder: float) -> Turned:
    """Return a can of a height to its rim [m]: bottom, wall, tapered shoulder, rim, lid."""
    lid = height - 0.0035
    radii = (0.0, 0.0245, CAN_RADIUS, CAN_RADIUS, 0.0275, 0.0270, 0.0258, 0.0250, 0.0)
    return Turned(radii, (0.0, 0.0, 0.0075, height - shoulder, height - 0.0015, height, height, lid, lid))


def draw_label(rng: np.random.Generator, shell: Turned, shade: Rgb, *, design: str) -> Canvas:
    """Draw half of a can from the bottom over a print, one of :data:`DESIGNS`, to the lid."""
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
            for radius, ink in ((0.021, accent), (0.0155, second), (0.008, accent)):
                canvas.ellipse((u * width, middle), (radius, radius), ink)
        canvas.band(low + 0.06 * span, low + 0.10 * span, accent)
    elif design == "stripes":
        slanted = (y + 0.9 * np.abs(x - width / 2.0)) % (0.40 * span)
        canvas.paint(printed & (slanted < 0.16 * span), accent)
        canvas.paint(printed & (slanted > 0.20 * span) & (slanted < 0.24 * span), second)
    else:
        for u in (0.0, 0.5, 1.0):
            away = np.abs(x - u * width) / 0.017 + np.abs(y - middle) / (0.34 * span)
            canvas.paint(printed & (away < 1.0), accent)
            canvas.paint(printed & (away < 0.62), second)
    canvas.band(low + 0.002, low + 0.0045, accent)
    canvas.shade(1.0 + 0.05 * np.cos(4.0 * math.pi * x / width + rng.uniform(0.0, 6.0)))
    canvas.shade(np.where(y < bottom, 0.6, 1.0))
    canvas.shade(np.where(canvas.between(rim, lid), 0.80, 1.0))
    canvas.paint(y > lid, shaded(CHROME, 0.93))
    return canvas
