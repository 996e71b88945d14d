"""Evaluation of a model on a static benchmark. An interrupted run can be resumed.

A run folder contains these files:

- ``run.json``: the benchmark, the model, the prompt and the coordinate convention. It is written first.
- ``shown.png``: an image at each resolution.
- ``probe.jsonl``: the answers of the coordinate probe.
- ``answers.jsonl``: one line for each answer, which is written to disk immediately.
- ``extracted.jsonl``: the replies of the extractor.
- ``items.jsonl``: the value, the parsing stage and the score of each item. It is written at the end.
- ``result.json``: the scores of the benchmark. It is written at the end.
"""

from __future__ import annotations

import json
import logging
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, dataclass, fields
from datetime import UTC, datetime
from fractions import Fraction
from pathlib import Path
from typing import Any

from betterbench.errors import InvalidInputError, ModelError, RecordError
from betterbench.jobs import OnCount, job_folder, write_durably
from betterbench.jobs.conflict import require_free, require_same
from betterbench.jobs.durable import on_disk
from betterbench.json_form import dump_json, open_seal, read_bounded, sealed_form, sealed_lines
from betterbench.quoting import json_line
from betterbench.statistics import Threshold
from betterbench.version import __version__
from betterbench.vlm.benchmarks.benchmark import Benchmark
from betterbench.vlm.completeness import Completeness, completeness_of
from betterbench.vlm.eyesight import eyesight, readings_of
from betterbench.vlm.items import ItemSet
from betterbench.vlm.models.eyes import Eyes, contact_sheet, convention_for
from betterbench.vlm.official import UPSTREAM, UpstreamScore, upstream_scores
from betterbench.vlm.pictures import NOT_A_PICTURE, size_of
from betterbench.vlm.probe import TARGETS, ask_targets, finding_of
from betterbench.vlm.prompts import Prompt
from betterbench.vlm.scoring import StaticScore, score_answers
from betterbench.vqa.asking import Answers, AnswersHead, ModelAnswer, Request, ask_all
from betterbench.vqa.coordinates import CONVENTIONS, Convention, Coordinates
from betterbench.vqa.llm import Model
from betterbench.vqa.parsing import read_text
from betterbench.vqa.parsing.extractor import extraction_prompt
from betterbench.vqa.question import Form
from betterbench.vqa.request_totals import Prices, RequestTotals, totals_of

logger = logging.getLogger(__name__)

SCHEMA_VERSION = 1
KIND = "static evaluation"
"""Kind of run that ``run.json`` states."""
RUN_NAME, ANSWERS_NAME, EXTRACTED_NAME = "run.json", "answers.jsonl", "extracted.jsonl"
ITEMS_NAME, RESULT_NAME, SHOWN_NAME = "items.jsonl", "result.json", "shown.png"
PROBE_NAME = "probe.jsonl"
PLACES = (Form.POINT, Form.POINTS, Form.BOX)
_MAX_BYTES = 1 << 24
_CURE = "Choose a different folder with --out"
_NOT_COMPARED = ("begun", "betterbench")

Bar = Callable[[str, int], AbstractContextManager[OnCount]]
"""Function that opens a progress bar, given a title and a total."""


@dataclass(frozen=True, slots=True)
class RunSettings:
    """Settings of a run that affect its requests and scores.

    Attributes:
        prompt: The prompt.
        coordinates: Declared coordinate convention.
        eyes: Resolution of the images.
        most_tiles: Maximum number of tiles per image. If None, it is the model's own maximum.
        at_once: Number of simultaneous requests.
        probe: Whether to check the declared coordinate convention with ten images before a run that asks for points or
            boxes.
        official: Whether to add the scores of upstream programs, i.e. of the benchmark's own and other published
            scorers.
        max_tokens: Maximum length of an answer [tokens], which is stored in the run. None if there is no limit.
        prices: Prices of the model's tokens. If None, no cost is reported.
    """

    prompt: Prompt
    coordinates: Coordinates = "pixels"
    eyes: Eyes = Eyes.NATIVE
    most_tiles: int | None = None
    at_once: int = 4
    probe: bool = False
    official: bool = False
    max_tokens: int | None = None
    prices: Prices | None = None

    @property
    def convention(self) -> Convention:
        """Coordinate convention of the answers, relative to the images that are shown to the model."""
        return convention_for(self.eyes, CONVENTIONS[self.coordinates])


