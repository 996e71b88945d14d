"""Generators of computer mice, and of a bar of soap with the outline of a mouse."""

import math

import numpy as np

from betterbench.sim.assets.authoring import Draft, Turned, generator, grip, merge, part, solid_span, zone
from betterbench.sim.assets.authoring.mesh import ABOVE, Mesh, creased, loft
from betterbench.sim.assets.authoring.paint import PALETTE, Canvas, Rgb, jittered, mixed, shaded, uniforms

_SIDES = 24


def _size(rng: np.random.Generator) -> tuple[float, float, float]:
    """Draw the length, width and height [m] of a mouse or of the soap that matches it.

    A generator must call this function before it draws any other random number, so that mouse and soap get equal sizes.
    """
    length, width, height = uniforms(rng, (0.096, 0.114), (0.0575, 0.0645), (0.0335, 0.0395))
    return length, width, height


@generator("computer_mouse", colors=("black", "white", "gray", "blue"))
def computer_mouse(rng: np.random.Generator, color: str) -> Draft:
    """Make a cordless computer mouse. Its buttons and its wheel are at -x, and the user sits at +x.

    Cordless mice are 95 to 125 mm long, 57 to 68 mm wide and 33 to 42 mm high, and weigh 80 to 120 g with their
    battery. The mass here is 430 kg/m^3 times the volume of the bounding box.
    """
    length, width, height = _size(rng)
    # The back is highest behind the center because of the hump; the waist narrows the sides.
    hump, waist, power = rng.uniform(0.002, 0.018), rng.uniform(0.00, 0.14), rng.uniform(2.1, 3.2)
    extra_button, trim = rng.random() < 0.5, str(rng.choice(["plain", "grips", "spine", "buttons", "palm", "buttons"]))
    wheel_paint = ((0.86, 0.87, 0.88), (0.95, 0.45, 0.10), (0.20, 0.75, 0.90), (0.80, 0.15, 0.15))[int(rng.integers(4))]
    shade = jittered(shaded(PALETTE[color], 1.06) if color == "black" else PALETTE[color], rng)
    accent = shaded(shade, 0.38) if sum(shade) > 0.9 else mixed(shade, (0.66, 0.67, 0.70), 0.26)
    x, half = -0.20 * length, 0.5 * width - 0.0006
    z = float(_back(np.array([x]), length, height, hump)[0]) - 0.0066
    radii = (0.0, 0.0085, 0.0100, 0.0100, 0.0085, 0.0)
    levels = (-0.0048, -0.0048, -0.0026, 0.0026, 0.0048, 0.0048)
    wheel = Turned(radii, levels, 12, wrap=False).mesh().rotated("x", math.pi / 2.0).moved(x, 0.0, z)
    shell = _dome(length, width, height, hump=hump, waist=waist, power=power)
    picture = _shell(shade, accent, length=length, width=width, wheel_x=x, trim=trim, extra_button=extra_button)
    return Draft(
        shape="irregular",
        description=f"A {color} cordless computer mouse with two buttons and a scroll wheel.",
        tags=("mouse", "computer mouse", "cordless mouse", "desk"),
        traits=("desk",),
        mass_kg=round(430.0 * length * width * height, 4),
        material="plastic",
        parts=(
            part("shell", shell, picture, view=ABOVE, specular=0.35, shininess=0.45),
            part("wheel", wheel, wheel_paint, specular=0.3),
            solid_span((-0.30 * length, 0.32 * length), half, (0.0, 0.021)),
            solid_span((-0.47 * length, 0.47 * length), 0.66 * half, (0.0005, 0.0155)),
            solid_span((-0.22 * length, 0.34 * length), 0.66 * half, (0.021, height - 0.003)),
        ),
        grasps=(grip("body", 0.016, 2.0 * half, clearance=0.007),),
        regions=(zone("base", 0.5 * length, 0.5 * width),),
        parameters={"length_m": length, "width_m": width, "height_m": height, "trim": trim},
    )


