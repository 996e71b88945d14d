"""``better study``: train and evaluate small policies on every arm of a study, and write one page with the results."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from betterbench.cli.console import OUT, print_json, print_table, progress_bar, say
from betterbench.errors import InvalidInputError

if TYPE_CHECKING:
    from betterbench.learning.study.findings import StudyFindings
    from betterbench.learning.study.plan import StudyPlan
    from betterbench.learning.study.stages import StudyOutcome, StudyProgress
    from betterbench.learning.study.work import Workshop


def study_command(
    plan: Annotated[Path | None, tyro.conf.Positional] = None,
    *,
    out: Path,
    preset: str | None = None,
    suite: str | None = None,
    workers: int | None = None,
    device: str = "cpu",
    certificate: Path | None = None,
    overwrite: bool = False,
    json: bool = False,
) -> None:
    """Train learners on confounded, balanced and covered demonstrations, and compare them on one page.

    For each task and arm (a way to choose the training data), learners are trained with each seed, evaluated on
    training conditions and all variations, and diagnosed. study.html shows each illusion gap, the part of it that
    balancing removes, and the accuracy of the audit's prediction. Ctrl-C keeps finished work. Running the command again
    resumes the job where it stopped, even with a larger plan.

    Example: better study --preset small --out studies/small

    Args:
        plan: YAML file with tasks, arms, seeds and recipe.
        out: Study folder.
        preset: Name of a built-in plan, instead of a file: small (half an hour on two cores), full, levers, doses or
            diverse (hours).
        suite: Packaged suite, or folder with a suite in JSON. Its tasks replace those of the plan.
        workers: Number of worker processes for demonstrations and trials; default: one per CPU core.
        device: Torch device for training: cpu, cuda or cuda:N.
        certificate: Certificate written by `better certify`, or its folder; default: the certificate shipped with the
            suite.
        overwrite: Write even to a folder that `better study` did not make, and replace files of the same names there.
        json: Print one JSON document instead of tables.
    """
    chosen = _plan(plan, preset, suite)
    count = sum(1 for _ in chosen.learners())
    say(f"{count} learners: {', '.join(chosen.tasks)}; {', '.join(chosen.arms)}; {len(chosen.seeds)} seeds")
    from betterbench.jobs.outputs import OutputFolder
    from betterbench.learning.study.page import document_of, write_page
    from betterbench.learning.study.stages import STAGES
    from betterbench.learning.study.work import usual_workshop

    with OutputFolder(out, "study", overwrite=overwrite, is_ours=(out / STAGES).is_dir):
        workshop = usual_workshop(workers=workers or os.cpu_count() or 1, device=device)
        outcome = _run(chosen, out, workshop, certificate)
        found = write_page(outcome, out)
    if json:
        print_json(document_of(outcome, found))
        return
    _print(found, out)


def _plan(file: Path | None, preset: str | None, suite: str | None) -> StudyPlan:
    from betterbench.cli.yaml_file import read_yaml
    from betterbench.learning.study.plan import CURE, preset_text, read_study_plan
    from betterbench.tasks import suite_tasks

    if (file is None) == (preset is None):
        raise InvalidInputError(
            "the plan", "expected exactly one plan", "Pass either a YAML file or a preset, such as --preset small"
        )
    tasks = {} if suite is None else {"tasks": list(suite_tasks(suite))}
    if file is not None:
        # Camera views are nested deeply.
        read = read_yaml(file, cure=CURE, deepest=8)
        return read_study_plan({**read, **tasks}, where=str(file))
    import yaml

    form: dict[str, Any] = yaml.safe_load(preset_text(str(preset)))
    return read_study_plan({**form, **tasks}, where=f"preset {preset}")


def _run(plan: StudyPlan, out: Path, workshop: Workshop, certificate: Path | None) -> StudyOutcome:
    from betterbench.cli.verbs.evaluate import prepare_robots_of
    from betterbench.learning.study.stages import run_study

    prepare_robots_of(plan.tasks)
    with progress_bar("study", 0) as (bar, row):
        shown = ("", "")

        def on_progress(progress: StudyProgress) -> None:
            nonlocal shown
            if shown != (progress.name, progress.note.partition(" ")[0]):  # a new stage has a different pace
                shown = (progress.name, progress.note.partition(" ")[0])
                bar.reset(row)
            what = f"{progress.number}/{progress.stages} {progress.name}"
            bar.update(
                row, description=what, total=progress.planned or None, completed=progress.done, note=progress.note
            )

        return run_study(plan, out, workshop, certificate=certificate, on_progress=on_progress)


def _print(found: StudyFindings, out: Path) -> None:
    """Print the results by arm, and whether each expectation was confirmed."""
    from betterbench.learning.study.page import expectations

    rows = [
        (a.lever, a.arm, *(f"{f.with_unit()} ({f.interval()})" for f in (a.training, a.variations, a.gap)))
        for a in found.arms
        if not a.task
    ]
    print_table(("lever", "arm", "training", "variations", "illusion gap"), rows)
    for line in expectations(found):
        held = "open" if line.held is None else "held" if line.held else "not confirmed"
        OUT.print(f"\n{line.expected}: {held}. {line.found}", markup=False)
    OUT.print(f"\npage  {out / 'study.html'}", markup=False, soft_wrap=True)
