"""Limits of the asset certificate, each with its unit and its reason.

Where a reason says "measured", it refers to the good and bad meshes that ``tools/planted_assets.py --seed 0`` makes,
and to the procedural library. After a change to a limit, measure the error rates again (docs/asset-certificate.md).
"""

from betterbench.sim.assets.importing.kinds import kinds
from betterbench.sim.assets.importing.upright import MOST_STANDING_LEAN_DEGREES

# ---------------------------------------------------------------------------------------------------------------- size
SIZE_FACTOR = 1.05
"""Factor by which a size may be outside the usual range of its kind, because the table of kinds is rounded to whole
centimeters."""
LEAST_M, MOST_M = 0.01, 0.6
"""Allowed range for the longest side of an object of unknown kind [m], as in the importer. An object in this range fits
on a table and is visible to a camera."""
MASS_FACTOR = 8.0
"""Factor by which a mass may differ from the usual mass of its kind and size, in either direction. A full beverage can
is 20 times as heavy as an empty one. The masses of other kinds vary by a factor of 4."""
LEAST_DENSITY, MOST_DENSITY = 15.0, 9000.0
"""Mass per volume of the visible solid [kg/m^3]: polystyrene foam has 15 to 30, brass 8,500."""

# ------------------------------------------------------------------------------------------------------------- upright
OPEN_DEPTH_SHARE = 0.12
"""Minimum depth of an open object's hollow, as a fraction of the object's height (as in the importer)."""
OPEN_AREA_SHARE = 0.25
"""Minimum area of an open object's hollow, as a fraction of the object's footprint."""
NECK_AREA_SHARE, NECK_DEPTH_SHARE = 0.1, 0.5
"""Minimum area and depth of the hollow of a tall object with a neck, such as a vase, as fractions of the object's
footprint and height."""
ROUND_RATIO, LYING_RATIO = 1.06, 1.12
"""An object is round about an axis if its largest width across the axis is at most the first number times its smallest.
It lies on its side if its ratio about the vertical axis is more than the second number times its ratio about a
horizontal axis. A square has a ratio of 1.41."""
FOOTING_RATIO = 1.6
"""An object of a kind that stands counts as upside down if it would be more stable the other way up by more than this
factor."""
END_SHARE, END_AREA_RATIO = 0.15, 1.3
"""Height of each end of an object, as a fraction of the object's height, and, for kinds with a narrow top, the maximum
ratio between the cross-sections of the upper and the lower end. A jam jar with a wide lid and a beveled base has a
ratio of 1.14. A jar that stands on its lid, which is a fifth narrower than its body, has 1.54 (measured)."""

# ------------------------------------------------------------------------------------------------------------- at rest
SETTLE_S, WATCH_S = 4.0, 1.5
"""Time in which an object settles after it is released 1 mm above the table, and the following time in which it must
stay at rest [s]."""
DROP_M = 0.001
DRIFT_MM = 1.0
"""Maximum displacement of the center of mass while the object must be at rest. A stack of good assets moves 0.03 mm in
5 s (measured)."""
TILT_DEGREES = 20.0
"""Maximum angle by which an object may tip from its upright pose before it is at rest, as in the importer. Fruit rolls
by 5 to 13 degrees (measured), and an object that topples tips by 60 degrees or more."""
STANDING_TILT_DEGREES = MOST_STANDING_LEAN_DEGREES
"""Maximum angle by which an object may tip if its kind stands. A kind stands if it is tall, round or open at the top. A
mug on a spike of 15 mm leans by 14 degrees. The importer turns objects of these kinds by at most the same angle."""
ROUND_SHARE, ROUND_TILT_DEGREES = 0.75, 60.0
"""Ratio of the shortest to the longest side above which an object counts as a ball, and the maximum angle by which a
ball may roll before it is at rest."""
JITTER_MM_S = 5.0
"""Maximum root mean square speed of the surface while the object must be at rest. Success checks accept 20 mm/s as
rest. A good rod that lies on one of its facets rocks at 2.2 mm/s (measured)."""
SINK_MM = 3.0
"""Maximum distance of the lowest visible point above or below the table surface."""

# ----------------------------------------------------------------------------------------------------- holds, supports
BALL_SHARE, BALL_MOST_M = 0.55, 0.015
"""Radius of the ball that is dropped into a container, as a fraction of the smaller half extent of the opening, and the
maximum radius [m]."""
BALL_DENSITY = 1000.0
"""Density of the ball, equal to water [kg/m^3]."""
BALL_FREE_M = 0.005
"""Height of the ball above the rim at its release [m]."""
BALL_DEPTH_SHARE = 0.45
"""Maximum height of the resting ball above the floor, as a fraction of the container's depth. If the opening were
closed, the ball would rest on it, at a fraction of 1."""
BALL_BELOW_M = 0.004
"""Maximum depth of the ball below the visible floor [m]. A deeper ball has fallen through."""
BLOCK_M, BLOCK_KG = 0.015, 0.05
"""Half the side length [m] and mass [kg] of the block that a support must carry."""
CARRY_DRIFT_MM, CARRY_TILT_DEGREES = 6.0, 10.0
"""Maximum displacement and rotation of the block on the support within two seconds."""

