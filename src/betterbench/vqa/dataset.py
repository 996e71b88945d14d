"""Creation of question sets from the records of a run.

The creation can be interrupted and resumed. Interruptions do not change any byte of the resulting set.

While a set is being made, ``candidates/`` contains the possible questions about each trial. When all trials have been
processed, questions are selected over all trials and written, and temporary files are removed. ``summary.json`` is
written last. Both ``summary.json`` and ``set.json`` contain checksums. ``summary.json`` also contains the hashes of
questions and images, which are checked when a set is read.
"""

from __future__ import annotations

import gzip
import hashlib
import io
import json
import shutil
import zlib
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from pydantic import TypeAdapter

from betterbench.errors import (
    InvalidInputError,
    RecordError,
    RunConflictError,
    UnknownNameError,
    one_line,
    require_between,
)
from betterbench.interface.state import FrameView
from betterbench.jobs import OnCount, counts, in_threads, job_folder, run_items, write_durably
from betterbench.jobs.conflict import require_free, require_same
from betterbench.jobs.durable import on_disk
from betterbench.jobs.places import require_inside
from betterbench.json_form import (
    dump_json,
    open_seal,
    open_sealed_lines,
    read_bounded,
    read_form,
    say_unsealed,
    sealed_form,
    sealed_lines,
)
from betterbench.quoting import json_line
from betterbench.records import Record, RunFolder
from betterbench.records.tables import table_bytes
from betterbench.tasks import TrialId, stream
from betterbench.tasks.randomness import FIRST_DEMONSTRATION_SEED
from betterbench.vqa.balance import Chosen, choose_balanced, thin
from betterbench.vqa.blind import Baseline, baselines
from betterbench.vqa.difficulty import difficulty_of
from betterbench.vqa.episode import episode_of, rows_to_ask
from betterbench.vqa.moment import Moment
from betterbench.vqa.phrasings import phrase
from betterbench.vqa.question import (
    CANDIDATE,
    QUESTION,
    Candidate,
    Form,
    FrameSource,
    Question,
    QuestionType,
    hash_number,
)
from betterbench.vqa.types import candidates_of

SET_SCHEMA_VERSION = 6
"""Version of the files and questions of a set. A set with a different version cannot be continued.

Version 6 states the direction of cutlery in the steps at a plate. In version 5, each answer occurs equally often in
each phrasing. Version 4 has the boxes of all objects of a question. Version 3 has new phrasings and balances the kinds
of questions within each type. Sets of all versions can be read. Sets of version 1 have no checksums and are read with a
warning.
"""

CAMERAS = ("front", "wrist", "left_shoulder", "right_shoulder")
"""Cameras of the images. Questions do not name the camera, because its name could reveal positions in the image."""

MOST_QUESTIONS, MOST_FRAMES = 10_000_000, 100_000
"""Maximum number of questions in a set, and maximum number of frames per trial."""
SET_NAME = "set.json"
"""Name of the file that describes a question set."""
SIZES_PX = 32, 4096
"""Minimum and maximum side length of the images [pixel]."""

_MAX_BYTES = 1 << 30
_MAX_CANDIDATE_BYTES = 1 << 28
"""Maximum size of one trial's candidates after unpacking [bytes]."""
_CURE = "Make the set again in a new folder"
_ANEW = "Delete the file and run the same command again"


class Photo(Protocol):
    """Rendered image, with data about the objects that are visible in it."""

    @property
    def jpeg(self) -> bytes:
        """The image as a JPEG file."""

    @property
    def view(self) -> FrameView:
        """Objects that are visible in the image, and the camera."""


class PhotoSource(Protocol):
    """Source of images of recorded trials. The images are rendered on demand, or were rendered earlier."""

    def photo(self, record: Record, row: int, camera: str) -> Photo:
        """Return the image from a camera at a row of a record, with the objects that are visible in it."""

    def stop(self) -> None:
        """Stop all rendering threads soon, by raising an error in each of them."""


