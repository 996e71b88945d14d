"""Certification of many trials in worker processes, with a journal and, at the end, a certificate file."""

from __future__ import annotations

import json
import platform
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from betterbench.certification.certificate import Certificate, CertificateVersions, TrialCertificate, certificate_path
from betterbench.certification.coverage import Coverage
from betterbench.certification.examine import examine
from betterbench.certification.journal import CertificationJournal
from betterbench.errors import InvalidInputError
from betterbench.interface.actions import USUAL_ROBOT
from betterbench.jobs import JobProgress, in_processes, run_items, write_durably
from betterbench.json_form import sealed_form
from betterbench.quoting import json_text
from betterbench.sim.scenes import engine_version
from betterbench.tasks import SUITE_VERSION, Looks, TrialId, get_task
from betterbench.tasks.demonstrated import demonstrated
from betterbench.tasks.interventions import resolve_condition
from betterbench.version import __version__


def versions_in_use(tasks: Sequence[str], *, robot: str = USUAL_ROBOT) -> CertificateVersions:
    """Return the current versions on which a certificate for the given tasks and robot depends."""
    numbers = {name: get_task(name).version for name in sorted(set(tasks))}
    return CertificateVersions(__version__, SUITE_VERSION, engine_version(), numbers, robot=robot)


def certify(
    trials: Sequence[TrialId],
    out: Path,
    *,
    workers: int = 1,
    looks: Looks = "seen",
    robot: str = USUAL_ROBOT,
    on_progress: Callable[[JobProgress[TrialCertificate]], None] | None = None,
) -> Certificate:
    """Examine every trial that the journal in the folder does not contain yet, and write ``certificate.json``.

    Returns:
        Certificate of these trials, in the given order.

    Raises:
        InvalidInputError: If no trial is given, if the number of workers is out of range, or if a task's demonstrations
            have not been measured with the versions in use.
        WorkerError: If worker processes keep dying.
        RunConflictError: If another process writes to the folder, or if the journal was started with other versions.
        RecordError: If the journal is corrupt.
    """
    if not trials:
        raise InvalidInputError("trials", "there are no trials to certify", "Pass at least one trial")
    if not 1 <= workers <= 256:
        raise InvalidInputError("--workers", f"{workers} is out of range", "Use a number from 1 to 256")
    for trial in trials:
        resolve_condition(trial.task, trial.condition)
    versions = replace(versions_in_use([t.task for t in trials], robot=robot), looks=looks)
    session, began = uuid.uuid4().hex, time.perf_counter()
    with CertificationJournal(out, versions) as journal:

        def work(waiting: list[TrialId]) -> Iterator[TrialCertificate]:
            for name in dict.fromkeys(t.task for t in waiting):
                demonstrated(get_task(name), engine=engine_version())
            usual = {"looks": "seen", "robot": USUAL_ROBOT}
            changed: dict[str, Any] = dict({"looks": looks, "robot": robot}.items() - usual.items())
            examination = partial(examine, **changed)
            return in_processes(sorted(waiting, key=lambda t: (t.task, t.seed)), examination, workers=workers)

        run_items(
            trials,
            is_done=journal.trials.__contains__,
            work=work,
            keep=lambda found: journal.append(found, session=session, elapsed_s=time.perf_counter() - began),
            on_progress=on_progress,
        )
        whole = tuple(journal.trials[t] for t in dict.fromkeys(trials))
        certificate = Certificate(versions, platform.platform(), whole, journal.wall_s, workers)
        write_json(certificate_path(out), certificate.sealed_json())
    return certificate


def write_coverage(certificate: Certificate | Coverage, path: Path) -> Path:
    """Write the coverage of a certificate as JSON, with one condition per line. Return the path of the file."""
    coverage = certificate if isinstance(certificate, Coverage) else Coverage.of(certificate)
    form = sealed_form({"version": 2, **coverage.to_json()})
    lines = [f"  {json.dumps(name)}: {json.dumps(seeds)}" for name, seeds in form.pop("conditions").items()]
    head = json.dumps(form, indent=1, sort_keys=True)[:-2]
    write_durably(path, (head + ',\n "conditions": {\n' + ",\n".join(lines) + "\n }\n}\n").encode())
    return path


def write_json(path: Path, form: object) -> None:
    """Write a JSON document to a file and flush it to the disk, so that it is not lost in a power failure."""
    write_durably(path, (json_text(form, indent=1, allow_nan=False) + "\n").encode())
