"""Limits of the asset certificate, each with its unit and its reason.

"Measured" refers to the good and bad meshes of ``tools/planted_assets.py --seed 0`` and the procedural library. After
changing a limit, measure the error rates again (docs/asset-certificate.md).
"""

from betterbench.sim.assets.importing.kinds import kinds
from betterbench.sim.assets.importing.upright import MOST_STANDING_LEAN_DEGREES

# ---------------------------------------------------------------------------------------------------------------- size
SIZE_FACTOR = 1.05
"""Allowed excess over the usual sizes of a kind: the table of kinds is rounded to whole centimeters."""
LEAST_M, MOST_M = 0.01, 0.6
"""Range for the longest side of an object of unknown kind [m], as in the importer: it fits on a table and is visible to
a camera."""
MASS_FACTOR = 8.0
"""Allowed ratio to the usual mass of a kind at this size, in either direction. The masses of an empty and a full can
differ by a factor of 20, those of other kinds by 4."""
LEAST_DENSITY, MOST_DENSITY = 15.0, 9000.0
"""Mass per volume of the visible solid [kg/m^3]: polystyrene foam has 15 to 30, brass 8,500."""

# ------------------------------------------------------------------------------------------------------------- upright
OPEN_DEPTH_SHARE = 0.12
"""Minimum depth of an open object's hollow as a share of its height, as in the importer."""
OPEN_AREA_SHARE = 0.25
"""Minimum area of an open object's hollow as a share of its footprint."""
NECK_AREA_SHARE, NECK_DEPTH_SHARE = 0.1, 0.5
"""Minimum area and depth of the hollow for a tall kind with a neck, such as a vase, as shares of footprint and
height."""
ROUND_RATIO, LYING_RATIO = 1.06, 1.12
"""Maximum ratio of the widths across an axis for an object that is round about this axis, and minimum excess of the
ratio about the vertical for an object that lies on its side. A square has a ratio of 1.41."""
FOOTING_RATIO = 1.6
"""Ratio of top to foot width above which an object of a standing kind is upside down."""
END_SHARE, END_AREA_RATIO = 0.15, 1.3
"""Height of each end as a share of the height of the object, and the largest ratio of the cross-sections of the upper
and the lower end for kinds with a narrow top. A jam jar with a wide lid and a beveled base has 1.14. A jar on its lid,
which is a fifth narrower than its body, has 1.54 (measured)."""

# ------------------------------------------------------------------------------------------------------------- at rest
SETTLE_S, WATCH_S = 4.0, 1.5
"""Settling time after a release 1 mm above the table, and subsequent time during which the object must be at rest
[s]."""
DROP_M = 0.001
DRIFT_MM = 1.0
"""Maximum displacement of the center of mass while the object must be at rest. A stack of good assets moves 0.03 mm in
5 s (measured)."""
TILT_DEGREES = 20.0
"""Maximum rotation of the vertical axis between the described pose and rest, as in the importer: fruit rolls by 5 to 13
degrees (measured), and a toppling object by 60 degrees or more."""
STANDING_TILT_DEGREES = MOST_STANDING_LEAN_DEGREES
"""Maximum rotation for kinds that stand, because they are tall, round or open at the top. On a spike of 15 mm, a mug
leans by 14 degrees. The importer leans such kinds by at most as much."""
ROUND_SHARE, ROUND_TILT_DEGREES = 0.75, 60.0
"""Ratio of shortest to longest side above which an object counts as a ball, and maximum rotation of a ball, which may
roll before it rests."""
JITTER_MM_S = 5.0
"""Maximum root mean square speed of the surface while the object must be at rest. Success checks accept 20 mm/s as
rest, and a good rod on a faceted side rocks at 2.2 mm/s (measured)."""
SINK_MM = 3.0
"""Maximum distance of the lowest visible point above or below the table surface."""

# ----------------------------------------------------------------------------------------------------- holds, supports
BALL_SHARE, BALL_MOST_M = 0.55, 0.015
"""Radius of the ball that is dropped into a container: a share of the smaller half of the opening, and an upper limit
[m]."""
BALL_DENSITY = 1000.0
"""Density of the ball, equal to water [kg/m^3]."""
BALL_FREE_M = 0.005
"""Height of the ball above the rim at its release [m]."""
BALL_DEPTH_SHARE = 0.45
"""Maximum height of the resting ball above the floor as a share of the depth. On a closed opening, the share is 1."""
BALL_BELOW_M = 0.004
"""Maximum depth of the ball below the visible floor [m]. A deeper ball has fallen through."""
BLOCK_M, BLOCK_KG = 0.015, 0.05
"""Half side [m] and mass [kg] of the block that a support must carry."""
CARRY_DRIFT_MM, CARRY_TILT_DEGREES = 6.0, 10.0
"""Maximum displacement and rotation of the block on the support within two seconds."""

