"""Limits of the asset certificate, each with its unit and its reason.

"Measured" refers to the good and bad meshes of ``tools/planted_assets.py --seed 0`` and the procedural library. After
changing a limit, measure the error rates again (docs/asset-certificate.md).
"""

from betterbench.sim.assets.importing.kinds import kinds

# ---------------------------------------------------------------------------------------------------------------- size
SIZE_FACTOR = 1.05
"""Allowed excess over the usual sizes of a kind: the table of kinds is rounded to whole centimeters."""
LEAST_M, MOST_M = 0.01, 0.6
"""Longest side of an object of unknown kind [m], as in the importer: fits on a table and is visible to a camera."""
MASS_FACTOR = 8.0
"""Allowed ratio to the usual mass of a kind at this size, in either direction. The masses of an empty and a full can
differ by a factor of 20, those of other kinds by 4."""
LEAST_DENSITY, MOST_DENSITY = 15.0, 9000.0
"""Mass per volume of the visible solid [kg/m^3]: polystyrene foam has 15 to 30, brass 8,500."""

# ------------------------------------------------------------------------------------------------------------- upright
OPEN_DEPTH_SHARE = 0.12
"""Minimum depth of the hollow of an open object as a share of its height, as in the importer."""
OPEN_AREA_SHARE = 0.25
"""Minimum area of the hollow of an open object as a share of its footprint."""
NECK_AREA_SHARE, NECK_DEPTH_SHARE = 0.1, 0.5
"""The same for a tall kind with a neck, such as a vase: least area, and least depth as a share of its height."""
ROUND_RATIO, LYING_RATIO = 1.06, 1.12
"""Largest ratio of the widths across an axis for an object that is round about this axis, and by how much the ratio
about the vertical is larger if the object lies on its side. A square has 1.41."""
FOOTING_RATIO = 1.6
"""Ratio of top to foot width above which an object of a standing kind is upside down."""
END_SHARE, END_AREA_RATIO = 0.15, 1.3
"""Height of each end as a share of the height of the object, and the largest ratio of the cross-sections of the upper
and the lower end for kinds with a narrow top. A jam jar with a wide lid and a beveled base has 1.14; a jar on its lid,
which is a fifth narrower than its body, has 1.54 (measured)."""

# ------------------------------------------------------------------------------------------------------------- at rest
SETTLE_S, WATCH_S = 4.0, 1.5
"""Time to settle after a release 1 mm above the table, and time during which the object must then lie still [s]."""
DROP_M = 0.001
DRIFT_MM = 1.0
"""Largest displacement of the center of mass while it must lie still; a stack of good assets moves 0.03 mm in 5 s
(measured)."""
TILT_DEGREES = 20.0
"""Largest turn of the vertical axis from the described pose to rest, the same as in the importer: fruit rolls by 5 to
13 degrees (measured), a toppling object turns by 60 or more."""
STANDING_TILT_DEGREES = 10.0
"""The same for kinds that stand: open at the top, or tall. On a spike of 15 mm, a mug leans by 14 degrees."""
ROUND_SHARE, ROUND_TILT_DEGREES = 0.75, 60.0
"""Ratio of shortest to longest side above which an object is a ball, and the largest turn of a ball, which rolls before
it rests."""
JITTER_MM_S = 5.0
"""Largest root mean square speed of the surface while the object must lie still: success checks accept 20 mm/s as at
rest, and a good rod on a faceted side rocks at 2.2 (measured)."""
SINK_MM = 3.0
"""Largest distance of the lowest visible point above or below the table surface."""

# ----------------------------------------------------------------------------------------------------- holds, supports
BALL_SHARE, BALL_MOST_M = 0.55, 0.015
"""Radius of the ball that is dropped into a container: a share of the smaller half of the opening, and an upper limit
[m]."""
BALL_DENSITY = 1000.0
"""Density of the ball [kg/m^3]: water."""
BALL_FREE_M = 0.005
"""Height of the ball above the rim at its release [m]."""
BALL_DEPTH_SHARE = 0.45
"""Largest height of the ball above the floor at rest as a share of the depth; on a closed opening it is 1."""
BALL_BELOW_M = 0.004
"""Largest depth of the ball below the visible floor [m]; beyond it, the ball has fallen through."""
BLOCK_M, BLOCK_KG = 0.015, 0.05
"""Half side [m] and mass [kg] of the block that a support must carry."""
CARRY_DRIFT_MM, CARRY_TILT_DEGREES = 6.0, 10.0
"""Largest displacement and turn of the block on the support in two seconds."""

