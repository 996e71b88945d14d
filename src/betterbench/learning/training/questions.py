"""Questions about the frames of demonstrations. A learner answers them in addition to acting (co-training).

A learner chooses among all answers that occur in its training questions. For a box, a point or an option that is a box,
the answer is the cell of an 8 x 8 grid over the image that contains the center. The baselines of the question sets use
the same cells. The input is the same as for acting at that row, with the question instead of the instruction.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.learning.training.frames import FrameStore
from betterbench.policies.learned.recipe import TrainingRecipe
from betterbench.policies.learned.tokens import pose_numbers, tool_numbers
from betterbench.policies.learned.vocabulary import Vocabulary
from betterbench.records import Record
from betterbench.tasks import TrialId
from betterbench.vqa import Question, QuestionSet, read_set
from betterbench.vqa.blind import answer_class, box_cell, in_cells
from betterbench.vqa.types.grounding import CELLS

_CURE = "Create a set with better vqa from the demonstrations listed in the recipe"


@dataclass(frozen=True, slots=True, eq=False)
class TrainingQuestions:
    """Arrays of Q questions about the demonstrations of a training set.

    Attributes:
        words: (Q, w) int64; ABSENT after the last word.
        episodes: (Q,) int64 demonstration of each question.
        tools: (Q, history, 10) float32, the current state first.
        poses: (Q, n, 9) float32.
        answers: (Q,) int64 indices of the correct answers in the vocabulary; -1 for an answer that does not occur in
            training.
        types: Type of each question.
        frames_of: Images of the frames that the questions are about; None for the family ``objects``.
        frames: (Q,) int64 indices of these frames.
    """

    words: np.ndarray
    episodes: np.ndarray
    tools: np.ndarray
    poses: np.ndarray
    answers: np.ndarray
    types: tuple[str, ...]
    frames_of: FrameStore | None = None
    frames: np.ndarray | None = None


@dataclass(frozen=True, slots=True)
class AskedQuestions:
    """Questions of a recipe's sets about its demonstrations, in demonstration order.

    Attributes:
        questions: The questions, each with its demonstration's index.
        sha256: Hashes of the sets.
    """

    questions: tuple[tuple[int, Question], ...]
    sha256: tuple[str, ...]

    def texts(self, held_out: np.ndarray) -> list[str]:
        """Return the training questions as strings; ``held_out`` marks the demonstrations not used for training."""
        return [question_text(question) for episode, question in self.questions if not held_out[episode]]

    def answers(self, held_out: np.ndarray) -> tuple[str, ...]:
        """Return the distinct answers of the training questions, sorted."""
        return tuple(sorted({learned_class(q) for episode, q in self.questions if not held_out[episode]}))

    def rows(self, count: int) -> list[np.ndarray]:
        """Return the sorted distinct rows of the questions for each of ``count`` demonstrations."""
        found: list[set[int]] = [set() for _ in range(count)]
        for episode, question in self.questions:
            found[episode].add(question.source.row)
        return [np.array(sorted(rows), dtype=np.int64) for rows in found]


def question_text(question: Question) -> str:
    """Return the text of a question with its options for a learner, with boxes replaced by words for their cells."""
    return in_cells(question.prompt, question.width, CELLS)


def learned_class(question: Question) -> str:
    """Return the answer class of a question's correct answer."""
    return option_class(question.answer, question.width) if question.options else answer_class(question)


def option_class(option: str, width: int) -> str:
    """Return the answer class of an option.

    For a box in an image of this width [pixel], it is the cell, else the text.
    """
    return box_cell(option, width, CELLS) or option


def read_questions(recipe: TrainingRecipe, records: Sequence[tuple[TrialId, str]]) -> AskedQuestions | None:
    """Read a recipe's questions about demonstrations, matched by trial and SHA-256, or None without co-training.

    Raises:
        RecordError: If a folder contains no complete set, or a damaged one.
        InvalidInputError: If a set is about evaluation trials, or about none of the demonstrations.
    """
    if recipe.co_training is None:
        return None
    number: dict[TrialId, list[int]] = {}
    for i, (trial, _) in enumerate(records):
        number.setdefault(trial, []).append(i)
    sets = [_checked(read_set(Path(place))) for place in recipe.co_training.sets]
    found = []
    for made in sets:
        asked = [
            (episode, question)
            for question in made.questions
            for episode in number.get(question.source.trial, ())
            if made.is_about(*records[episode])
        ]
        if not asked:
            problem = f"none of its {len(made.questions)} questions is about a demonstration of the recipe"
            raise InvalidInputError(f"co_training: {made.path}", problem, _CURE)
        found += asked
    return AskedQuestions(tuple(sorted(found, key=lambda item: (item[0], item[1].id))), tuple(s.sha256 for s in sets))


