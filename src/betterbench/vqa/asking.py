"""Functions that send questions to a model and score its answers by type of question.

:func:`ask_all` is the only function that sends requests to a vision-language model. ``better vqa --ask``, ``better
vlm`` and the extractor of ``better vlm`` use it, and all of them write answer files in the same format.
"""

from __future__ import annotations

import codecs
import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

from pydantic import TypeAdapter

from betterbench.errors import (
    InvalidInputError,
    RecordError,
    RunConflictError,
    encodable,
    one_line,
    require_between,
)
from betterbench.jobs import OnCount, counts, in_threads, run_items, write_durably
from betterbench.jobs.line_journal import MAX_BYTES, LineJournal, say_lost_tail
from betterbench.jobs.outputs import OutputFile, require_replaceable
from betterbench.json_form import SEAL, dump_json, open_form, read_bounded, read_form, seal_of
from betterbench.ordinary_file import open_ordinary
from betterbench.quoting import json_line
from betterbench.statistics import Rate
from betterbench.vqa.coordinates import Coordinates
from betterbench.vqa.dataset import QuestionSet
from betterbench.vqa.llm import Chat, ChatModel, Model, RefusedError, Reply
from betterbench.vqa.llm.model import opened
from betterbench.vqa.parsing import AnswerSpec
from betterbench.vqa.question import Form, Question
from betterbench.vqa.scoring import is_right, parse_answer, spec_of

logger = logging.getLogger(__name__)

_LONGEST_NAME = 200
_MOST_HEAD = 10_000
_BEGINNING = b'{"coordinates":'
"""Text at the beginning of the first line of an answer file."""
MOST_AT_ONCE = 256
"""Maximum number of requests that are sent at the same time."""
_MOST_AHEAD = 64
"""Maximum number of answers that wait for the answer to an earlier request.

They wait because answers are written in the order of the requests.
"""
_SYNC_WITHIN_S = 1.0
"""Maximum time until an answer is flushed to disk [s].

A flush takes 4 ms, so that flushing after each answer would limit a run to 250 answers per second. If the process is
killed, no answer is lost. A power failure can cause the loss of the answers in this interval.
"""

LONGEST_ANSWER, _KEPT_START = 100_000, 2_000
"""Maximum length of a stored answer [characters]. Only the start and the end of a longer answer are stored."""

_LINES = {
    Form.YES_NO: "Answer with Yes or No only.",
    Form.CHOICE: "Answer with the letter of the right option only.",
    Form.NUMBER: "Answer with a number only.",
}
_SHAPES: dict[Form, Literal["box", "point", "points"]] = {
    Form.BOX: "box", Form.POINT: "point", Form.POINTS: "points",
}  # fmt: skip


def answer_line(spec: AnswerSpec) -> str:
    """Return the sentence of the prompt that states the required form of the answer."""
    if spec.form in _SHAPES:
        return spec.convention.request(_SHAPES[spec.form], spec.width, spec.height)
    return _LINES[spec.form]


@dataclass(frozen=True, slots=True)
class Request:
    """Request to a model.

    Attributes:
        prompt: Text of the request.
        pictures: Function that reads the images (PNG or JPEG). It is called when the request is sent.
    """

    prompt: str
    pictures: Callable[[], Sequence[bytes]] = tuple


@open_form
@dataclass(frozen=True, slots=True)
class ModelAnswer:
    """Answer of a model to a question.

    Attributes:
        id: Identifier of the question.
        text: Text of the answer. Empty if the request was rejected.
        error: Reason why there is no answer, or None.
        seal: Checksum of the line in the answer file. None if another program or an earlier version wrote the file.
        prompt_tokens: Number of tokens in the prompt, or None if the server did not report it.
        completion_tokens: Number of tokens in the answer, or None if the server did not report it.
        retries: Reasons why earlier attempts failed, each as "KIND: DETAILS".
        cached: Whether the answer was taken from the cache instead of the model.
        cut: Whether the server cut off the text at the maximum number of tokens.
    """

    id: str
    text: str
    error: str | None = None
    seal: str | None = None
    prompt_tokens: int | None = None
    completion_tokens: int | None = None
    retries: tuple[str, ...] = ()
    cached: bool = False
    cut: bool = False