# ---------------------------------------------------------------------------------------------------------------- lift
PAYLOAD_KG = 2.27
"""Franka's payload of 3 kg (data sheet of the Emika Panda) minus the 0.73 kg of the gripper."""
GRASP_TOLERANCE_MM = 6.0
"""Allowed excess of the measured over the stated opening: two cells of a 20 cm solid."""
LEAST_THICK_M = 0.008
"""Flatter objects cannot be grasped from a table, because the pads touch the table first: 6 mm always failed, 10 mm
always succeeded."""
LIFT_M, HOLD_S, CARRY_M = 0.15, 1.0, 0.20
"""Lift height, hold time and carry distance of the trial."""
LIFT_SPEED, CARRY_SPEED = 0.15, 0.20
"""Speed of the gripper [m/s]; the experts carry at 0.15."""
SLIP_MM = 15.0
"""Largest displacement of the object relative to the closed gripper until the end of the trial."""
SWING_DEGREES = 45.0
"""Largest turn of the object relative to the gripper: plates and bowls held at the rim tilt by 22 to 39 degrees and can
be carried; heavier objects turn by 75 (measured)."""
GRASPS_TRIED = 4
"""Number of grasps tried, by preference; one success is enough, since experts try the next grasp after a failure."""

# ------------------------------------------------------------------------------------------------------ mass and shape
INERTIA_FACTOR = 3.0
"""Allowed ratio of each principal moment to that of a uniform body of the visible shape; a hollow and a solid body
differ by 1.7."""
LEAST_FRICTION, MOST_FRICTION = 0.05, 2.0
"""Sliding friction of a collision part: oiled steel has 0.1, rubber on a dry rough surface up to 1.5."""
CENTER_DEPTH_MM = 0.0
"""Minimum depth of the center of mass inside the convex hull of the visual shape."""
OUTSIDE_MM, OUTSIDE_SHARE = 6.0, 0.12
"""Largest distance of the collision shape from the visual shape, for 95 of 100 points: a length or a share of the
middle side, whichever is larger. A share of the longest side would allow a 28 cm bottle to be 25 mm too thick. V-HACD
of a scan has 3 to 5 mm (measured)."""
INSIDE_MM, INSIDE_SHARE = 4.0, 0.08
"""Largest distance of the visual shape from the collision shape, defined in the same way."""
OPENING_SHARE = 0.60
"""Minimum share of the visible hollow's volume that the collision parts leave free."""
GAP_MM, GAP_SHARE = 4.0, 0.04
"""Largest gap between parts: a length and a share of the longest side; Kenney's models leave up to 3 % (measured)."""

# ---------------------------------------------------------------------------------------------------------------- look
BEHIND_SHARE = 0.06
"""Largest share of an image whose nearest surface faces away, which renderers do not draw."""
DEGENERATE_SHARE = 0.02
"""Largest share of triangles without an area; decimation leaves a few slivers."""
DARK, DARK_SHARE = 8, 0.6
"""Brightness (of 255) below which a point of a texture is black, and the largest share of such points."""
PLACEHOLDER_SHARE = 0.5
"""Largest share of magenta (255, 0, 255) in a texture; programs use it to mark missing textures."""
LEAST_ALPHA = 0.05
"""Minimum opacity of a visible part."""

# --------------------------------------------------------------------------------------------------- uses of the kinds
ROUND_KINDS = frozenset(kind.name for kind in kinds() if kind.is_tall) | {
    "mug",
    "cup",
    "bowl",
    "pot",
    "can",
    "jar",
    "shaker",
    "egg cup",
    "plate",
    "steamer",
    "mortar",
}
"""Kinds that are often round about the vertical, never about a horizontal axis."""
FOOTED_KINDS = frozenset({"bottle", "jar", "vase", "pepper mill", "shaker"})
"""Kinds that stand on their broader end."""
NARROW_TOP_KINDS = frozenset({"bottle", "jar", "pepper mill", "shaker", "burger", "lid", "tajine", "pumpkin"})
"""Kinds with a neck, a cap, a knob, a stem or a domed top, which is hardly ever broader than their base."""
HOLLOW_TOP_KINDS = frozenset({"plate", "spoon", "cooking spoon"})
"""Kinds that are not open, but whose hollow, if they have one, is above; the same applies to open kinds."""
ALWAYS_LIFTED_KINDS = frozenset(
    {
        "fork", "spoon", "knife", "chopstick", "cooking fork", "cooking spoon", "cooking knife", "whisk",
        "banana", "carrot", "marker", "candy bar", "toothbrush", "toothpaste", "screwdriver", "sausage", "candle",
        "egg", "strawberry", "cherry", "mushroom", "radish", "sushi", "dice", "hot dog", "popsicle", "stapler",
        "shaker", "lemon", "cookie",
    }
)  # fmt: skip
"""Kinds that fit the jaw in every usual size."""
CLOSED_WORDS = frozenset(
    {"lid", "lidded", "cereal", "egg", "soft drink", "soup", "broth", "stew", "filled", "cocktail"}
)
"""Tags and names of objects of open kinds that are full or covered."""
