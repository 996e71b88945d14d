"""Comparison of policies: their differences, overall and by group, and the differences that could be detected."""

from betterbench.comparison.compare import Comparison, compare
from betterbench.comparison.contrast import Contrast, Group, SequentialContrast
from betterbench.comparison.matching import Matching, match_sides
from betterbench.comparison.side import Side, load_sides, name_sides
from betterbench.comparison.submission import Submission, read_submission, require_same, submission_of

__all__ = [
    "Comparison",
    "Contrast",
    "Group",
    "Matching",
    "SequentialContrast",
    "Side",
    "Submission",
    "compare",
    "load_sides",
    "match_sides",
    "name_sides",
    "read_submission",
    "require_same",
    "submission_of",
]
