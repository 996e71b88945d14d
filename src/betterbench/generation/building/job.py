"""Resumable job that builds tasks from scenarios and writes the certified tasks as a suite."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Self

from pydantic import TypeAdapter

from betterbench.certification.certificate import Certificate, CertificateVersions
from betterbench.certification.runner import write_json
from betterbench.errors import InvalidInputError
from betterbench.generation.building.attempts import Built, build_task
from betterbench.generation.building.importing import ImportedMeshes, import_missing
from betterbench.generation.building.result import (
    BuildReport,
    ChosenAsset,
    Result,
    Settings,
    UnbuiltVariation,
)
from betterbench.generation.scenario import Scenario
from betterbench.jobs import JobProgress, in_processes, run_items, write_durably
from betterbench.json_form import dump_json, open_seal, read_bounded, read_form, sealed_form
from betterbench.sim.assets import categories
from betterbench.sim.assets.catalogue.encoders import open_encoder
from betterbench.sim.assets.catalogue.indexing import index_sources
from betterbench.sim.assets.catalogue.search import Catalogue
from betterbench.sim.assets.catalogue.sources import open_source
from betterbench.sim.assets.catalogue.sources.procedural import NAME
from betterbench.sim.assets.catalogue.sources.source import SourceOptions
from betterbench.sim.scenes import engine_version
from betterbench.tasks import SUITE_VERSION, require_suite_name, suite_files, task_names, task_to_json
from betterbench.tasks.demonstrated import DemonstrationsFile
from betterbench.tasks.suite_folder import CERTIFICATE, TASKS
from betterbench.tasks.user_files import COMPANION_SUFFIX
from betterbench.version import __version__

CATALOGUE, RESULTS = "catalogue", "built"
"""Folders of a build: the asset catalogue, and one file per finished scenario."""
_MOST_BYTES = 64 << 20
_LONGEST_ID = 40
_CURE = "Remove the file, and run the same command again"


_RESULT = TypeAdapter(Result)


@dataclass(frozen=True, slots=True)
class BuildItem:
    """Scenario to build, as JSON, with the identifier of the task that is built from it."""

    scenario: str
    task_id: str

    @classmethod
    def of(cls, scenario: Scenario, task_id: str) -> Self:
        """Return the item for a scenario."""
        return cls(json.dumps(asdict(scenario), sort_keys=True), task_id)


def build_suite(
    scenarios: Sequence[Scenario],
    out: Path,
    *,
    name: str,
    settings: Settings | None = None,
    workers: int = 1,
    meshes: Path | None = None,
    on_import: Callable[[ImportedMeshes], None] = lambda _: None,
    on_progress: Callable[[JobProgress[Result]], None] | None = None,
) -> BuildReport:
    """Build, certify and write a suite. Repeating the call resumes an interrupted build and produces the same files.

    Args:
        scenarios: Scenarios to build.
        out: Folder of the job.
        name: Name of the suite, without its digest.
        settings: Number of seeds to certify, and number of demonstrations.
        workers: Number of worker processes.
        meshes: Catalogue written by ``better assets index``, searched for objects that the library lacks.
        on_import: Called with the assets that were imported from the catalogue ``meshes``.
        on_progress: Called at the start and after every scenario.

    Raises:
        InvalidInputError: If there is no scenario, the name is not a valid suite name, or a stored result is damaged.
        WorkerError: If worker processes keep dying.
    """
    if not scenarios:
        raise InvalidInputError("scenarios", "the list is empty", "Pass at least one scenario")
    require_suite_name(name)  # check the name before the build, which takes hours
    settings = settings or Settings()
    if meshes is not None:
        index_library(out)
        with Catalogue(out / CATALOGUE) as library, Catalogue(meshes, encoder=open_encoder) as user:
            imported = import_missing(scenarios, library, user, out)
        on_import(imported)
    taken = Counter(task_names())
    items = [BuildItem.of(scenario, new_task_id(scenario.name, taken)) for scenario in scenarios]
    found = build_items(items, out, settings=settings, workers=workers, on_progress=on_progress)
    return BuildReport(found, write_suite([r for r in found if r.certified], out, name))


def build_items(
    items: Sequence[BuildItem],
    out: Path,
    *,
    settings: Settings,
    workers: int = 1,
    on_stored: Callable[[Result], object] = lambda _: None,
    on_progress: Callable[[JobProgress[Result]], None] | None = None,
) -> tuple[Result, ...]:
    """Build and certify tasks from scenarios in a folder, and return the results in the order of the scenarios.

    Stored results are reused. ``on_stored`` is called for each stored result. ``on_progress`` is called at the start
    and after every new result.

    Raises:
        InvalidInputError: If a stored result is damaged.
        WorkerError: If worker processes keep dying.
    """
    index_library(out)
    results: dict[BuildItem, Result] = {}
    for item in items:
        stored = _stored(out, item, settings)
        if stored is not None:
            results[item] = stored
            on_stored(stored)
    by_id = {item.task_id: item for item in items}

    def keep(result: Result) -> None:
        content = dump_json(sealed_form(json.loads(dump_json(asdict(result))))) + b"\n"
        write_durably(out / RESULTS / f"{result.task_id}.json", content)
        results[by_id[result.task_id]] = result

    (out / RESULTS).mkdir(parents=True, exist_ok=True)
    run_items(
        items,
        is_done=results.__contains__,
        work=lambda waiting: _work(waiting, out, settings, workers),
        keep=keep,
        on_progress=on_progress,
    )
    return tuple(results[item] for item in items)


def index_library(out: Path) -> None:
    """Write the catalogue of the asset library into the folder of a build."""
    index_sources(out / CATALOGUE, [open_source(NAME, SourceOptions())], on_progress=lambda *_: None)


def _work(waiting: list[BuildItem], out: Path, settings: Settings, workers: int) -> Iterator[Result]:
    return in_processes(waiting, functools.partial(_build, str(out / CATALOGUE), settings), workers=workers)


def _build(catalogue: str, settings: Settings, item: BuildItem) -> Result:
    scenario = TypeAdapter(Scenario).validate_json(item.scenario)
    with Catalogue(Path(catalogue)) as opened:
        built = build_task(scenario, item.task_id, opened, settings=settings)
    return _result(built, _key(item, settings))


def _result(built: Built, key: str) -> Result:
    made, proof = built.made, built.proof
    return Result(
        schema_version=1,
        key=key,
        task_id=built.task_id,
        template=built.scenario.template,
        title=built.scenario.name,
        attempts=built.attempts,
        left_out=built.left_out,
        unbuilt=() if made is None else tuple(UnbuiltVariation(u.axis, u.title, u.reason) for u in made.unbuilt),
        confounds=() if made is None else made.confounds,
        chosen=tuple(
            ChosenAsset(c.group, c.described.description, c.described.asset_query, c.entry.id, c.score, c.passed_over)
            for c in built.choices
        ),
        task=None if made is None else task_to_json(made.task),
        demonstrated=None if proof is None else proof.demonstrated,
        # Leave out durations, because the same command must give the same bytes.
        trials=() if proof is None else tuple(dataclasses.replace(t, expert_s=0.0, total_s=0.0) for t in proof.trials),
    )


def write_suite(results: Sequence[Result], out: Path, name: str) -> Path | None:
    """Write a suite folder with the tasks, their demonstrations and their certificate, and return its path.

    Return None if there are no results.
    """
    if not results:
        return None
    full, files = suite_files(name, {r.task_id: r.task for r in results if r.task is not None})
    folder = out / full
    for path, content in files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        write_durably(folder / path, content)
    for result in results:
        if result.demonstrated is not None:
            text = DemonstrationsFile({result.task_id: result.demonstrated}).to_text()
            write_durably(folder / TASKS / f"{result.task_id}{COMPANION_SUFFIX}", text.encode())
    versions = {r.task_id: int((r.task or {})["version"]) for r in results}
    trials = tuple(trial for result in results for trial in result.trials)
    certificate = Certificate(
        CertificateVersions(__version__, SUITE_VERSION, engine_version(), versions), "any", trials, 0.0, 1
    )
    write_json(folder / CERTIFICATE, certificate.sealed_json())
    return folder


def _stored(out: Path, item: BuildItem, settings: Settings) -> Result | None:
    """Return the stored result of a scenario, or None if there is none for the same settings and versions.

    Raises:
        InvalidInputError: If the file was changed after it was written.
    """
    path = out / RESULTS / f"{item.task_id}.json"
    if not path.exists():
        return None
    form = open_seal(read_bounded(path, max_bytes=_MOST_BYTES, cure=_CURE), where=str(path), cure=_CURE)
    # The format of a result with other settings or from another version may differ, so it is not parsed.
    if form.get("key") != _key(item, settings):
        return None
    return read_form(_RESULT, form, where=str(path), cure=_CURE)


def _key(item: BuildItem, settings: Settings) -> str:
    parts = {
        "scenario": item.scenario,
        "task": item.task_id,
        "settings": asdict(settings),
        "versions": [__version__, SUITE_VERSION, engine_version()],
        "assets": sorted(categories()),
    }
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def new_task_id(name: str, taken: Counter[str]) -> str:
    """Create a unique task identifier from the letters and digits in a scenario's name, and reserve it."""
    words = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")[:_LONGEST_ID].strip("_")
    base = words if re.match(r"[a-z]", words) else f"task_{words}".strip("_")
    found, number = base, 1
    while taken[found]:
        number += 1
        found = f"{base}_{number}"
    taken[found] += 1
    return found