OpenPhotos = Callable[[], AbstractContextManager[PhotoSource]]


def require_size(size: int) -> None:
    """Check that an image size is in range.

    Raises:
        InvalidInputError: If the size is out of range.
    """
    require_between("--size", size, *SIZES_PX)


@dataclass(frozen=True, slots=True)
class SetOptions:
    """Options of a question set.

    Attributes:
        questions: Approximate number of questions, or 0 for the largest balanced set.
        frames: Number of frames per trial, or 0 for all frames. The trial is divided into this number of equally long
            parts, and one frame is taken from each.
        cameras: Cameras of the images.
        size: Side of the images [pixel].
        quality: Render quality of the images.
        seed: Seed for choosing frames, questions and phrasings.
        types: Types of questions.
        tasks: Tasks whose trials are used. Empty for all tasks.
    """

    questions: int = 10_000
    frames: int = 8
    cameras: tuple[str, ...] = CAMERAS
    size: int = 256
    quality: str = "standard"
    seed: int = 0
    types: tuple[QuestionType, ...] = tuple(QuestionType)
    tasks: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check that the numbers are in range.

        Raises:
            InvalidInputError: If a number is out of range.
        """
        require_between("--questions", self.questions, 0, MOST_QUESTIONS)
        require_between("--frames", self.frames, 0, MOST_FRAMES)
        require_size(self.size)


@dataclass(frozen=True, slots=True)
class QuestionSet:
    """Question set in a folder.

    Attributes:
        path: Folder of the set.
        purpose: "test" if the records have evaluation seeds, so that the set must not be used for training. Otherwise
            "training".
        questions: The questions.
        baselines: Number of questions of each type that are answered correctly without the images.
        sha256: SHA-256 of ``questions.jsonl``.
        records: SHA-256 of the record of each trial that was used, by trial name. Empty for older sets.
        images: SHA-256 of each image, by path. Empty for older sets.
    """

    path: Path
    purpose: str
    questions: tuple[Question, ...]
    baselines: tuple[Baseline, ...]
    sha256: str
    records: Mapping[str, str] = field(default_factory=dict)
    images: Mapping[str, str] = field(default_factory=dict)

    def image(self, place: str) -> bytes:
        """Return an image of the set as a JPEG file.

        Raises:
            RecordError: If the image is missing or was changed.
            InvalidInputError: If a link leads out of the set.
        """
        file = self.path / place
        require_inside(file, self.path)
        data = read_bounded(file, max_bytes=_MAX_BYTES, cure=_CURE, raises=RecordError)
        known = self.images.get(place, "") if self.images else None
        if known not in (None, hashlib.sha256(data).hexdigest()):
            raise RecordError(f"{file} was changed after the question set was made. {_CURE}.")
        return data

    def is_about(self, trial: TrialId, record: str) -> bool:
        """Return whether the questions of the set about a trial were made from a record with this SHA-256.

        The result is also True if the set does not store the hashes of its records.
        """
        return self.records.get(str(trial), record) == record

    def require_about(self, run: RunFolder) -> None:
        """Check that the set was made from the same records that the run contains now.

        Raises:
            InvalidInputError: If a record of the run differs from the record from which the set was made.
        """
        for entry in run.entries():
            if entry.status == "done" and not self.is_about(entry.key, run.record_digest(entry)):
                problem = f"the record of {entry.key} in {run.path} is not the record from which the set was created"
                raise InvalidInputError(str(self.path), problem, "Use the set that `better vqa` created from this run")

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict that describes the set without its questions."""
        counts: dict[str, dict[str, int]] = {"type": {}, "form": {}, "difficulty": {}, "family": {}, "task": {}}
        for q in self.questions:
            for name, value in (*((n, getattr(q, n)) for n in list(counts)[:4]), ("task", q.source.task)):
                counts[name][str(value)] = counts[name].get(str(value), 0) + 1
        return {
            "schema_version": SET_SCHEMA_VERSION,
            "questions": len(self.questions),
            "images": len({q.image for q in self.questions}),
            "purpose": self.purpose,
            "sha256": self.sha256,
            "counts": {name: dict(sorted(found.items())) for name, found in counts.items()},
            "baselines": [b.to_json() for b in self.baselines],
        }


