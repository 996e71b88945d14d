"""``better import-better``: import tasks of the BeTTER release, audit them, and certify them on request."""

from __future__ import annotations

import os
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from betterbench.cli.console import OUT, print_json, print_listing, print_table, progress_bar, say
from betterbench.errors import InvalidInputError, UnknownNameError

if TYPE_CHECKING:
    from betterbench.certification.certificate import Certificate, Summary, TrialCertificate
    from betterbench.certification.demonstrations import Demonstration
    from betterbench.generation.better_release import Imported, ReleaseTask
    from betterbench.jobs import JobProgress

_SUITE = "better_release"
_MAX_BYTES = 512 * 1024
_DEEPEST = 8


def import_better_command(
    folder: Annotated[Path, tyro.conf.Positional],
    *,
    out: Path,
    asset: tuple[str, ...] = (),
    catalogue: Path | None = None,
    certify: bool = False,
    trials: int = 3,
    demonstrations: int = 60,
    workers: int | None = None,
    overwrite: bool = False,
    json: bool = False,
) -> None:
    """Import tasks of the BeTTER release.

    List motions outside the training support, and instructions that contradict the scene.

    The folder is a clone of github.com/BeingBeyond/BeTTER, or one task folder in it. The output contains audit.json,
    audit.md and a suite folder, in which the tasks use the assets of betterbench. Other commands load this folder with
    --suite or --task-file. The release is only read; none of its code is executed.

    Example: better import-better BeTTER --out imported --certify

    Args:
        folder: Clone of the release, or folder with a task.yaml.
        out: Folder to write.
        asset: Asset category to use for an object of the release instead of the search result, as NAME=CATEGORY.
        catalogue: Catalogue of assets to search; the built-in generators if not given.
        certify: Measure demonstrations of the imported tasks and certify them; takes minutes.
        trials: Trials per variation for --certify.
        demonstrations: Demonstrations per task to measure for --certify.
        workers: Worker processes for --certify; one per CPU core if not given.
        overwrite: Write even to a folder that `better import-better` did not make, and replace existing files.
        json: Print the audit as one JSON document.
    """
    from betterbench.generation.better_release import audit_form, audit_markdown
    from betterbench.jobs import write_durably
    from betterbench.jobs.outputs import OutputFolder
    from betterbench.quoting import json_text

    releases = _read(folder)
    imported = _imported(releases, _choices(asset, releases), catalogue)
    with OutputFolder(out, "import-better", overwrite=overwrite):
        suite = _write_suite(imported, out)
        if certify and suite is not None:
            results = _certify(
                imported,
                out,
                suite,
                trials=trials,
                demonstrations=demonstrations,
                workers=workers or os.cpu_count() or 1,
            )
            imported = [replace(one, certificate=results.get(one.task_id or "", {})) for one in imported]
        form = audit_form(imported, suite=suite)
        write_durably(out / "audit.json", (json_text(form, indent=1, allow_nan=False) + "\n").encode())
        write_durably(out / "audit.md", audit_markdown(imported, suite=suite).encode())
    if json:
        print_json(form)
        return
    for one in imported:
        _print(one)
    if suite is not None:
        OUT.print(f"suite       {out / suite}", markup=False, soft_wrap=True)
    OUT.print(f"audit       {out / 'audit.md'}", markup=False, soft_wrap=True)


def _read(folder: Path) -> list[ReleaseTask]:
    from betterbench.cli.yaml_file import read_yaml
    from betterbench.generation.better_release import find_tasks, read_release_task

    reader = partial(
        read_yaml, cure="Correct the file, or restore it from the release", deepest=_DEEPEST, max_bytes=_MAX_BYTES
    )
    return [read_release_task(task, reader) for task in find_tasks(folder)]


def _choices(asset: tuple[str, ...], releases: list[ReleaseTask]) -> dict[str, str]:
    """Return the asset category that ``--asset`` gives for each named object."""
    found: dict[str, str] = {}
    known = {name for release in releases for name in release.instances}
    for text in asset:
        name, separator, category = text.partition("=")
        if not separator or not name or not category or name in found:
            problem = "the object was given twice" if name in found else "expected NAME=CATEGORY"
            raise InvalidInputError(f"--asset {text}", problem, "Write, for example, --asset pear_1=lemon")
        if name not in known:
            raise UnknownNameError("object of the release", name, known)
        found[name] = category
    return found


