"""Human reviews of imported objects. This package stores the decisions and applies them to the objects.

The browser page is in a different package.

- ``changes``: one change to an object, with the values before and after.
- ``content``: hash of the reviewed mesh file.
- ``journal``: append-only file of decisions, and the history of each object in it.
- ``applying``: applies the changes of a history to an object.
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
