"""Faulty policies (addresses ``zoo:NAME``). Each moves like the expert, but its decisions follow one faulty rule."""

from betterbench.policies.faulty.blind import NoLanguage
from betterbench.policies.faulty.breakdown import Crash, Slow
from betterbench.policies.faulty.clumsy import Clumsy
from betterbench.policies.faulty.halt import Halt, Length, Phase, Refuse
from betterbench.policies.faulty.inertia import Inertia
from betterbench.policies.faulty.layout import Layout
from betterbench.policies.faulty.lexical import Lexical
from betterbench.policies.faulty.lookalike import Color, Shape
from betterbench.policies.faulty.progress_cue import ProgressCue
from betterbench.policies.faulty.rules import BrokenRule, Fault
from betterbench.policies.faulty.steps import HabitPlace, Reorder, Repeat, Sequence

__all__ = [
    "BrokenRule",
    "Clumsy",
    "Color",
    "Crash",
    "Fault",
    "HabitPlace",
    "Halt",
    "Inertia",
    "Layout",
    "Length",
    "Lexical",
    "NoLanguage",
    "Phase",
    "ProgressCue",
    "Refuse",
    "Reorder",
    "Repeat",
    "Sequence",
    "Shape",
    "Slow",
]