@open_form
@dataclass(frozen=True, slots=True)
class AnswersHead:
    """First line of an answer file. It identifies the model and the question set.

    Attributes:
        model: Name of the model.
        set_sha256: SHA-256 of the question set.
        coordinates: Coordinate convention of the answers.
        seal: Checksum of the line. None if another program or an earlier version wrote the file.
    """

    model: str
    set_sha256: str
    coordinates: Coordinates = "pixels"
    seal: str | None = None

    def __post_init__(self) -> None:
        """Check that the name of the model is suitable for tables and sentences.

        Raises:
            InvalidInputError: If the name is not suitable.
        """
        if not self.model.strip() or not self.model.isprintable() or len(self.model) > _LONGEST_NAME:
            problem = (
                f"{one_line(self.model, most=60)!r} is not a name with at most {_LONGEST_NAME} printable characters"
            )
            raise InvalidInputError("model", problem, "Write the name of the model in one line")


_ALWAYS = frozenset({"error", "coordinates"})
"""Fields that are always written. Other fields are left out if they have their default value."""
_ANSWER, _HEAD = TypeAdapter(ModelAnswer), TypeAdapter(AnswersHead)
_CURE = "Correct the file if you wrote it, or write the answers to a different file with --answers"


@dataclass(frozen=True, slots=True)
class Answers:
    """Answers of a model to a question set. A question without an answer is counted as answered incorrectly.

    Attributes:
        head: First line of the answer file.
        answers: Answers by the identifier of the question.
        changed: Number of the first line with a wrong checksum, or 0 if all checksums are correct.
    """

    head: AnswersHead
    answers: dict[str, ModelAnswer]
    changed: int = 0

    def has(self, question: Question) -> bool:
        """Return whether a question was sent to the model, even if its answer is empty."""
        return question.id in self.answers

    def right(self, question: Question) -> bool:
        """Return whether the model answered a question correctly."""
        answer = self.answers.get(question.id)
        if answer is None:
            return False
        return is_right(question, parse_answer(question, answer.text, coordinates=self.head.coordinates).answer)


@dataclass(frozen=True, slots=True)
class Score:
    """Score of a model on one part of a question set.

    Attributes:
        name: Name of the part.
        rate: Fraction of correct answers.
        read: Number of answers that could be parsed.
        strict: Number of answers that were written in exactly the requested form.
        chance: Expected fraction of correct answers if all answers are guessed without the image.
        blind: Fraction of questions that are answered correctly by a classifier that sees only the text of the
            question.
    """

    name: str
    rate: Rate
    read: int
    strict: int
    chance: float
    blind: float

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        return {**asdict(self), "rate": self.rate.to_json()}


class _AnswerFile(LineJournal):
    """Append-only file of answers. Each line has a checksum."""

    def __init__(self, path: Path, head: AnswersHead) -> None:
        self.head, self.known = head, dict[str, ModelAnswer]()
        super().__init__(path, alone=True)
        if self.is_empty:
            self._append_line(_sealed(head, head))

    def _take_in(self, lines: list[bytes]) -> None:
        if lines:
            found = _parsed(lines, self._path)
            if replace(found.head, seal=None) != self.head:
                raise RunConflictError(
                    f"{self._path} contains answers of {found.head.model!r} to a different set, or with different "
                    f"coordinates. Choose a different file."
                )
            _require_unchanged(found, self._path)
            self.known = found.answers

    def append(self, answer: ModelAnswer) -> None:
        """Append an answer to the file.

        Answers are flushed to disk together if they arrive within one second.
        """
        self._append_line(_sealed(self.head, answer), within_s=_SYNC_WITHIN_S)
        self.known[answer.id] = answer


def prompt_for(question: Question, coordinates: Coordinates = "pixels") -> str:
    """Return the prompt for a model: the question, the options, and the form in which to answer."""
    return f"{question.prompt}\n{answer_line(spec_of(question, coordinates=coordinates))}"


def ask_set(
    asked: QuestionSet,
    chat: Chat,
    file: Path,
    *,
    coordinates: Coordinates = "pixels",
    at_once: int = 4,
    overwrite: bool = False,
    on_progress: OnCount | None = None,
) -> Answers:
    """Ask a model all questions of a set that have no answer yet, and return all answers.

    Raises the same errors as :func:`ask_all`.
    """
    requests = {q.id: Request(prompt_for(q, coordinates), partial(_image_of, asked, q.image)) for q in asked.questions}
    head = AnswersHead(chat.name, asked.sha256, coordinates)
    return ask_all(requests, ChatModel(chat), head, file, at_once=at_once, overwrite=overwrite, on_progress=on_progress)


def _image_of(asked: QuestionSet, place: str) -> tuple[bytes]:
    return (asked.image(place),)


