"""Generator of open laptops, next to which tasks place objects on a desk."""

import math

import numpy as np

from betterbench.geometry import from_axis_angle, rotate
from betterbench.sim.assets.authoring import Draft, Turned, generator, leaning_box, part, solid_span, span, zone
from betterbench.sim.assets.authoring.mesh import ABOVE, FRONT, Mesh, mapped, prism, rectangle
from betterbench.sim.assets.authoring.paint import PALETTE, Canvas, Rgb, jittered, mixed, shaded, uniforms
from betterbench.sim.assets.procedural.keyboard import draw_keys

_BASE = 0.014  # height of the lower half
_LID = 0.006  # thickness of the screen
_GAP = 0.075  # distance from the side of the laptop to the center of the zone next to it
_BEHIND = 0.065  # distance from the back edge of the screen to the center of the zone behind it


@generator("laptop", colors=("silver", "black"))
def laptop(rng: np.random.Generator, color: str) -> Draft:
    """Make an open laptop whose user sits at +x. The screen leans back and shows a desktop with windows.

    A laptop with a 10- to 11-inch screen is 0.24 to 0.29 m wide and 0.16 to 0.20 m deep, and weighs 1.1 to 1.4 kg, most
    of it in the lower half. The zones "left", "right" and "behind" are named from the view of the user, who looks
    toward -x. Right is therefore +y.
    """
    depth, width, lean = uniforms(rng, (0.160, 0.172), (0.240, 0.258), (13.0, 20.0))
    lean, half_x, half_y = math.radians(lean), 0.5 * depth, 0.5 * width
    height, corner = rng.uniform(0.142, 0.156), rng.uniform(0.003, 0.016)
    wallpaper = str(rng.choice(["hills", "gradient", "rings", "night"]))
    dark_keys = bool(color == "black" or rng.random() < 0.6)
    metal = jittered(shaded(PALETTE[color], 1.10) if color == "black" else PALETTE[color], rng, amount=0.06)

    # The lid turns about the hinge, which is the far upper edge of the base. At first, the base is centered at x = 0.
    hinge_x, hinge_z = -0.5 * depth + 0.006, _BASE - 0.001
    reach = (height - hinge_z - 0.5 * _LID * math.sin(lean)) / math.cos(lean)  # length of the lid
    back = hinge_x - reach * math.sin(lean) - 0.5 * _LID * math.cos(lean)
    x = -0.5 * (0.5 * depth + back)
    # The lid is made upright over the origin and then opened.
    hinge = (lean, hinge_x + x, hinge_z)
    front, screen_size, deck_size = 0.5 * _LID, (width - 0.014, reach - 0.022), (width - 0.010, depth - 0.016)
    shell = _sheet(half_y, (0.0, reach), corner, (front - _LID, front))
    bezel = _sheet(half_y - 0.0014, (0.001, reach - 0.0014), corner, (front - 0.0006, front + 0.0004))
    glass = (front - 0.0001, front + 0.0009)
    screen = span(glass, 0.5 * screen_size[0], (0.012, 0.012 + screen_size[1]))
    deck_x = (x + 0.001 - 0.5 * deck_size[1], x + 0.001 + 0.5 * deck_size[1])
    deck = span(deck_x, 0.5 * deck_size[0], (_BASE - 0.0002, _BASE + 0.0004))
    base = span((x - half_x, x + half_x), half_y, (0.0, _BASE), bevel=0.0025, corner=corner, steps=2)
    end = 0.31 * width
    pin = Turned((0.0, 0.0048, 0.0048, 0.0), (-end, -end, end, end), 10, wrap=False)
    barrel = pin.mesh().rotated("x", math.pi / 2.0)
    middle = rotate(from_axis_angle((0.0, -lean, 0.0)), (0.0, 0.0, 0.5 * reach))
    sizes = {"depth_m": depth, "width_m": width, "height_m": height, "lean_degrees": math.degrees(lean)}
    deck_picture = _deck(metal, size_m=deck_size, dark_keys=dark_keys)
    shown = _desktop(rng, size_m=screen_size, wallpaper=wallpaper)
    return Draft(
        shape="box",
        description=f"An open {color} laptop with a lit screen.",
        tags=("laptop", "notebook", "computer", "desk"),
        traits=("desk",),
        mass_kg=round(30.7 * width * depth, 3),
        material="rubber",  # material of the feet
        densities=(1.0, 1.1),
        parts=(
            part("base", base, metal, specular=0.4, shininess=0.4),
            part("deck", deck, deck_picture, view=ABOVE),
            part("lid", shell.hinged(*hinge), shaded(metal, 0.95), specular=0.4, shininess=0.4),
            part("bezel", bezel.hinged(*hinge), (0.05, 0.05, 0.055), specular=0.3),
            part("screen", mapped(screen, *FRONT).hinged(*hinge), shown),
            part("hinge", barrel.moved(hinge_x + x, 0.0, hinge_z), shaded(metal, 0.45), specular=0.3),
            solid_span((x - half_x, x + half_x), half_y, (0.0, _BASE)),
            leaning_box((front, half_y, 0.5 * reach), (hinge_x + x + middle[0], 0.0, hinge_z + middle[2]), -lean),
        ),
        regions=(
            zone("base", half_x, half_y, x=x),
            zone("right", 0.035, 0.035, x=x, y=half_y + _GAP, half_z=0.02),
            zone("left", 0.035, 0.035, x=x, y=-half_y - _GAP, half_z=0.02),
            zone("behind", 0.035, 0.035, x=back + x - _BEHIND, half_z=0.02),
        ),
        parameters={**sizes, "wallpaper": wallpaper},
    )


