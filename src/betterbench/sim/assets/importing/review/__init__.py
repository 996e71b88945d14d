"""Data of human reviews of imported objects: changes, verdicts, and their replay without the browser page.

- ``changes``: one change of an object, with its value before and after.
- ``content``: hash of the reviewed mesh file.
- ``journal``: the append-only file of decisions, and the history of one object in it.
- ``applying``: an object with the changes of its history applied.
"""

from betterbench.jobs.decisions import Undo, Verdict
from betterbench.sim.assets.importing.review.applying import ReviewState, apply, changed
from betterbench.sim.assets.importing.review.changes import (
    Change,
    Decision,
    GraspChange,
    MassChange,
    NameChange,
    Plane,
    PoseChange,
    RegionChange,
    ScaleChange,
    SupportChange,
)
from betterbench.sim.assets.importing.review.content import content_hash
from betterbench.sim.assets.importing.review.journal import History, Review, ReviewJournal, history_of, read_reviews

__all__ = [
    "Change",
    "Decision",
    "GraspChange",
    "History",
    "MassChange",
    "NameChange",
    "Plane",
    "PoseChange",
    "RegionChange",
    "Review",
    "ReviewJournal",
    "ReviewState",
    "ScaleChange",
    "SupportChange",
    "Undo",
    "Verdict",
    "apply",
    "changed",
    "content_hash",
    "history_of",
    "read_reviews",
]
