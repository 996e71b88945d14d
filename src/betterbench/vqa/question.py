"""Questions about an image, with their answers. They can be stored as JSON."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import PurePosixPath
from typing import Annotated, Any

from pydantic import AfterValidator, Field, TypeAdapter

from betterbench.interface.state import Box
from betterbench.json_form import strict_form
from betterbench.tasks import TrialId


class QuestionType(StrEnum):
    """Topic of a question. Question sets are balanced and scored by type."""

    GROUNDING = "grounding"
    COUNTING = "counting"
    RELATION = "relation"
    CONTAINMENT = "containment"
    STACKING = "stacking"
    STATE = "state"
    EXECUTION = "execution"
    PREMISE = "premise"


class Form(StrEnum):
    """Form of an answer."""

    YES_NO = "yes_no"
    """"Yes" or "No"."""
    CHOICE = "choice"
    """Choice among options that are listed with letters."""
    NUMBER = "number"
    """Number of objects."""
    BOX = "box"
    """Edges [left, top, right, bottom] of a box [pixel].

    The answer is correct if the overlap (IoU) with the true box is at least one half.
    """
    POINT = "point"
    """Column and row [x, y] of a point [pixel].

    The answer is correct if the point is on a visible pixel of the object.
    """
    POINTS = "points"
    """One or more points. The score is the fraction in the target region. Only published sets have this form."""


class Difficulty(StrEnum):
    """Difficulty of a question, see :func:`betterbench.vqa.difficulty.difficulty_of`."""

    EASY = "easy"
    MEDIUM = "medium"
    HARD = "hard"


@strict_form
@dataclass(frozen=True, slots=True)
class FrameSource:
    """Frame of a question: a camera and a row in the record of a trial, with the time of the row [s]."""

    task: str
    condition: str
    seed: Annotated[int, Field(ge=0)]
    row: Annotated[int, Field(ge=0)]
    time_s: float
    camera: str

    @property
    def trial(self) -> TrialId:
        """Trial to which the frame belongs."""
        return TrialId(self.task, self.condition, self.seed)


@strict_form
@dataclass(frozen=True, slots=True)
class Candidate:
    """Question before the selection, without its wording and options.

    Attributes:
        type: Topic of the question.
        form: Form of the answer.
        family: Kind of the question, regardless of the objects. Each family has its own wordings.
        group: Information that the text reveals in addition to the family, such as the objects. Answers are balanced
            among the questions with the same family and group.
        bucket: Value that is balanced: the answer itself, or the image cell of a box or point.
        answer: The correct answer.
        words: Words that are inserted into the wordings.
        objects: Scene names of the objects that the question is about.
        source: Frame of the question.
        tags: Properties used for the difficulty and for filtering ("look-alike", "robot frame").
        box: True box of the object, for a question about a box.
        runs: Visible pixels of the object, for a question about a point, see
            :class:`~betterbench.interface.state.SeenObject`.
        boxes: Box of the visible part of each of ``objects``. None for an object that is not visible.
    """

    type: QuestionType
    form: Form
    family: str
    group: tuple[str, ...]
    bucket: str
    answer: str
    words: Mapping[str, str]
    objects: tuple[str, ...]
    source: FrameSource
    tags: tuple[str, ...] = ()
    box: Box | None = None
    runs: tuple[int, ...] | None = None
    boxes: tuple[Box | None, ...] = ()

    @property
    def key(self) -> tuple[str, ...]:
        """Family and group of the question. Together, they describe the information in the wording of the question."""
        return (self.family, *self.group)

    def id(self, seed: int) -> str:
        """Return the identifier that the question gets in a set with a given seed.

        The identifier is a hash of the question and the frame. It does not depend on the answer.
        """
        s = self.source
        told = (str(seed), s.task, s.condition, str(s.seed), str(s.row), s.camera, *self.key, *sorted(self.objects))
        told += tuple(f"{k}={v}" for k, v in sorted(self.words.items()))
        return hashlib.sha256("\x1f".join(told).encode()).hexdigest()[:16]

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        return asdict(self)


_LONGEST_PLACE = 1000
"""Maximum length of an image's path within its set [characters]."""