def ask_all(
    requests: Mapping[str, Request],
    model: Model,
    head: AnswersHead,
    file: Path,
    *,
    at_once: int = 4,
    overwrite: bool = False,
    verb: str = "vqa",
    on_progress: OnCount | None = None,
) -> Answers:
    """Send all requests that have no answer yet to a model, and return all answers.

    Answers are appended in the order of the requests, so that the file does not depend on the number of simultaneous
    requests. A request that the model rejects is stored as an empty answer with a reason.

    Args:
        requests: Requests, by identifier.
        model: The model.
        head: First line of the file, with model, set and coordinate convention.
        file: Answer file. If it exists, answers are appended to it.
        at_once: Number of requests that are sent at the same time.
        overwrite: Whether to replace a file with other content.
        verb: Subcommand that writes the file, for error messages.
        on_progress: Called with the number of answers and the number of requests.

    Raises:
        ModelError: If the model cannot be reached. The answers so far are kept.
        RunConflictError: If the file has other content, such as answers from a different model or to a different set,
            and must not be overwritten, or if another process is writing to it.
        InvalidInputError: If the number of requests at the same time is out of range.
    """
    require_between("--at-once", at_once, 1, MOST_AT_ONCE)
    require_replaceable(file, verb, overwrite=overwrite, is_ours=is_answers)
    if overwrite and not _goes_on(file, head):
        with OutputFile(file, verb, overwrite=True):
            write_durably(file, b"")
    with _AnswerFile(file, head) as kept:
        run_items(
            requests,
            is_done=kept.known.__contains__,
            work=lambda waiting: in_threads(
                waiting,
                lambda _, name: _ask(model, name, requests[name]),
                workers=at_once,
                open_resource=lambda: opened(model),
                in_order=True,
                ahead=_MOST_AHEAD,
            ),
            keep=kept.append,
            on_progress=counts(on_progress),
        )
    return Answers(head, kept.known)


def is_answers(file: Path) -> bool:
    """Return whether a file looks like an answer file. The result is False if the file is missing.

    If a process was killed while writing the first line, the incomplete line is recognized by its beginning.

    Raises:
        OSError: If the file cannot be read.
    """
    line = _first_line(file)
    if not line.endswith(b"\n"):
        return line[: len(_BEGINNING)] == _BEGINNING[: len(line)]
    try:
        read_form(_HEAD, line, where="", cure="")
    except InvalidInputError:
        return False
    return True


def _goes_on(file: Path, head: AnswersHead) -> bool:
    """Return whether new answers can be appended to a file, i.e. whether it is empty or has the same first line."""
    return _first_line(file) in (b"", json_line(dump_json(asdict(head))))


def _first_line(file: Path) -> bytes:
    try:
        with open_ordinary(file) as opened:
            return opened.readline(_MOST_HEAD)
    except FileNotFoundError:
        return b""


def _ask(model: Model, name: str, request: Request) -> ModelAnswer:
    try:
        found = model.answer(request.prompt, request.pictures())
    except RefusedError as error:
        return ModelAnswer(name, "", str(error), retries=_readable(error.retries))
    reply = found if isinstance(found, Reply) else Reply(found)
    return ModelAnswer(
        name,
        encodable(_shortened(reply.text)),
        prompt_tokens=reply.prompt_tokens,
        completion_tokens=reply.completion_tokens,
        retries=_readable(reply.retries),
        cached=reply.is_cached,
        cut=reply.is_cut,
    )


def _readable(reasons: Sequence[str]) -> tuple[str, ...]:
    return tuple(encodable(reason) for reason in reasons)


def _shortened(text: str) -> str:
    if len(text) <= LONGEST_ANSWER:
        return text
    return f"{text[:_KEPT_START]}\n[...]\n{text[_KEPT_START - LONGEST_ANSWER :]}"


def read_answers(file: Path, asked: QuestionSet) -> Answers:
    """Read the answers to a set from a file written by ``better vqa --ask`` or by another program.

    The first line is ``{"model": ..., "set_sha256": ..., "coordinates": "pixels"}``. Each other line is ``{"id": ...,
    "text": ...}``.

    Raises:
        RecordError: If the file cannot be read or is malformed.
        InvalidInputError: If the answers belong to a different set.
    """
    cure = _CURE if file.exists() else "Pass the file written by `better vqa SET --ask`"
    raw = read_bounded(file, max_bytes=MAX_BYTES, cure=cure, raises=RecordError)
    lines = [line for line in raw.removeprefix(codecs.BOM_UTF8).split(b"\n") if line.strip()]
    if not lines:
        raise RecordError(f"{file} is empty. {_CURE}.")
    if len(lines) > len(asked.questions) + 1:
        problem = f"has {len(lines) - 1:,} answers to the {len(asked.questions):,} questions of {asked.path}"
        raise InvalidInputError(str(file), problem, "Use a file with one answer per question of that set")
    found = _parsed(lines, file)
    if found.head.seal is not None:
        say_lost_tail(file)
        if (left := len(asked.questions) - len(found.answers)) > 0:
            logger.warning(
                "%s: %d questions of %s have no answer in this file and count as wrong", file, left, asked.path
            )
    if found.head.set_sha256 != asked.sha256:
        raise InvalidInputError(
            str(file),
            f"contains answers to a different set than {asked.path}",
            "Use the question set to which the answers belong",
        )
    unknown = found.answers.keys() - {q.id for q in asked.questions}
    if unknown:
        raise RecordError(
            f"{file} contains an answer to {one_line(min(unknown), most=80)}, which is not in the set. {_CURE}."
        )
    _require_unchanged(found, file)
    return found


