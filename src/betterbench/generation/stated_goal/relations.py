"""Vocabulary of relations, numbers, orders and poses in instructions."""

from __future__ import annotations

from betterbench.generation.sentence_words import COUNTS, DETERMINERS, NUMBERS

_PHRASES = {
    "left": "to the left of, on the left of, at the left of, left of, to the left, on the left, at the left, "
    "to the left side of, on the left side of, at the left side of, to the left side, on the left side, "
    "at the left side, on its left, to its left, on its left side, just left of",
    "right": "to the right of, on the right of, at the right of, right of, to the right, on the right, at the right, "
    "to the right side of, on the right side of, at the right side of, to the right side, on the right side, "
    "at the right side, on its right, to its right, on its right side, just right of",
    "behind": "behind, right behind, just behind, in back of, at the back of, to the back of",
    "upper_right": "at the upper right of, to the upper right of, on the upper right of, at the upper right, "
    "to the upper right, on the upper right, upper right of",
    "front": "in front of, to the front of, at the front of, in front, at the front, to the front",
    "beside": "next to, right next to, beside, near, by, close to, alongside",
    "around": "around",
    "between": "between, in between, among, amid",
    "on": "on, onto, upon, on to, on top of, atop",
    "top": "on top, at the top, to the top, on the top",
    "bottom": "at the bottom, on the bottom, at the bottom of, on the bottom of",
    "under": "under, underneath, below, beneath",
    "over": "over, above",
    "in": "in, into, inside, within, inside of, in to",
    "from": "from, off, out of, off of, outside, outside of",
    "at": "at",
    "to": "to",
    "elsewhere": "against, across, across from, opposite, facing, toward, along, past, beyond, through, away from, "
    "far from, parallel to, perpendicular to, in line with, aligned with, instead of",
}
RELATIONS = {tuple(phrase.split()): meaning for meaning, phrases in _PHRASES.items() for phrase in phrases.split(", ")}
"""Meaning of each phrase that states a relation.

The words of the phrases are singular, as returned by :func:`sentence_tokens`.
"""
LONGEST_RELATION = max(map(len, RELATIONS))

SIDES = ("left", "right", "behind", "upper_right")
HOLES = {"left": "hole_1", "middle": "hole_2", "center": "hole_2", "right": "hole_3"}
RING = frozenset({"ring", "mark", "circle", "spot", "tray"})
RING_OR_SPOUT = RING | {"spout"}
SURFACES = frozenset(
    {"table", "desk", "counter", "buffet", "workspace", "workstation", "kitchen", "tabletop", "countertop", "bathroom"}
)
"""Surfaces on which all objects stand, so that "on the table" adds nothing to the goal."""
TRASH = frozenset({"trash", "garbage", "litter"})
GATHERED = frozenset({"pile", "stack", "tower", "column", "one"})
_POSITIONS_WORDS = """
left right middle center top bottom front corner upper lower leftmost rightmost side edge end
"""
POSITIONS = frozenset(_POSITIONS_WORDS.split())
"""Adjectives and nouns for positions. They are ignored unless they belong to a relation, a hole or a drawer."""

_NEGATIONS_WORDS = """
without not no none never except excluding but nothing neither nor don dont avoid instead skip unless
"""
NEGATIONS = frozenset(_NEGATIONS_WORDS.split())
_CHOICES_WORDS = """
or either if when while whichever any only
"""
CHOICES = frozenset(_CHOICES_WORDS.split())
AGAIN = frozenset(["twice", "thrice", "again", "repeatedly", "alternately", "alternating"])
_COMPARED_WORDS = """
bigger biggest smaller smallest larger largest taller tallest shorter shortest heavier heaviest lighter lightest
nearer nearest closer closest farther farthest other another same different opposite topmost lowest highest
"""
COMPARED = frozenset(_COMPARED_WORDS.split())
_POSES_WORDS = """
upside sideway upright vertically horizontally facedown inverted tilted flipped halfway diagonally flat face
"""
POSES = frozenset(_POSES_WORDS.split())
OPEN = frozenset(["open", "opened", "unopened", "ajar"])
THEN = frozenset(["then", "finally", "lastly", "afterward", "afterwards", "followed"])
_ORDER_WORDS = """
before after until once last second secondly third thirdly firstly
"""
ORDER = frozenset(_ORDER_WORDS.split())
PRONOUNS = frozenset({"it", "them", "they", "these", "those", "that", "this"})

READ_WORDS = frozenset().union(
    *RELATIONS, RING, SURFACES, GATHERED, POSITIONS, NEGATIONS, CHOICES, AGAIN, COMPARED, POSES, OPEN,
    THEN, ORDER, NUMBERS, PRONOUNS, COUNTS, DETERMINERS, ("first", "close", "hole", "slot", "spout", "with"),
)  # fmt: skip
"""Words that :func:`stated_goal` interprets, or rejects with a reason."""