def make_set(
    run: RunFolder,
    out: Path,
    options: SetOptions,
    *,
    open_photos: OpenPhotos,
    workers: int = 1,
    on_progress: OnCount | None = None,
) -> QuestionSet:
    """Make a question set from the records of a run, or continue one that was interrupted.

    Args:
        run: The run.
        out: Folder of the set.
        options: Options of the set.
        open_photos: Function that opens a source of images for a worker.
        workers: Number of trials that are processed in parallel. The set does not depend on it.
        on_progress: Called with the number of trials done and the number of trials planned.

    Raises:
        RunConflictError: If the folder contains a different set or other files, or if another process is writing to it.
        InvalidInputError: If the run has no records, or mixes seeds of demonstrations and of evaluation.
        RecordError: If a record or a scene cannot be read.
        StorageError: If the disk is full, or if the folder was removed or moved in the meantime.
    """
    trials = trials_of(run, options.tasks)
    purpose = purpose_of(trials)
    records = records_of(run, trials)
    plan = {"kind": "balanced", "run": run_digest(run), "records": records}
    plan |= {"options": asdict(options), "purpose": purpose}
    out = out.absolute()
    with on_disk(out), begun_set(out, plan) as done:
        if done:
            return read_set(out)
        _survey(run, out, trials, options, open_photos=open_photos, workers=workers, on_progress=on_progress)
        candidates = (c for trial in trials for c in _read_candidates(_shard(out, trial)))
        chosen = choose_balanced(candidates, count=options.questions, seed=options.seed)
        made = [_question(c, options) for c in chosen]
        order = sorted(range(len(made)), key=lambda i: made[i].id)
        questions = [made[i] for i in order]
        found = baselines(questions, [chosen[i].turn for i in order])
        return replace(write_set(out, questions, found, purpose), records=records)


def trials_of(run: RunFolder, tasks: Sequence[str] = ()) -> list[TrialId]:
    """Return the trials of a run that have a record, sorted.

    If ``tasks`` are given, only trials of these tasks are returned.

    Raises:
        InvalidInputError: If no trial has a record.
        UnknownNameError: If one of the tasks has no trial with a record.
    """
    done = sorted(e.key for e in run.entries() if e.status == "done")
    if not done:
        raise InvalidInputError(str(run.path), "has no finished trials", "Use a run with finished trials")
    known = {trial.task for trial in done}
    for task in tasks:
        if task not in known:
            raise UnknownNameError("task of the run's finished trials", task, known)
    return [trial for trial in done if not tasks or trial.task in tasks]


def purpose_of(trials: Sequence[TrialId]) -> str:
    """Return the permitted use of the questions: "test" or "training", depending on the seeds of the trials.

    Raises:
        InvalidInputError: If the trials mix seeds of demonstrations and of evaluation.
    """
    purposes = {"training" if t.seed >= FIRST_DEMONSTRATION_SEED else "test" for t in trials}
    if len(purposes) > 1:
        raise InvalidInputError(
            "seeds",
            "mixes demonstration seeds and evaluation seeds",
            "Make a separate run and a separate set for each kind of seed",
        )
    return purposes.pop()


def run_digest(run: RunFolder) -> str:
    """Return a hash of a run's plan, which identifies the run."""
    return hashlib.sha256(dump_json(dict(run.plan))).hexdigest()


def records_of(run: RunFolder, trials: Collection[TrialId]) -> dict[str, str]:
    """Return the SHA-256 of the record of each given trial, by trial name."""
    wanted = set(trials)
    return {str(e.key): run.record_digest(e) for e in run.entries() if e.key in wanted and e.status == "done"}