def _outline(half_x: float, half_y: float, power: float, waist: float) -> np.ndarray:
    """Return (n, 2) points on a super-ellipse with the given half extents [m], which narrows toward -x."""
    angle = 2.0 * math.pi * np.arange(_SIDES) / _SIDES
    c, s = np.cos(angle), np.sin(angle)
    x = half_x * np.sign(c) * np.abs(c) ** (2.0 / power)
    y = half_y * np.sign(s) * np.abs(s) ** (2.0 / power)
    # The mouse is widest behind its center, where the palm rests.
    y = y * (1.0 - waist * np.clip(0.25 - x / half_x, 0.0, 1.0))
    return np.stack([x, y * half_y / float(np.abs(y).max())], axis=1)


def _back(x: np.ndarray, length: float, height: float, hump: float) -> np.ndarray:
    """Return the height of a mouse's back at positions along its center line [m]."""
    t = (x - hump) / (0.5 * length + np.where(x < hump, hump, -hump))
    return height * (1.0 - np.where(x < hump, 0.36, 0.50) * np.abs(t) ** 2.2)


def _dome(length: float, width: float, height: float, *, hump: float, waist: float, power: float) -> Mesh:
    """Return the shell of a mouse: upright sides that lean in slightly, under a smooth arched back."""
    outline = _outline(0.5 * length, 0.5 * width, power, waist)

    def ring(share: float, level: float) -> np.ndarray:
        points = share * outline
        return np.column_stack([points, level * _back(points[:, 0], length, height, hump)])

    foot, side = ring(0.93, 0.0), ring(1.0, 0.0)
    side[:, 2] = 0.006
    levels = ((0.985, 0.58), (0.92, 0.80), (0.78, 0.925), (0.52, 0.985), (0.24, 1.0))
    return creased(loft([foot, side, *(ring(s, v) for s, v in levels)]), 55.0)


def _shell(
    shade: Rgb, accent: Rgb, *, length: float, width: float, wheel_x: float, trim: str, extra_button: bool
) -> Canvas:
    """Draw a mouse from above, with the seams of the buttons, the slot of the wheel, trim and a small logo."""
    canvas = Canvas(width, length, (144, 256), shade)
    x, y = canvas.x - 0.5 * width, canvas.y - 0.5 * length  # x to the right, y away from the user
    # Seams are wide, and light on a dark mouse, so that the two buttons can be seen from the other side of a table.
    seam = mixed(shade, (1.0, 1.0, 1.0), 0.55) if sum(shade) < 1.2 else shaded(shade, 0.25)
    bow = -0.09 * length - 3.0 * x * x / width
    if trim == "buttons":
        canvas.paint(y > bow, accent)
    elif trim == "palm":
        canvas.paint(y < bow - 0.06 * length, accent)
    elif trim == "grips":
        canvas.paint((np.abs(x) > 0.34 * width) & (y < 0.30 * length), accent)
    elif trim == "spine":
        canvas.paint((np.abs(x) < 0.15 * width) & (y > -0.30 * length), accent)
    canvas.paint(np.abs(y - bow) < 0.0013, seam)
    canvas.paint((y > bow) & (np.abs(x) < 0.0013), seam)
    wheel_y = 0.5 * length - wheel_x
    canvas.ellipse((0.5 * width, wheel_y), (0.0088, 0.0165), seam)
    canvas.ellipse((0.5 * width, wheel_y), (0.0072, 0.0149), (0.02, 0.02, 0.025))
    if extra_button:
        canvas.ellipse((0.5 * width, wheel_y - 0.0225), (0.0046, 0.0056), seam)
        canvas.ellipse((0.5 * width, wheel_y - 0.0225), (0.0034, 0.0044), mixed(shade, accent, 0.7))
    mark = (0.5 * width, 0.5 * length - 0.27 * length)
    ink = (0.80, 0.81, 0.82) if sum(shade) < 1.6 else (0.35, 0.36, 0.38)
    canvas.ellipse(mark, (0.0066, 0.0044), ink)
    canvas.ellipse((mark[0], mark[1] + 0.0006), (0.0044, 0.0024), accent if trim == "palm" else shade)
    return canvas


