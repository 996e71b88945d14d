"""Co-training: in addition to acting, a policy learns to answer questions about the frames of demonstrations.

The policy chooses among all answers that occur in its training questions. The image is divided into a grid of 8 x 8
cells. An answer that is a box or a point is represented by the cell that contains its center. The baselines of the
question sets use the same cells. The policy receives the same input as when it acts in the recorded state, except that
the question replaces the instruction.
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

_CURE = "Create a set with `better vqa` from the demonstrations listed in the recipe"


@dataclass(frozen=True, slots=True, eq=False)
class TrainingQuestions:
    """Q questions about the demonstrations of a training set, as arrays.

    Attributes:
        words: (Q, w) int64 words of the question; ABSENT after the last word.
        episodes: (Q,) int64 index of the demonstration that each question is about.
        tools: (Q, history, 10) float32 tool pose and gripper opening, starting with the current state.
        poses: (Q, n, 9) float32 object poses.
        answers: (Q,) int64 indices of the correct answers in the vocabulary; -1 for an answer that does not occur in
            training.
        types: Type of each question.
        frames_of: Images of the frames that the questions are about; None for the family ``objects``.
        frames: (Q,) int64 index of each question's frame in ``frames_of``.
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
    """Questions about the demonstrations of a recipe, in the order of the demonstrations.

    Attributes:
        questions: Each question, together with the index of the demonstration that it is about.
        sha256: Hashes of the question sets.
    """

    questions: tuple[tuple[int, Question], ...]
    sha256: tuple[str, ...]

    def texts(self, held_out: np.ndarray) -> list[str]:
        """Return the texts of the training questions.

        ``held_out`` marks demonstrations that are not used for training.
        """
        return [question_text(question) for episode, question in self.questions if not held_out[episode]]

    def answers(self, held_out: np.ndarray) -> tuple[str, ...]:
        """Return the distinct answers to the training questions, sorted."""
        return tuple(sorted({learned_class(q) for episode, q in self.questions if not held_out[episode]}))

    def rows(self, count: int) -> list[np.ndarray]:
        """Return, for each of ``count`` demonstrations, the sorted rows about which there are questions."""
        found: list[set[int]] = [set() for _ in range(count)]
        for episode, question in self.questions:
            found[episode].add(question.source.row)
        return [np.array(sorted(rows), dtype=np.int64) for rows in found]


def question_text(question: Question) -> str:
    """Return a question with its options as the policy receives it.

    Boxes in the text are replaced by words for their cells.
    """
    return in_cells(question.prompt, question.width, CELLS)


def learned_class(question: Question) -> str:
    """Return the answer class of the correct answer to a question."""
    return option_class(question.answer, question.width) if question.options else answer_class(question)


def option_class(option: str, width: int) -> str:
    """Return the answer class of an option.

    The class of a box is its cell. The class of any other option is the option's text.

    Args:
        option: Text of the option.
        width: Width of the image [pixel].
    """
    return box_cell(option, width, CELLS) or option


def read_questions(recipe: TrainingRecipe, records: Sequence[tuple[TrialId, str]]) -> AskedQuestions | None:
    """Read the questions of a recipe about its demonstrations. Return None if the recipe has no co-training.

    Args:
        recipe: The recipe.
        records: Trial and SHA-256 of each demonstration, used to match the questions.

    Raises:
        RecordError: If a folder contains no complete question set, or the question set is damaged.
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
        problem = "the set contains questions about evaluation trials, which must not be used for training"
        raise InvalidInputError(f"co_training: {made.path}", problem, _CURE)
    return made


def _drawn(
    asked: AskedQuestions, count: int, draw: Callable[[Sequence[np.ndarray]], FrameStore]
) -> tuple[FrameStore, np.ndarray]:
    """Render the frames that the questions are about. Return the frames, and the index of each question's frame."""
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
        records: Records of the demonstrations.
        held_out: (E,) bool mask of the held-out demonstrations.
        recipe: The recipe.
        vocabulary: Words, categories and colors that the policy knows.
        objects: Maximum number of objects in a demonstration.
        draw: Function that renders rows of each demonstration; None for policies that use no images.

    Raises:
        InvalidInputError: If all questions are about held-out demonstrations, or a row does not exist.
    """
    questions = [question for _, question in asked.questions]
    episodes = np.array([episode for episode, _ in asked.questions], dtype=np.int64)
    if held_out[episodes].all():
        cure = "Make a larger question set, or set validation: 0"
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
    """Count the correct answers for each question type, in alphabetical order, and for all types together.

    The list is empty if there are no questions.
    """
    if not types:
        return []
    asked: Mapping[str, int] = Counter(types)
    hits = Counter(name for name, hit in zip(types, right, strict=True) if hit)
    found = [AnswerRate(step, name, hits[name], asked[name]) for name in sorted(asked)]
    return [*found, AnswerRate(step, "all", sum(hits.values()), len(types))]