def _checked(made: QuestionSet) -> QuestionSet:
    if made.purpose != "training":
        problem = "contains questions about evaluation trials, which must not be used for training"
        raise InvalidInputError(f"co_training: {made.path}", problem, _CURE)
    return made


def _drawn(
    asked: AskedQuestions, count: int, draw: Callable[[Sequence[np.ndarray]], FrameStore]
) -> tuple[FrameStore, np.ndarray]:
    """Render the frames for the questions; return them with each question's frame index."""
    rows_of = asked.rows(count)
    store = draw(rows_of)
    first = dict(zip([e for e, rows in enumerate(rows_of) if len(rows)], store.first.tolist(), strict=False))
    numbers = [first[e] + int(np.searchsorted(rows_of[e], q.source.row)) for e, q in asked.questions]
    return store, np.array(numbers, dtype=np.int64)


def training_questions(
    asked: AskedQuestions,
    records: Sequence[Record],
    held_out: np.ndarray,
    recipe: TrainingRecipe,
    vocabulary: Vocabulary,
    *,
    objects: int,
    draw: Callable[[Sequence[np.ndarray]], FrameStore] | None,
) -> TrainingQuestions:
    """Convert the questions about demonstrations to arrays.

    Args:
        asked: The questions.
        records: The demonstrations.
        held_out: (E,) bool mask of held-out demonstrations.
        recipe: The recipe.
        vocabulary: Words, categories and colors known to the learner.
        objects: Maximum number of objects in a demonstration.
        draw: Renders rows of each demonstration, for pixels learners.

    Raises:
        InvalidInputError: If all questions are about held-out demonstrations, or a row does not exist.
    """
    questions = [question for _, question in asked.questions]
    episodes = np.array([episode for episode, _ in asked.questions], dtype=np.int64)
    if held_out[episodes].all():
        cure = "Create a larger set, or give validation: 0"
        raise InvalidInputError("co_training", "all questions are about held-out demonstrations", cure)
    for episode, question in asked.questions:
        if question.source.row > records[episode].n_steps:
            problem = f"question {question.id} is about row {question.source.row}, which is not in the record"
            raise InvalidInputError("co_training", problem, _CURE)
    ids = [vocabulary.word_ids(question_text(question)) for question in questions]
    words = np.zeros((len(ids), max(map(len, ids))), dtype=np.int64)
    for i, found in enumerate(ids):
        words[i, : len(found)] = found
    number = {answer: i for i, answer in enumerate(vocabulary.answers)}
    back = recipe.history_stride * np.arange(recipe.history)
    tools, poses = [], np.zeros((len(questions), objects, 9), dtype=np.float32)
    for i, (episode, question) in enumerate(asked.questions):
        record, row = records[episode], question.source.row
        rows = np.maximum(row - back, 0)
        tools.append(tool_numbers(record.ee_position[rows], record.ee_quaternion[rows], record.finger_width[rows]))
        there = pose_numbers(record.object_positions[row], record.object_quaternions[row])
        poses[i, : len(there)] = there
    store, frames = (None, None) if draw is None else _drawn(asked, len(records), draw)
    return TrainingQuestions(
        words=words,
        episodes=episodes,
        tools=np.stack(tools),
        poses=poses,
        answers=np.array([number.get(learned_class(question), -1) for question in questions]),
        types=tuple(question.type.value for question in questions),
        frames_of=store,
        frames=frames,
    )


@dataclass(frozen=True, slots=True)
class AnswerRate:
    """Number of correct answers to questions about held-out demonstrations.

    Attributes:
        step: Training step.
        type: Question type; "all" for all types together.
        right: Number of correct answers.
        asked: Number of questions.
    """

    step: int
    type: str
    right: int
    asked: int


def answer_rates(step: int, types: Sequence[str], right: Sequence[bool]) -> list[AnswerRate]:
    """Return the rates of correct answers by sorted type, then over all, or an empty list without questions."""
    if not types:
        return []
    asked: Mapping[str, int] = Counter(types)
    hits = Counter(name for name, hit in zip(types, right, strict=True) if hit)
    found = [AnswerRate(step, name, hits[name], asked[name]) for name in sorted(asked)]
    return [*found, AnswerRate(step, "all", sum(hits.values()), len(types))]