@generator("soap_bar", colors=("gray", "white", "green"), family="computer_mouse")
def soap_bar(rng: np.random.Generator, color: str) -> Draft:
    """Make a bar of soap with the size and approximate outline of a computer mouse, and lather on one end.

    A bar of soap fills 70 % of its bounding box. With 1050 kg/m^3, a new bar would weigh 0.15 kg. Here it has three
    quarters of that mass, like a used bar, so that it is hardly heavier than the mouse that it resembles.
    """
    length, width, height = _size(rng)
    length, width, height = 0.95 * length, 0.97 * width, 0.93 * height
    power, stamp = float(rng.choice([2.1, 2.8, 4.0])), str(rng.choice(["SOAP", "SOAP", "leaf", "SOAP", "PURE"]))
    dish, waist, lather = rng.uniform(0.0012, 0.0022), rng.random() < 0.4, int(rng.integers(4, 7))
    shade = jittered({"gray": (0.60, 0.61, 0.64), "white": PALETTE["white"], "green": (0.42, 0.66, 0.44)}[color], rng)
    outline, half = _outline(0.5 * length, 0.5 * width, power, 0.0), 0.5 * width - 0.0006
    if waist:
        # The bar is narrower in the middle, like bars that fit the hand.
        drawn = 1.0 - 0.16 * np.exp(-((outline[:, 0] / (0.22 * length)) ** 2))
        outline = outline * np.column_stack(
            [np.ones(_SIDES), drawn / float((drawn * np.abs(outline[:, 1])).max()) * half]
        )
        half = float(np.abs(outline[np.abs(outline[:, 0]) < 0.13 * length, 1]).max())
    sides = ((0.78, 0.0), (0.93, 0.12), (1.0, 0.42), (0.985, 0.62), (0.89, 0.90))
    levels = (*sides, (0.80, 1.0), (0.72, 1.0), (0.66, 1.0 - dish / height))
    bar = creased(loft([np.column_stack([s * outline, np.full(_SIDES, v * height)]) for s, v in levels]), 50.0)
    picture = _stamped(rng, shade, stamp=stamp, length=length, width=width)
    seen = [part("bar", bar, picture, view=ABOVE, specular=0.45, shininess=0.5)]
    seen.append(part("lather", _lather(rng, length, width, height, count=lather), (0.97, 0.98, 1.0), specular=0.1))
    return Draft(
        shape="irregular",
        description=f"A {color} bar of soap with a stamp on its top.",
        tags=("soap", "bar of soap", "soap bar", "bathroom"),
        traits=("bathroom",),
        mass_kg=round(560.0 * length * width * height, 4),
        material="soap",
        parts=(
            *seen,
            solid_span((-0.38 * length, 0.38 * length), 0.66 * half, (0.0, height - 0.001)),
            solid_span((-0.28 * length, 0.28 * length), half, (0.005, 0.82 * height)),
            solid_span((-0.49 * length, 0.49 * length), 0.5 * half, (0.006, 0.78 * height)),
        ),
        grasps=(grip("body", 0.016, 2.0 * half, clearance=0.008),),
        regions=(zone("base", 0.5 * length, 0.5 * width),),
        parameters={"length_m": length, "width_m": width, "height_m": height, "stamp": stamp},
    )