def read_stored_answers(file: Path) -> Answers:
    """Read the answers of a run without reading its questions.

    Raises:
        RecordError: If the file cannot be read, or was changed after it was written.
    """
    raw = read_bounded(file, max_bytes=MAX_BYTES, cure=_CURE, raises=RecordError)
    lines = [line for line in raw.split(b"\n") if line.strip()]
    if not lines:
        raise RecordError(f"{file} is empty. {_CURE}.")
    found = _parsed(lines, file)
    _require_unchanged(found, file)
    return found


def _parsed(lines: Sequence[bytes], file: Path) -> Answers:
    where = f"{file}, line"
    head = read_form(_HEAD, lines[0], where=f"{where} 1", cure=_CURE, raises=RecordError)
    changed = 1 if head.seal not in (None, _sealed(head, head)[SEAL]) else 0
    answers: dict[str, ModelAnswer] = {}
    for number, line in enumerate(lines[1:], start=2):
        answer = read_form(_ANSWER, line, where=f"{where} {number}", cure=_CURE, raises=RecordError)
        if (head.seal is not None or answer.seal is not None) and answer.seal != _sealed(head, answer)[SEAL]:
            changed = changed or number
        if answer.id in answers:
            raise RecordError(f"{where} {number}: {one_line(answer.id, most=80)} is answered twice. {_CURE}.")
        answers[answer.id] = answer
    return Answers(head, answers, changed)


def _require_unchanged(found: Answers, file: Path) -> None:
    if found.changed:
        raise RecordError(
            f"{file}: the checksum of line {found.changed} does not match, so it was changed after it was written. "
            f"{_CURE}."
        )


def _sealed(head: AnswersHead, line: AnswersHead | ModelAnswer) -> dict[str, Any]:
    """Add a checksum to a line of an answer file. The checksum covers the line, the model and the set."""
    form = {
        f.name: value
        for f in fields(line)
        if f.name != SEAL and ((value := getattr(line, f.name)) != f.default or f.name in _ALWAYS)
    }
    to = [head.model, head.set_sha256, head.coordinates]
    return {**form, SEAL: seal_of({**form, "to": to})}


def scores_of(asked: QuestionSet, answers: Answers) -> list[Score]:
    """Return the scores of a model for each part of a set and for the whole set.

    The parts are the types of questions, the forms of answer within the type "grounding", and the levels of difficulty.
    A question is counted as answered incorrectly if its answer is missing or cannot be parsed.
    """
    baselines = {b.name: b for b in asked.baselines}
    found = []
    for name, members in _parts(asked.questions):
        reads = [
            parse_answer(q, a.text, coordinates=answers.head.coordinates) if a is not None else None
            for q in members
            for a in (answers.answers.get(q.id),)
        ]
        right = sum(r is not None and is_right(q, r.answer) for q, r in zip(members, reads, strict=True))
        stages = [r.stage for r in reads if r is not None]
        baseline = baselines.get(name)
        chance, blind = (0.0, 0.0) if baseline is None else (baseline.chance, baseline.blind / max(1, baseline.n))
        if baseline is None:
            chance = sum(q.chance or 0.0 for q in members) / len(members)
            blind = chance
        strict, read = stages.count("strict"), len(stages) - stages.count("none")
        found.append(Score(name, Rate(right, len(members)), read, strict, chance, blind))
    return found


def _parts(questions: Sequence[Question]) -> Iterator[tuple[str, list[Question]]]:
    parts: dict[str, list[Question]] = {}
    for q in questions:
        parts.setdefault(q.type.value, []).append(q)
    for q in questions:
        if q.form in (Form.BOX, Form.POINT):
            parts.setdefault(f"{q.type.value}: {q.form.value}", []).append(q)
    yield from sorted(parts.items())
    for level in ("easy", "medium", "hard"):
        members = [q for q in questions if q.difficulty.value == level]
        if members:
            yield f"difficulty: {level}", members
    yield "all", list(questions)
