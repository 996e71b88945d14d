"""Static twins: pairs of a question about a variation's scene and the same question about the training scene.

The static twin of a question is about the training trial with the same seed, in the condition from which the variation
is derived. It asks about the objects in the scene of that trial. It has the same type, form and family and, in a set
about decisive moments, the same role.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from functools import lru_cache

from betterbench.errors import UnknownNameError
from betterbench.tasks import TrialId
from betterbench.tasks.interventions import resolve_condition
from betterbench.vqa.question import Question, hash_number


@lru_cache(maxsize=4096)
def axis_of(task: str, condition: str) -> str | None:
    """Return the axis of a variation, or None for other conditions and for unknown tasks."""
    try:
        return resolve_condition(task, condition).axis
    except UnknownNameError:
        return None


def scene_twin(trial: TrialId) -> TrialId | None:
    """Return the twin of a variation trial, i.e. the training trial with the same seed.

    The result is None if the given trial is not a trial of a variation.
    """
    if axis_of(trial.task, trial.condition) is None:
        return None
    return TrialId(trial.task, resolve_condition(trial.task, trial.condition).base, trial.seed)


def static_twins(questions: Sequence[Question]) -> dict[str, str]:
    """Map the identifier of each question about a variation to the identifier of the question's twin.

    The twin is chosen among the questions of the same kind about the training scene. Among these, the question that is
    already the twin of the fewest others is chosen. If several are equal in this respect, the same camera, the same
    tags and a small difference in time are preferred, in this order. A question about a training scene may be the twin
    of several questions, just as a training trial may be the twin of several variations. If there is no question of the
    same kind about the training scene, the question has no twin and is left out.
    """
    scenes: dict[tuple[object, ...], list[Question]] = {}
    for question in questions:
        scenes.setdefault((question.source.trial, *_kind(question)), []).append(question)
    used = Counter[str]()
    found: dict[str, str] = {}
    for question in questions:
        trial = scene_twin(question.source.trial)
        candidates = [] if trial is None else scenes.get((trial, *_kind(question)), [])
        if candidates:
            twin = min(candidates, key=lambda other: (used[other.id], *_distance(question, other)))
            used[twin.id] += 1
            found[question.id] = twin.id
    return found


def _kind(question: Question) -> tuple[object, ...]:
    return question.type, question.form, question.family, question.role


def _distance(question: Question, other: Question) -> tuple[object, ...]:
    """Return a sort key that measures how different two questions of the same kind are."""
    return (
        question.source.camera != other.source.camera,
        bool(set(question.tags) ^ set(other.tags)),
        abs(question.source.time_s - other.source.time_s),
        hash_number("twin", question.id, other.id),
    )