@contextmanager
def begun_set(out: Path, plan: dict[str, Any]) -> Iterator[bool]:
    """Context manager that locks the folder of a set, and yields whether the set is already complete.

    The plan of the set is written if it does not exist yet. Raises the same errors as :func:`make_set`.
    """
    file, plan = out / SET_NAME, json.loads(dump_json({"schema_version": SET_SCHEMA_VERSION, **plan}))
    require_free(out, "set", file=SET_NAME)
    with job_folder(out):
        _require_same(file, plan)
        write_durably(file, json.dumps(sealed_form(plan), indent=1, sort_keys=True).encode() + b"\n")
        done = (out / "summary.json").exists()
        if done:
            shutil.rmtree(out / "candidates", ignore_errors=True)
        yield done


def _require_same(file: Path, plan: dict[str, Any]) -> None:
    """Check that the folder does not contain a set with a different plan or a different version.

    Raises:
        RunConflictError: If the folder contains such a set.
    """
    stored = _sealed(file) if file.exists() else plan
    version = stored.get("schema_version")
    if version != SET_SCHEMA_VERSION:
        raise RunConflictError(
            f"{file.parent}: the set in this folder has version {one_line(repr(version), most=40)}, but this "
            f"betterbench makes sets of version {SET_SCHEMA_VERSION}. Choose a different folder."
        )
    require_same(file.parent, stored, plan, "set", where="set")


def _sealed(file: Path) -> dict[str, Any]:
    data = read_bounded(file, max_bytes=_MAX_BYTES, cure=_CURE, raises=RecordError)
    return open_seal(data, where=str(file), cure=_CURE, raises=RecordError, since=("schema_version", 2))


def _survey(
    run: RunFolder,
    out: Path,
    trials: Sequence[TrialId],
    options: SetOptions,
    *,
    open_photos: OpenPhotos,
    workers: int,
    on_progress: OnCount | None,
) -> None:
    """Write the images of each trial and the possible questions about them.

    Trials that are already done are skipped.
    """
    look = partial(_look_at, run, out, options)
    run_items(
        trials,
        is_done=lambda trial: _shard(out, trial).exists(),
        work=lambda waiting: in_threads(waiting, look, workers=workers, open_resource=open_photos),
        on_progress=counts(on_progress),
    )


def _look_at(run: RunFolder, out: Path, options: SetOptions, source: PhotoSource, trial: TrialId) -> None:
    """Write the images of a trial and the possible questions about these images."""
    record = run.read_record(trial.task, trial.condition, trial.seed)
    episode = episode_of(record)
    draw = stream(trial.task, trial.seed, f"vqa:{options.seed}:{trial.condition}")
    found: list[Candidate] = []
    for row in rows_to_ask(episode.rows, options.frames, draw):
        for camera in options.cameras:
            photo = source.photo(record, row, camera)
            candidates = list(candidates_of(Moment(episode, row, photo.view), options.types))
            if candidates:
                write_durably(out / image_path(candidates[0].source), photo.jpeg)
                found += candidates
    write_durably(_shard(out, trial), candidates_bytes(thin(found, seed=options.seed)))


def candidates_bytes(candidates: Iterable[Candidate]) -> bytes:
    """Serialize candidates to compressed lines with a checksum. Identical candidates produce identical bytes."""
    buffer = io.BytesIO()
    with gzip.GzipFile(fileobj=buffer, mode="wb", mtime=0, compresslevel=6) as packed:
        packed.write(sealed_lines(b"".join(dump_json(c.to_json()) + b"\n" for c in candidates)))
    return buffer.getvalue()


def image_path(source: FrameSource) -> str:
    """Return the path at which a set stores the image of a frame."""
    return f"images/{source.task}/{source.condition}/{source.seed}_{source.row:05d}_{source.camera}.jpg"


