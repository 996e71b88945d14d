"""Production of a training set: the demonstrations, their checks, and files derived from them.

``OUT/recipe.json`` is the recipe. ``OUT/sources`` and ``OUT/demonstrations`` are ordinary run folders. The other files
are derived from their records. ``OUT/dataset.json`` is written last and marks the set as complete.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from betterbench.demonstrations.export.job import validation_seeds
from betterbench.demonstrations.making.amplifier import AmplifierSettings
from betterbench.demonstrations.making.production import SetProgress, amplify, collect, set_hash
from betterbench.demonstrations.making.variety import TaskVariety, VarietyMeter, variety_of_run
from betterbench.demonstrations.sets.card import CardFacts, dataset_card
from betterbench.demonstrations.sets.numbers import SetNumbers, counts_form
from betterbench.demonstrations.sets.pairs import twin_pairs
from betterbench.demonstrations.sets.proof import RegimeBounds, proven_facts
from betterbench.demonstrations.sets.recipe import SetRecipe, holds_recipe, keep_recipe, require_recipe
from betterbench.demonstrations.sets.sheet import draw_sheet
from betterbench.demonstrations.shortcuts.examine import FEWEST, ShortcutAudit, audit_dataset
from betterbench.demonstrations.shortcuts.facts import EpisodeFacts
from betterbench.demonstrations.shortcuts.prediction import Prediction, predict, write_prediction
from betterbench.errors import BetterError, InvalidInputError, StorageError
from betterbench.jobs import write_durably
from betterbench.jobs.durable import on_disk
from betterbench.jobs.outputs import OutputFolder
from betterbench.quoting import json_text
from betterbench.records import RunFolder
from betterbench.records.twins import PAIRS_FILE, TwinPair, pairs_bytes
from betterbench.tasks import TrialId, get_task

SOURCES, DEMONSTRATIONS = "sources", "demonstrations"
"""Folders of a training set: the expert's demonstrations from which further ones are generated, and the demonstrations
that the set consists of."""

OnStage = Callable[[str, int, int, str], None]
"""Callback that receives the name of a stage, the number of finished items, the total number, and a note."""


@dataclass(frozen=True, slots=True)
class MadeDataset:
    """Finished training set.

    Attributes:
        path: Folder of the set.
        sha256: Hash of the demonstrations.
        command: Command that reproduces the set.
        demonstrations: Number of demonstrations.
        steps: Number of control steps.
        missing: Number of planned initial states that have no demonstration, even after replacements.
        audit: Shortcut audit; None if no task has enough demonstrations.
        prediction: Predicted failures from the audit; None without an audit.
        pairs: Pairs of twins (demonstrations with the same initial state and different instructions).
        variety: Variety of the demonstrations of each task.
        sources: Variety of the source demonstrations of each task; empty if there are no sources.
    """

    path: Path
    sha256: str
    command: str
    demonstrations: int
    steps: int
    missing: int
    audit: ShortcutAudit | None
    prediction: Prediction | None
    pairs: tuple[TwinPair, ...]
    variety: tuple[TaskVariety, ...]
    sources: tuple[TaskVariety, ...]


def make_dataset(
    recipe: SetRecipe,
    out: Path,
    *,
    workers: int = 1,
    pictures: bool = True,
    overwrite: bool = False,
    on_progress: OnStage | None = None,
) -> MadeDataset:
    """Make the training set that a recipe describes.

    If an earlier call was interrupted, calling the function again resumes the work. The resulting files are the same as
    without the interruption.

    Args:
        recipe: Recipe of the set.
        out: Output folder of the set.
        workers: Number of worker processes.
        pictures: Whether to draw a sheet of initial states for each task.
        overwrite: Whether to replace files of the set that were edited by hand.
        on_progress: Called with the progress of each stage.

    Raises:
        InvalidInputError: If a number is out of range, a task does not define the training distribution, or the
            training support of a task was not measured.
        UnknownNameError: If a task does not exist.
        RunConflictError: If the folder contains another data set, or another process writes to it.
        RecordError: If a record is damaged, or shows behavior outside the training distribution.
        StorageError: If the disk is full.
        WorkerError: If worker processes keep dying.
    """
    recipe.check()
    out = out.absolute()
    tell = on_progress or (lambda *_: None)
    require_recipe(recipe, out)
    with on_disk(out), OutputFolder(out, "dataset", overwrite=overwrite, is_ours=lambda: holds_recipe(out)):
        return _made(recipe, out, workers, tell, pictures=pictures)


def _made(recipe: SetRecipe, out: Path, workers: int, tell: OnStage, *, pictures: bool) -> MadeDataset:
    """Make a training set in its folder, which the caller has locked."""
    keep_recipe(recipe, out)
    (out / "dataset.json").unlink(missing_ok=True)
    run = _demonstrations(recipe, out, workers, tell)
    trials = sorted(entry.key for entry in run.entries() if entry.status == "done")
    if not trials:
        raise InvalidInputError(
            str(run.path), "no attempt was accepted", "See the reasons in its subfolder 'acceptance'"
        )
    held_out = frozenset(validation_seeds({trial.seed for trial in trials}, recipe.validation))
    numbers, facts, variety = _proven(run, recipe, trials, held_out, tell)
    pairs = tuple(twin_pairs(run, recipe.regime)) if recipe.pairs else ()
    hashed = set_hash(run)
    audit, prediction = _audited(facts, hashed)
    sheets = _sheets(run, trials, out, tell) if pictures else {}
    missing = _missing(recipe, len(trials))
    sources = variety_of_run(RunFolder.open(out / SOURCES)) if recipe.amplified else ()
    command = recipe.command(hashed)
    made = MadeDataset(
        out, hashed, command, len(trials), numbers.steps, missing, audit, prediction, pairs, variety, sources
    )
    split = {
        "train": [str(trial) for trial in trials if trial.seed not in held_out],
        "validation": [str(trial) for trial in trials if trial.seed in held_out],
    }
    _write(made, recipe, numbers, split, sheets)
    return made


def _demonstrations(recipe: SetRecipe, out: Path, workers: int, tell: OnStage) -> RunFolder:
    """Make or resume the run that contains the demonstrations."""

    def told(stage: str) -> Callable[[SetProgress], None]:
        def on_progress(progress: SetProgress) -> None:
            last = "" if progress.last is None else f", {progress.last.trial}"
            tell(stage, progress.done, progress.planned, f"{progress.attempts} attempts{last}")

        return on_progress

    collected = {"first_seed": recipe.seed, "regime": recipe.regime, "workers": workers}
    if not recipe.amplified:
        return collect(
            recipe.tasks,
            out / DEMONSTRATIONS,
            demos=recipe.demos,
            twins=recipe.pairs,
            on_progress=told("collect"),
            **collected,  # type: ignore[arg-type] # the values are as the function has them
        )
    collect(recipe.tasks, out / SOURCES, demos=recipe.sources, on_progress=told("collect"), **collected)  # type: ignore[arg-type]
    return amplify(
        out / SOURCES,
        out / DEMONSTRATIONS,
        tasks=recipe.tasks,
        demos=recipe.demos,
        first_seed=recipe.amplified_seed,
        settings=AmplifierSettings(action_noise=recipe.noise),
        workers=workers,
        on_progress=told("amplify"),
    )


def _proven(
    run: RunFolder, recipe: SetRecipe, trials: list[TrialId], held_out: frozenset[int], tell: OnStage
) -> tuple[SetNumbers, tuple[EpisodeFacts, ...], tuple[TaskVariety, ...]]:
    """Check that each record lies within the training distribution.

    Return the statistics of the set, the facts for the shortcut audit, and the variety of the demonstrations.
    """
    numbers, facts, meter = SetNumbers(held_out), [], VarietyMeter()
    bounds = {name: RegimeBounds.of(get_task(name), recipe.regime) for name in recipe.tasks}
    for count, trial in enumerate(trials, start=1):
        record = run.read_record(trial.task, trial.condition, trial.seed)
        where = str(run.record_path(trial.task, trial.condition, trial.seed))
        facts.append(proven_facts(record, bounds[trial.task], where))
        numbers.add(trial, record)
        meter.add(record)
        tell("prove", count, len(trials), str(trial))
    return numbers, tuple(facts), meter.tasks()


def _audited(facts: tuple[EpisodeFacts, ...], hashed: str) -> tuple[ShortcutAudit | None, Prediction | None]:
    groups = [f.group for f in facts]
    if max(map(groups.count, set(groups))) < FEWEST:
        return None, None
    audit = audit_dataset(hashed, facts)
    return audit, predict(audit, dataset_sha256=hashed)


def _missing(recipe: SetRecipe, there: int) -> int:
    planned = sum(recipe.demos * len(get_task(name).training) for name in recipe.tasks)
    return max(0, planned - there)


def _sheets(run: RunFolder, trials: list[TrialId], out: Path, tell: OnStage) -> Mapping[str, str]:
    """Draw a sheet of initial states for each task.

    Return the path of each sheet, or the reason why it was not drawn.
    """
    found: dict[str, str] = {}
    tasks = list(dict.fromkeys(trial.task for trial in trials))
    for count, task in enumerate(tasks, start=1):
        firsts: dict[str, TrialId] = {}
        for trial in trials:
            if trial.task == task:
                firsts.setdefault(trial.condition, trial)
        name = f"pictures/{task}.jpg"
        try:
            if not (out / name).exists():
                draw_sheet(run, sorted(firsts.values(), key=lambda t: (len(t.condition), t.condition)), out / name)
            found[task] = name
        except StorageError:
            raise
        except BetterError as problem:
            found[task] = f"none: {problem}"
        tell("draw", count, len(tasks), task)
    return found


def _write(
    made: MadeDataset, recipe: SetRecipe, numbers: SetNumbers, split: Mapping[str, list[str]], sheets: Mapping[str, str]
) -> None:
    """Write the files that are derived from the demonstrations. ``dataset.json`` is written last."""
    out, counts = made.path, numbers.counts()
    write_durably(out / "split.json", _json(split))
    write_durably(out / "statistics.json", _json(numbers.statistics()))
    if recipe.pairs:
        write_durably(out / DEMONSTRATIONS / PAIRS_FILE, pairs_bytes(made.pairs))
    if made.audit is not None and made.prediction is not None:
        write_durably(out / "shortcuts.json", _json(made.audit.to_json()))
        write_prediction(out / "prediction.json", made.prediction)
    facts = CardFacts(
        made.sha256,
        made.command,
        counts,
        numbers,
        made.audit,
        made.prediction,
        made.pairs,
        sheets,
        made.variety,
        made.sources,
    )
    write_durably(out / "README.md", dataset_card(recipe, facts).encode())
    document = {
        "sha256": made.sha256,
        "recipe": asdict(recipe),
        "command": made.command,
        "demonstrations": made.demonstrations,
        "missing": made.missing,
        "steps": made.steps,
        "train": len(split["train"]),
        "validation": len(split["validation"]),
        "pairs": len(made.pairs),
        "demonstrators": dict(numbers.demonstrators),
        "proven": {"records": made.demonstrations, "outside_the_regime": 0, "of_tests": 0},
        "conditions": counts_form(counts),
        "variety": {"set": [asdict(t) for t in made.variety], "sources": [asdict(t) for t in made.sources]},
    }
    write_durably(out / "dataset.json", _json(document))


def _json(form: Mapping[str, Any]) -> bytes:
    return (json_text(form, indent=1) + "\n").encode()
