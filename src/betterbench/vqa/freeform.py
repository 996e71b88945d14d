"""Descriptions and questions written by a model. They are kept only if the recorded state proves their claims.

The model gets an image and the names of objects that may be in it. It replies with descriptions and with pairs of a
question and an answer. For each text, it also states the claims of the text in a small formal language. A text is kept
if every claim can be decided from the state and is true. The claims must also cover all objects that the text mentions,
and all words of the text about positions and states. Texts that cannot be checked are dropped.
"""

from __future__ import annotations

import contextlib
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, TypeAdapter

from betterbench.errors import BetterError, RecordError, require_between
from betterbench.jobs import OnCount, counts, job_folder, run_items, write_durably
from betterbench.jobs.outputs import OutputFile
from betterbench.json_form import (
    dump_json,
    open_form,
    open_seal,
    parse_json,
    read_bounded,
    read_form,
    sealed_form,
    strict_form,
)
from betterbench.ordinary_file import open_ordinary
from betterbench.quoting import default_name, json_line
from betterbench.records import RunFolder
from betterbench.vqa.dataset import PhotoSource, QuestionSet
from betterbench.vqa.episode import episode_of
from betterbench.vqa.llm import Chat, RefusedError, user_message
from betterbench.vqa.moment import Moment
from betterbench.vqa.nouns import definite
from betterbench.vqa.question import Candidate, FrameSource, hash_number
from betterbench.vqa.types import candidates_of

_MAX_BYTES = 16 << 20
_MOST_LINE = 1 << 20

CLAIMS = {
    "is visible": "X can be seen",
    "is absent": "there is no X",
    "is left of": "X is to the left of Y in the image",
    "is right of": "X is to the right of Y in the image",
    "is closer than": "X is closer to the camera than Y",
    "is in": "X is in the container Y",
    "is not in": "X is not in the container Y",
    "is on": "X lies directly on Y",
    "is held": "the gripper holds X",
    "is not held": "the gripper does not hold X",
    "is open": "the drawer X is open",
    "is shut": "the drawer X is shut",
}
"""Claims of the formal language. X and Y stand for names of objects."""

_WORDS: dict[str, tuple[str, ...]] = {
    "left": ("is left of", "is right of"),
    "right": ("is right of", "is left of"),
    "closer": ("is closer than",), "nearer": ("is closer than",), "front": ("is closer than",),
    "behind": ("is closer than",), "in": ("is in", "is not in"), "inside": ("is in", "is not in"),
    "into": ("is in", "is not in"), "on": ("is on",), "top": ("is on",), "under": ("is on",), "below": ("is on",),
    "above": ("is on",), "held": ("is held", "is not held"), "holding": ("is held", "is not held"),
    "holds": ("is held", "is not held"), "gripping": ("is held", "is not held"),
    "carrying": ("is held", "is not held"), "open": ("is open", "is shut"), "closed": ("is shut", "is open"),
    "shut": ("is shut", "is open"),
}  # fmt: skip
"""Words about positions and states. A text with such a word must make one of the word's claims."""
_FREE = ("in the image", "in this image", "in the picture", "in the scene", "in this scene", "in view", "on the table")
_UNCHECKED = frozenset(
    [
        "red",
        "blue",
        "green",
        "yellow",
        "white",
        "black",
        "gray",
        "orange-colored",
        "brown",
        "large",
        "small",
        "big",
        "tiny",
        "two",
        "three",
        "four",
        "five",
        "six",
        "many",
        "several",
        "both",
        "next",
        "beside",
        "between",
        "near",
        "edge",
        "corner",
        "center",
        "middle",
        "left-hand",
        "right-hand",
        "empty",
        "full",
    ]
)
"""Words that no claim can express. A text with such a word is dropped, unless the word is part of a name."""

MOST_IMAGES = 1_000_000
MOST_TEXTS = 8
LONGEST_TEXT = 600


@open_form
@dataclass(frozen=True, slots=True)
class StateClaim:
    """Claim in the formal language that is defined by :data:`CLAIMS`."""

    x: Annotated[str, Field(max_length=60)]
    says: Annotated[str, Field(max_length=30)]
    y: Annotated[str, Field(max_length=60)] = ""


@open_form
@dataclass(frozen=True, slots=True)
class ModelText:
    """Description of an image, or answer to a question about it, with the claims made in this text."""

    text: Annotated[str, Field(max_length=LONGEST_TEXT)]
    claims: Annotated[tuple[StateClaim, ...], Field(max_length=20)]
    question: Annotated[str, Field(max_length=LONGEST_TEXT)] = ""


@open_form
@dataclass(frozen=True, slots=True)
class _Reply:
    texts: Annotated[list[ModelText], Field(max_length=MOST_TEXTS)]


_REPLY = TypeAdapter(_Reply)


