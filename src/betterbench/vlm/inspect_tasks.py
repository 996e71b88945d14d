"""Static benchmarks as a task for inspect_ai, which the user must install (``pip install inspect-ai``).

``inspect eval betterbench/static -T benchmark=better-vqa -T data=FOLDER --model PROVIDER/MODEL`` sends the same prompts
and images as ``better vlm``, and reads and scores the answers with the same functions. inspect_ai finds the task
through an entry point in the metadata of the betterbench package.
"""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any

from inspect_ai import Task, task
from inspect_ai.dataset import MemoryDataset, Sample
from inspect_ai.model import ChatMessageUser, ContentImage, ContentText
from inspect_ai.scorer import Score, Scorer, Target, grouped, mean, scorer, stderr
from inspect_ai.solver import TaskState, generate

from betterbench.vlm.benchmarks import Benchmark, find_benchmark
from betterbench.vlm.items import Item, ItemSet
from betterbench.vlm.models.eyes import Eyes
from betterbench.vlm.prompts import find_prompt
from betterbench.vlm.running import RunSettings
from betterbench.vlm.scoring import score_of
from betterbench.vqa.coordinates import convention
from betterbench.vqa.llm.chat import PICTURE
from betterbench.vqa.parsing import read_text


@task
def static(
    benchmark: str = "better-vqa",
    data: str = "",
    prompt: str | None = None,
    coordinates: str | None = None,
    eyes: str = "native",
) -> Task:
    """Return a static benchmark as a task for inspect_ai.

    Args:
        benchmark: Name of the benchmark, as for ``better vlm``.
        data: Folder with the data of the benchmark. For better-vqa, it is a set written by ``better vqa``.
        prompt: Identifier of the prompt. If None, betterbench's own prompt for the benchmark is used.
        coordinates: Coordinate convention of the points and boxes in the model's answers. If None, it is the convention
            of the prompt.
        eyes: Resolution of the images.
    """
    chosen = find_benchmark(benchmark)
    items = chosen.load(Path(data))
    wording = find_prompt(chosen.name, prompt)
    declared = None if coordinates is None else convention(coordinates).name
    settings = RunSettings(wording, wording.convention(declared, chosen.coordinates), Eyes(eyes))
    return Task(
        dataset=MemoryDataset([_sample(items, item, settings) for item in items.items], name=chosen.name),
        solver=generate(),
        scorer=static_score(items, settings, chosen),
        metadata={"data": items.sha256, "prompt": wording.id, "coordinates": settings.coordinates, "eyes": eyes},
    )


def _sample(items: ItemSet, item: Item, settings: RunSettings) -> Sample:
    request = items.request(item, settings.prompt.text(item, settings.convention), settings.eyes)
    pictures = [ContentImage(image=_address(picture)) for picture in request.pictures()]
    parts = request.prompt.split(PICTURE)
    if len(parts) != len(pictures) + 1:
        parts = [*[""] * len(pictures), request.prompt]
    content: list[ContentText | ContentImage] = []
    for number, part in enumerate(parts):
        content += [ContentText(text=part)] if part else []
        content += pictures[number : number + 1]
    return Sample(
        input=[ChatMessageUser(content=content)],
        target=item.gold.written,
        id=item.id,
        metadata={**item.groups, "cluster": item.cluster},
    )


def _address(picture: bytes) -> str:
    kind = "png" if picture.startswith(b"\x89PNG") else "jpeg"
    return f"data:image/{kind};base64,{base64.b64encode(picture).decode()}"


def _metrics(chosen: Benchmark) -> list[Any]:
    """Return the metrics for inspect_ai: the mean, its clustered standard error, and the mean of each group.

    Only the groups of the first two kinds in ``chosen.groups`` are included.
    """
    return [mean(), stderr(cluster="cluster"), *(grouped(mean(), kind, all=False) for kind in chosen.groups[:2])]


def static_score(items: ItemSet, settings: RunSettings, chosen: Benchmark) -> Scorer:
    """Return a scorer for inspect_ai that scores an answer from 0 to 1 as ``better vlm`` does.

    An answer that cannot be read scores 0.
    """
    known = {item.id: item for item in items.items}

    @scorer(metrics=_metrics(chosen), name="betterbench")
    def made() -> Scorer:
        async def score(state: TaskState, target: Target) -> Score:  # noqa: ARG001 - the interface of inspect_ai
            item = known[str(state.sample_id)]
            read = read_text(item.spec(settings.convention), state.output.completion)
            value, _ = score_of(items, item, read.answer)
            return Score(value=float(value), answer=read.answer, explanation=f"parsing stage: {read.stage}")

        return score

    return made()
