"""The calibration zoo: policies that move as well as the expert and decide by exactly one broken rule."""

from betterbench.experts.faulty.blind import NoLanguage
from betterbench.experts.faulty.breakdown import Crash, Slow
from betterbench.experts.faulty.clumsy import Clumsy
from betterbench.experts.faulty.halt import Halt, Length, Phase, Refuse
from betterbench.experts.faulty.inertia import Inertia
from betterbench.experts.faulty.layout import Layout
from betterbench.experts.faulty.lexical import Lexical
from betterbench.experts.faulty.lookalike import Color, Shape
from betterbench.experts.faulty.progress_cue import ProgressCue
from betterbench.experts.faulty.rules import BrokenRule, Fault
from betterbench.experts.faulty.steps import HabitPlace, Reorder, Repeat, Sequence

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