@dataclass(frozen=True, slots=True)
class Described:
    """Result of :func:`describe_images`.

    Attributes:
        path: File with the texts that were kept.
        images: Number of images.
        kept: Number of texts that the state proves.
        dropped: Number of texts that were dropped, by reason.
    """

    path: Path
    images: int
    kept: int
    dropped: dict[str, int]

    @property
    def sentence(self) -> str:
        """Summary of the result in one sentence, with the number of texts that were kept and dropped."""
        reasons = ", ".join(f"{reason} {n}" for reason, n in sorted(self.dropped.items()))
        return f"{self.kept} texts about {self.images} images kept in {self.path}; dropped: {reasons or 'none'}."

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        return {"images": self.images, "kept": self.kept, "dropped": self.dropped}


def describe_images(
    run: RunFolder,
    described: QuestionSet,
    chat: Chat,
    photos: PhotoSource,
    *,
    count: int,
    overwrite: bool = False,
    on_progress: OnCount | None = None,
) -> Described:
    """Request descriptions of images and questions about them from a model, and keep the texts that the state proves.

    The results for each image are stored in ``descriptions/``, so that running an interrupted command again resumes it
    where it stopped. Texts that are kept are written to the set's ``descriptions.jsonl``, in LLaVA's conversation
    format.

    Raises:
        ModelError: If the model cannot be reached.
        RecordError: If a record or a scene cannot be read.
        InvalidInputError: If the number of images is out of range.
        RunConflictError: If the file has other content and must not be overwritten, or if another process is writing to
            it.
    """
    require_between("--images", count, 1, MOST_IMAGES)
    path = described.path / "descriptions.jsonl"
    with job_folder(described.path), OutputFile(path, "vqa", overwrite=overwrite, is_ours=_is_described):
        return _described(run, described, chat, photos, path, count=count, on_progress=on_progress)


def _is_described(path: Path) -> bool:
    """Return whether the first line of a file is a text about an image, as written by this module."""
    with contextlib.suppress(ValueError), open_ordinary(path) as file:
        first = parse_json(file.readline(_MOST_LINE))
        return isinstance(first, dict) and {"image", "conversations", "claims", "source"} <= first.keys()
    return False


def _described(
    run: RunFolder,
    described: QuestionSet,
    chat: Chat,
    photos: PhotoSource,
    path: Path,
    *,
    count: int,
    on_progress: OnCount | None,
) -> Described:
    sources = {q.image: q.source for q in described.questions}
    chosen = sorted(sources, key=lambda image: hash_number("described", image))[:count]
    folder = described.path / "descriptions" / default_name(chat.name, otherwise="model")
    files = {image: folder / f"{hash_number(image):016x}.json" for image in chosen}
    about = partial(_about, run, described, chat, photos)
    run_items(
        chosen,
        is_done=lambda image: files[image].exists(),
        work=lambda waiting: ((image, about(image=image, source=sources[image])) for image in waiting),
        keep=lambda found: write_durably(files[found[0]], json_line(dump_json(sealed_form(found[1])))),
        on_progress=counts(on_progress),
    )
    kept: list[dict[str, Any]] = []
    dropped: Counter[str] = Counter()
    for file in files.values():
        there = _read(file)
        kept += there.kept
        dropped.update(there.dropped)
    write_durably(path, b"".join(json_line(dump_json(line)) for line in kept))
    return Described(path, len(chosen), len(kept), dict(dropped))


def _about(
    run: RunFolder, described: QuestionSet, chat: Chat, photos: PhotoSource, *, image: str, source: FrameSource
) -> dict[str, Any]:
    """Return the texts of a model about one image that are kept, and the reasons for dropping its other texts."""
    record = run.read_record(source.task, source.condition, source.seed)
    photo = photos.photo(record, source.row, source.camera)
    moment = Moment(episode_of(record), source.row, photo.view)
    checked: dict[str, Any] = {"kept": [], "dropped": {}}
    reasons: Counter[str] = Counter()
    try:
        said = chat.complete([user_message(prompt_of(moment), described.image(image))], max_tokens=1500).text
        texts = parsed_texts(said)
    except RefusedError:
        texts, reasons["refused"] = [], 1
    except BetterError as error:
        if not isinstance(error, RecordError):
            raise
        texts, reasons["not in the requested form"] = [], 1
    facts = facts_of(moment)
    for text in texts:
        reason = why_dropped(text, moment, facts)
        if reason is None:
            checked["kept"].append(_line(image, text, source))
        else:
            reasons[reason] += 1
    return {"version": 2, **checked, "dropped": dict(reasons)}


def _read(file: Path) -> _Kept:
    """Return the stored texts about one image.

    Raises:
        RecordError: If the file cannot be read or is malformed.
    """
    cure = "Move the file elsewhere and run the same command again, which asks about the image again"
    data = read_bounded(file, max_bytes=_MAX_BYTES, cure=cure, raises=RecordError)
    form = open_seal(data, where=str(file), cure=cure, raises=RecordError, since=("version", 2))
    form.pop("version", None)
    return read_form(_DESCRIBED, form, where=str(file), cure=cure, raises=RecordError)


@strict_form
@dataclass(frozen=True, slots=True)
class _Kept:
    """Stored texts of a model about one image, with the number of dropped texts for each reason."""

    kept: list[dict[str, Any]]
    dropped: dict[str, Annotated[int, Field(ge=0, lt=1 << 31)]]