def _inside(place: str) -> str:
    parts = PurePosixPath(place).parts
    if (
        not 0 < len(place) <= _LONGEST_PLACE
        or not parts
        or PurePosixPath(place).is_absolute()
        or ".." in parts
        or not place.isprintable()
    ):
        raise ValueError("the path does not lead to a file inside the set")
    return place


@strict_form
@dataclass(frozen=True, slots=True)
class Question:
    """Question of a set.

    Attributes:
        id: Identifier within the set.
        type: Topic of the question.
        form: Form of the answer.
        family: Kind of the question, regardless of the objects.
        text: The question without its options.
        options: Options of a choice, in the order of their letters.
        answer: The correct answer: the chosen option, or the coordinates of a box or point in brackets.
        image: Path of the image, relative to the folder of the set.
        width: Number of columns of the image [pixel].
        height: Number of rows of the image [pixel].
        difficulty: Difficulty of the question.
        tags: Properties used for the difficulty and for filtering.
        objects: Scene names of the objects that the question is about.
        group: Information that the text reveals. Answers are balanced among the questions of a group.
        words: Words that are inserted into the wording.
        chance: Expected fraction of correct answers if the answer is guessed from the text. None for boxes and points,
            because they are compared with the best constant answer of the set.
        source: Frame of the question.
        box: True box of the object, for a question about a box.
        runs: Visible pixels of the object, for a question about a point.
        role: Role of a question about a decisive moment ("asked", "where", "under", "exists", "done").
        boxes: Box of the visible part of each of ``objects``. None for an object that is not visible. Empty in sets of
            version 3 and older.
    """

    id: str
    type: QuestionType
    form: Form
    family: str
    text: str
    options: tuple[str, ...]
    answer: str
    image: Annotated[str, AfterValidator(_inside)]
    width: int
    height: int
    difficulty: Difficulty
    tags: tuple[str, ...]
    objects: tuple[str, ...]
    group: tuple[str, ...]
    words: Mapping[str, str]
    chance: float | None
    source: FrameSource
    box: Box | None = None
    runs: tuple[int, ...] | None = None
    role: str | None = None
    boxes: tuple[Box | None, ...] = ()

    @property
    def smallest(self) -> tuple[int, int] | None:
        """Width and height of the question's smallest visible object, measured by area [pixel].

        The value is None if no object of the question is visible.
        """
        sides = [(box[2] - box[0], box[3] - box[1]) for box in self.boxes or (self.box,) if box is not None]
        return min(sides, key=lambda side: side[0] * side[1], default=None)

    @property
    def prompt(self) -> str:
        """Prompt of the question: its text, and its options with letters, one per line."""
        return "\n".join([self.text, *(f"{letter(i)}. {option}" for i, option in enumerate(self.options))])

    @property
    def reply(self) -> str:
        """Correct answer as text. For a choice, this is the letter with the option."""
        return f"{letter(self.options.index(self.answer))}. {self.answer}" if self.options else self.answer

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        return asdict(self)


QUESTION, CANDIDATE = TypeAdapter(Question), TypeAdapter(Candidate)


def letter(number: int) -> str:
    """Return the letter of an option. The first option, with index 0, has the letter A."""
    return chr(ord("A") + number)


def hash_number(*parts: object) -> int:
    """Convert all parts to text and return a hash of them as a number.

    The number is the same on every machine, and is used to make reproducible choices.
    """
    return int.from_bytes(hashlib.sha256("\x1f".join(map(str, parts)).encode()).digest()[:8], "big")


@dataclass(frozen=True, slots=True)
class QuestionDraft:
    """Part of a question that is created by the generator of its type. Data about the frame are added afterward.

    For the fields, see :class:`Candidate`.
    """

    form: Form
    family: str
    group: tuple[str, ...]
    answer: str
    words: Mapping[str, str]
    objects: tuple[str, ...] = ()
    tags: tuple[str, ...] = ()
    bucket: str | None = None
    box: Box | None = None
    runs: tuple[int, ...] | None = None
