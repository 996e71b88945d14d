"""Generators of dinner plates that stack in any order, and of a bowl that is as wide as a plate."""

import math

import numpy as np

from betterbench.geometry import Pose, from_yaw, multiply
from betterbench.sim.assets.asset import CollisionPart, Grasp
from betterbench.sim.assets.authoring import Draft, Turned, disc, generator, part, round_wall, upright_cylinder
from betterbench.sim.assets.authoring.draft import JAW_OPENS_ALONG_X
from betterbench.sim.assets.authoring.mesh import Mesh
from betterbench.sim.assets.authoring.paint import PALETTE, Canvas, Rgb, jittered, mixed, shaded, uniforms

FLOOR_M = 0.0105
"""Height of a plate's floor, on which the next plate of a stack rests [m]. It is the same for all plates, so that all
stacks of equally many plates have the same height.

It is also the height at which the rim of a plate begins. In a stack, the rim of each plate therefore begins above the
rim of the plate below it. Plates with any radii can therefore be stacked with clearance at the sides.
"""

RIM_M = 0.0205
"""Height of the rim [m]. Its upright edge is 10 mm high. Finger pads that reach 9 mm down this edge hold a plate with
half of their force, and the plate then tilts by less than 1 degree. The pads end 1 mm above the floor of the plate, and
1 mm above the rim of a plate below it."""

_LIP = 0.004
_GRIP_ABOVE_RIM = 0.0030  # height of the center of the pads, which reach 12 mm further down
_COLORS = ("white", "red", "blue", "green", "yellow")
_DESIGNS = ("plain", "wide band", "thin lines", "pale middle", "dots", "rays", "speckled", "broad rings")


@generator("dinner_plate", colors=_COLORS, family="plates")
def dinner_plate(rng: np.random.Generator, color: str) -> Draft:
    """Make a flat plate on a foot, 152 to 164 mm in diameter. Its edge is turned up, so that a gripper can pinch it.

    Side plates are 150 to 180 mm in diameter and 20 to 30 mm high. A melamine plate (1.5 g/cm^3, 2.5 to 3 mm thick)
    weighs 0.10 to 0.15 kg, and so does a plate of 0.6 mm enameled steel sheet. A plate tilts when it is held at its
    rim, and a stoneware plate of 0.25 kg would tilt by more than 20 degrees. Therefore no plate is heavier than 0.13
    kg.
    """
    return _plate(rng, color, radii=(0.0760, 0.0820), density=1500.0, solid=0.70, name="dinner plate")


@generator("serving_plate", colors=_COLORS, family="plates")
def serving_plate(rng: np.random.Generator, color: str) -> Draft:
    """Make a plate like a dinner plate, but 190 to 202 mm in diameter.

    If a dinner plate stands on it, its rim extends 13 to 25 mm beyond that plate. Service plates are 25 to 35 % wider
    than the plates that stand on them. Foot, floor and rim are the same as for a dinner plate, so that stacks have
    equal heights. A polypropylene plate (0.9 g/cm^3, 2.5 to 3 mm thick) weighs 0.09 to 0.12 kg. When it is held at its
    rim, it tilts no more than a dinner plate of melamine.
    """
    return _plate(rng, color, radii=(0.0950, 0.1010), density=905.0, solid=0.95, name="serving plate")


def _plate(
    rng: np.random.Generator, color: str, *, radii: tuple[float, float], density: float, solid: float, name: str
) -> Draft:
    """Make a flat plate with an upright rim.

    Args:
        rng: Random generator for the variant.
        color: Color word.
        radii: Smallest and largest radius [m].
        density: Density of the material [kg/m^3].
        solid: Fraction of the radius up to which the floor has a collision shape. The ring between this radius and the
            rim has none, so that there is room for a finger that pinches the rim. The ring must be too narrow for the
            edge of an upside-down object.
        name: Name of the plate, for its description.
    """
    radius, foot_share, well = uniforms(rng, radii, (0.46, 0.56), (0.60, 0.76))
    raised, flare = float(rng.choice([0.0, 0.0010, 0.0016])), rng.uniform(0.0006, 0.0020)
    scallops, depth = int(rng.choice([0, 0, 0, 10, 14])), rng.uniform(0.008, 0.014)
    enameled, thickness = bool(rng.random() < 0.35), rng.uniform(0.0025, 0.0030)
    glaze, r, foot = _Glaze(rng, color, edge=enameled), radius, foot_share * radius
    # The profile runs from the foot over the sloped underside and the upright edge to the well.
    outer = (0.0, foot, foot + 0.0010, r - 0.0060, r - flare, r, r - 0.5 * _LIP)
    rising = (0.0, 0.0, 0.0030, FLOOR_M - 0.0020, FLOOR_M + 0.0020, RIM_M - 0.0010, RIM_M)
    inner = (r - _LIP, r - _LIP - flare - 0.0010, well * r + 0.004, well * r, 0.0)
    falling = (RIM_M - 0.0010, FLOOR_M + 0.0010, FLOOR_M + 0.0004, FLOOR_M - raised, FLOOR_M - raised)
    plate = Turned((*outer, *inner), (*rising, *falling), sides=28, crease_degrees=46.0, wrap=False)
    mesh = _scalloped(plate.mesh(), r, scallops, depth).seen_from_above(1.02 * r)
    mass = 0.105 + 0.012 * enameled if enameled else round(density * thickness * math.pi * r * r * 1.35, 4)
    return Draft(
        shape="round",
        description=f"A round {color} {name} with {glaze.design} decoration.",
        tags=("plate", name, "dish", "tableware", "crockery"),
        mass_kg=min(mass, 0.13),
        material="steel" if enameled else "plastic",
        # The foot is a ring and the floor is thin, so the foot weighs a third of its solid collision shape.
        densities=(0.33, *(1.0,) * 9),
        parts=(
            part("plate", mesh, glaze.from_above(1.02 * r, well * r, r - _LIP), specular=0.5, shininess=0.6),
            upright_cylinder(foot, 0.0, 0.006),
            upright_cylinder(solid * r, 0.006, FLOOR_M),
            *_lip(r, FLOOR_M - 0.0001, RIM_M),
        ),
        grasps=_rim_grasps(r, RIM_M),
        regions=(disc("base", foot), disc("floor", r - _LIP, FLOOR_M), disc("rim", r, RIM_M)),
        parameters={"radius_m": r, "foot_radius_m": foot, "design": glaze.design, "scallops": float(scallops)},
    )


