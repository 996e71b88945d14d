"""``better dataset``: make a training set with its manifest, dataset card, statistics and shortcut audit."""

from __future__ import annotations

import os
import re
import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from betterbench.cli.console import OUT, print_json, print_table, progress_bar
from betterbench.errors import InvalidInputError

if TYPE_CHECKING:
    from betterbench.demonstrations.sets.build import MadeDataset
    from betterbench.demonstrations.sets.recipe import SetRecipe


def dataset_command(
    *,
    out: Path,
    tasks: tuple[str, ...] = (),
    suite: str = "better60",
    regime: Literal["training", "balanced", "diverse-confounded", "covered"] = "training",
    demos: int = 50,
    sources: int = 10,
    seed: int = 1_000_000,
    noise: float = 0.02,
    validation: float = 0.1,
    pairs: bool = False,
    expect: str | None = None,
    sign: Path | None = None,
    workers: int | None = None,
    pictures: bool = True,
    overwrite: bool = False,
    json: bool = False,
) -> None:
    """Make a training set from demonstrations of one training distribution, and check every record.

    Expert demonstrations are adapted to initial states that cover the distribution evenly (see `better amplify`). The
    folder contains the demonstrations as a run, which `better export`, `better materialize` and `better vqa` can read.
    It also contains a dataset card, the split, normalization statistics, the shortcut audit, and a prediction of the
    variations that a learner trained on this set will fail. The command prints how to reproduce the set. Ctrl-C keeps
    finished demonstrations. Running the command again resumes the job where it stopped; a larger --demos adds more.

    Example: better dataset --demos 50 --out sets/training

    Args:
        out: Set folder.
        tasks: Tasks to demonstrate; default: all tasks in the suite.
        suite: Suite that contains the tasks.
        regime: training (with the confounds), balanced (the same number of demonstrations without the confounds or any
            test condition), diverse-confounded (as many conditions as balanced, but each word always refers to the same
            slot), or covered (the test conditions).
        demos: Demonstrations per training condition; the other distributions divide the same total among their
            conditions.
        sources: Expert demonstrations per training condition from which the others are generated; with 0 or --pairs,
            the expert makes all demonstrations.
        seed: First seed, 1000000 or above.
        noise: Standard deviation of the noise added to the executed actions, in action units; the recorded actions are
            free of this noise.
        validation: Fraction of the seeds held out for validation.
        pairs: Make pairs of twins: in conditions with the same scene, the expert moves identically until the
            instructions require different motions.
        expect: Expected hash of the set, as printed on another machine; the command fails if the hash differs.
        sign: Private SSH key with which prediction.json is signed.
        workers: Number of worker processes; default: one per CPU core.
        pictures: Also render a contact sheet of each task's initial states.
        overwrite: Replace files of the set that were changed by hand.
        json: Print the result as one JSON document.
    """
    from betterbench.demonstrations.sets.recipe import SetRecipe
    from betterbench.tasks import suite_tasks

    _require_hash(expect)
    of_suite = suite_tasks(suite)  # needed with --tasks too, so that the tasks of a suite folder are loaded
    recipe = SetRecipe(tuple(dict.fromkeys(tasks or of_suite)), regime, demos, sources, seed, noise, validation, pairs)
    began = time.monotonic()
    made = _make(recipe, out, workers, pictures=pictures, overwrite=overwrite)
    seconds = time.monotonic() - began
    if sign is not None:
        _sign(made, sign)
    _tell(made, seconds, as_json=json)
    if expect is not None and made.sha256 != expect:
        cure = "Use the same betterbench version, kind of machine and arguments to make the same set"
        raise InvalidInputError("--expect", f"the set has a different hash, {made.sha256}", cure)


def _require_hash(text: str | None) -> None:
    if text is not None and not re.fullmatch("[0-9a-f]{64}", text):
        raise InvalidInputError(
            "--expect",
            f"{text!r} is not the hash of a set",
            "Pass the 64 hexadecimal digits printed by `better dataset`",
        )


def _sign(made: MadeDataset, key: Path) -> None:
    from betterbench.demonstrations.shortcuts.prediction import sign

    if made.prediction is None:
        raise InvalidInputError("--sign", "there are too few demonstrations for a prediction", "Increase --demos")
    sign(made.path / "prediction.json", key)


def _make(recipe: SetRecipe, out: Path, workers: int | None, *, pictures: bool, overwrite: bool) -> MadeDataset:
    from betterbench.cli.verbs.evaluate import prepare_robots_of
    from betterbench.demonstrations.sets.build import make_dataset

    recipe.check()
    prepare_robots_of(recipe.tasks)
    with progress_bar("dataset", 0) as (bar, shown):
        shown_stage = ""

        def told(stage: str, done: int, planned: int, note: str) -> None:
            nonlocal shown_stage
            if stage != shown_stage:  # the pace of the previous stage does not predict the pace of this stage
                shown_stage = stage
                bar.reset(shown)
            bar.update(shown, description=stage, total=planned, completed=done, note=note)

        return make_dataset(
            recipe,
            out,
            workers=workers or os.cpu_count() or 1,
            pictures=pictures,
            overwrite=overwrite,
            on_progress=told,
        )


def _tell(made: MadeDataset, seconds: float, *, as_json: bool) -> None:
    from betterbench.cli.output.demonstrations import tell_variety
    from betterbench.cli.progress import took

    size = sum(file.stat().st_size for file in made.path.rglob("*") if file.is_file())
    if as_json:
        print_json(_document(made) | {"bytes": size, "seconds": round(seconds, 3)})
        return
    if made.audit is not None:
        rows = [
            (group.group, str(group.episodes), ", ".join(dict.fromkeys(f.title for f in group.shortcuts)) or "none")
            for group in made.audit.groups
        ]
        print_table(("task", "demonstrations", "shortcuts"), rows)
    tell_variety(made.variety, made.sources)
    missing = f", {made.missing} fewer than requested" if made.missing else ""
    pairs = f", {len(made.pairs)} pairs of twins" if made.pairs else ""
    OUT.print(
        f"{made.demonstrations} demonstrations{missing}, {made.steps} steps{pairs}\n{took(seconds, size)}", markup=False
    )
    OUT.print(f"hash of the set {made.sha256}\ncard            {made.path / 'README.md'}", markup=False, soft_wrap=True)
    OUT.print(f"again           {made.command}", markup=False, soft_wrap=True)


def _document(made: MadeDataset) -> dict[str, Any]:
    shortcuts = {} if made.audit is None else {g.group: [f.question for f in g.shortcuts] for g in made.audit.groups}
    return {
        "path": str(made.path),
        "sha256": made.sha256,
        "command": made.command,
        "demonstrations": made.demonstrations,
        "missing": made.missing,
        "steps": made.steps,
        "pairs": len(made.pairs),
        "shortcuts": shortcuts,
        "variety": {"set": [asdict(t) for t in made.variety], "sources": [asdict(t) for t in made.sources]},
    }
