"""Generators of a desk cabinet for two drawers, and of its drawers.

Each drawer has a handle that can be grasped from above. The cabinet and the two drawers are separate assets. In a
scene, a slide joint along +x connects each drawer to the carcass of the cabinet. The frame of the joint is a region of
the cabinet. The two drawers of a variant differ only in which side the handle is on, so that a gripper at one handle
does not touch the other. The upper handle is at -y. In the task suite, the camera looks down from +y, so the upper
handle appears clearly above the lower one. If the sides were swapped, both handles would be at the same height in the
image.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from betterbench.sim.assets.asset import CollisionPart, VisualPart
from betterbench.sim.assets.authoring import Draft, generator, grip, merge, part, solid_box, solid_span, zone
from betterbench.sim.assets.authoring.mesh import ABOVE, FRONT, Mesh, box, face_normals, mapped, span
from betterbench.sim.assets.authoring.paint import Canvas, Rgb, jittered, mixed, shaded, uniforms
from betterbench.sim.assets.authoring.turned import Turned

_COLORS = ("white", "brown", "gray")
_PAINT: dict[str, Rgb] = {"white": (0.98, 0.975, 0.96), "brown": (0.50, 0.31, 0.16), "gray": (0.45, 0.47, 0.50)}
_OAK: Rgb = (0.72, 0.53, 0.33)
_SLATE: Rgb = (0.25, 0.29, 0.34)

_BOARD = 0.009  # top, bottom, shelf and back [m]
_SIDE = 0.012  # thickness of the sides, which support the slides [m]

# Sizes of the drawer [m]. The drawer is lower than its opening: there is play below it, and a gap of about 16 mm above
# its rim.
_PLAY = 0.0015
_FRONT_GAP = 0.002  # gap between the closed front panel and the carcass
_PANEL = 0.012
_WALL, _REAR, _FLOOR, _RIM = 0.008, 0.006, 0.006, 0.054

# Distance of the handle from the panel. A gripper that is 65 mm thick and centered on the handle clears the panel by
# 20 mm, and the wrist above the gripper clears it by 8 mm.
_HANDLE_AWAY = 0.053
_HANDLE_SIDE, _HANDLE_HEIGHT = 0.066, 0.030
_STEM = (0.010, 0.010)  # thickness along y and z
_HANDLES = ("bar", "knob", "cube", "grip")

_SLIDE: dict[str, float | str] = {"travel_m": 0.15, "friction_n": 1.5, "damping_n_s_m": 4.0}


@dataclass(frozen=True, slots=True)
class _Style:
    """Style of one variant, which the carcass and both drawers share.

    Attributes:
        half_x, half_y, height: Half the depth, half the width, and the height of the carcass [m].
        front: Pattern of the front: "plain", "frame", "groove" or "band".
        handle: Kind of handle, one of :data:`_HANDLES`.
        handle_size: Extents of the handle along x, y and z [m].
        boards, fronts, top: Colors of the sides, the front panels and the top board.
        card: Whether each front has a card holder with a card.
    """

    half_x: float
    half_y: float
    height: float
    grain_seed: int
    front: str
    handle: str
    handle_size: tuple[float, float, float]
    boards: Rgb
    fronts: Rgb
    top: Rgb
    metal: Rgb
    card: bool
    corner: float

    @staticmethod
    def draw(rng: np.random.Generator, color: str) -> _Style:
        """Draw a random style. The same random numbers are drawn for every color."""
        half_x, half_y, height = uniforms(rng, (0.1085, 0.1140), (0.1150, 0.1225), (0.1685, 0.1710))
        handle, front = str(rng.choice(_HANDLES)), str(rng.choice(["plain", "frame", "groove", "band"]))
        width, tall, thick = uniforms(rng, (0.044, 0.056), (0.034, 0.042), (0.013, 0.016))
        sizes = {
            "bar": (thick, width, 0.014),
            "knob": (thick + 0.003, 0.027, 0.027),
            "cube": (0.018, 0.022, 0.030),
            "grip": (thick, 0.018, tall),
        }
        tone, roof, dark = int(rng.integers(3)), int(rng.integers(3)), rng.random() < 0.5
        shade = jittered(_PAINT[color], rng, amount=0.12 if color == "brown" else 0.06)
        # A white front is already gray in the shade, so its tones differ little.
        pale, deep = mixed(shade, (1.0, 1.0, 1.0), 0.35), shaded(shade, 0.80 if color != "white" else 0.95)
        fronts = (shade, pale, deep)[tone]
        top = (shade, _OAK if color != "brown" else deep, _SLATE)[roof]
        # Light fronts get dark handles, and dark fronts get bright ones.
        light = sum(fronts) > 1.35
        metals = ((0.08, 0.08, 0.09), (0.36, 0.20, 0.09)) if light else ((0.93, 0.78, 0.40), (0.92, 0.93, 0.94))
        seed, card = int(rng.integers(2**31)), rng.random() < 0.4
        corner = float(rng.choice([0.0, 0.006, 0.018]))
        return _Style(
            *(half_x, half_y, height, seed, front, handle, sizes[handle]),
            *(shade, fronts, top, metals[int(dark)], card, corner),
        )

    @property
    def opening(self) -> float:
        """Height of the opening for each drawer [m]."""
        return 0.5 * (self.height - 3.0 * _BOARD)

    @property
    def shelf(self) -> float:
        """Height of the underside of the shelf [m]."""
        return _BOARD + self.opening

    @property
    def inside_x(self) -> float:
        """Inside depth of a drawer [m]."""
        return 2.0 * self.half_x - 0.055

    @property
    def inside_half_y(self) -> float:
        """Half the inside width of a drawer [m]."""
        return self.half_y - _SIDE - 0.004 - _WALL

    @property
    def half_drawer(self) -> float:
        """Half the depth of a drawer with its front panel but without its handle [m]."""
        return 0.5 * (_REAR + self.inside_x + _PANEL)

    def surface(self, width: float, height: float, pixels: tuple[int, int], shade: Rgb) -> Canvas:
        """Return the texture of a board in this style, with the grain along the width of the board."""
        rng, wood = np.random.default_rng(self.grain_seed), shade[0] > 1.25 * shade[2]
        canvas = Canvas(width, height, pixels, shade)
        canvas.grain(rng, cells=(4, 26), amount=0.075 if wood else 0.008)
        canvas.grain(rng, cells=(30, 30), amount=0.020 if wood else 0.006)
        return canvas


def _carcass(s: _Style) -> tuple[CollisionPart, ...]:
    """Return the collision boxes of the cabinet's boards: bottom, shelf, top, back and both sides."""
    x, rear, inside = (-s.half_x, s.half_x), (-s.half_x, -s.half_x + _BOARD), (_BOARD, s.height - _BOARD)
    open_half = s.half_y - _SIDE
    return (
        solid_span(x, s.half_y, (0.0, _BOARD)),
        solid_span(x, open_half, (s.shelf, s.shelf + _BOARD)),
        solid_span(x, s.half_y, (s.height - _BOARD, s.height)),
        solid_span(rear, open_half, inside),
        solid_box((-s.half_x, -s.half_y, _BOARD), (s.half_x, -open_half, s.height - _BOARD)),
        solid_box((-s.half_x, open_half, _BOARD), (s.half_x, s.half_y, s.height - _BOARD)),
    )