def _shard(out: Path, trial: TrialId) -> Path:
    return out / "candidates" / trial.task / trial.condition / f"{trial.seed}.jsonl.gz"


def _read_candidates(file: Path) -> Iterator[Candidate]:
    raw = read_bounded(file, max_bytes=_MAX_BYTES, cure=_ANEW, raises=RecordError)
    try:
        with gzip.GzipFile(fileobj=io.BytesIO(raw)) as unpacked:
            data = unpacked.read(_MAX_CANDIDATE_BYTES + 1)
    except (OSError, EOFError, ValueError, zlib.error) as error:
        raise RecordError(f"{file} cannot be read ({one_line(error, most=200)}). {_ANEW}.") from error
    if len(data) > _MAX_CANDIDATE_BYTES:
        raise RecordError(f"{file} unpacks to more than {_MAX_CANDIDATE_BYTES} bytes. {_ANEW}.")
    for line in open_sealed_lines(data, where=str(file), cure=_ANEW, raises=RecordError):
        yield read_form(CANDIDATE, line, where=str(file), cure=_ANEW, raises=RecordError, sealed=True)


def _question(chosen: Chosen, options: SetOptions) -> Question:
    """Complete a selected question with its text and options.

    Questions with the same group and the same turn get the same phrasing. Each answer occurs once among them, so the
    phrasing does not reveal the answer.
    """
    candidate, answers = chosen.candidate, chosen.answers
    spatial = candidate.form in (Form.BOX, Form.POINT)
    identifier = candidate.id(options.seed)
    shown = sorted(answers, key=lambda a: hash_number("option", identifier, a)) if candidate.form is Form.CHOICE else ()
    return finished(
        candidate,
        identifier=identifier,
        text=phrase(candidate, number=hash_number("phrasing", options.seed, candidate.key, chosen.turn)),
        options=tuple(shown),
        size=options.size,
        chance=None if spatial else 1.0 / len(answers),
    )


def finished(
    candidate: Candidate,
    *,
    identifier: str,
    text: str,
    options: tuple[str, ...],
    size: int,
    chance: float | None,
    role: str | None = None,
) -> Question:
    """Create the final question from a candidate by adding a wording and options.

    For the arguments, see :class:`Question`.
    """
    c = candidate
    tags = tuple(sorted(set(c.tags)))
    return Question(
        id=identifier, type=c.type, form=c.form, family=c.family, text=text[:1].upper() + text[1:], options=options,
        answer=c.answer, image=image_path(c.source), width=size, height=size, difficulty=difficulty_of(tags), tags=tags,
        objects=c.objects, group=c.key, words=c.words, chance=chance, source=c.source, box=c.box, runs=c.runs,
        role=role, boxes=c.boxes,
    )  # fmt: skip


def write_set(out: Path, questions: Sequence[Question], found: Sequence[Baseline], purpose: str) -> QuestionSet:
    """Write the files of a set, remove temporary files, and return the set.

    Raises:
        InvalidInputError: If there are no questions.
    """
    if not questions:
        raise InvalidInputError(
            str(out), "no balanced questions are possible", "Use more trials, variations, frames or cameras"
        )
    lines = b"".join(json_line(dump_json(_conversation(q))) for q in questions)
    images = sorted({q.image for q in questions})
    digests = {image: _digest_of(out / image) for image in images if (out / image).is_file()}
    made = QuestionSet(out, purpose, tuple(questions), tuple(found), hashlib.sha256(lines).hexdigest(), images=digests)
    write_durably(out / "questions.jsonl", lines)
    rows = [_row(q) for q in questions]
    write_durably(out / "questions.parquet", table_bytes(COLUMNS, rows, {"betterbench": f"vqa {SET_SCHEMA_VERSION}"}))
    wanted = {q.image for q in questions}
    require_inside(out / "images", out)  # files in this folder are deleted below
    for file in sorted((out / "images").rglob("*.jpg")):
        if file.relative_to(out).as_posix() not in wanted:
            file.unlink()
    for folder in sorted((p for p in (out / "images").rglob("*") if p.is_dir()), reverse=True):
        if not any(folder.iterdir()):
            folder.rmdir()
    summary = sealed_form({**made.to_json(), "image_sha256": digests})
    write_durably(out / "summary.json", json.dumps(summary, indent=1, sort_keys=True).encode() + b"\n")
    shutil.rmtree(out / "candidates", ignore_errors=True)
    return made