_DESCRIBED = TypeAdapter(_Kept)
_MAX_BYTES, _CURE = 1 << 24, "Delete it and ask again"


def prompt_of(moment: Moment) -> str:
    """Return the prompt that asks a model about an image."""
    names = ", ".join(sorted({*moment.single, *moment.episode.vocabulary}))
    language = "\n".join(f'- "{says}": {meaning}' for says, meaning in CLAIMS.items())
    return (
        f"Things that may or may not be in this image: {names}.\n"
        "Write up to two descriptions of one or two sentences, and up to four questions with short answers, about what "
        "the image shows. Call things by exactly these names. For each text list every claim on which it rests, in "
        f"this language, with X and Y among these names:\n{language}\n"
        'Answer with JSON only: {"texts": [{"question": "" or the question, "text": the description or the answer as a '
        'whole sentence, "claims": [{"x": X, "says": one of the claims, "y": Y or ""}]}]}'
    )


def parsed_texts(said: str) -> list[ModelText]:
    """Return the texts in a model's reply. The reply may be inside a Markdown code fence.

    Raises:
        RecordError: If the reply does not have the requested form.
    """
    found = re.search(r"\{.*\}", said, flags=re.DOTALL)
    form = found[0] if found else said
    return read_form(_REPLY, form, where="reply", cure="Ask again", raises=RecordError).texts


Facts = Mapping[tuple[str, str, str], bool]


def facts_of(moment: Moment) -> Facts:
    """Return all claims about a moment that can be decided from the recorded state, mapped to their truth values."""
    facts: dict[tuple[str, str, str], bool] = {}
    for c in candidates_of(moment):
        for claim, truth in _claims_of(c):
            facts[claim] = truth
    return facts


def _claims_of(c: Candidate) -> list[tuple[tuple[str, str, str], bool]]:
    """Return the claims that follow from the answer to a question, each with its truth value."""
    holds = c.answer == "Yes"
    match c.family:
        case "is it there":
            return [((c.group[0], "is visible", ""), holds), ((c.group[0], "is absent", ""), not holds)]
        case "side in image":
            side, a, b = c.group
            other = "left" if side == "right" else "right"
            return [((a, f"is {side} of", b), holds), ((b, f"is {other} of", a), holds)]
        case "closer to camera":
            a, b = c.group
            return [((a, "is closer than", b), c.answer == a), ((b, "is closer than", a), c.answer == b)]
        case "is it in" if c.words["where"].startswith("in the "):
            target = c.words["where"].removeprefix("in the ")
            return [((c.group[0], "is in", target), holds), ((c.group[0], "is not in", target), not holds)]
        case "is it on":
            return [((c.group[0], "is on", c.group[1]), holds)]
        case "is it held":
            return [((c.group[0], "is held", ""), holds), ((c.group[0], "is not held", ""), not holds)]
        case "is it open":
            return [((c.group[0], "is open", ""), holds), ((c.group[0], "is shut", ""), not holds)]
        case _:
            return []


def why_dropped(text: ModelText, moment: Moment, facts: Facts) -> str | None:
    """Return the reason for dropping a text, or None if the state proves all its claims."""
    if not text.claims or not text.text.strip():
        return "without a claim"
    for claim in text.claims:
        truth = facts.get((claim.x, claim.says, claim.y))
        if truth is None:
            return "cannot be decided from the state"
        if not truth:
            return "false"
    named = {name for claim in text.claims for name in (claim.x, claim.y) if name}
    rest = f" {text.question} {text.text} ".lower()
    for name in sorted({*moment.kinds, *moment.episode.vocabulary, *moment.episode.foreign}, key=len, reverse=True):
        for spelling in dict.fromkeys((definite(name).removeprefix("the "), name)):
            if re.search(rf"(?<!\w){re.escape(spelling)}(?!\w)", rest):
                if name not in named:
                    return "names objects without a claim"
                rest = re.sub(rf"(?<!\w){re.escape(spelling)}(?!\w)", " ", rest)
    for phrase in _FREE:
        rest = rest.replace(phrase, " ")
    words = set(re.findall(r"[a-z-]+", rest))
    said = {claim.says for claim in text.claims}
    if any(word in words and not said & set(needed) for word, needed in _WORDS.items()):
        return "contains words without a claim"
    return "contains words that cannot be checked" if words & _UNCHECKED or re.search(r"\d", rest) else None


def _line(image: str, text: ModelText, source: FrameSource) -> dict[str, Any]:
    """Return a text in LLaVA's conversation format."""
    asked = text.question.strip() or "Describe what you see in the image."
    identifier = f"{hash_number(image, asked, text.text):016x}"
    claims: Sequence[Sequence[str]] = [[c.x, c.says, c.y] for c in text.claims]
    return {
        "id": identifier,
        "image": image,
        "conversations": [
            {"from": "human", "value": f"<image>\n{asked}"},
            {"from": "gpt", "value": text.text.strip()},
        ],
        "claims": claims,
        "source": [source.task, source.condition, source.seed, source.row, source.camera],
    }