def _linings(s: _Style) -> Mesh:
    """Return the dark inside of the openings, as thin boards that do not cover the front edges."""
    back, deep, thin, sheets = -s.half_x + _BOARD, 2.0 * s.half_x - _BOARD - 0.004, 0.0004, []
    x, half_y = (back, back + deep), s.half_y - _SIDE
    for low in (_BOARD, s.shelf + _BOARD):
        high, middle = low + s.opening, low + 0.5 * s.opening
        sheets += [span(x, half_y, z) for z in ((low, low + thin), (high - thin, high))]
        size, away = (deep, thin, s.opening), half_y - 0.5 * thin
        sheets += [box(size, (back + 0.5 * deep, y * away, middle)) for y in (-1, 1)]
        sheets.append(span((back, back + thin), half_y, (low, high)))
    return merge(sheets)


@generator("drawer_cabinet", colors=_COLORS, family="drawers")
def drawer_cabinet(rng: np.random.Generator, color: str) -> Draft:
    """Make the carcass of a two-drawer desk cabinet, which is open at its front (+x).

    Desk organizers with two drawers are 22 to 25 cm wide and deep and 16 to 20 cm high. The carcass has 1.9 l of
    particle board (650 kg/m^3), which weigh 1.2 kg. It is meant to be fixed in place. Its regions "upper" and "lower"
    are the frames of the two drawers when they are closed.
    """
    s = _Style.draw(rng, color)
    inner, x, open_half = s.height - 2.0 * _BOARD, (-s.half_x, s.half_x), s.half_y - _SIDE
    # In the visual shape, the bevels of top and bottom extend beyond the sides. All other boards are in between.
    top = span(x, s.half_y, (s.height - _BOARD, s.height), bevel=0.0016, corner=s.corner, steps=3)
    size, away = (2 * s.half_x - 0.002, _SIDE - 0.001, inner), s.half_y - 0.5 * _SIDE - 0.0005
    sides = merge([box(size, (-0.001, y * away, 0.5 * s.height)) for y in (-1, 1)])
    shelf = span((-s.half_x, s.half_x - 0.002), open_half, (s.shelf, s.shelf + _BOARD))
    rear = span((-s.half_x, -s.half_x + _BOARD), open_half, (_BOARD, s.height - _BOARD))
    boards = merge([span(x, s.half_y, (0.0, _BOARD), bevel=0.0012), shelf, rear])
    half, half_z = (s.half_x - 0.5 * _BOARD, open_half), 0.5 * s.opening
    origin_x = s.half_x + _FRONT_GAP + _PANEL - s.half_drawer
    side_view = ((-1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    return Draft(
        shape="box",
        description=f"A small {color} desk cabinet with two openings for drawers.",
        tags=("drawer cabinet", "cabinet", "desk organizer", "furniture"),
        traits=("furniture",),
        mass_kg=1.2,
        material="wood",
        parts=(
            part("top", top, s.surface(0.24, 0.22, (160, 144), s.top), view=ABOVE, specular=0.15),
            part("sides", sides, s.surface(0.22, 0.15, (128, 96), s.boards), view=side_view, specular=0.15),
            part("boards", boards, shaded(s.boards, 0.94), specular=0.1),
            part("lining", _linings(s), shaded(s.boards, 0.22), specular=0.0),
            *_carcass(s),
        ),
        regions=(
            zone("upper", *half, s.shelf + _BOARD + _PLAY, x=origin_x, half_z=half_z),
            zone("lower", *half, _BOARD + _PLAY, x=origin_x, half_z=half_z),
        ),
        parameters={"depth_m": 2.0 * s.half_x, "width_m": 2.0 * s.half_y, "height_m": s.height, "handle": s.handle},
    )


@generator("upper_drawer", colors=_COLORS, family="drawers")
def upper_drawer(rng: np.random.Generator, color: str) -> Draft:
    """Make the upper drawer of the cabinet, with its handle at -y (see :func:`_drawer`)."""
    return _drawer(rng, color, side=-1.0, place="upper")


@generator("lower_drawer", colors=_COLORS, family="drawers")
def lower_drawer(rng: np.random.Generator, color: str) -> Draft:
    """Make the lower drawer of the cabinet, with its handle at +y (see :func:`_drawer`)."""
    return _drawer(rng, color, side=1.0, place="lower")


def _drawer(rng: np.random.Generator, color: str, *, side: float, place: str) -> Draft:
    """Make a drawer with a front panel and a handle on stems.

    The handle is at +y if ``side`` is 1, and at -y if it is -1. The origin is the center of the bottom face of the
    drawer's bounding box, without the handle. The front faces +x, the direction in which the drawer opens. The boards
    are 6 to 12 mm thick and have a volume of 0.9 l. If they are made of poplar plywood (450 kg/m^3), they weigh 0.5 kg
    with the handle, or 13 kg per m^2 of floor.

    The parameters describe the joint that a scene adds. The travel of 0.15 m fits a three-quarter extension slide for a
    drawer 0.18 m long: 35 mm of the drawer stay in the carcass. The friction of 1.5 N is 0.5 kg x 9.81 m/s^2 x 0.3, as
    for waxed wood on wood or a light roller slide. Therefore a light touch does not move the drawer, but a pinch with
    35 N per finger can pull it. With a damping of 4 N s/m, a push decays in 0.5 kg / 4 N s/m = 0.13 s, so that a drawer
    stays where it is released.
    """
    s = _Style.draw(rng, color)
    front, back, half_y = s.half_drawer, -s.half_drawer, s.inside_half_y + _WALL
    panel = front - _PANEL  # position of the panel's inner face
    panel_half_y, panel_height = s.half_y - 0.002, s.opening + 0.0045
    size, middle = (s.inside_x, _WALL, _RIM), back + _REAR + 0.5 * s.inside_x
    flanks = [box(size, (middle, y * (half_y - 0.5 * _WALL), 0.5 * _RIM)) for y in (-1, 1)]
    walls = merge([span((back, back + _REAR), half_y, (0.0, _RIM)), *flanks])
    board = span((panel, front), panel_half_y, (0.0, panel_height))
    pale = mixed(s.boards, (0.90, 0.78, 0.56), 0.75)
    inside = 0.5 * (_RIM - _FLOOR)
    seen, touched = _handle(s, front, side * _HANDLE_SIDE)
    kx, ky, kz = (0.5 * e for e in s.handle_size)
    x, y = front + _HANDLE_AWAY, side * _HANDLE_SIDE
    return Draft(
        shape="box",
        description=f"The {place} drawer of a {color} desk cabinet, open at the top, with a handle on its front.",
        tags=("drawer", f"{place} drawer", "desk drawer", "container"),
        mass_kg=round(12.8 * s.inside_x * 2.0 * panel_half_y, 3),
        material="wood",
        parts=(
            part("front", _panel_mapped(board), _front(s, 2.0 * panel_half_y, panel_height)),
            part("walls", walls, pale, specular=0.1),
            part("floor", span((back, panel), half_y - 0.0002, (0.0, _FLOOR)), shaded(pale, 0.66), specular=0.05),
            seen,
            solid_span((back, panel), half_y, (0.0, _FLOOR)),
            solid_span((back, back + _REAR), half_y, (_FLOOR, _RIM)),
            solid_box((back + _REAR, s.inside_half_y, _FLOOR), (panel, half_y, _RIM)),
            solid_box((back + _REAR, -half_y, _FLOOR), (panel, -s.inside_half_y, _RIM)),
            solid_span((panel, front), panel_half_y, (0.0, panel_height)),
            *touched,
        ),
        grasps=(grip("knob", _HANDLE_HEIGHT, s.handle_size[1], x=x, y=y),),
        regions=(
            zone("inside", 0.5 * s.inside_x, s.inside_half_y, _FLOOR + inside, x=middle, half_z=inside),
            zone("knob", kx, ky, _HANDLE_HEIGHT, x=x, y=y, half_z=kz),
            zone("front", 0.001, panel_half_y, 0.5 * panel_height, x=front, half_z=0.5 * panel_height),
        ),
        parameters={**_SLIDE, "front": s.front, "handle": s.handle},
    )


def _handle(s: _Style, front: float, y: float) -> tuple[VisualPart, tuple[CollisionPart, ...]]:
    """Return the visual part and the collision parts of a handle.

    The handle is at ``y``, on a panel whose front is at ``front`` [m].
    """
    (kx, ky, kz), z = (0.5 * e for e in s.handle_size), _HANDLE_HEIGHT
    x, (sy, sz) = front + _HANDLE_AWAY, (0.5 * e for e in _STEM)
    length, middle = x - kx - front + 0.001, 0.5 * (front + x - kx)
    spread = (-0.62 * ky, 0.62 * ky) if s.handle == "bar" else (0.0,)
    stems = [box((length, *_STEM), (middle, y + at, z), bevel=0.0015) for at in spread]
    plates = [box((0.0024, 0.020, 0.024), (front + 0.0008, y + at, z), bevel=0.003) for at in spread]
    if s.handle == "knob":
        radii = (0.0, 0.8 * ky, ky, ky, 0.75 * ky, 0.0)
        heights = (x - kx, x - kx, x - 0.4 * kx, x + 0.3 * kx, x + 0.9 * kx, x + kx)
        head = Turned(radii, heights, 14, 50.0, wrap=False).facing_front(0.0, z).moved(y=y)
    else:
        head = box(s.handle_size, (x, y, z), bevel=0.0035, corner=0.0045, steps=2)
    # The collision shape of a round knob is the square inside its rim.
    share = 0.86 if s.handle == "knob" else 1.0
    solids = (
        solid_box((front, y + spread[0] - sy, z - sz), (x - kx, y + spread[-1] + sy, z + sz)),
        solid_box((x - kx, y - share * ky, z - share * kz), (x + kx, y + share * ky, z + share * kz)),
    )
    return part("handle", merge([head, *stems, *plates]), s.metal, specular=0.6, shininess=0.7), solids


def _panel_mapped(mesh: Mesh) -> Mesh:
    """Return the panel with the texture on its front. The back and the edges only show a plain area of the texture."""
    uv = mapped(mesh, *FRONT).uv
    # A creased box has separate vertices for each face, so the normals identify the faces.
    normals = face_normals(mesh.vertices, mesh.faces)
    seen = np.unique(mesh.faces[normals[:, 0] > 0.9 * np.linalg.norm(normals, axis=1)])
    others = np.setdiff1d(np.arange(len(uv)), seen)
    uv[others] = 0.5 + 0.02 * (uv[others] - 0.5)
    uv[others, 1] -= 0.22  # the part of the texture below the card
    return Mesh(mesh.vertices, mesh.faces, uv)


def _front(s: _Style, width: float, height: float) -> Canvas:
    """Draw the front panel with its grain and its pattern. A dark edge separates it from the other panel."""
    canvas = s.surface(width, height, (256, 88), s.fronts)
    x, y = canvas.x, canvas.y
    edge = np.minimum(np.minimum(x, width - x), np.minimum(y, height - y))
    dark, light = shaded(s.fronts, 0.50), shaded(s.fronts, 1.18)
    if s.front == "frame":
        canvas.paint(edge > 0.0135, shaded(s.fronts, 0.95 if min(s.fronts) > 0.8 else 0.88), strength=0.8)
        canvas.paint((edge > 0.0110) & (edge < 0.0138), dark, strength=0.8)
        canvas.paint((edge > 0.0138) & (edge < 0.0150), light, strength=0.6)
    elif s.front == "groove":
        for line in (0.020, 0.038, 0.056):
            canvas.paint(np.abs(y - line) < 0.0012, dark, strength=0.8)
    elif s.front == "band":
        canvas.paint(canvas.between(height - 0.0150, height - 0.0085), dark, strength=0.7)
    if s.card:
        # Draw a card holder, as on office drawers.
        away = np.maximum(np.abs(x - 0.5 * width) / 0.026, np.abs(y - 0.62 * height) / 0.011)
        canvas.paint(away < 1.0, s.metal)
        canvas.paint(away < 0.84, (0.95, 0.94, 0.90))
        canvas.paint(canvas.near(0.5 * width, 0.62 * height, 0.014, 0.0012), (0.35, 0.36, 0.40))
    canvas.paint(edge < 0.0022, shaded(s.fronts, 0.30))
    return canvas
