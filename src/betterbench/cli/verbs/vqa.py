"""``better vqa``: make questions about recorded frames, and score a model's answers against image-free guesses."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from betterbench.cli.console import OUT, print_json, progress_bar, say
from betterbench.errors import InvalidInputError
from betterbench.quoting import default_name

if TYPE_CHECKING:
    from betterbench.vqa.asking import Score
    from betterbench.vqa.dataset import QuestionSet, SetOptions
    from betterbench.vqa.decisive import DecisiveOptions

CoordinateNames = Literal[
    "pixels", "thousandths", "fractions", "thousandths-json", "thousandths-yx-json", "percent-xml"
]
QuestionTypes = Literal["grounding", "counting", "relation", "containment", "stacking", "state", "execution", "premise"]


@dataclass(frozen=True, slots=True)
class FrameOptions:
    """Options that select the frames, cameras and types of the questions in a set.

    Attributes:
        questions: Approximate number of questions; 0 for as many as can be balanced.
        frames: Number of frames per trial, one from each equal part of the trial's duration; 0 for every frame.
        cameras: Cameras whose images the questions are about.
        size: Side length of the images in pixels.
        quality: Render preset of the images (shadows and antialiasing).
        types: Types of question; all if not given.
        tasks: Tasks whose trials the questions are about; all if not given.
        seed: Seed for choosing frames, questions and phrasings.
        failures_only: With --run, leave out the trials that succeeded.
    """

    questions: int = 10_000
    frames: int = 8
    cameras: tuple[str, ...] = ("front", "wrist", "left_shoulder", "right_shoulder")
    size: int = 256
    quality: Literal["fast", "standard", "high"] = "standard"
    types: tuple[QuestionTypes, ...] = ()
    tasks: tuple[str, ...] = ()
    seed: int = 0
    failures_only: bool = False

    def balanced(self) -> SetOptions:
        """Return the options for a balanced question set."""
        from betterbench.vqa.dataset import SetOptions
        from betterbench.vqa.question import QuestionType

        types = tuple(QuestionType(t) for t in self.types) or tuple(QuestionType)
        frames = self.questions, self.frames, self.cameras, self.size
        return SetOptions(*frames, quality=self.quality, seed=self.seed, types=types, tasks=self.tasks)

    def decisive(self) -> DecisiveOptions:
        """Return the options for a question set about decisive moments."""
        from betterbench.vqa.decisive import DecisiveOptions

        return DecisiveOptions(self.cameras, self.size, self.quality, self.seed, self.tasks, self.failures_only)


@dataclass(frozen=True, slots=True)
class ModelOptions:
    """Options for the model that answers the questions of a set or describes its images.

    Attributes:
        ask: Base URL of an OpenAI-compatible chat endpoint that answers the complete set, such as
            http://localhost:8000/v1.
        describe: Base URL of an endpoint whose model describes images of the set and asks questions about them.
            Statements that the recorded state does not confirm are dropped.
        images: Number of images to describe.
        model: Model name at that URL.
        coordinates: Meaning of the numbers in the model's boxes and points.
        at_once: Number of simultaneous requests.
        answers: File of answers: written with --ask (SET/answers-MODEL.jsonl if not given), otherwise read and scored.
        learner: With --run: the co-trained learner that was evaluated in this run (learned:CHECKPOINT). It is asked for
            the position of the object named in the instruction.
        key_variable: Environment variable with the key of the endpoint.
    """

    ask: str | None = None
    describe: str | None = None
    images: int = 100
    model: str = "default"
    coordinates: CoordinateNames = "pixels"
    at_once: int = 4
    answers: Path | None = None
    learner: str | None = None
    key_variable: str = "OPENAI_API_KEY"


_Frames = Annotated[FrameOptions, tyro.conf.arg(name="")]
_Model = Annotated[ModelOptions, tyro.conf.arg(name="")]


def vqa_command(
    source: Annotated[Path | None, tyro.conf.Positional] = None,
    *,
    run: Path | None = None,
    out: Path | None = None,
    suite: str | None = None,
    asked: _Frames = FrameOptions(),
    chat: _Model = ModelOptions(),
    workers: int = 1,
    overwrite: bool = False,
    json: bool = False,
) -> None:
    """Make questions about the frames of a run, with answers from the records of the run.

    The questions ask for bounding boxes, counts, relations, containment, stacks, states, progress and presence of
    objects. They are balanced, so that guessing without the images does not help. Questions and images are written as
    JSON lines in the conversation format of LLaVA, and as Parquet. With --run, the questions are about the decisive
    moments of the run's trials, for `better diagnose --answers`. Running the command again resumes an interrupted set.

    Example: better vqa runs/expert --out sets/expert --questions 10000

    Args:
        source: Run folder to make questions about, or set folder whose questions a model answers.
        run: Folder of a run whose decisive moments the questions are about.
        out: Folder of the set.
        suite: Packaged suite, or folder with a suite in JSON; its tasks are used if --tasks is not given.
        asked: Options that select the frames, cameras and types of the questions.
        chat: Model that answers the set.
        workers: Number of trials processed in parallel.
        overwrite: Replace a file of answers or descriptions that `better vqa` did not write.
        json: Print one JSON document instead of tables.
    """
    from betterbench.cli.output.vqa import print_scores, print_set

    if suite is not None:
        from betterbench.tasks import suite_tasks

        of_suite = suite_tasks(suite)
        asked = asked if asked.tasks else replace(asked, tasks=of_suite)
    if chat.learner is not None:
        _ask_learner(chat.learner, source, run, out, asked, json=json)
        return
    made, folder = _made(source, run, out, asked, workers)
    document: dict[str, object] = {"set": str(made.path), **made.to_json()}
    if chat.describe is not None:
        document["descriptions"] = _described(folder, made, chat, asked, overwrite=overwrite)
    scores = _scores(made, chat, overwrite=overwrite)
    if json:
        print_json({**document, "scores": None if scores is None else [s.to_json() for s in scores]})
        return
    print_set(made)
    if scores is not None:
        print_scores(scores)
    OUT.print(str(made.path), markup=False, soft_wrap=True)


def _made(
    source: Path | None, run: Path | None, out: Path | None, asked: FrameOptions, workers: int
) -> tuple[QuestionSet, Path | None]:
    """Return the question set and, if it is known, the folder of the run that the questions are about.

    If the set does not exist yet, it is made first.
    """
    from betterbench.sim.scenes.stage import require_cameras
    from betterbench.vqa.dataset import read_set

    if source is not None and run is not None:
        raise InvalidInputError(
            "better vqa", "expected one folder, got two", "Pass either the folder of a run or set, or --run RUN"
        )
    folder = run if source is None else source
    if folder is None:
        raise InvalidInputError("better vqa", "no folder is given", "Pass the folder of a run or set, or add --run RUN")
    if not folder.is_dir():
        raise InvalidInputError("better vqa", f"{folder} is not a folder", "Pass the folder of a run or of a set")
    if run is None and (folder / "set.json").exists():
        return read_set(folder), None
    if out is None:
        raise InvalidInputError("--out", "this option is required", "Pass the folder for the set")
    require_cameras(asked.cameras)
    return (balanced_set(folder, out, asked.balanced(), workers) if run is None else _decisive(run, out, asked)), folder


def _scores(made: QuestionSet, chat: ModelOptions, *, overwrite: bool) -> list[Score] | None:
    """Return the scores of a model's answers. The answers are requested now, or read from a file.

    If there are no answers, return None.
    """
    from betterbench.vqa.asking import ask_set, read_answers, scores_of
    from betterbench.vqa.llm import ChatEndpoint

    if chat.ask is None:
        return None if chat.answers is None else scores_of(made, read_answers(chat.answers, made))
    name = default_name(chat.model, otherwise="model")
    file = chat.answers or made.path / f"answers-{name}.jsonl"
    with progress_bar(f"asking {chat.model}", len(made.questions)) as (bar, task):
        said = ask_set(
            made,
            ChatEndpoint(chat.ask, chat.model, key_variable=chat.key_variable),
            file,
            coordinates=chat.coordinates,
            at_once=chat.at_once,
            overwrite=overwrite,
            on_progress=lambda done, _: bar.update(task, completed=done),
        )
    say(f"answers: {file}")
    return scores_of(made, said)


def _ask_learner(
    address: str, source: Path | None, run: Path | None, out: Path | None, asked: FrameOptions, *, json: bool
) -> None:
    """Ask the learner that was evaluated in a run for the positions of the named objects, and print its answers."""
    from betterbench.cli.output.diagnosis import diagnosed
    from betterbench.cli.output.vqa import print_own_answers
    from betterbench.evaluation.figures.views import ViewRenderer
    from betterbench.policies.kinds import find_kind
    from betterbench.policies.kinds.learned import LEARNED
    from betterbench.policies.learned.loading import load_learner
    from betterbench.records import RunFolder

    if run is None or source is not None:
        raise InvalidInputError(
            "--learner", "no run of this learner is given", "Pass the run with --run RUN, and no other folder"
        )
    if out is not None:
        raise InvalidInputError(
            "--out", "the learner's answers are printed, and no set is written", "Leave out --out, or use --json"
        )
    if find_kind(address) is not LEARNED:
        raise InvalidInputError("--learner", f"{address!r} is not a learner", f"Write {LEARNED.shown}")
    learner = load_learner(LEARNED.parse(address))
    from betterbench.learning.training.own_answers import answers_form, ask_about_run, summaries_of

    folder = RunFolder.open(run)
    diagnosis = diagnosed(folder)
    with progress_bar(f"asking {address}", len(folder.entries())) as (bar, task):
        answers = ask_about_run(
            learner,
            folder,
            diagnosis,
            open_photos=lambda: ViewRenderer(folder, size=asked.size, quality="fast"),
            camera=asked.cameras[0],
            tasks=asked.tasks,
            failures_only=asked.failures_only,
            on_progress=lambda done, total: bar.update(task, completed=done, total=total),
        )
    if json:
        summaries = [summary.to_json() for summary in summaries_of(answers)]
        print_json({"learner": address, "run": str(run), "summaries": summaries, "answers": answers_form(answers)})
        return
    print_own_answers(list(summaries_of(answers)))


def balanced_set(run: Path, out: Path, options: SetOptions, workers: int) -> QuestionSet:
    """Make a balanced question set about the records of a run, or resume one that is incomplete."""
    from betterbench.evaluation.figures.views import ViewRenderer
    from betterbench.records import RunFolder
    from betterbench.vqa.dataset import make_set

    folder = RunFolder.open(run)
    with progress_bar(f"questions about {run.name}", len(folder.entries())) as (bar, task):
        return make_set(
            folder,
            out,
            options,
            open_photos=lambda: ViewRenderer(folder, size=options.size, quality=options.quality),
            workers=workers,
            on_progress=lambda done, total: bar.update(task, completed=done, total=total),
        )


def _decisive(run: Path, out: Path, asked: FrameOptions) -> QuestionSet:
    """Make a question set about the decisive moments of a run, or resume one that is incomplete."""
    from betterbench.cli.output.diagnosis import diagnosed
    from betterbench.evaluation.figures.views import ViewRenderer
    from betterbench.records import RunFolder
    from betterbench.vqa.decisive import make_decisive_set

    folder, options = RunFolder.open(run), asked.decisive()
    diagnosis = diagnosed(folder)
    with progress_bar(f"decisive moments of {run.name}", len(folder.entries())) as (bar, task):
        return make_decisive_set(
            folder,
            diagnosis,
            out,
            options,
            open_photos=lambda: ViewRenderer(folder, size=options.size, quality=options.quality),
            on_progress=lambda done, total: bar.update(task, completed=done, total=total),
        )


def _described(
    run: Path | None, made: QuestionSet, model: ModelOptions, asked: FrameOptions, *, overwrite: bool
) -> dict[str, object]:
    """Have a model describe images of a question set, and keep the statements that the recorded state confirms."""
    from betterbench.evaluation.figures.views import ViewRenderer
    from betterbench.records import RunFolder
    from betterbench.vqa.freeform import describe_images
    from betterbench.vqa.llm import ChatEndpoint

    if run is None or model.describe is None:
        raise InvalidInputError(
            "--describe", "the records of the run are needed", "Pass the run folder too: `better vqa RUN --out SET`"
        )
    folder = RunFolder.open(run)
    chat = ChatEndpoint(model.describe, model.model, key_variable=model.key_variable)
    photos = ViewRenderer(folder, size=asked.size, quality=asked.quality)
    with progress_bar(f"descriptions by {model.model}", model.images) as (bar, task), photos:
        told = describe_images(
            folder,
            made,
            chat,
            photos,
            count=model.images,
            overwrite=overwrite,
            on_progress=lambda done, _: bar.update(task, completed=done),
        )
    say(told.sentence)
    return told.to_json()
