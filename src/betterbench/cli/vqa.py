"""``better vqa``: questions about recorded frames, what can be answered blind, and what a model answers."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from betterbench.cli.console import OUT, print_json, progress_bar, say

if TYPE_CHECKING:
    from betterbench.vqa.dataset import QuestionSet, SetOptions
    from betterbench.vqa.decisive import DecisiveOptions

QuestionTypes = Literal["grounding", "counting", "relation", "containment", "stacking", "state", "execution", "premise"]


def vqa_command(
    source: Annotated[Path | None, tyro.conf.Positional] = None,
    *,
    run: Path | None = None,
    out: Path | None = None,
    questions: int = 10_000,
    frames: int = 8,
    cameras: tuple[str, ...] = ("front", "wrist", "left_shoulder", "right_shoulder"),
    size: int = 256,
    quality: Literal["fast", "standard", "high"] = "standard",
    types: tuple[QuestionTypes, ...] = (),
    tasks: tuple[str, ...] = (),
    seed: int = 0,
    workers: int = 1,
    failures_only: bool = False,
    ask: str | None = None,
    describe: str | None = None,
    images: int = 100,
    model: str = "default",
    coordinates: Literal["pixels", "thousandths", "fractions"] = "pixels",
    at_once: int = 4,
    answers: Path | None = None,
    key_variable: str = "OPENAI_API_KEY",
    json: bool = False,
) -> None:
    """Ask about the frames of a run what its records can answer, in a set that cannot be answered blind.

    Boxes, counts, relations, containment, stacks, states, progress and what is there at all, as JSON lines in the
    conversation form of LLaVA and as Parquet, with images. With --run, the questions are about the moments at which the
    run's trials were decided, for better diagnose --answers. The same command goes on with a set that was interrupted.

    Example: better vqa runs/expert --out sets/expert --questions 10000

    Args:
        source: Folder of a run to ask about, or of a set to ask a model.
        run: Folder of a run whose decisive moments are asked about.
        out: Folder of the set.
        questions: About how many questions; 0 for as many as can be balanced.
        frames: Frames per trial, one from each equal part of it; 0 for every frame.
        cameras: Cameras whose images are asked about.
        size: Side of the images in pixels.
        quality: Quality of the images: shadows, and smooth edges.
        types: Types of question; all if not given.
        tasks: Tasks whose trials are asked about; all if not given.
        seed: Seed of the choice of frames, questions and words.
        workers: Trials that are looked at at the same time.
        failures_only: With --run, leave out the trials that succeeded.
        ask: Base address of a chat endpoint in OpenAI's protocol to ask the whole set, such as
            http://localhost:8000/v1.
        describe: Likewise, to write descriptions and questions of its own about images of the set; what the state does
            not prove is dropped.
        images: Number of images to be described.
        model: Name of the model at that address.
        coordinates: What the numbers of the model's boxes and points mean.
        at_once: Requests at the same time.
        answers: File of answers: written with --ask (SET/answers-MODEL.jsonl if not given), else read and scored.
        key_variable: Environment variable with the key of the endpoint.
        json: Print one JSON document instead of tables.
    """
    from betterbench.cli.output.vqa import print_scores, print_set
    from betterbench.errors import InvalidInputError
    from betterbench.vqa.asking import ask_set, read_answers, scores_of
    from betterbench.vqa.dataset import SetOptions, read_set
    from betterbench.vqa.decisive import DecisiveOptions
    from betterbench.vqa.question import QuestionType

    if (source is None) == (run is None):
        raise InvalidInputError("better vqa", "needs one folder", "Give a run or a set, or --run RUN")
    if source is not None and (source / "set.json").exists():
        made = read_set(source)
    elif out is None:
        raise InvalidInputError("--out", "is missing", "Name the folder of the set")
    elif run is not None:
        made = _decisive(run, out, DecisiveOptions(cameras, size, quality, seed, tasks, failures_only))
    else:
        chosen = tuple(QuestionType(t) for t in types) or tuple(QuestionType)
        made = _balanced(
            source or Path(), out, SetOptions(questions, frames, cameras, size, quality, seed, chosen, tasks), workers
        )
    document = {"set": str(made.path), **made.to_json()}
    if describe is not None:
        if source is None or (source / "set.json").exists():
            raise InvalidInputError("--describe", "needs the records of the run", "Give better vqa RUN --out SET too")
        document["descriptions"] = _describe(
            source, made, describe, model, key_variable=key_variable, images=images, size=size
        )
    scores = None
    if ask is not None:
        from betterbench.llm import ChatEndpoint

        chat = ChatEndpoint(ask, model, key_variable=key_variable)
        file = answers or made.path / f"answers-{re.sub(r'[^A-Za-z0-9.]+', '-', model).strip('-.') or 'model'}.jsonl"
        with progress_bar(f"asking {model}", len(made.questions)) as (bar, task):
            said = ask_set(
                made, chat, file, coordinates=coordinates, at_once=at_once,
                on_progress=lambda done, _: bar.update(task, completed=done),
            )  # fmt: skip
        say(f"answers: {file}")
        scores = scores_of(made, said)
    elif answers is not None:
        scores = scores_of(made, read_answers(answers, made))
    if json:
        print_json({**document, "scores": None if scores is None else [s.to_json() for s in scores]})
        return
    print_set(made)
    if scores is not None:
        print_scores(scores)
    OUT.print(str(made.path), markup=False, soft_wrap=True)


def _balanced(run: Path, out: Path, options: SetOptions, workers: int) -> QuestionSet:
    """Make or go on with a balanced set."""
    from betterbench.evaluation.figures.views import ViewRenderer
    from betterbench.recording import RunFolder
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


def _decisive(run: Path, out: Path, options: DecisiveOptions) -> QuestionSet:
    """Make or go on with a set about the decisive moments of a run."""
    from betterbench.diagnosis import diagnose_run
    from betterbench.evaluation.figures.views import ViewRenderer
    from betterbench.recording import RunFolder
    from betterbench.vqa.decisive import make_decisive_set

    folder = RunFolder.open(run)
    with progress_bar(f"decisive moments of {run.name}", len(folder.entries())) as (bar, task):
        return make_decisive_set(
            folder,
            diagnose_run(folder),
            out,
            options,
            open_photos=lambda: ViewRenderer(folder, size=options.size, quality=options.quality),
            on_progress=lambda done, total: bar.update(task, completed=done, total=total),
        )


def _describe(
    run: Path, made: QuestionSet, url: str, model: str, *, key_variable: str, images: int, size: int
) -> dict[str, object]:
    """Let a model describe images of a set, keep what the state proves, and say how much that was."""
    from betterbench.evaluation.figures.views import ViewRenderer
    from betterbench.llm import ChatEndpoint
    from betterbench.recording import RunFolder
    from betterbench.vqa.freeform import describe_images

    folder = RunFolder.open(run)
    chat = ChatEndpoint(url, model, key_variable=key_variable)
    with progress_bar(f"descriptions by {model}", images) as (bar, task), ViewRenderer(folder, size=size) as photos:
        told = describe_images(
            folder, made, chat, photos, count=images, on_progress=lambda done, _: bar.update(task, completed=done)
        )
    say(told.sentence)
    return told.to_json()