# ---------------------------------------------------------------------------------------------------------------- lift
PAYLOAD_KG = 2.27
"""Maximum mass that the gripper can lift. The Franka Emika Panda has a payload of 3 kg (data sheet), and its gripper
weighs 0.73 kg."""
GRASP_TOLERANCE_MM = 6.0
"""Maximum amount by which the measured opening may exceed the stated opening. It is the size of two grid cells for an
object 20 cm long."""
LEAST_THICK_M = 0.008
"""Minimum thickness of an object that can be grasped from a table. With flatter objects, the pads touch the table
first. Objects of 6 mm always failed, and objects of 10 mm always succeeded."""
LIFT_M, HOLD_S, CARRY_M = 0.15, 1.0, 0.20
"""Height to which a grasp trial lifts an object [m], how long it holds the object there [s], and how far it then
carries the object [m]."""
LIFT_SPEED, CARRY_SPEED = 0.15, 0.20
"""Speed of the gripper while it lifts an object and while it carries it [m/s]. The experts carry objects at 0.15
m/s."""
SLIP_MM = 15.0
"""Maximum displacement of the object relative to the closed gripper until the end of the trial."""
SWING_DEGREES = 45.0
"""Maximum rotation of the object relative to the gripper. Plates and bowls that are held at the rim tilt by 22 to 39
degrees and can be carried. Objects that are too heavy rotate by 75 degrees (measured)."""
GRASPS_TRIED = 4
"""Maximum number of grasps to try, in order of preference. One success is enough, because experts try the next grasp
after a failure."""

# ------------------------------------------------------------------------------------------------------ mass and shape
INERTIA_FACTOR = 3.0
"""Maximum factor between a principal moment of inertia and that of a body of uniform density with the visible shape. A
hollow and a solid body differ by a factor of 1.7."""
LEAST_FRICTION, MOST_FRICTION = 0.05, 2.0
"""Range of plausible sliding friction. Oiled steel has 0.1, and rubber on a dry, rough surface has up to 1.5."""
CENTER_DEPTH_MM = 0.0
"""Minimum depth of the center of mass inside the convex hull of the visual shape."""
OUTSIDE_MM, OUTSIDE_SHARE = 6.0, 0.12
"""Maximum distance of the collision shape from the visual shape, for 95 % of the points: the larger of a length and a
fraction of the object's second-longest side. A fraction of the longest side would allow a 28 cm bottle to be 25 mm too
thick. The V-HACD decomposition of a scan has a distance of 3 to 5 mm (measured)."""
INSIDE_MM, INSIDE_SHARE = 4.0, 0.08
"""Maximum distance of the visual shape from the collision shape, for 95 % of the points: the larger of a length and a
fraction of the object's second-longest side."""
BARE_SHARE = 0.012
"""Maximum size of a connected patch of visible surface that is farther from the collision shape than the limits above
allow. The size is the volume of the patch's convex hull, as a fraction of that of the whole object. A mug handle
without collision parts has 2.2 to 3 %. In the procedural library, the straw of the drink cup, which has no collision
parts, has 0.6 %, and the dents of a crushed can have 0.4 %. All good imported assets have 0 (measured)."""
OPENING_SHARE = 0.60
"""Minimum fraction of the visible hollow's volume that the collision parts must leave free."""
GAP_MM, GAP_SHARE = 4.0, 0.04
"""Maximum gap between visible parts: the larger of a length and a fraction of the longest side. The models of the
Kenney asset packs have gaps of up to 3 % (measured)."""

# ---------------------------------------------------------------------------------------------------------------- look
BEHIND_SHARE = 0.06
"""Maximum fraction of an image in which the nearest surface faces away from the camera and is therefore not
rendered."""
DEGENERATE_SHARE = 0.02
"""Maximum fraction of triangles with no area. It is not 0, because decimation leaves a few slivers."""
DARK, DARK_SHARE = 8, 0.6
"""Brightness (of 255) below which a texture pixel counts as black, and the maximum fraction of black pixels."""
PLACEHOLDER_SHARE = 0.5
"""Maximum fraction of magenta (255, 0, 255) in a texture. Programs use this color to mark missing textures."""
LEAST_ALPHA = 0.05
"""Minimum opacity of a visible part."""

# --------------------------------------------------------------------------------------------------- uses of the kinds
ROUND_KINDS = frozenset(kind.name for kind in kinds() if kind.is_tall or kind.is_round)
"""Kinds that are often round about the vertical axis, but never about a horizontal axis."""
FOOTED_KINDS = frozenset({"bottle", "jar", "vase", "pepper mill", "shaker"})
"""Kinds that stand on their broader end."""
NARROW_TOP_KINDS = frozenset({"bottle", "jar", "pepper mill", "shaker", "burger", "lid", "tajine", "pumpkin"})
"""Kinds with a neck, a cap, a knob, a stem or a domed top. Their top is hardly ever broader than their base."""
HOLLOW_TOP_KINDS = frozenset({"plate", "spoon", "cooking spoon"})
"""Kinds that are not containers but, if they have a hollow, have it on the upper side. The hollow of an open kind must
be on the upper side as well."""
ALWAYS_LIFTED_KINDS = frozenset(
    {
        "fork", "spoon", "knife", "chopstick", "cooking fork", "cooking spoon", "cooking knife", "whisk",
        "banana", "carrot", "marker", "candy bar", "toothbrush", "toothpaste", "screwdriver", "sausage", "candle",
        "egg", "strawberry", "cherry", "mushroom", "radish", "sushi", "dice", "hot dog", "popsicle", "stapler",
        "shaker", "lemon", "cookie",
    }
)  # fmt: skip
"""Kinds whose objects fit into the gripper in every usual size."""
CLOSED_WORDS = frozenset(
    {"lid", "lidded", "cereal", "egg", "soft drink", "soup", "broth", "stew", "filled", "cocktail"}
)
"""Tags and names that mark objects of open kinds as full or covered."""