def _imported(releases: list[ReleaseTask], given: dict[str, str], catalogue: Path | None) -> list[Imported]:
    from betterbench.generation.better_release import (
        Imported,
        audit_release,
        build_task,
        library_catalogue,
        match_instances,
        resolve,
    )

    found = []
    with library_catalogue(catalogue) as opened:
        if not opened.has_vectors:
            say("Assets were searched by words only; the extra assets adds the search by meaning.")
        for release in releases:
            resolved = resolve(release)
            own = {name: category for name, category in given.items() if name in release.instances}
            matches = match_instances(release, opened, given=own)
            built = build_task(release, resolved, matches)
            audit = audit_release(release, resolved, matches, built)
            found.append(Imported(release, resolved, matches, built, audit))
    return found


def _write_suite(imported: list[Imported], out: Path) -> str | None:
    """Write the imported tasks as a suite folder, and return the name of the folder.

    Return None if no task can be represented in our task format.
    """
    from betterbench.jobs import write_durably
    from betterbench.tasks import suite_files, task_to_json

    forms = {}
    for one in imported:
        if one.built.task is not None:
            if one.built.task.id in forms:
                problem = f"two tasks get the same id, {one.built.task.id}"
                raise InvalidInputError(str(one.release.folder), problem, "Import each task folder separately")
            forms[one.built.task.id] = task_to_json(one.built.task)
    if not forms:
        return None
    name, files = suite_files(_SUITE, forms)
    for path, content in files.items():
        (out / name / path).parent.mkdir(parents=True, exist_ok=True)
        write_durably(out / name / path, content)
    return name


def _certify(
    imported: list[Imported], out: Path, suite: str, *, trials: int, demonstrations: int, workers: int
) -> dict[str, dict[str, Summary]]:
    """Measure demonstrations of imported tasks and certify all conditions. Return the results by task and condition."""
    from betterbench.certification import summaries
    from betterbench.certification.measuring import measure, write_demonstrations
    from betterbench.certification.runner import certify
    from betterbench.cli.verbs.evaluate import prepare_robots_of
    from betterbench.evaluation import make_plan
    from betterbench.report.pages.certificate_page import write_certificate_page
    from betterbench.tasks import TrialId
    from betterbench.tasks.user_files import load_task_files

    names = [one.built.task.id for one in imported if one.built.task is not None]
    load_task_files([out / suite])
    prepare_robots_of(names)
    folder = out / f"certificate-{suite.rpartition('-')[2]}"
    with progress_bar("measure", demonstrations * len(names)) as (bar, task):

        def measured(progress: JobProgress[Demonstration]) -> None:
            last = progress.last
            bar.update(task, total=progress.planned, completed=progress.done)
            if last is not None and last.problem:
                say(f"{last.task}/{last.condition} seed {last.seed}: {last.problem}; the demonstration is left out")

        write_demonstrations(measure(names, folder, number=demonstrations, workers=workers, on_progress=measured))
    plan = [TrialId(t.task, t.condition, t.seed) for t in make_plan("expert", tasks=names, trials=trials).trials]
    with progress_bar("certify", len(plan)) as (bar, task):

        def told(progress: JobProgress[TrialCertificate]) -> None:
            bar.update(task, completed=progress.done)

        certificate: Certificate = certify(plan, folder, workers=workers, on_progress=told)
    say(f"certificate: {write_certificate_page(certificate, folder / 'certificate.html')}")
    found: dict[str, dict[str, Summary]] = {}
    for summary in summaries(certificate.trials):
        found.setdefault(summary.task, {})[summary.condition] = summary
    return found


def _print(one: Imported) -> None:
    """Print the assets, the variations and the faults of an imported task."""
    from betterbench.generation.better_release import certified_text, counts_of
    from betterbench.generation.better_release.pages import certificate_notes

    rows = []
    for name in one.release.instances:
        match = one.matches.get(name)
        found = ["none", "–", ""] if match is None else [match.category, f"{match.score:.2f}", match.how]
        rows.append([name, *found])
    print_table(["object", "asset", "score", "found by"], rows, title=one.release.task.task_id)
    OUT.print("")
    rows = []
    for name, variation in one.resolved.items():
        shown = one.built.variations[name]
        faults, remarks = counts_of(one.audit.of(name))
        kind = "training" if variation.training else "test"
        ours = shown.name or "not represented"
        certified = certified_text(one.certified(name)) or "–"
        rows.append([name, kind, ours, shown.base or "", str(faults), str(remarks), certified])
    print_table(["variation", "kind", "in our form", "from", "faults", "remarks", "certified"], rows)
    faulty = [[f.variation or "all", f.code, f.text] for f in one.audit.faults]
    for name in one.resolved:
        faulty += [[name, "certificate", note] for note in certificate_notes(one.certified(name))]
    if faulty:
        OUT.print("")
        print_listing(["variation", "fault", ""], faulty)
    remarks = len(one.audit.findings) - len(one.audit.faults)
    OUT.print(f"\n{len(one.audit.faults)} faults, {remarks} remarks", markup=False)