def _digest_of(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def _conversation(question: Question) -> dict[str, Any]:
    """Return a question in LLaVA's conversation format. All other fields are under the key "betterbench"."""
    return {
        "id": question.id,
        "image": question.image,
        "conversations": [
            {"from": "human", "value": f"<image>\n{question.prompt}"},
            {"from": "gpt", "value": question.reply},
        ],
        "betterbench": question.to_json(),
    }


COLUMNS = {
    "id": "text", "image": "text", "type": "text", "form": "text", "family": "text", "question": "text",
    "options": "texts", "answer": "text", "difficulty": "text", "tags": "texts", "objects": "texts", "group": "texts",
    "chance": "number", "role": "text", "task": "text", "condition": "text", "seed": "integer", "row": "integer",
    "time_s": "number", "camera": "text", "width": "integer", "height": "integer", "box": "integers",
    "runs": "integers",
}  # fmt: skip
"""Columns of ``questions.parquet``, each with the type of its values."""


def _row(question: Question) -> dict[str, Any]:
    form = question.to_json()
    return {**form, **form["source"], "question": question.text, "type": question.type.value}


@dataclass(frozen=True, slots=True)
class _Line:
    betterbench: Question


@dataclass(frozen=True, slots=True)
class _Summary:
    purpose: str
    sha256: str
    baselines: tuple[Baseline, ...]
    image_sha256: dict[str, str] = field(default_factory=dict)


_LINE, _SUMMARY = TypeAdapter(_Line), TypeAdapter(_Summary)


def read_set(folder: Path) -> QuestionSet:
    """Read a complete question set.

    Raises:
        RecordError: If the folder contains no complete set, or if a file is missing, damaged or malformed.
    """
    if not (folder / "summary.json").exists():
        raise RecordError(
            f"{folder} contains no complete question set. Create one with `better vqa RUN --out {folder}`."
        )
    form = _sealed(folder / "summary.json")
    summary = read_form(_SUMMARY, form, where=str(folder / "summary.json"), cure=_CURE, raises=RecordError)
    file = folder / "questions.jsonl"
    data = read_bounded(file, max_bytes=_MAX_BYTES, cure=_CURE, raises=RecordError)
    if hashlib.sha256(data).hexdigest() != summary.sha256:
        raise RecordError(f"{file} was changed after it was written. {_CURE}.")
    questions = tuple(
        read_form(_LINE, line, where=f"{file}, line {n}", cure=_CURE, raises=RecordError).betterbench
        for n, line in enumerate(data.splitlines(), start=1)
    )
    found, records = summary.baselines, _records(folder / SET_NAME)
    return QuestionSet(folder, summary.purpose, questions, found, summary.sha256, records, summary.image_sha256)


def _records(file: Path) -> dict[str, str]:
    """Return the hashes of the records from which a set was made, or an empty dict if they are not stored."""
    if not file.exists():
        say_unsealed(str(file.parent))
    form = _sealed(file) if file.exists() else {}
    records = form.get("records", {})
    if not isinstance(records, dict) or not all(isinstance(value, str) for value in records.values()):
        raise RecordError(f"{file}: the field 'records' is not a mapping from trials to hashes. {_CURE}.")
    return records


__all__ = ["CAMERAS", "QUESTION", "OpenPhotos", "PhotoSource", "QuestionSet", "SetOptions", "make_set", "read_set"]
