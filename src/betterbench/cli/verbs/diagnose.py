"""``better diagnose``: assign a label with evidence to each trial of a run."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from betterbench.cli.console import OUT, print_json, say
from betterbench.errors import InvalidInputError, RunConflictError, StorageError

if TYPE_CHECKING:
    from betterbench.diagnosis import RunDiagnosis
    from betterbench.diagnosis.changes import DiagnosisChanges
    from betterbench.diagnosis.measures.standing import Standing
    from betterbench.records import RunFolder
    from betterbench.vqa.knowing import Knowledge


def diagnose_command(
    run: Annotated[Path, tyro.conf.Positional],
    *,
    twins: Path | None = None,
    keep: bool = False,
    answers: Path | None = None,
    questions: Path | None = None,
    json: bool = False,
) -> None:
    """Diagnose every trial of a run from its records alone.

    The result is stored as RUN/diagnosis.json. If the run contains an earlier diagnosis, the differences are printed.
    An unfinished run can be diagnosed too: missing trials are not counted, and nothing is stored.

    With --answers, a model's answers about the decisive moments are compared with the policy's behavior. For each
    trial, the result states whether the model answered correctly, and whether the policy acted accordingly.
    `better report` shows the comparison too.

    Example: better diagnose runs/expert

    Args:
        run: Run folder.
        twins: For a LIBERO-PRO run: a run of the same policy on the base suite. Its trials from the same initial states
            are the counterfactual twins. Nothing is stored in this case.
        keep: Do not change the stored diagnosis and the stored answers.
        answers: File with answers to a question set made by `better vqa --run`.
        questions: Folder of the question set; default: the folder of the answers.
        json: Print one JSON document instead of tables.
    """
    from betterbench.cli.output.diagnosis import diagnosed
    from betterbench.diagnosis import stored
    from betterbench.diagnosis.changes import find_changes
    from betterbench.diagnosis.measures.standing import standing_of
    from betterbench.records import RunFolder

    folder = RunFolder.open(run)
    before = stored.read_stored(folder)
    result = diagnosed(folder, twins_in=None if twins is None else RunFolder.open(twins))
    changes = (
        None
        if before is None or result.pending or twins is not None
        else find_changes(before, stored.StoredDiagnosis.of(result))
    )
    if result.pending:
        say(f"The run is unfinished: {len(result.trials)} of {result.planned} trials are done. Nothing is stored.")
    elif not keep and twins is None:
        _store(folder, result)
    known = None if answers is None else _knowledge(folder, result, answers, questions, keep=keep)
    standing = standing_of(result) if folder.world.measured else None
    if json:
        print_json(_document(result, standing, changes, known))
        return
    _print(result, standing, changes, known)


def _document(
    result: RunDiagnosis, standing: Standing | None, changes: DiagnosisChanges | None, known: Knowledge | None
) -> dict[str, Any]:
    """Return the JSON document that ``--json`` prints."""
    from betterbench.report.headline import headline_of

    document = {
        **result.to_json(),
        "power": None if standing is None else standing.to_json(),
        "changes": None if changes is None else changes.to_json(),
        "headline": headline_of(result).to_json(),
    }
    return document if known is None else {**document, "knowledge": known.to_json()}


def _store(folder: RunFolder, result: RunDiagnosis) -> None:
    """Store the diagnosis in the run folder, or report why it could not be stored."""
    from betterbench.diagnosis import stored

    with _said_if_not_kept("not stored", stored.stored_path(folder)):
        stored.store_diagnosis(folder, result)


@contextmanager
def _said_if_not_kept(consequence: str, path: Path) -> Iterator[None]:
    """Report an error that occurs while a result is being stored, and continue, so that the result is still printed.

    Args:
        consequence: Beginning of the message, which states the consequence of the error.
        path: File that was to be written.
    """
    try:
        yield
    except (InvalidInputError, RunConflictError, StorageError) as error:
        say(f"{consequence}: {error}")
    except OSError as error:
        say(f"{consequence}: {path} cannot be written ({error.strerror})")


def _print(
    result: RunDiagnosis, standing: Standing | None, changes: DiagnosisChanges | None, known: Knowledge | None
) -> None:
    """Print the tables of a diagnosis, followed by the verdict in one line."""
    from betterbench.cli.output.diagnosis import print_changes, print_diagnosis
    from betterbench.cli.output.standing import print_standing
    from betterbench.cli.output.vqa import print_knowledge
    from betterbench.report.headline import headline_of, verdict_line

    print_diagnosis(result)
    if standing is not None:
        print_standing(result.policy, standing)
    if changes is not None and changes.any:
        print_changes(changes)
    if known is not None:
        OUT.print()
        print_knowledge(known)
    OUT.print(f"\n{verdict_line(result)}", markup=False, style="bold", soft_wrap=not OUT.is_terminal)
    claim = headline_of(result).claim
    for line in filter(None, (claim.deciding, claim.command)):
        OUT.print(line, markup=False, soft_wrap=True)


def _knowledge(
    folder: RunFolder, result: RunDiagnosis, answers: Path, questions: Path | None, *, keep: bool
) -> Knowledge:
    """Compare a model's answers with the policy's behavior in a run, and store the comparison for the report."""
    from betterbench.vqa.asking import read_answers
    from betterbench.vqa.dataset import SET_NAME, read_set
    from betterbench.vqa.knowing import knowledge_of, knowledge_path, store_knowledge

    if questions is None and not (answers.absolute().parent / SET_NAME).exists():
        problem = f"the folder of {answers} contains no question set"
        raise InvalidInputError("--questions", problem, "Pass the folder of the question set that was answered")
    asked = read_set(answers.absolute().parent if questions is None else questions)
    asked.require_about(folder)
    known = knowledge_of(result, asked, read_answers(answers, asked))
    if not known.is_complete:
        say(
            "Not stored for the report: not every question has an answer yet. Ask the rest with `better vqa SET --ask`."
        )
    elif not keep:
        with _said_if_not_kept("the report will not show it", knowledge_path(folder)):
            store_knowledge(folder, known)
    return known
