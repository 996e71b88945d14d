"""The calibration zoo: policies that move as well as the expert and decide by exactly one broken rule."""

from betterbench.experts.zoo.blind import NoLanguage
from betterbench.experts.zoo.body import Crash, Slow
from betterbench.experts.zoo.clumsy import Clumsy
from betterbench.experts.zoo.halt import Halt, Phase, Refuse
from betterbench.experts.zoo.inertia import Inertia
from betterbench.experts.zoo.layout import Layout
from betterbench.experts.zoo.lexical import Lexical
from betterbench.experts.zoo.lookalike import Colour, Shape
from betterbench.experts.zoo.progress_cue import ProgressCue
from betterbench.experts.zoo.rules import BrokenRule, Fault
from betterbench.experts.zoo.steps import HabitPlace, Reorder, Repeat, Sequence

__all__ = [
    "BrokenRule",
    "Clumsy",
    "Colour",
    "Crash",
    "Fault",
    "HabitPlace",
    "Halt",
    "Inertia",
    "Layout",
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
