"""Questions about the decisive moments in the trials of a run.

In a failed trial, the decisive moment is the first wrong decision according to the diagnosis. In a successful trial, it
is the first attempt. Questions about the right target, its position, finished steps and the presence of objects use the
frame at which this decision began. The question about the object at the gripper uses the frame of the attempt. Each
question is asked twice, with different wording and a different order of the options, because guesses are rarely right
both times.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from betterbench.diagnosis import RunDiagnosis, TrialDiagnosis
from betterbench.diagnosis.analysis.episode_analysis import EpisodeAnalysis, analyze_episode
from betterbench.errors import InvalidInputError, RecordError
from betterbench.interface.state import ObjectInfo
from betterbench.jobs import OnCount, counts, run_items, write_durably
from betterbench.jobs.durable import on_disk
from betterbench.json_form import dump_json, open_sealed_lines, read_bounded, read_form, sealed_lines
from betterbench.quoting import json_line
from betterbench.records import RunFolder
from betterbench.tasks import Expected, Kind, Label, TrialId, training_distribution_of
from betterbench.vqa.blind import baselines
from betterbench.vqa.dataset import (
    OpenPhotos,
    Photo,
    PhotoSource,
    QuestionSet,
    begun_set,
    finished,
    image_path,
    purpose_of,
    read_set,
    records_of,
    require_size,
    run_digest,
    trials_of,
    write_set,
)
from betterbench.vqa.episode import Episode, episode_of
from betterbench.vqa.moment import Moment
from betterbench.vqa.nouns import definite, indefinite
from betterbench.vqa.phrasings import phrase
from betterbench.vqa.question import QUESTION, Candidate, Form, Question, QuestionDraft, QuestionType, hash_number
from betterbench.vqa.types.execution import EVERYTHING, NOTHING_LEFT, NOTHING_YET, done_words, evidence_of, step_words
from betterbench.vqa.types.grounding import written
from betterbench.vqa.types.relation import yes

TIMES_ASKED = 2
"""Number of times that each question is asked, each time with different wording."""
MOST_OPTIONS = 6
"""Maximum number of boxes or objects that are offered as options."""
_MAX_BYTES = 1 << 26
SETTLE_S = 0.5
"""Time from a release until the gripper has left the object and the next decision begins [s]."""

ASKED, WHERE, UNDER, EXISTS, DONE = "asked", "where", "under", "exists", "done"
ROLES = (ASKED, WHERE, UNDER, EXISTS, DONE)
"""Roles of questions about a decisive moment.

- ``ASKED``: which box contains the object that must be picked or moved now.
- ``WHERE``: which box contains the named object.
- ``UNDER``: what kind of object is at the gripper.
- ``EXISTS``: whether an object is present.
- ``DONE``: which steps are finished.
"""

DECIDING: dict[Label, tuple[str, ...]] = {
    Label.LEXICAL_KINEMATIC_SHORTCUT: (ASKED, WHERE),
    Label.VISUAL_LAYOUT_BIAS: (ASKED, WHERE),
    Label.WRONG_OBJECT: (ASKED, WHERE),
    Label.SEMANTIC_FEATURE_COLLAPSE: (UNDER, EXISTS),
    Label.BEHAVIORAL_INERTIA: (ASKED, DONE),
    Label.CAUSAL_CONFUSION: (ASKED, DONE),
    Label.ORDER_VIOLATION: (ASKED, DONE),
    Label.PHASE_CONFLICT: (ASKED, DONE),
    Label.EARLY_HALT: (ASKED, DONE),
    Label.EXECUTION_FAILURE: (ASKED, WHERE),
    Label.TIMEOUT: (ASKED, DONE),
    Label.SUCCESS: (ASKED, WHERE),
    Label.CORRECT_FREEZE: (DONE,),
    Label.CORRECT_REFUSAL: (EXISTS,),
}
"""Roles of the questions that show whether the model knew the right decision, by label of the trial.

