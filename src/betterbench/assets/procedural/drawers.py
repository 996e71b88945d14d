"""A desk cabinet for two drawers, and the drawers, each with a knob that a jaw can take from above.

The three are assets of their own: a scene joins each drawer to the carcass by a slide along +x, whose frame is a
region of the cabinet. The two drawers differ only in the side their knob is on, so that a hand at one knob clears the
other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from betterbench.assets.asset import CollisionPart
from betterbench.assets.authoring import Draft, generator, grip, merge, part, solid_box, solid_span, zone
from betterbench.assets.authoring.mesh import ABOVE, FRONT, Mesh, box, face_normals, mapped, span
from betterbench.assets.authoring.paint import Canvas, Rgb, jittered, mixed, shaded

_COLORS = ("white", "brown", "gray")
_PAINT: dict[str, Rgb] = {"white": (0.88, 0.87, 0.84), "brown": (0.56, 0.36, 0.19), "gray": (0.45, 0.47, 0.50)}

# The carcass [m].
_HALF_X, _HALF_Y, _HEIGHT = 0.110, 0.120, 0.170
_BOARD = 0.009  # top, bottom, shelf and back
_SIDE = 0.012  # the sides hold the slides, and are thicker
_OPENING = 0.5 * (_HEIGHT - 3.0 * _BOARD)  # height of each opening
_OPENING_HALF_Y = _HALF_Y - _SIDE
_SHELF = _BOARD + _OPENING  # height of the underside of the shelf

# The drawer [m]. It is lower than its opening by the play and 22 mm of free height over its rim.
_PLAY = 0.0015
_FRONT_GAP = 0.002  # between the closed front panel and the carcass
_PANEL = 0.012
_PANEL_HEIGHT, _PANEL_HALF_Y = 0.076, 0.118
_WALL, _REAR, _FLOOR, _RIM = 0.008, 0.006, 0.006, 0.054
_INSIDE_X, _INSIDE_HALF_Y = 0.165, 0.096
_FRONT = 0.5 * (_REAR + _INSIDE_X + _PANEL)

# The knob [m].
_KNOB = (0.016, 0.020, 0.030)
# From the panel: a hand 65 mm thick, centered on the knob, clears the panel by 20 mm, the wrist above it by 8 mm.
_KNOB_AWAY = 0.053
_KNOB_SIDE, _KNOB_HEIGHT = 0.070, 0.030
_STEM = (0.010, 0.010)  # thickness along y and z

_SLIDE: dict[str, float | str] = {"travel_m": 0.15, "friction_n": 1.5, "damping_n_s_m": 4.0}


@dataclass(frozen=True, slots=True)
class _Style:
    """What the carcass and the drawers of one look share; the front is "plain", "frame", "groove" or "band"."""

    shade: Rgb
    wood: bool
    grain_seed: int
    front: str
    metal: Rgb

    @staticmethod
    def draw(rng: np.random.Generator, color: str) -> _Style:
        """Draw a style; the same numbers are drawn for every color."""
        shade = jittered(_PAINT[color], rng, amount=0.12 if color == "brown" else 0.06)
        front = str(rng.choice(["plain", "frame", "groove", "band"]))
        knobs: tuple[Rgb, ...] = ((0.16, 0.16, 0.17), (0.74, 0.57, 0.24), (0.66, 0.67, 0.69), (0.36, 0.22, 0.12))
        metal = knobs[int(rng.integers(len(knobs)))]
        return _Style(shade, color == "brown", int(rng.integers(2**31)), front, metal)

    def surface(self, width: float, height: float, pixels: tuple[int, int]) -> Canvas:
        """Return a picture of a board of this style, its grain along the width."""
        rng = np.random.default_rng(self.grain_seed)
        canvas = Canvas(width, height, pixels, self.shade)
        canvas.grain(rng, cells=(4, 26), amount=0.075 if self.wood else 0.008)
        canvas.grain(rng, cells=(30, 30), amount=0.020 if self.wood else 0.006)
        return canvas


def _carcass() -> tuple[CollisionPart, ...]:
    """Return the boards of the cabinet: bottom, shelf, top, back and both sides."""
    x, rear, inside = (-_HALF_X, _HALF_X), (-_HALF_X, -_HALF_X + _BOARD), (_BOARD, _HEIGHT - _BOARD)
    return (
        solid_span(x, _HALF_Y, (0.0, _BOARD)),
        solid_span(x, _OPENING_HALF_Y, (_SHELF, _SHELF + _BOARD)),
        solid_span(x, _HALF_Y, (_HEIGHT - _BOARD, _HEIGHT)),
        solid_span(rear, _OPENING_HALF_Y, inside),
        solid_box((-_HALF_X, -_HALF_Y, _BOARD), (_HALF_X, -_OPENING_HALF_Y, _HEIGHT - _BOARD)),
        solid_box((-_HALF_X, _OPENING_HALF_Y, _BOARD), (_HALF_X, _HALF_Y, _HEIGHT - _BOARD)),
    )


def _linings() -> Mesh:
    """Return the dark inside of the openings: thin boards that leave the front edges free."""
    back, deep, thin, sheets = -_HALF_X + _BOARD, 2.0 * _HALF_X - _BOARD - 0.012, 0.0004, []
    x = (back, back + deep)
    for low in (_BOARD, _SHELF + _BOARD):
        high, middle = low + _OPENING, low + 0.5 * _OPENING
        sheets += [span(x, _OPENING_HALF_Y, z) for z in ((low, low + thin), (high - thin, high))]
        size, away = (deep, thin, _OPENING), _OPENING_HALF_Y - 0.5 * thin
        sheets += [box(size, (back + 0.5 * deep, y * away, middle)) for y in (-1, 1)]
        sheets.append(span((back, back + thin), _OPENING_HALF_Y, (low, high)))
    return merge(sheets)


@generator("drawer_cabinet", colors=_COLORS, family="drawers")
def drawer_cabinet(rng: np.random.Generator, color: str) -> Draft:
    """Make the carcass of a two-drawer desk cabinet, open at its front (+x).

    Its volume of 1.9 l of particle board (650 kg/m^3) weighs 1.2 kg; it is meant to be fixed. The regions "upper" and
    "lower" are the frames of the closed drawers.
    """
    style = _Style.draw(rng, color)
    inner, x = _HEIGHT - 2.0 * _BOARD, (-_HALF_X, _HALF_X)
    # Seen are a top and a bottom that stand over the sides by their bevel, and boards between them.
    top = span(x, _HALF_Y, (_HEIGHT - _BOARD, _HEIGHT), bevel=0.0016)
    size, away = (2 * _HALF_X - 0.002, _SIDE - 0.001, inner), _HALF_Y - 0.5 * _SIDE - 0.0005
    sides = merge([box(size, (-0.001, y * away, 0.5 * _HEIGHT)) for y in (-1, 1)])
    shelf = span((-_HALF_X, _HALF_X - 0.002), _OPENING_HALF_Y, (_SHELF, _SHELF + _BOARD))
    rear = span((-_HALF_X, -_HALF_X + _BOARD), _OPENING_HALF_Y, (_BOARD, _HEIGHT - _BOARD))
    boards = merge([span(x, _HALF_Y, (0.0, _BOARD), bevel=0.0012), shelf, rear])
    half, half_z = (_HALF_X - 0.5 * _BOARD, _OPENING_HALF_Y), 0.5 * _OPENING
    origin_x = _HALF_X + _FRONT_GAP + _PANEL - _FRONT
    side_view = ((-1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    return Draft(
        shape="box",
        description=f"A small {color} desk cabinet with two openings for drawers.",
        tags=("drawer cabinet", "cabinet", "desk organizer", "furniture"),
        mass_kg=1.2,
        parts=(
            part("top", top, style.surface(0.24, 0.22, (160, 144)), view=ABOVE, specular=0.15),
            part("sides", sides, style.surface(0.22, 0.15, (128, 96)), view=side_view, specular=0.15),
            part("boards", boards, shaded(style.shade, 0.94), specular=0.1),
            part("lining", _linings(), shaded(style.shade, 0.42), specular=0.0),
            *_carcass(),
        ),
        regions=(
            zone("upper", *half, _SHELF + _BOARD + _PLAY, x=origin_x, half_z=half_z),
            zone("lower", *half, _BOARD + _PLAY, x=origin_x, half_z=half_z),
        ),
        parameters={"opening_height_m": _OPENING, "opening_width_m": 2.0 * _OPENING_HALF_Y},
    )


@generator("upper_drawer", colors=_COLORS, family="drawers")
def upper_drawer(rng: np.random.Generator, color: str) -> Draft:
    """Make the upper drawer of the cabinet, see :func:`_drawer`; its knob is at +y."""
    return _drawer(rng, color, side=1.0, place="upper")


@generator("lower_drawer", colors=_COLORS, family="drawers")
def lower_drawer(rng: np.random.Generator, color: str) -> Draft:
    """Make the lower drawer of the cabinet, see :func:`_drawer`; its knob is at -y."""
    return _drawer(rng, color, side=-1.0, place="lower")


def _drawer(rng: np.random.Generator, color: str, *, side: float, place: str) -> Draft:
    """Make a drawer: a box with a front panel and a knob on a stem, at +y for a ``side`` of +1 and at -y for -1.

    Its origin is the center of the bottom face of the bounding box without the knob, its front looks along +x, along
    which it opens. Boards of 6 to 12 mm have a volume of 0.9 l; poplar plywood (450 kg/m^3) and the knob make 0.5 kg.

    The joint that a scene adds is given in the parameters. Travel 0.15 m: a slide of three quarters' extension for a
    drawer 0.183 m long, 35 mm of which stay in the carcass. Friction loss 1.5 N: 0.5 kg x 9.81 m/s^2 x 0.3, waxed wood
    on wood or a light roller slide; a brush of the hand leaves it where it is, and a pinch of 35 N a finger pulls it.
    Damping 4 N s/m: a push dies away in 0.5 kg / 4 N s/m = 0.13 s, so that a drawer let go stops where it was left.
    """
    style = _Style.draw(rng, color)
    back, half_y, panel = -_FRONT, _INSIDE_HALF_Y + _WALL, _FRONT - _PANEL  # panel: its inner face
    knob_x, knob_y = _FRONT + _KNOB_AWAY, side * _KNOB_SIDE
    kx, ky, kz = (0.5 * s for s in _KNOB)
    sy, sz = (0.5 * s for s in _STEM)
    size, middle = (_INSIDE_X, _WALL, _RIM), back + _REAR + 0.5 * _INSIDE_X
    flanks = [box(size, (middle, y * (half_y - 0.5 * _WALL), 0.5 * _RIM)) for y in (-1, 1)]
    walls = merge([span((back, back + _REAR), half_y, (0.0, _RIM)), *flanks])
    front = span((panel, _FRONT), _PANEL_HALF_Y, (0.0, _PANEL_HEIGHT))
    knob = box(_KNOB, (knob_x, knob_y, _KNOB_HEIGHT), bevel=0.0035, corner=0.0050, steps=2)
    stem = box((_KNOB_AWAY - kx + 0.001, *_STEM), (0.5 * (_FRONT + knob_x - kx), knob_y, _KNOB_HEIGHT), bevel=0.0015)
    rosette = box((0.0024, 0.026, 0.026), (_FRONT + 0.0008, knob_y, _KNOB_HEIGHT), bevel=0.003)
    pale = mixed(style.shade, (0.86, 0.76, 0.58), 0.55)
    inside = 0.5 * (_RIM - _FLOOR)
    return Draft(
        shape="box",
        description=f"The {place} drawer of a {color} desk cabinet, open at the top, with a knob on its front.",
        tags=("drawer", f"{place} drawer", "desk drawer", "container"),
        mass_kg=0.5,
        parts=(
            part("front", _panel_mapped(front), _front(style)),
            part("walls", walls, pale, specular=0.1),
            part("floor", span((back, panel), half_y - 0.0002, (0.0, _FLOOR)), shaded(pale, 0.66), specular=0.05),
            part("knob", merge([knob, stem, rosette]), style.metal, specular=0.7, shininess=0.7),
            solid_span((back, panel), half_y, (0.0, _FLOOR)),
            solid_span((back, back + _REAR), half_y, (_FLOOR, _RIM)),
            solid_box((back + _REAR, _INSIDE_HALF_Y, _FLOOR), (panel, half_y, _RIM)),
            solid_box((back + _REAR, -half_y, _FLOOR), (panel, -_INSIDE_HALF_Y, _RIM)),
            solid_span((panel, _FRONT), _PANEL_HALF_Y, (0.0, _PANEL_HEIGHT)),
            solid_box((_FRONT, knob_y - sy, _KNOB_HEIGHT - sz), (knob_x - kx, knob_y + sy, _KNOB_HEIGHT + sz)),
            solid_box((knob_x - kx, knob_y - ky, _KNOB_HEIGHT - kz), (knob_x + kx, knob_y + ky, _KNOB_HEIGHT + kz)),
        ),
        grasps=(grip("knob", _KNOB_HEIGHT, _KNOB[1], x=knob_x, y=knob_y),),
        regions=(
            zone("inside", 0.5 * _INSIDE_X, _INSIDE_HALF_Y, _FLOOR + inside, x=middle, half_z=inside),
            zone("knob", kx, ky, _KNOB_HEIGHT, x=knob_x, y=knob_y, half_z=kz),
            zone("front", 0.001, _PANEL_HALF_Y, 0.5 * _PANEL_HEIGHT, x=_FRONT, half_z=0.5 * _PANEL_HEIGHT),
        ),
        parameters={**_SLIDE, "front": style.front},
    )


def _panel_mapped(mesh: Mesh) -> Mesh:
    """Return the panel with the picture on its front; its back and its edges show the board's plain middle."""
    uv = mapped(mesh, *FRONT).uv
    # A creased box has vertices of its own for each face, so the faces can be told apart by their normals.
    normals = face_normals(mesh.vertices, mesh.faces)
    seen = np.unique(mesh.faces[normals[:, 0] > 0.9 * np.linalg.norm(normals, axis=1)])
    others = np.setdiff1d(np.arange(len(uv)), seen)
    uv[others] = 0.5 + 0.02 * (uv[others] - 0.5)
    return Mesh(mesh.vertices, mesh.faces, uv)


