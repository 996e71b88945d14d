"""Certification of many trials: worker processes, one journal, and a certificate at the end."""

from __future__ import annotations

import json
import logging
import multiprocessing
import platform
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import TypeVar

from betterbench.certification.certificate import Certificate, CertificateVersions, TrialCertificate, certificate_path
from betterbench.certification.coverage import Coverage
from betterbench.certification.examine import examine
from betterbench.certification.journal import CertificationJournal
from betterbench.errors import InvalidInputError, WorkerError
from betterbench.jobs import RetryLedger, write_durably
from betterbench.jobs.lock import held_folders
from betterbench.jobs.worker_process import interrupts_blocked, prepare_process
from betterbench.json_form import sealed_form
from betterbench.quoting import json_text
from betterbench.sim.scenes import engine_version
from betterbench.tasks import SUITE_VERSION, Looks, TrialId, get_task
from betterbench.tasks.demonstrated import demonstrated
from betterbench.tasks.interventions import resolve_condition
from betterbench.version import __version__

FoundT = TypeVar("FoundT")

logger = logging.getLogger(__name__)

Examination = Callable[[TrialId], TrialCertificate]


@dataclass(frozen=True, slots=True)
class CertificationProgress:
    """Progress of a certification: numbers of examined and planned trials, and the last one (None at the start)."""

    done: int
    planned: int
    last: TrialCertificate | None


def versions_in_use(tasks: Sequence[str]) -> CertificateVersions:
    """Return the versions on which a certificate of some tasks depends."""
    numbers = {name: get_task(name).version for name in sorted(set(tasks))}
    return CertificateVersions(__version__, SUITE_VERSION, engine_version(), numbers)


def certify(
    trials: Sequence[TrialId],
    out: Path,
    *,
    workers: int = 1,
    looks: Looks = "seen",
    on_progress: Callable[[CertificationProgress], None] | None = None,
) -> Certificate:
    """Examine every trial that is not yet in the journal of a folder, and write ``certificate.json``.

    Returns:
        The certificate of exactly these trials, in order.

    Raises:
        InvalidInputError: If no trial is given, the number of workers is out of range, or the demonstrations of a task
            were not measured under the current versions.
        WorkerError: If worker processes keep dying.
        RunConflictError: If another process writes to the folder, or the journal was started under other versions.
        RecordError: If the journal is corrupt.
    """
    if not trials:
        raise InvalidInputError("trials", "no trials to certify", "Name at least one trial")
    if not 1 <= workers <= 256:
        raise InvalidInputError("--workers", f"{workers} is out of range", "Give a number from 1 to 256")
    for trial in trials:
        resolve_condition(trial.task, trial.condition)
    versions = replace(versions_in_use([t.task for t in trials]), looks=looks)
    session, began = uuid.uuid4().hex, time.perf_counter()
    with CertificationJournal(out, versions) as journal:
        waiting = [t for t in dict.fromkeys(trials) if t not in journal.trials]
        for name in dict.fromkeys(t.task for t in waiting):
            demonstrated(get_task(name), engine=engine_version())
        planned = len(set(trials))
        done = planned - len(waiting)
        if on_progress is not None:
            on_progress(CertificationProgress(done, planned, None))
        examination = examine if looks == "seen" else partial(examine, looks=looks)
        for found in in_workers(sorted(waiting, key=lambda t: (t.task, t.seed)), workers, examination):
            journal.append(found, session=session, elapsed_s=time.perf_counter() - began)
            done += 1
            if on_progress is not None:
                on_progress(CertificationProgress(done, planned, found))
        whole = tuple(journal.trials[t] for t in dict.fromkeys(trials))
        certificate = Certificate(versions, platform.platform(), whole, journal.wall_s, workers)
        write_json(certificate_path(out), certificate.sealed_json())
    return certificate


def write_coverage(certificate: Certificate, path: Path) -> Path:
    """Write the compact form of a certificate, one condition per line."""
    form = sealed_form({"version": 2, **Coverage.of(certificate).to_json()})
    lines = [f"  {json.dumps(name)}: {json.dumps(seeds)}" for name, seeds in form.pop("conditions").items()]
    head = json.dumps(form, indent=1, sort_keys=True)[:-2]
    write_durably(path, (head + ',\n "conditions": {\n' + ",\n".join(lines) + "\n }\n}\n").encode())
    return path


def write_json(path: Path, form: object) -> None:
    """Write a JSON document durably."""
    write_durably(path, (json_text(form, indent=1, allow_nan=False) + "\n").encode())


def in_workers(trials: list[TrialId], workers: int, work: Callable[[TrialId], FoundT]) -> Iterator[FoundT]:
    """Yield the results of a function for trials as they finish; a crash repeats the affected trials one by one.

    Raises:
        WorkerError: If worker processes keep dying.
    """
    if workers == 1 or len(trials) <= 1:
        yield from map(work, trials)
        return
    cure = "Run the same command again with fewer --workers."
    ledger = RetryLedger(trials, workers="worker processes", cure=cure)
    while ledger.left:
        pending: dict[Future[FoundT], TrialId] = {}
        try:
            yield from _pooled(ledger, pending, workers, work)
        except BrokenProcessPool as error:
            logger.warning("a worker process died; %d trials are examined again", len(pending))
            how = "it was killed, for example because memory ran out"
            for trial in ledger.worker_died(list(pending.values()), how):
                raise WorkerError(f"{trial}: {ledger.reason(how)}.") from error


def _pooled(
    ledger: RetryLedger[TrialId],
    pending: dict[Future[FoundT], TrialId],
    workers: int,
    work: Callable[[TrialId], FoundT],
) -> Iterator[FoundT]:
    """Yield the results of one pool, which works on ``pending``: all suspects one by one, or all waiting trials."""
    alone = ledger.suspects > 0
    context = multiprocessing.get_context("spawn")
    started: set[BaseProcess] = set()
    with ProcessPoolExecutor(
        1 if alone else workers, mp_context=context, initializer=prepare_process, initargs=(held_folders(),)
    ) as pool:
        try:
            while True:
                if not alone:
                    new = ledger.take(2 * workers - len(pending))
                else:
                    new = [ledger.take_suspect()] if ledger.suspects and not pending else []
                with interrupts_blocked():  # the parent process handles Ctrl-C
                    others = set(multiprocessing.active_children()) - started
                    for trial in new:
                        pending[pool.submit(work, trial)] = trial
                    started |= set(multiprocessing.active_children()) - others
                if not pending:
                    return
                finished, _ = wait(pending, return_when=FIRST_COMPLETED)
                for future in finished:
                    found = future.result()
                    del pending[future]
                    ledger.item_ended()
                    yield found
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for process in started:  # otherwise Python would wait for their current work
                process.kill()
            raise
