"""Selection of questions with balanced answers, so that the text of a question alone does not reveal the answer.

Questions belong to the same group if their wording gives the same information, i.e. if they have the same family and
are about the same objects. Within a group, each of the selected answers occurs equally often. Therefore, no rule that
uses only the text is better than guessing. A group with only one answer is left out, because it could be answered
without the image. Boxes and points are balanced over cells of the image. If possible, all types have the same number of
questions, and all kinds within a type have the same number of questions. No kind has more questions than all other
kinds of its type together. Questions are selected by hashes of their text and frame, never by their answer.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

from betterbench.vqa.question import Candidate, Form, QuestionType, hash_number

LEAST_CELLS = 10
"""Minimum number of image cells over which the boxes or points for one kind of object must be spread."""
MOST_ALIKE = 2
"""Maximum number of questions with the same answer about the same objects, for each trial and camera.

The number is limited because successive frames are almost identical.
"""


SUBJECTS = {"what is held": "holding", "is it held": "holding"}
"""Question families that are about the same subject. They are balanced together within their type."""

NameT = TypeVar("NameT", bound=str)
"""Name of a type, kind or family of questions."""


@dataclass(frozen=True, slots=True)
class Chosen:
    """Selected question, with the answers that are selected in its group.

    Attributes:
        candidate: The question.
        answers: Answers that are selected in the group, sorted.
        turn: Index of the question among those questions of its group that have the same answer. Cross-validation keeps
            questions with the same turn together, so that each fold is as balanced as the whole set.
    """

    candidate: Candidate
    answers: tuple[str, ...]
    turn: int


def thin(candidates: Iterable[Candidate], *, seed: int) -> list[Candidate]:
    """Keep at most :data:`MOST_ALIKE` questions of each set of almost identical questions.

    The remaining questions are returned in the order of their identifiers.
    """
    alike: dict[tuple[object, ...], list[tuple[str, Candidate]]] = defaultdict(list)
    for candidate in candidates:
        what = (candidate.type, candidate.key, candidate.bucket, candidate.source.camera)
        alike[what].append((candidate.id(seed), candidate))
    kept = [pair for pairs in alike.values() for pair in sorted(pairs, key=lambda p: p[0])[:MOST_ALIKE]]
    return [candidate for _, candidate in sorted(kept, key=lambda p: p[0])]


def choose_balanced(candidates: Iterable[Candidate], *, count: int, seed: int) -> list[Chosen]:
    """Return about ``count`` questions with balanced answers.

    If possible, there are equally many questions of each type.

    If there are too few questions of a type, the other types get more. The kinds within a type are treated in the same
    way, except that no kind has more questions than all other kinds together. Within a kind, questions are taken from
    families and groups in turn.

    Args:
        candidates: All possible questions.
        count: Number of questions, or 0 for as many as can be balanced.
        seed: Seed of the set.
    """
    sorted_out: dict[tuple[QuestionType, tuple[str, ...]], dict[str, list[Candidate]]] = {}
    for c in candidates:
        sorted_out.setdefault((c.type, c.key), {}).setdefault(c.bucket, []).append(c)
    groups: dict[QuestionType, dict[str, list[list[list[Chosen]]]]] = defaultdict(lambda: defaultdict(list))
    for (kind, (family, *_)), by_answer in sorted(sorted_out.items()):
        rounds = _rounds(by_answer, seed)
        if rounds:
            groups[kind][family].append(rounds)
    turns = {kind: {f: _turns(rounds, seed) for f, rounds in groups[kind].items()} for kind in QuestionType}
    sizes = {kind: _balanced_sizes(families) for kind, families in turns.items()}
    available = {
        kind: sum(map(sum, (found.values() for found in subjects.values()))) for kind, subjects in sizes.items()
    }
    shares = _shares(available, count or sum(available.values()))
    chosen: list[Chosen] = []
    for kind, subjects in sizes.items():
        each = _shares({subject: sum(found.values()) for subject, found in subjects.items()}, shares[kind])
        for subject, found in subjects.items():
            for family, wanted in _shares(found, each[subject]).items():
                taken = 0
                for row in turns[kind][family]:
                    if taken >= wanted:
                        break
                    chosen += row
                    taken += len(row)
    return chosen


def _balanced_sizes(families: Mapping[str, Sequence[Sequence[Chosen]]]) -> dict[str, dict[str, int]]:
    """Return the number of questions that each family of a type may contribute. Families are grouped by subject.

    No subject has more questions than all other subjects of its type together.
    """
    subjects: dict[str, dict[str, int]] = {}
    for family, rows in families.items():
        subjects.setdefault(SUBJECTS.get(family, family), {})[family] = sum(map(len, rows))
    totals = {subject: sum(found.values()) for subject, found in subjects.items()}
    largest = max(totals, key=lambda subject: totals[subject], default="")
    others = sum(totals.values()) - totals.get(largest, 0)
    if others and totals[largest] > others:
        subjects[largest] = _shares(subjects[largest], others)
    return subjects


def _rounds(by_answer: dict[str, list[Candidate]], seed: int) -> list[list[Chosen]]:
    """Divide the questions of a group into rounds. Each round has one question for each answer.

    The result is empty if there are too few different answers.
    """
    lists = {answer: sorted(cs, key=lambda c: c.id(seed)) for answer, cs in by_answer.items()}
    ranked = sorted(lists, key=lambda answer: (-len(lists[answer]), answer))
    spatial = lists[ranked[0]][0].form in (Form.BOX, Form.POINT)
    least = LEAST_CELLS if spatial else 2
    best = max(range(least, len(ranked) + 1), key=lambda k: (k * len(lists[ranked[k - 1]]), k), default=None)
    if best is None:
        return []
    answers = tuple(sorted(ranked[:best]))
    first = hash_number("fold", lists[ranked[0]][0].key) % 1000
    return [[Chosen(lists[a][n], answers, first + n) for a in answers] for n in range(len(lists[ranked[best - 1]]))]


def _turns(groups: Sequence[list[list[Chosen]]], seed: int) -> list[list[Chosen]]:
    """Return the rounds of all groups, alternating between the groups."""
    keyed = [
        (number, hash_number("turn", seed, rounds[0][0].candidate.key), r)
        for rounds in groups
        for number, r in enumerate(rounds)
    ]
    return [r for _, _, r in sorted(keyed, key=lambda entry: entry[:2])]


def _shares(available: Mapping[NameT, int], count: int) -> dict[NameT, int]:
    """Return the number of questions for each type or family.

    If possible, all get the same number. If a type or family has too few questions, the others get more.
    """
    shares = dict.fromkeys(available, 0)
    wanting, left = [k for k in available if available[k]], count
    while wanting and left > 0:
        part = max(1, left // len(wanting))
        for kind in list(wanting):
            given = min(part, available[kind] - shares[kind], left)
            shares[kind] += given
            left -= given
            if shares[kind] >= available[kind]:
                wanting.remove(kind)
    return shares