def _front(style: _Style) -> Canvas:
    """Draw the front panel: its grain, how it is worked, and a fine dark edge that parts it from its neighbors."""
    width, height = 2.0 * _PANEL_HALF_Y, _PANEL_HEIGHT
    canvas = style.surface(width, height, (256, 88))
    x, y = canvas.x, canvas.y
    edge = np.minimum(np.minimum(x, width - x), np.minimum(y, height - y))
    dark, light = shaded(style.shade, 0.62), shaded(style.shade, 1.18)
    if style.front == "frame":
        canvas.paint(edge > 0.0125, shaded(style.shade, 0.93), strength=0.7)
        canvas.paint((edge > 0.0110) & (edge < 0.0128), dark, strength=0.8)
        canvas.paint((edge > 0.0128) & (edge < 0.0138), light, strength=0.6)
    elif style.front == "groove":
        for line in (0.022, 0.038, 0.054):
            canvas.paint(np.abs(y - line) < 0.0008, dark, strength=0.7)
    elif style.front == "band":
        canvas.paint(canvas.between(height - 0.0120, height - 0.0085), dark, strength=0.6)
    # A holder for a card, as on the drawers of an office.
    away = np.maximum(np.abs(x - 0.5 * width) / 0.026, np.abs(y - 0.62 * height) / 0.011)
    canvas.paint(away < 1.0, style.metal)
    canvas.paint(away < 0.84, (0.95, 0.94, 0.90))
    canvas.paint(canvas.near(0.5 * width, 0.62 * height, 0.014, 0.0012), (0.35, 0.36, 0.40))
    canvas.paint(edge < 0.0012, dark, strength=0.75)
    return canvas
