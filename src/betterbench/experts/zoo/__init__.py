"""The calibration zoo: policies that move as well as the expert and decide by exactly one broken rule."""

from betterbench.experts.zoo.clumsy import clumsiness
from betterbench.experts.zoo.colour import Colour
from betterbench.experts.zoo.halt import Halt
from betterbench.experts.zoo.inertia import Inertia
from betterbench.experts.zoo.layout import Layout
from betterbench.experts.zoo.lexical import Lexical
from betterbench.experts.zoo.progress_cue import ProgressCue
from betterbench.experts.zoo.truth import true_label

__all__ = ["Colour", "Halt", "Inertia", "Layout", "Lexical", "ProgressCue", "clumsiness", "true_label"]
