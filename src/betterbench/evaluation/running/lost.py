"""Search for finished trials whose record or scene cannot be used, so that they are repeated in a resumed run."""

from __future__ import annotations

import logging
import re

from betterbench.errors import RecordError
from betterbench.records import Journal, RunFolder

logger = logging.getLogger(__name__)

_CURES = re.compile(r" (Copy it again from an intact source|Repeat the command of the run [^.]*)\.")
"""Remedies in errors of damaged files, which are left out of the messages because the trial is being run again."""


def reopen_lost(run: RunFolder, journal: Journal) -> int:
    """Find finished trials whose files cannot be used, and mark them as unfinished. Return the number of such trials.

    The mark is written to the journal. Files that cannot be used are not deleted, but moved to ``RUN/set-aside``.
    Raises OSError if they cannot be moved.
    """
    lost = 0
    sound: set[tuple[str, str | None]] = set()
    for entry in journal.entries:
        if entry.status != "done":
            continue
        path = run.record_path(entry.task, entry.condition, entry.seed)
        try:
            scene = run.read_brief(entry.key, entry=entry).metadata.scene_hash
            if (scene, entry.scene) in sound:
                continue
            path = run.scene_path(scene)
            run.load_scene(scene, digest=entry.scene)
            sound.add((scene, entry.scene))
        except RecordError as error:
            problem = _CURES.sub("", str(error))
            aside = run.set_aside(path)
            lost += 1
            logger.warning(
                "%s is run again: %s%s", entry.key, problem, f" The file is kept as {aside}." if aside else ""
            )
            journal.reopen(entry.key, f"run again: {problem}")
    return lost
