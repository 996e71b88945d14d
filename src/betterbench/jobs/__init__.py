"""Resumable jobs: journals that survive a crash, locks on folders and files, retries, and worker processes.

``places`` and ``lock`` protect a folder or a file against a second writer. ``durable`` writes whole files or none.
``line_journal`` appends finished items. ``outputs`` is the folder of a command other than a run. ``retries`` counts
failed attempts. ``item_threads`` and ``ahead`` work on several items at once. ``worker_process``, ``process_output``
and ``leftovers`` start child processes, read their output, and end those that outlive their parent.
"""

from betterbench.jobs.durable import write_durably
from betterbench.jobs.line_journal import LineJournal
from betterbench.jobs.lock import RunLock
from betterbench.jobs.retries import RetryLedger

__all__ = ["LineJournal", "RetryLedger", "RunLock", "write_durably"]