After a grasp of a look-alike, the questions ask for the kind of this object. After a shortcut, they ask for the
requested object and its position. After a wrong step, they ask for the current step and the finished steps.
"""


@dataclass(frozen=True, slots=True)
class DecisiveOptions:
    """Options of a set of questions about decisive moments.

    Attributes:
        cameras: Cameras to try in order, until one of them shows the objects of a question.
        size: Side of the images [pixel].
        quality: Render quality of the images.
        seed: Seed for choosing the wordings and the order of the options.
        tasks: Tasks whose trials are used. Empty for all tasks.
        failures_only: Whether only failed trials are used.
    """

    cameras: tuple[str, ...] = ("front", "left_shoulder", "right_shoulder", "wrist")
    size: int = 256
    quality: str = "standard"
    seed: int = 0
    tasks: tuple[str, ...] = ()
    failures_only: bool = False

    def __post_init__(self) -> None:
        """Check that the image size is in range.

        Raises:
            InvalidInputError: If the size is out of range.
        """
        require_size(self.size)


def make_decisive_set(
    run: RunFolder,
    diagnosis: RunDiagnosis,
    out: Path,
    options: DecisiveOptions,
    *,
    open_photos: OpenPhotos,
    on_progress: OnCount | None = None,
) -> QuestionSet:
    """Make the question set about the decisive moments of a run, or continue one that was interrupted.

    Raises the same errors as :func:`~betterbench.vqa.dataset.make_set`.
    """
    trials = trials_of(run, options.tasks)
    records = records_of(run, trials)
    plan = {"kind": "decisive", "run": run_digest(run), "records": records}
    plan |= {"options": asdict(options), "purpose": purpose_of(trials)}
    out = out.absolute()
    told = {t.trial_id: t for t in diagnosis.trials if t.record is not None}
    chosen = [told[t] for t in trials if t in told and told[t].kind is not Kind.SYSTEM]
    if options.failures_only:
        chosen = [t for t in chosen if t.kind is not Kind.NONE]
    if not chosen:
        raise InvalidInputError(
            str(run.path), "no trial of this run failed", "Leave out --failures-only to ask about all trials"
        )
    with on_disk(out), begun_set(out, plan) as done:
        if done:
            return read_set(out)
        with open_photos() as source:
            run_items(
                [t.trial_id for t in chosen],
                is_done=lambda trial: _file(out, trial).exists(),
                work=lambda waiting: ((trial, _about(run, told[trial], out, options, source)) for trial in waiting),
                keep=lambda found: _keep(_file(out, found[0]), found[1]),
                on_progress=counts(on_progress),
            )
        ordered = sorted((q for t in chosen for q in _read(_file(out, t.trial_id))), key=lambda q: q.id)
        return replace(
            write_set(out, ordered, baselines(ordered, folds_of(ordered)), purpose_of(trials)), records=records
        )


def folds_of(questions: Sequence[Question]) -> list[int]:
    """Return the cross-validation fold of each question. All questions about one trial are in the same fold."""
    return [hash_number("fold", q.source.task, q.source.condition, q.source.seed) % 1000 for q in questions]


def _file(out: Path, trial: TrialId) -> Path:
    """Return the path of the file with the questions about one trial."""
    return out / "candidates" / trial.task / trial.condition / f"{trial.seed}.jsonl"


def _keep(file: Path, questions: Sequence[Question]) -> None:
    write_durably(file, sealed_lines(b"".join(json_line(dump_json(q.to_json())) for q in questions)))


def _read(file: Path) -> list[Question]:
    cure = "Delete the file and run the same command again"
    data = read_bounded(file, max_bytes=_MAX_BYTES, cure=cure, raises=RecordError)
    lines = open_sealed_lines(data, where=str(file), cure=cure, raises=RecordError)
    return [read_form(QUESTION, line, where=str(file), cure=cure, raises=RecordError, sealed=True) for line in lines]


@dataclass(frozen=True, slots=True)
class _Asked:
    """Draft of a question, with its type, its role, its options, and its moment in the trial."""

    draft: QuestionDraft
    type: QuestionType
    role: str
    options: tuple[str, ...]
    moment: Moment


def _about(
    run: RunFolder, trial: TrialDiagnosis, out: Path, options: DecisiveOptions, source: PhotoSource
) -> list[Question]:
    """Return the questions about one trial, after writing the images that they need."""
    where = trial.trial_id
    record = run.read_record(where.task, where.condition, where.seed)
    episode = episode_of(record)
    condition = episode.resolved.condition
    analysis = analyze_episode(episode.trace, condition, training_distribution_of(episode.resolved.task))
    at, before = decisive_rows(episode, analysis, trial)
    photos: dict[tuple[int, str], Photo] = {}

    def moments(row: int) -> Iterator[Moment]:
        for camera in options.cameras:
            if (row, camera) not in photos:
                photos[row, camera] = source.photo(record, row, camera)
            yield Moment(episode, row, photos[row, camera].view)

    makers: list[Callable[[], _Asked | None]] = [
        lambda: _first(_asked(m, analysis) for m in moments(before)),
        lambda: _first(_where(m, analysis) for m in moments(before)),
        lambda: _first(_done(m) for m in moments(before)),
        lambda: _first(_exists(m, present=True) for m in moments(before)),
        lambda: _first(_exists(m, present=False) for m in moments(before)),
    ]
    if at is not None:
        row, thing = at
        makers.append(lambda: _first(_under(m, thing) for m in moments(row)))
    found = [asked for make in makers if (asked := make()) is not None]
    for asked in found:
        s = asked.moment.source
        write_durably(out / image_path(s), photos[s.row, s.camera].jpeg)
    return [q for asked in found for q in _twice(asked, options)]


def _first(found: Iterator[_Asked | None]) -> _Asked | None:
    return next((asked for asked in found if asked is not None), None)


def decisive_rows(
    episode: Episode, analysis: EpisodeAnalysis, trial: TrialDiagnosis
) -> tuple[tuple[int, int] | None, int]:
    """Return the row of a trial's decisive attempt, and the row where the policy began to decide.

    Returns:
        The row and the object index of the decisive attempt, or None if no object was attempted. The second value is
        the row where the decision began. This is the start of the trial, or the row where the gripper had left the
        previous object.
    """
    trace, rate = episode.trace, episode.record.metadata.control_rate_hz
    last = trace.rows - 1
    decided = min(last, max(0, round(trial.evidence.start_s * rate)))
    steps = [s for s in analysis.decisions if s.at is not None]
    if trial.success:
        chosen = steps[0] if steps else None
    else:
        chosen = next((s for s in steps if s.grasp.start >= decided - 1), None)
        chosen = chosen if chosen is not None and chosen.grasp.start <= decided + 1 else None
    row = chosen.grasp.start if chosen is not None else decided
    released = [g.release for g in episode.grasps if g.release <= row]
    before = min(row, max(released) + trace.steps(SETTLE_S)) if released else 0
    at = None if chosen is None or chosen.at is None else (chosen.grasp.start, chosen.at)
    return at, before


def _boxes(moment: Moment, wanted: Sequence[str]) -> tuple[ObjectInfo, tuple[str, ...]] | None:
    """Return a requested object and the boxes to choose from, with the box of this object first.

    Return None if the object is not clearly visible, or if there are no other objects.
    """
    things = [o for o in moment.objects if o.role in ("item", "distractor", "drawer") and moment.is_clear(o.name)]
    right = sorted((o for o in things if o.name in wanted), key=lambda o: (o.slot or "", o.kind))
    if not right or len(things) <= len(right):
        return None
    others = sorted((o for o in things if o.name not in wanted), key=lambda o: hash_number("among", o.kind, moment.row))
    shown = [right[0], *others[: MOST_OPTIONS - 1]]
    return right[0], tuple(written(moment.view.objects[o.name].box) for o in shown)


def _asked(moment: Moment, analysis: EpisodeAnalysis) -> _Asked | None:
    """Return the question that asks which of several boxes contains the object that must be picked up or moved now."""
    if moment.condition.expected is not Expected.SUCCEED:
        return _next(moment)
    found = _boxes(moment, [moment.objects[i].name for i in analysis.wanted(moment.row)])
    if found is None:
        return None
    thing, boxes = found
    text = moment.condition.instruction.text
    draft = QuestionDraft(
        Form.CHOICE, "box for next step", (text,), boxes[0], {"instruction": text}, (thing.name,),
        box=moment.view.objects[thing.name].box,
    )  # fmt: skip
    return _Asked(draft, QuestionType.EXECUTION, ASKED, boxes, moment)


def _next(moment: Moment) -> _Asked | None:
    """Return the question that asks for the next step, for a condition in which no step is left."""
    goals = moment.condition.instruction.subgoals
    if moment.condition.expected is not Expected.STAY_STILL:
        return None
    text = moment.condition.instruction.text
    options = (NOTHING_LEFT, *dict.fromkeys(step_words(moment, goal) for goal in goals))
    draft = QuestionDraft(Form.CHOICE, "what is next", (text,), NOTHING_LEFT, {"instruction": text})
    return _Asked(draft, QuestionType.EXECUTION, ASKED, options, moment)


def _where(moment: Moment, analysis: EpisodeAnalysis) -> _Asked | None:
    """Return the question that asks which of several boxes contains the requested object, given its name."""
    wanted = [moment.objects[i] for i in analysis.wanted(moment.row)]
    named = [o for o in wanted if o.kind in moment.single]
    found = _boxes(moment, [o.name for o in named[:1]])
    if found is None:
        return None
    thing, boxes = found
    words = {"thing": definite(thing.kind)}
    draft = QuestionDraft(
        Form.CHOICE, "box of named", (thing.kind,), boxes[0], words, (thing.name,),
        box=moment.view.objects[thing.name].box,
    )  # fmt: skip
    return _Asked(draft, QuestionType.GROUNDING, WHERE, boxes, moment)


def _under(moment: Moment, i: int) -> _Asked | None:
    """Return the question that asks which object is at the gripper."""
    thing = moment.objects[i]
    seen = moment.seen(thing.name)
    if seen is None or not moment.is_clear(thing.name):
        return None
    others = {k for k in (*moment.episode.vocabulary, *moment.kinds) if k != thing.kind}
    usual = moment.state.info.slot(thing.slot).trained_kinds if thing.slot is not None else ()
    near = [k for k in usual if k != thing.kind]
    rest = sorted(others - set(near), key=lambda k: hash_number("kind", k, moment.source))
    options = (thing.kind, *dict.fromkeys([*near, *rest]))[:4]
    words = {"box": written(seen.box)}
    draft = QuestionDraft(Form.CHOICE, "what is at gripper", options, thing.kind, words, (thing.name,), box=seen.box)
    return _Asked(draft, QuestionType.GROUNDING, UNDER, options, moment)


def _exists(moment: Moment, *, present: bool) -> _Asked | None:
    """Return the question that asks whether an object is present.

    If ``present`` is True, the question is about the requested object, otherwise about an absent object.
    """
    trace, goals = moment.episode.trace, moment.condition.instruction.subgoals
    if present:
        kinds = [moment.objects[i].kind for g in range(len(goals)) for i in trace.meant[g]]
        shown = [k for k in kinds if any(moment.is_clear(o.name) for o in moment.objects if o.kind == k)]
        kind = shown[0] if shown else None
    else:
        named = [g.reference.kind for g in goals if g.reference.kind is not None]
        absent = [k for k in (*named, *moment.episode.vocabulary) if moment.surely_absent(k)]
        foreign = sorted(moment.episode.foreign, key=lambda k: hash_number("absent", k, moment.source))
        kind = next((k for k in (*absent, *foreign) if moment.surely_absent(k)), None)
    if kind is None:
        return None
    tags = () if present else ("absent",)
    draft = QuestionDraft(Form.YES_NO, "is it there", (kind,), yes(present), {"thing": indefinite(kind)}, (), tags)
    return _Asked(draft, QuestionType.PREMISE, EXISTS, (), moment)


def _done(moment: Moment) -> _Asked | None:
    """Return the question that asks which steps of the instruction have already been done."""
    done = [bool(v) for v in moment.episode.record.subgoals[moment.row]]
    names = evidence_of(moment, done)
    if names is None:
        return None
    text, answer = moment.condition.instruction.text, done_words(moment, done)
    count = len(done)
    firsts = [done_words(moment, [i < n for i in range(count)]) for n in range(1, count)]
    singles = [done_words(moment, [i == n for i in range(count)]) for n in range(count)]
    options = tuple(dict.fromkeys((answer, NOTHING_YET, EVERYTHING, *firsts, *singles)))[:4]
    draft = QuestionDraft(Form.CHOICE, "what is done", (text,), answer, {"instruction": text}, names, ("over time",))
    return _Asked(draft, QuestionType.EXECUTION, DONE, options, moment)


def _twice(asked: _Asked, options: DecisiveOptions) -> Iterator[Question]:
    """Yield each wording of a question, with a different order of the options for each wording."""
    d = asked.draft
    candidate = Candidate(
        type=asked.type, form=d.form, family=d.family, group=d.group, bucket=d.answer, answer=d.answer, words=d.words,
        objects=d.objects, source=asked.moment.source, tags=d.tags, box=d.box,
    )  # fmt: skip
    first = hash_number("wording", candidate.id(options.seed))
    for number in range(TIMES_ASKED):
        told = replace(candidate, tags=(*candidate.tags, f"asked {number + 1} of {TIMES_ASKED}"))
        identifier = f"{candidate.id(options.seed)}-{asked.role}-{number + 1}"
        shown = sorted(asked.options, key=lambda o: hash_number("option", identifier, o))
        if number and shown and shown.index(d.answer) == _place(asked, candidate, options):
            shown = [*shown[1:], shown[0]]
        yield finished(
            told,
            identifier=identifier,
            text=phrase(candidate, number=first + number),
            options=tuple(shown),
            size=options.size,
            chance=1.0 / len(asked.options) if asked.options else 0.5,
            role=asked.role,
        )


def _place(asked: _Asked, candidate: Candidate, options: DecisiveOptions) -> int:
    """Return the index of the correct option in the first wording of a question."""
    identifier = f"{candidate.id(options.seed)}-{asked.role}-1"
    return sorted(asked.options, key=lambda o: hash_number("option", identifier, o)).index(asked.draft.answer)