def _lather(rng: np.random.Generator, length: float, width: float, height: float, *, count: int) -> Mesh:
    """Return a heap of lather on one end of the bar.

    The lather runs from the top over the edge of the bar, but does not reach the point where the bar is grasped.
    """
    end, side = float(rng.choice([-1.0, 1.0])), float(rng.choice([-1.0, 1.0]))
    lumps = []
    for k in range(count):
        r = rng.uniform(0.0075, 0.0115) * (1.0 if k < 4 else 0.75)
        x = end * (0.43 - 0.07 * (k % 3) + rng.uniform(-0.02, 0.02)) * length
        y = side * (0.30 - 0.19 * (k // 2) + rng.uniform(-0.04, 0.04)) * width
        top = height - 0.35 * (r if k != 1 else 2.2 * r)
        lump = Turned((0.92 * r, r, 0.70 * r, 0.0), (-0.5 * r, 0.0, 0.70 * r, r), 7, 80.0, wrap=False, phase=0.5 * k)
        x, y = 0.94 * x, 0.94 * y
        lumps.append(lump.mesh().moved(x, y, min(top, height + 0.0035 - r)))
    return merge(lumps)


# Strokes of the letters that are stamped into the soap. A stroke is given by the x coordinates of its points and then
# the y coordinates, in a cell of 1 by 1.6.
_Stroke = tuple[tuple[float, ...], tuple[float, ...]]
_BOWL: _Stroke = ((0.05, 0.05, 0.7, 1.0, 0.7, 0.05), (0.0, 1.6, 1.6, 1.25, 0.8, 0.8))
_SNAKE = (0.95, 0.7, 0.25, 0.0, 0.2, 0.8, 1.0, 0.75, 0.25, 0.02)
_OVAL = (0.5, 0.1, 0.0, 0.1, 0.5, 0.9, 1.0, 0.9, 0.5)
_LETTERS: dict[str, tuple[_Stroke, ...]] = {
    "S": ((_SNAKE, (1.35, 1.6, 1.6, 1.3, 0.9, 0.7, 0.3, 0.0, 0.0, 0.25)),),
    "O": ((_OVAL, (0.0, 0.3, 0.8, 1.3, 1.6, 1.3, 0.8, 0.3, 0.0)),),
    "A": (((0.0, 0.5, 1.0), (0.0, 1.6, 0.0)), ((0.2, 0.8), (0.55, 0.55))),
    "P": (_BOWL,),
    "U": (((0.0, 0.0, 0.3, 0.7, 1.0, 1.0), (1.6, 0.4, 0.0, 0.0, 0.4, 1.6)),),
    "R": (_BOWL, ((0.5, 1.0), (0.8, 0.0))),
    "E": (((1.0, 0.05, 0.05, 1.0), (0.0, 0.0, 1.6, 1.6)), ((0.05, 0.8), (0.8, 0.8))),
}


def _stamped(rng: np.random.Generator, shade: Rgb, *, stamp: str, length: float, width: float) -> Canvas:
    """Draw a bar of soap from above, with an oval groove around a word or a leaf that runs along the bar."""
    canvas = Canvas(width, length, (144, 256), shade)
    canvas.grain(rng, cells=(7, 11), amount=0.018)
    middle = (0.5 * width, 0.5 * length)
    dark, light = shaded(shade, 0.66), mixed(shade, (1.0, 1.0, 1.0), 0.45)
    a, b = 0.40 * width, 0.44 * length
    for grow, ink in ((0.0018, light), (0.0, dark), (-0.0024, mixed(shade, (1.0, 1.0, 1.0), 0.12))):
        canvas.ellipse(middle, (a + grow, b + grow), ink)
    for shift, ink in ((-0.0008, light), (0.0, dark)):
        if stamp == "leaf":
            tip, stalk = (middle[0] + shift, middle[1] + 0.024), (middle[0] + shift, middle[1] - 0.024)
            canvas.line([stalk, tip], 0.0030, ink)
            for k in range(5):
                y = middle[1] - 0.015 + 0.0075 * k
                spread = 0.017 - 0.0024 * k
                canvas.line([(middle[0] - spread + shift, y + 0.007), (middle[0] + shift, y)], 0.0030, ink)
                canvas.line([(middle[0] + spread + shift, y + 0.007), (middle[0] + shift, y)], 0.0030, ink)
            continue
        # The word can be read from -y. It runs along the bar from the near to the far end.
        cell, left = 0.0125, middle[0] + shift
        for k, letter in enumerate(stamp):
            low = middle[1] + 0.0165 * (k - 1.5) + shift
            for across, up in _LETTERS[letter]:
                points = [(left + cell * (0.8 - v), low + cell * (u - 0.5)) for u, v in zip(across, up, strict=True)]
                canvas.line(points, 0.0028, ink)
    return canvas