def _scalloped(mesh: Mesh, radius: float, count: int, depth: float) -> Mesh:
    """Indent the edge of a mesh between ``count`` scallops.

    ``depth`` is the depth of the indentation, as a fraction of the edge's distance from the center.
    """
    if not count:
        return mesh
    angle = np.arctan2(mesh.vertices[:, 1], mesh.vertices[:, 0])
    out = np.clip(np.hypot(mesh.vertices[:, 0], mesh.vertices[:, 1]) / radius * 4.0 - 3.0, 0.0, 1.0)
    return mesh.scaled_across(1.0 - depth * out * (1.0 - np.abs(np.cos(0.5 * count * angle))))


@generator("shallow_bowl", colors=("red", "white", "blue"), keeps_upright=True)
def shallow_bowl(rng: np.random.Generator, color: str) -> Draft:
    """Make a round soup bowl on a narrow foot. It is about as wide as a dinner plate and more than twice as high.

    A melamine bowl of 140 to 150 mm is 55 to 65 mm high and weighs 0.12 to 0.2 kg. The collision shape consists of the
    upright upper part of the wall, two discs under the hollow, and the foot. A plate that is wrongly put into the bowl
    therefore comes to rest in it.
    """
    radius, rim, foot = uniforms(rng, (0.0702, 0.0745), (0.0560, 0.0640), (0.0260, 0.0310))
    belly, floor, banded = rng.uniform(0.90, 1.0), 0.010, bool(rng.random() < 0.5)
    r, glaze, wall = radius, _Glaze(rng, color, edge=banded), RIM_M - FLOOR_M + 0.0045
    outside = (0.0, foot, foot - 0.0010, 0.66 * r * belly, 0.86 * r * belly, r - 0.0016, r, r - 0.5 * _LIP)
    rising = (0.0, 0.0, 0.0060, 0.0110, 0.38 * rim, rim - wall, rim - 0.0012, rim)
    inside = (r - _LIP, r - 0.0056, 0.80 * r * belly, 0.58 * r * belly, 0.30 * r, 0.0)
    falling = (rim - 0.0012, rim - wall, 0.38 * rim, 0.0160, floor + 0.0010, floor)
    bowl = Turned((*outside, *inside), (*rising, *falling), sides=22, crease_degrees=50.0, wrap=False)
    return Draft(
        shape="round",
        description=f"A {color} soup bowl with a high curved wall.",
        tags=("bowl", "soup bowl", "shallow bowl", "tableware", "crockery"),
        mass_kg=round(2.45 * r, 4),
        material="plastic",
        densities=(0.33, *(1.0,) * 9),
        parts=(
            part("bowl", bowl.mesh(), glaze.inside_out(bowl, rim=7, floor=12), specular=0.5, shininess=0.6),
            upright_cylinder(foot, 0.0, 0.0060),
            upright_cylinder(0.46 * r, 0.0060, floor),
            *_lip(r, rim - wall, rim),
        ),
        grasps=_rim_grasps(r, rim),
        regions=(disc("base", foot), disc("floor", 0.46 * r, floor), disc("rim", r, rim)),
        parameters={"radius_m": r, "foot_radius_m": foot, "height_m": rim, "design": glaze.design},
    )


def _lip(radius: float, low: float, high: float) -> list[CollisionPart]:
    """Return the rim as eight upright boxes, one for each grasp. They stick out of the round rim by at most 1.5 mm."""
    return round_wall(radius, _LIP, low, high, half_length=math.sqrt((radius + 0.0015) ** 2 - radius**2))