# ---------------------------------------------------------------------------------------------------------------- lift
PAYLOAD_KG = 2.27
"""Franka's payload of 3 kg (data sheet of the Emika Panda) minus the gripper's 0.73 kg."""
GRASP_TOLERANCE_MM = 6.0
"""Allowed excess of the measured over the stated opening: two cells of a 20 cm solid."""
LEAST_THICK_M = 0.008
"""Minimum thickness for a grasp from a table. At flatter objects, the pads touch the table first. Objects of 6 mm
always failed, and objects of 10 mm always succeeded."""
LIFT_M, HOLD_S, CARRY_M = 0.15, 1.0, 0.20
"""Lift height, hold time and carry distance of a grasp trial."""
LIFT_SPEED, CARRY_SPEED = 0.15, 0.20
"""Speed of the gripper [m/s]. The experts carry objects at 0.15 m/s."""
SLIP_MM = 15.0
"""Maximum displacement of the object relative to the closed gripper until the end of the trial."""
SWING_DEGREES = 45.0
"""Maximum rotation of the object relative to the gripper. Plates and bowls held at the rim tilt by 22 to 39 degrees and
can be carried. Heavier objects rotate by 75 degrees (measured)."""
GRASPS_TRIED = 4
"""Number of grasps to try, by preference. One success is enough, because experts try the next grasp after a failure."""

# ------------------------------------------------------------------------------------------------------ mass and shape
INERTIA_FACTOR = 3.0
"""Allowed ratio of each principal moment to that of a uniform body of the visible shape. A hollow and a solid body
differ by 1.7."""
LEAST_FRICTION, MOST_FRICTION = 0.05, 2.0
"""Sliding friction of a collision part: oiled steel has 0.1, rubber on a dry rough surface up to 1.5."""
CENTER_DEPTH_MM = 0.0
"""Minimum depth of the center of mass inside the convex hull of the visual shape."""
OUTSIDE_MM, OUTSIDE_SHARE = 6.0, 0.12
"""Maximum distance of the collision shape from the visual shape for 95 % of the points: a length or a share of the
middle side, whichever is larger. A share of the longest side would allow a 28 cm bottle to be 25 mm too thick. V-HACD
of a scan has 3 to 5 mm (measured)."""
INSIDE_MM, INSIDE_SHARE = 4.0, 0.08
"""Maximum distance of the visual shape from the collision shape, defined in the same way."""
BARE_SHARE = 0.012
"""Maximum convex volume of one connected patch of visible surface that is farther than this from the collision shape,
as a share of the convex volume of the object. The handle of a mug without collision parts has 2.2 to 3 %. Of the
library, the straw of the drink cup, which has no collision parts, has 0.6 %, the dents of a crushed can 0.4 %. All
imported good assets have 0 (measured)."""
OPENING_SHARE = 0.60
"""Minimum share of the visible hollow's volume that the collision parts leave free."""
GAP_MM, GAP_SHARE = 4.0, 0.04
"""Maximum gap between parts: a length and a share of the longest side. Kenney's models have gaps of up to 3 %
(measured)."""

# ---------------------------------------------------------------------------------------------------------------- look
BEHIND_SHARE = 0.06
"""Maximum share of an image in which the nearest surface faces away from the camera and is therefore not rendered."""
DEGENERATE_SHARE = 0.02
"""Maximum share of triangles with zero area, because decimation leaves a few slivers."""
DARK, DARK_SHARE = 8, 0.6
"""Brightness (of 255) below which a texture pixel is black, and maximum share of such pixels."""
PLACEHOLDER_SHARE = 0.5
"""Maximum share of magenta (255, 0, 255) in a texture. Programs use this color to mark missing textures."""
LEAST_ALPHA = 0.05
"""Minimum opacity of a visible part."""

# --------------------------------------------------------------------------------------------------- uses of the kinds
ROUND_KINDS = frozenset(kind.name for kind in kinds() if kind.is_tall or kind.is_round)
"""Kinds that are often round about the vertical, but never about a horizontal axis."""
FOOTED_KINDS = frozenset({"bottle", "jar", "vase", "pepper mill", "shaker"})
"""Kinds that stand on their broader end."""
NARROW_TOP_KINDS = frozenset({"bottle", "jar", "pepper mill", "shaker", "burger", "lid", "tajine", "pumpkin"})
"""Kinds with a neck, a cap, a knob, a stem or a domed top, which is hardly ever broader than their base."""
HOLLOW_TOP_KINDS = frozenset({"plate", "spoon", "cooking spoon"})
"""Kinds that are not open, but whose hollow, if they have one, is above. The same applies to open kinds."""
ALWAYS_LIFTED_KINDS = frozenset(
    {
        "fork", "spoon", "knife", "chopstick", "cooking fork", "cooking spoon", "cooking knife", "whisk",
        "banana", "carrot", "marker", "candy bar", "toothbrush", "toothpaste", "screwdriver", "sausage", "candle",
        "egg", "strawberry", "cherry", "mushroom", "radish", "sushi", "dice", "hot dog", "popsicle", "stapler",
        "shaker", "lemon", "cookie",
    }
)  # fmt: skip
"""Kinds that fit into the jaw in every usual size."""
CLOSED_WORDS = frozenset(
    {"lid", "lidded", "cereal", "egg", "soft drink", "soup", "broth", "stew", "filled", "cocktail"}
)
"""Tags and names that mark objects of open kinds as full or covered."""
