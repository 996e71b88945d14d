"""``better vlm``: evaluate a vision-language model on static benchmarks."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from betterbench.cli.console import OUT, print_json, progress_bar, say
from betterbench.errors import InvalidInputError

if TYPE_CHECKING:
    from betterbench.diagnosis import RunDiagnosis
    from betterbench.jobs import OnCount
    from betterbench.vlm import Benchmark, ItemSet
    from betterbench.vlm.models.eyes import Eyes
    from betterbench.vqa.coordinates import Coordinates
    from betterbench.vqa.llm import Model
    from betterbench.vqa.request_totals import Prices

FETCH = "fetch"
"""First argument of the command if it downloads the data of a benchmark."""
PROBE = "probe"
"""First argument of the command if it identifies the coordinate convention of a model."""
SIDE_PX = 896
"""Side length of the images in newly made sets [pixels], equal to 2 x 2 InternVL tiles.

The values of ``--eyes`` other than native downscale such an image. They would hardly change an image of 256 pixels.
"""


def vlm_command(
    benchmark: Annotated[str, tyro.conf.Positional] = "better-vqa",
    fetched: Annotated[str | None, tyro.conf.Positional] = None,
    *,
    model: str | None = None,
    data: Path | None = None,
    records: Path | None = None,
    acted: Path | None = None,
    out: Path | None = None,
    prompt: str | None = None,
    coordinates: str | None = None,
    eyes: Literal["native", "tile-1", "blur-224", "native-224"] = "native",
    max_tiles: int | None = None,
    probe: bool = True,
    extractor: str | None = None,
    scoring: Literal["own", "official"] = "own",
    questions: int = 1000,
    at_once: int = 4,
    max_tokens: int = 1024,
    price_in: float | None = None,
    price_out: float | None = None,
    cache: bool = True,
    workers: int = 1,
    key_variable: str = "OPENAI_API_KEY",
    extractor_key_variable: str = "OPENAI_API_KEY",
    json: bool = False,
) -> None:
    """Evaluate a vision-language model on a static benchmark.

    The benchmarks are better-vqa (questions about recorded frames of this suite, no download), embspatial, refspatial
    and egoplan2. `better vlm fetch BENCHMARK` downloads the data, or lists the files to download and where to find
    them. Every item is scored: a missing or unreadable answer counts as wrong. Running the command again resumes an
    interrupted run without repeating requests.

    Example: better vlm embspatial --data data/embspatial --model http://localhost:8000/v1#my-model --out runs/emb

    Args:
        benchmark: Benchmark, "fetch", or "probe" (only identifies the coordinate convention of a model).
        fetched: After fetch, the benchmark whose data is downloaded into the folder --data.
        model: OpenAI-compatible chat endpoint and model name, such as http://localhost:8000/v1#my-model; hf:FOLDER
            with an InternVL checkpoint (extra vlm); or learned:CHECKPOINT, a co-trained learner.
        data: Folder of the data in any published format; for better-vqa, a set made by `better vqa` (default: a new
            set).
        records: For a learner: the run from which the questions were made; the learner gets the recorded state of each
            frame.
        acted: Run of a policy. Its illusion gap is shown next to the static illusion gap of better-vqa.
        out: Folder of the run.
        prompt: Identifier of the prompt; default: betterbench's prompt.
        coordinates: Order, scale and format of the model's points and boxes: pixels, thousandths, fractions,
            thousandths-json, thousandths-yx-json or percent-xml. The prompts of betterbench state this convention.
            Default: fractions for refspatial, pixels for better-vqa.
        eyes: Resolution of the images: native (unchanged), tile-1 (one tile of 448 pixels), blur-224 (224 pixels,
            enlarged to 448), or native-224 (224 pixels).
        max_tiles: Maximum number of InternVL tiles per image, default 12; sent to an endpoint as vLLM's
            mm_processor_kwargs. Only with --eyes native.
        probe: Check the declared coordinates with ten images of known points before the first question.
        extractor: Chat endpoint of a language model that extracts the answer from texts that cannot be parsed.
        scoring: "official" also prints the results of the published scorers, including their known errors.
        questions: Approximate number of questions in a newly made set.
        at_once: Number of simultaneous requests.
        max_tokens: Maximum answer length in tokens.
        price_in: Price of a million tokens of prompts and images, in any currency. With --price-out, the cost of the
            run is printed.
        price_out: Price of a million tokens of answers.
        cache: Reuse cached replies to identical requests, also from other runs; --no-cache sends all requests.
        workers: Number of worker processes that make a question set.
        key_variable: Environment variable with the key of the endpoint.
        extractor_key_variable: Environment variable with the key of the extractor's endpoint.
        json: Print one JSON document instead of tables.
    """
    from betterbench.vlm import find_benchmark

    if benchmark == FETCH:
        _fetch(fetched, data, json=json)
        return
    if fetched is not None:
        raise InvalidInputError(
            "better vlm", f"unexpected argument {fetched!r}", "Pass one benchmark, or fetch BENCHMARK"
        )
    chosen = None if benchmark == PROBE else find_benchmark(benchmark)
    if model is None:
        raise InvalidInputError(
            "--model",
            "this option is required",
            "Pass an endpoint as URL#MODEL, for example http://localhost:8000/v1#my-model",
        )

    from betterbench.learning.training.model_kind import LEARNER_MODEL
    from betterbench.vlm.models.endpoint import ENDPOINT
    from betterbench.vlm.models.eyes import Eyes
    from betterbench.vlm.models.hugging_face import HUGGING_FACE
    from betterbench.vlm.models.kind import ModelOptions, kind_of
    from betterbench.vqa.coordinates import convention

    resolution, declared = Eyes(eyes), None if coordinates is None else convention(coordinates).name
    if max_tiles is not None and resolution is not Eyes.NATIVE:
        raise InvalidInputError(
            "--max-tiles", f"--eyes {eyes} uses one tile per image", "Leave out --max-tiles, or use --eyes native"
        )
    kind = kind_of(model, (HUGGING_FACE, LEARNER_MODEL, ENDPOINT))
    options = ModelOptions(
        address=model,
        own_set=chosen is not None and not chosen.source.repository,
        eyes=resolution,
        max_tiles=max_tiles,
        max_tokens=max_tokens,
        key_variable=key_variable,
        coordinates=coordinates,
        data=data,
        records=records,
    )
    kind.require(options)
    if kind.one_at_a_time:
        at_once = 1
    if acted is not None and benchmark != "better-vqa":
        raise InvalidInputError(
            "--acted", f"{benchmark} has no static illusion gap", "Leave out --acted, or run better-vqa"
        )
    if chosen is None:
        _probe(kind.make(options, None), out, coordinates=declared, eyes=resolution, at_once=at_once, json=json)
        return
    if out is None:
        raise InvalidInputError("--out", "this option is required", "Pass the run folder")

    from betterbench.cli.output.vlm import acted_form, print_run
    from betterbench.vlm.prompts import find_prompt
    from betterbench.vlm.running import RunSettings, evaluate_model
    from betterbench.vqa.llm import ChatModel, ReplyCache, endpoint_at

    kept = ReplyCache() if cache else None
    reader = None
    if extractor is not None:
        endpoint = endpoint_at(extractor, option="--extractor", key_variable=extractor_key_variable, cache=kept)
        reader = ChatModel(endpoint, 512)
    wording = find_prompt(chosen.name, prompt)
    spoken = wording.convention(declared, chosen.coordinates)
    settings = RunSettings(
        wording,
        spoken,
        eyes=resolution,
        most_tiles=max_tiles,
        at_once=at_once,
        probe=probe and kind.sees,
        official=scoring == "official",
        max_tokens=max_tokens,
        prices=_prices(price_in, price_out),
    )
    asked = kind.make(options, kept)
    did = None if acted is None else _acted(acted)
    items = _items(chosen, data, questions, workers)
    run = evaluate_model(chosen, items, asked, out, settings, extractor=reader, bar=_bar)
    if json:
        shown = {} if did is None else {"acted_gap": acted_form(did)}
        print_json({"run": str(out), **run.to_json(), **shown})
        return
    print_run(chosen, run, did)
    OUT.print(str(out), markup=False, soft_wrap=True)


def _prices(price_in: float | None, price_out: float | None) -> Prices | None:
    """Return the prices of tokens, or None if no price is given. Raise InvalidInputError if one price is missing."""
    from betterbench.vqa.request_totals import Prices

    if price_in is None and price_out is None:
        return None
    if price_in is None or price_out is None:
        missing = "--price-in" if price_in is None else "--price-out"
        raise InvalidInputError(
            missing, "this price is missing", "Pass both prices per million tokens, or leave out both"
        )
    return Prices(price_in, price_out)


def _acted(run: Path) -> RunDiagnosis:
    """Diagnose the run of a policy."""
    from betterbench.cli.output.diagnosis import diagnosed
    from betterbench.records import RunFolder

    return diagnosed(RunFolder.open(run))


def _probe(
    asked: Model, out: Path | None, *, coordinates: Coordinates | None, eyes: Eyes, at_once: int, json: bool
) -> None:
    """Identify and print the coordinate convention of a model."""
    from tempfile import TemporaryDirectory

    from betterbench.cli.output.vlm import print_probe
    from betterbench.vlm.probe import TARGETS, probe_model
    from betterbench.vlm.running import PROBE_NAME

    with TemporaryDirectory() as scratch, _bar("probing ten images", len(TARGETS)) as on_progress:
        folder = out or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        file = folder / PROBE_NAME
        finding = probe_model(asked, file, declared=coordinates, eyes=eyes, at_once=at_once, on_progress=on_progress)
    if json:
        print_json(finding.to_json())
        return
    print_probe(finding)


@contextmanager
def _bar(what: str, total: int) -> Iterator[OnCount]:
    with progress_bar(what, total) as (bar, task):
        yield lambda done, _: bar.update(task, completed=done)


def _items(chosen: Benchmark, data: Path | None, questions: int, workers: int) -> ItemSet:
    """Return the items of a benchmark. If no data folder is given, make a new question set."""
    if data is None:
        if chosen.source.repository:
            cure = f"Pass the folder with its data; `better vlm fetch {chosen.name}` explains what it must contain"
            raise InvalidInputError("--data", "this option is required", cure)
        data = _made(questions, workers)
    elif not chosen.source.repository:
        say(f"set: {data}")
    return chosen.load(data)


def _made(questions: int, workers: int) -> Path:
    """Make or resume a question set about expert trials (one per condition of the suite), and return its folder."""
    import platformdirs

    from betterbench.cli.verbs.evaluate import run_with_bar
    from betterbench.cli.verbs.vqa import balanced_set
    from betterbench.evaluation import make_plan
    from betterbench.version import __version__
    from betterbench.vqa.dataset import SET_SCHEMA_VERSION, SetOptions

    options = SetOptions(questions=questions, frames=2, cameras=("front", "left_shoulder"), size=SIDE_PX)
    name = f"{__version__}-{SET_SCHEMA_VERSION}-{SIDE_PX}-{questions}"
    place = platformdirs.user_cache_path("betterbench") / "vlm" / name
    folder = place / "set"
    say(f"question set: {folder}, made from one expert trial per condition of the suite")
    if not (folder / "summary.json").exists():
        plan = make_plan("expert", trials=1, observation="state_only", quality="fast")
        run_with_bar(plan, place / "records", label="the expert", workers=workers)
    balanced_set(place / "records", folder, options, workers)
    return folder


def _fetch(name: str | None, folder: Path | None, *, json: bool) -> None:
    """Download the data of a benchmark, or list the files that the user must download."""
    from betterbench.vlm import find_benchmark

    if name is None:
        raise InvalidInputError(
            "better vlm fetch", "no benchmark was given", "Run `better vlm fetch BENCHMARK --data DIR`"
        )
    chosen = find_benchmark(name)
    from betterbench.cli.output.vlm import print_source
    from betterbench.vlm.fetching import fetch_data

    if not chosen.source.repository:
        raise InvalidInputError("better vlm fetch", f"{chosen.name} needs no data", f"Run `better vlm {chosen.name}`")
    if folder is None:
        print_source(chosen)
        raise InvalidInputError("--data", "this option is required", "Pass the folder for the data")
    with progress_bar(f"data of {chosen.name}", 0) as (bar, task):
        fetched = fetch_data(
            chosen, folder, on_progress=lambda done, total: bar.update(task, completed=done, total=total or None)
        )
    if json:
        print_json({"data": str(folder), "files": [file.to_json() for file in fetched], "terms": chosen.source.terms})
        return
    print_source(chosen, fetched)
    OUT.print(str(folder), markup=False, soft_wrap=True)