@dataclass(frozen=True, slots=True)
class StaticRun:
    """A finished run of ``better vlm``.

    Attributes:
        head: Content of ``run.json``.
        answers: Answers of the model.
        extracted: Replies of the extractor, or None if there was no extractor.
        score: Scores of the run.
        upstream: Scores of upstream programs, if they were requested.
        requests: Totals over all requests to the model, such as their number and their tokens, including the coordinate
            probe.
        extractor_requests: Totals of the requests to the extractor, or None if there was no extractor.
        completeness: Number of items in the data, compared with the published number.
        prices: Prices of the model's tokens, or None if they are not given.
        eyesight: Smallest object size at which the model answers correctly. None if the object sizes are unknown.
    """

    path: Path
    head: Mapping[str, Any]
    answers: Answers
    extracted: Answers | None
    score: StaticScore
    upstream: tuple[UpstreamScore, ...]
    requests: RequestTotals
    extractor_requests: RequestTotals | None
    completeness: Completeness
    prices: Prices | None = None
    eyesight: Threshold | None = None

    @property
    def refusal(self) -> str:
        """Most frequent reason why requests were rejected. Empty if no request was rejected."""
        reasons = Counter(answer.error for answer in self.answers.answers.values() if answer.error is not None)
        return reasons.most_common(1)[0][0] if reasons else ""

    @property
    def refused(self) -> int:
        """Number of items whose request was rejected."""
        return sum(answer.error is not None for answer in self.answers.answers.values())

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict. It does not include the items."""
        extractor = self.extractor_requests
        return {
            **self.head,
            "refused": self.refused,
            "requests": self.requests.to_json(),
            "extractor_requests": None if extractor is None else extractor.to_json(),
            "prices": None if self.prices is None else asdict(self.prices),
            "cost": None if self.prices is None else self.requests.cost(self.prices),
            "completeness": self.completeness.to_json(),
            **self.score.to_json(),
            "upstream": [found.to_json() for found in self.upstream],
            **({} if self.eyesight is None else {"eyesight": self.eyesight.to_json()}),
        }


def evaluate_model(
    benchmark: Benchmark,
    items: ItemSet,
    model: Model,
    out: Path,
    settings: RunSettings,
    *,
    extractor: Model | None = None,
    bar: Bar | None = None,
) -> StaticRun:
    """Evaluate a model on all items of a benchmark, and write the run.

    If an earlier call with the same arguments was interrupted, the run resumes where it stopped.

    Args:
        benchmark: The benchmark.
        items: Items of the benchmark.
        model: The model.
        out: Folder of the run.
        settings: Prompt, coordinate convention, number of simultaneous requests, and other settings.
        extractor: Model that extracts the answers from replies that the parser cannot read, or None.
        bar: Function that opens a progress bar, or None.

    Raises:
        InvalidInputError: If the prompt or the answers of the model use a different coordinate convention than the
            declared one, or if an image cannot be read.
        ModelError: If the model cannot be reached. Earlier answers are kept.
        RunConflictError: If the folder contains a different run or other files, or if another process is writing to it.
        StorageError: If the disk is full or write-protected.
    """
    settings.prompt.convention(settings.coordinates, benchmark.coordinates)
    out, bar = out.absolute(), bar or (lambda _what, _total: nullcontext(lambda _done, _planned: None))
    require_free(out, "run", file=RUN_NAME)
    with on_disk(out), job_folder(out):
        head = _begin(out, _head(benchmark, items, model, settings, extractor))
        _show(items, out)
        probed = _check_convention(items, model, out, settings, bar)
        answers = _asked(items, model, out, settings, bar)
        texts = {name: answer.text for name, answer in answers.answers.items()}
        extracted = None if extractor is None else _extracted(items, extractor, texts, out, settings=settings, bar=bar)
        told = {} if extracted is None else {name: a.text for name, a in extracted.answers.items()}
        score = score_answers(benchmark, items, texts, settings.convention, extractions=told)
        scorers = UPSTREAM.get(benchmark.name, ()) if settings.official else ()
        upstream = tuple(upstream_scores(scorers, items, texts, score, settings.coordinates))
        column = "parsed" if extracted is None else "extracted"
        sight = eyesight(readings_of(items, score, settings.eyes, column), f"{head['benchmark']}:{head['model']}")
        run = StaticRun(
            out,
            head,
            answers,
            extracted,
            score,
            upstream,
            requests=totals_of([*probed, *answers.answers.values()]),
            extractor_requests=None if extracted is None else totals_of(extracted.answers.values()),
            completeness=completeness_of(benchmark, items),
            prices=settings.prices,
            eyesight=sight,
        )
        _write(run, items, settings)
        return run


def _head(
    benchmark: Benchmark, items: ItemSet, model: Model, settings: RunSettings, extractor: Model | None
) -> dict[str, Any]:
    return {
        "schema_version": SCHEMA_VERSION,
        "kind": KIND,
        "benchmark": benchmark.name,
        "data": items.sha256,
        "n": len(items.items),
        "model": model.name,
        "prompt": settings.prompt.id,
        "template": settings.prompt.template,
        "coordinates": settings.coordinates,
        "eyes": settings.eyes.value,
        "max_tiles": settings.most_tiles,
        "max_tokens": settings.max_tokens,
        "extractor": None if extractor is None else extractor.name,
        "betterbench": __version__,
        "begun": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def _begin(out: Path, head: dict[str, Any]) -> dict[str, Any]:
    """Write the header of a new run. If the run already exists, return its stored header.

    A run that was started without an extractor may be resumed with one. The extractor then reads the remaining answers.
    """
    file = out / RUN_NAME
    if file.exists():
        raw = read_bounded(file, max_bytes=_MAX_BYTES, cure=_CURE, raises=RecordError)
        stored = open_seal(raw, where=str(file), cure=_CURE, raises=RecordError)
        if stored.get("extractor") is None:
            stored = {**stored, "extractor": head["extractor"]}
        there, asked = ({k: v for k, v in of.items() if k not in _NOT_COMPARED} for of in (stored, head))
        require_same(out, there, asked, "run", where="run")
        head = stored
    write_durably(file, json.dumps(sealed_form(head), indent=1).encode() + b"\n")
    return head


def _show(items: ItemSet, out: Path) -> None:
    """Write an image file that shows the first image of the benchmark at each resolution."""
    name = next((item.pictures[-1] for item in items.items if item.pictures), None)
    if name is None or (out / SHOWN_NAME).exists():
        return
    try:
        picture = items.read(name)
        size_of(picture, name)  # a large image is not decoded
        sheet = contact_sheet(picture)
    except (InvalidInputError, *NOT_A_PICTURE):
        return  # a broken image is reported when its request is sent
    write_durably(out / SHOWN_NAME, sheet)


def _check_convention(
    items: ItemSet, model: Model, out: Path, settings: RunSettings, bar: Bar
) -> Sequence[ModelAnswer]:
    """Ask the model for the positions of known shapes, to check the declared coordinate convention.

    Raises InvalidInputError if the answers of the model do not follow the declared convention.
    """
    if not settings.probe or all(item.form not in PLACES for item in items.items):
        return ()
    with bar("checking the coordinates", len(TARGETS)) as on_progress:
        answers = ask_targets(
            model,
            out / PROBE_NAME,
            declared=settings.coordinates,
            eyes=settings.eyes,
            at_once=settings.at_once,
            on_progress=on_progress,
        )
    finding = finding_of(
        model.name, [answer.text for answer in answers], declared=settings.coordinates, eyes=settings.eyes
    )
    finding.require(settings.coordinates)
    if not finding.found:
        logger.warning("%s Points and boxes are interpreted as %s.", finding.sentence, settings.coordinates)
    return answers


def _asked(items: ItemSet, model: Model, out: Path, settings: RunSettings, bar: Bar) -> Answers:
    requests = {
        item.id: items.request(item, settings.prompt.text(item, settings.convention), settings.eyes)
        for item in items.items
    }
    head = AnswersHead(model.name, items.sha256, settings.coordinates)
    file = out / ANSWERS_NAME
    with bar(f"asking {model.name}", len(requests)) as on_progress:
        found = ask_all(requests, model, head, file, at_once=settings.at_once, verb="vlm", on_progress=on_progress)
    _require_accepted(found, file)
    return found


def _require_accepted(found: Answers, file: Path) -> None:
    """If the server has rejected every request, delete the file of answers and raise ModelError.

    Without this error, the run would report a meaningless score of 0.
    """
    refused = Counter(answer.error for answer in found.answers.values())
    if not refused or None in refused:
        return
    file.unlink()
    (reason, _), *_ = refused.most_common(1)
    raise ModelError(
        f"The server rejected all {refused.total():,} requests, so there is no score: {reason}. Correct the model, the "
        f"server or the options, and run the command again to repeat the requests."
    )


def _extracted(
    items: ItemSet, extractor: Model, texts: Mapping[str, str], out: Path, *, settings: RunSettings, bar: Bar
) -> Answers:
    """Send the replies that the parser cannot read to the extractor, and return the extractor's replies."""
    convention = settings.convention
    requests: dict[str, Request] = {}
    for item in items.items:
        text, spec = texts.get(item.id, ""), item.spec(convention)
        if text.strip() and read_text(spec, text).answer is None:
            requests[item.id] = Request(extraction_prompt(spec, text))
    head = AnswersHead(extractor.name, items.sha256, settings.coordinates)
    with bar(f"extracting with {extractor.name}", len(requests)) as on_progress:
        return ask_all(
            requests,
            extractor,
            head,
            out / EXTRACTED_NAME,
            at_once=settings.at_once,
            verb="vlm",
            on_progress=on_progress,
        )


def _write(run: StaticRun, items: ItemSet, settings: RunSettings) -> None:
    lines = []
    for item, score in zip(items.items, run.score.items, strict=True):
        line = {f.name: getattr(score, f.name) for f in fields(score)}
        line |= {"score": _shown(score.score), "groups": dict(item.groups), "cluster": item.cluster}
        line |= {"size_px": item.size_px(settings.eyes), "chance": item.chance}
        line |= {"prompt": settings.prompt.text(item, settings.convention), "target": item.gold.written}
        lines.append(json_line(dump_json(line)))
    write_durably(run.path / ITEMS_NAME, sealed_lines(b"".join(lines)))
    form = sealed_form(json.loads(dump_json(run.to_json())))
    write_durably(run.path / RESULT_NAME, json.dumps(form, indent=1).encode() + b"\n")


def _shown(score: Fraction) -> str:
    """Format an exact score, such as "0", "1" or "2/3"."""
    return str(score)
