"""Search for finished trials whose record or scene cannot be used. A resumed run repeats these trials."""

from __future__ import annotations

import logging

from betterbench.errors import RecordError
from betterbench.records import Journal, RunFolder

logger = logging.getLogger(__name__)


def reopen_lost(run: RunFolder, journal: Journal) -> int:
    """Mark finished trials whose files cannot be used as unfinished in the journal. Return the number of these trials.

    Files that cannot be used are moved to ``RUN/set-aside`` and never deleted. Raises OSError if they cannot be moved.
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
        except RecordError as problem:
            aside = run.set_aside(path)
            lost += 1
            logger.warning(
                "%s is run again: %s%s", entry.key, problem, f" The file is kept as {aside}." if aside else ""
            )
            journal.reopen(entry.key, f"run again: {problem}")
    return lost