def _sheet(half_y: float, z: tuple[float, float], corner: float, x: tuple[float, float]) -> Mesh:
    """Return an upright plate with rounded corners that spans the given ranges of x and z [m]."""
    flat = rectangle(half_y, 0.5 * (z[1] - z[0]), 0.0, corner=corner, steps=2)
    up = 0.5 * (z[0] + z[1]) + flat[:, 1]
    return prism([np.column_stack([np.full(len(flat), at), flat[:, 0], up]) for at in x])


def _deck(metal: Rgb, *, size_m: tuple[float, float], dark_keys: bool) -> Canvas:
    """Draw the upper side of the base as the user sees it, with the keys and the trackpad in front of them."""
    width, depth = size_m
    canvas = Canvas(width, depth, (256, 176), metal)
    keys = (0.10, 0.10, 0.11) if dark_keys else (0.86, 0.87, 0.88)
    (left, low), (across, up) = (0.030 * width, 0.43 * depth), (0.94 * width, 0.50 * depth)
    inside = (canvas.x > left - 0.002) & (canvas.x < left + across + 0.002)
    canvas.paint(inside & canvas.between(low - 0.002, low + up + 0.002), shaded(metal, 0.55 if dark_keys else 0.75))
    draw_keys(canvas, (left, low), (across, up), keys)
    dx, dy = np.abs(canvas.x - 0.5 * width), np.abs(canvas.y - 0.205 * depth)
    pad = (0.19 * width, 0.165 * depth)
    canvas.paint((dx < pad[0] + 0.0012) & (dy < pad[1] + 0.0012), shaded(metal, 0.60))
    canvas.paint((dx < pad[0]) & (dy < pad[1]), mixed(metal, (1.0, 1.0, 1.0), 0.10))
    return canvas


def _desktop(rng: np.random.Generator, *, size_m: tuple[float, float], wallpaper: str) -> Canvas:
    """Draw the content of the screen: a wallpaper, two or three windows, and a bar with icons."""
    width, height = size_m
    canvas = Canvas(width, height, (256, 144), (0.30, 0.55, 0.85))
    x, y = canvas.x / width, canvas.y / height
    if wallpaper == "hills":
        canvas.paint(np.clip(y, 0.0, 1.0), (0.62, 0.84, 1.0))
        canvas.paint(y < 0.42 + 0.10 * np.sin(5.0 * x + 0.8), (0.30, 0.62, 0.50))
        canvas.paint(y < 0.28 + 0.09 * np.sin(7.0 * x + 2.6), (0.20, 0.48, 0.36))
    elif wallpaper == "gradient":
        canvas.paint(np.clip(0.5 * (x + y), 0.0, 1.0), (0.95, 0.45, 0.55))
    elif wallpaper == "rings":
        wave = 0.5 + 0.5 * np.sin(24.0 * np.hypot(x - 0.85, 0.6 * (y - 0.15)))
        canvas.paint(wave, (0.20, 0.80, 0.85), strength=0.8)
    else:
        canvas.paint(np.ones_like(x), (0.10, 0.13, 0.32))
        canvas.paint(np.clip(1.0 - 1.6 * y, 0.0, 1.0), (0.55, 0.28, 0.62))
        for u, v in rng.uniform(0.0, 1.0, (30, 2)).tolist():
            canvas.ellipse((u * width, v * height), (0.0008, 0.0008), (0.95, 0.95, 1.0))
    frames = [(0.07, 0.22, 0.45, 0.60), (0.46, 0.34, 0.46, 0.52), (0.30, 0.14, 0.34, 0.42)]
    titles = ((0.20, 0.40, 0.75), (0.35, 0.37, 0.42), (0.78, 0.36, 0.20))
    for k in range(int(rng.integers(2, 4))):
        left, low, across, up = frames[k]
        left, low = left + rng.uniform(-0.03, 0.03), low + rng.uniform(-0.03, 0.03)
        u, v = (x - left) / across, (y - low) / up
        frame = (u > 0.0) & (u < 1.0) & (v > 0.0) & (v < 1.0)
        canvas.paint((u > 0.02) & (u < 1.03) & (v > -0.05) & (v < 0.95), (0.0, 0.0, 0.0), strength=0.25)
        canvas.paint(frame, (0.97, 0.97, 0.98))
        canvas.paint(frame & (v > 0.88), titles[k])
        if k == 1:
            # Draw a bar chart.
            for bar, share in enumerate(rng.uniform(0.2, 0.65, 5).tolist()):
                column = (np.abs(u - 0.18 - 0.16 * bar) < 0.05) & (v > 0.10) & (v < 0.10 + share)
                canvas.paint(frame & column, (0.95, 0.55, 0.15))
        else:
            for line, share in enumerate(rng.uniform(0.45, 0.88, 6).tolist()):
                row = (np.abs(v - 0.76 + 0.115 * line) < 0.025) & (u > 0.06) & (u < share)
                canvas.paint(frame & row, (0.45, 0.47, 0.52))
    canvas.paint(y < 0.065, (0.12, 0.13, 0.16), strength=0.85)
    icons = ((0.95, 0.35, 0.30), (0.98, 0.78, 0.20), (0.35, 0.80, 0.45), (0.30, 0.60, 0.95), (0.75, 0.50, 0.90))
    for k, ink in enumerate(icons):
        canvas.ellipse(((0.38 + 0.06 * k) * width, 0.033 * height), (0.0034, 0.0034), ink)
    return canvas
