"""Resumable jobs: planned items, crash-safe journals and files, workers, and child processes.

- ``job``: runs the unfinished items of a plan and stores each result (:func:`run_items`), in a locked folder
  (:func:`job_folder`). ``conflict`` rejects a folder that contains other files or a different job.
- ``item_processes``, ``item_threads``, ``retries``: process several items at once, and retry items whose worker died.
- ``line_journal``, ``durable``: journals with one synced line per finished item, and files that are either complete or
  absent.
- ``lock``, ``places``, ``outputs``: allow only one writer per folder or file. Links that lead out of the folder are not
  followed, and files that betterbench did not write are not replaced.
- ``worker_process``, ``process_output``, ``leftovers``: child processes, their output, and their termination together
  with the parent.
- ``limited_process``: child processes with memory and time limits, for reading untrusted files.
- ``ahead``: prefetching of items in a thread.
"""

from typing import TYPE_CHECKING

from betterbench.lazy_names import lazy_names

if TYPE_CHECKING:
    from betterbench.jobs.durable import write_durably
    from betterbench.jobs.item_processes import in_processes
    from betterbench.jobs.item_threads import in_threads
    from betterbench.jobs.job import JobProgress, OnCount, counts, job_folder, run_items
    from betterbench.jobs.line_journal import LineJournal
    from betterbench.jobs.lock import RunLock
    from betterbench.jobs.retries import RetryLedger

__all__ = [
    "JobProgress",
    "LineJournal",
    "OnCount",
    "RetryLedger",
    "RunLock",
    "counts",
    "in_processes",
    "in_threads",
    "job_folder",
    "run_items",
    "write_durably",
]

if not TYPE_CHECKING:
    __getattr__ = lazy_names(
        __name__,
        {
            "durable": ("write_durably",),
            "item_processes": ("in_processes",),
            "item_threads": ("in_threads",),
            "job": ("JobProgress", "OnCount", "counts", "job_folder", "run_items"),
            "line_journal": ("LineJournal",),
            "lock": ("RunLock",),
            "retries": ("RetryLedger",),
        },
    )