def _rim_grasps(radius: float, rim: float) -> tuple[Grasp, ...]:
    """Return eight grasps that pinch the rim from above, one every 45 degrees. The fingers open along the radius.

    All eight grasps have the name "rim". A search by this name finds the grasp at +x, but a planner can use any of
    them.
    """
    away, height = radius - 0.5 * _LIP, rim + _GRIP_ABOVE_RIM
    angles = [k * math.pi / 4.0 for k in range(8)]
    places = [(away * math.cos(a), away * math.sin(a), height) for a in angles]
    turns = [multiply(from_yaw(a), JAW_OPENS_ALONG_X) for a in angles]
    return tuple(Grasp("rim", Pose(place, turn), _LIP) for place, turn in zip(places, turns, strict=True))


class _Glaze:
    """Color and decoration of a piece of tableware."""

    def __init__(self, rng: np.random.Generator, color: str, *, edge: bool) -> None:
        """Draw a random design.

        If ``edge`` is True, the rim has a dark or a pale line around it, like enameled tableware.
        """
        self.color: Rgb = jittered(PALETTE[color], rng, amount=0.10)
        self.design = str(rng.choice(_DESIGNS))
        self._edge, self._rng = edge, rng
        # The decoration of white tableware is gray, sand or brown, which are not colors of plates in the suite. The
        # decoration of other tableware is a pale tint.
        inks = ((0.42, 0.43, 0.45), (0.66, 0.55, 0.36), (0.40, 0.27, 0.17))
        chosen = inks[int(rng.integers(3))]
        self._ink = chosen if color == "white" else mixed(self.color, (0.97, 0.96, 0.93), 0.80)

    def from_above(self, reach: float, well: float, lip: float) -> Canvas:
        """Draw the plate from above. The edge of the texture is at radius ``reach`` [m]."""
        canvas = Canvas(2.0, 2.0, (160, 160), self.color)
        r = canvas.radius
        inner, edge, ink = well / reach, lip / reach, self._ink
        middle = 0.5 * (inner + edge)
        if self.design == "wide band":
            canvas.paint(np.abs(r - middle) < 0.30 * (edge - inner), ink)
        elif self.design == "thin lines":
            canvas.paint((np.abs(r - edge + 0.07) < 0.016) | (np.abs(r - inner) < 0.016), ink)
        elif self.design == "pale middle":
            canvas.paint(r < inner, mixed(self.color, (0.97, 0.96, 0.93), 0.40))
        elif self.design == "dots":
            around = (canvas.angle / (2.0 * math.pi) * 12.0) % 1.0 - 0.5
            canvas.paint(np.hypot(around * 2.0 * math.pi / 12.0 * r, r - middle) < 0.34 * (edge - inner) + 0.02, ink)
        elif self.design == "rays":
            canvas.paint((np.cos(16.0 * canvas.angle) > 0.35) & (r > inner + 0.03) & (r < edge - 0.02), ink)
        elif self.design == "broad rings":
            canvas.paint((np.abs(r - 0.30) < 0.055) | (np.abs(r - middle) < 0.055), ink)
        elif self.design == "speckled":
            for u, v, size in self._rng.uniform(0.0, 1.0, (70, 3)).tolist():
                dot = 0.012 + 0.022 * size
                canvas.ellipse((2.0 * u, 2.0 * v), (dot, dot), ink)
        # A shadow marks where the well begins and where the edge rises. The edge itself is bright.
        canvas.shade(1.0 - 0.20 * np.exp(-(((r - inner) / 0.022) ** 2)))
        canvas.paint(np.clip(1.0 - r / inner, 0.0, 1.0) * (r < inner), shaded(self.color, 1.15), strength=0.5)
        canvas.shade(np.where(r > edge - 0.02, 0.88, 1.0))
        crest = (r > edge + 0.006) & (r < 0.978)
        canvas.paint(crest, ink if self._edge else shaded(self.color, 1.22))
        return canvas

    def inside_out(self, piece: Turned, *, rim: int, floor: int) -> Canvas:
        """Draw the texture of a bowl, from the foot over the rim to the floor inside.

        The inside becomes darker toward the floor.

        ``rim`` and ``floor`` are the indices of the profile points at which the rim and the floor begin.
        """
        crest, well = piece.rows[rim], piece.rows[floor]
        canvas = piece.canvas(self.color, (8, 256), width=1.0)
        y = canvas.y
        wall, down = piece.rows[4], np.clip((y - crest) / (well - crest), 0.0, 1.0)
        if self.design in ("wide band", "broad rings", "rays"):
            canvas.band(wall + 0.45 * (crest - wall), wall + 0.78 * (crest - wall), self._ink)
        elif self.design in ("thin lines", "dots"):
            for share in (0.45, 0.65):
                canvas.band(wall + share * (crest - wall), wall + (share + 0.09) * (crest - wall), self._ink)
        elif self.design == "pale middle":
            canvas.paint(y > crest + 0.004, mixed(self.color, (0.97, 0.96, 0.93), 0.35))
        canvas.shade(np.where(y > crest + 0.002, 0.92 - 0.42 * down, 0.82 + 0.18 * np.clip(y / crest, 0.0, 1.0)))
        lit = self._ink if self._edge else shaded(self.color, 1.25)
        canvas.paint(canvas.between(crest - 0.0022, crest + 0.0032), lit)
        return canvas
