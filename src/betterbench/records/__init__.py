"""Episode records and run folders. A record is the privileged log of an episode, which is read without a simulator.

- ``record``, ``metadata``, ``columns``, ``parquet``: the log of one episode and its file. ``builder`` creates it step
  by step.
- ``run``, ``journal``, ``scene_archive``: the folder of a run, its finished trials, and its compiled scenes.
- ``demonstration``, ``segmenting``, ``twins``: data that is stored only with demonstrations.
- ``modalities``: files with images, depth, masks and boxes of recorded states.

Each public name is imported from its module when it is first used, because a process that renders modalities needs
neither tasks nor Parquet.
"""

from typing import TYPE_CHECKING

from betterbench.lazy_names import lazy_names

if TYPE_CHECKING:
    from betterbench.records.builder import RecordBuilder
    from betterbench.records.columns import Contacts
    from betterbench.records.demonstration import Demonstrator, SkillWindow, SubgoalSegment
    from betterbench.records.journal import Journal, JournalEntry, TrialStatus, read_journal
    from betterbench.records.metadata import SCHEMA_VERSION, Outcome, RecordMetadata, Termination
    from betterbench.records.naming import require_each_once, run_names, told_apart
    from betterbench.records.parquet import read_outcome, read_record, record_bytes, write_record
    from betterbench.records.record import Record
    from betterbench.records.run import RunFolder
    from betterbench.records.segmenting import subgoal_segments

__all__ = [
    "SCHEMA_VERSION",
    "Contacts",
    "Demonstrator",
    "Journal",
    "JournalEntry",
    "Outcome",
    "Record",
    "RecordBuilder",
    "RecordMetadata",
    "RunFolder",
    "SkillWindow",
    "SubgoalSegment",
    "Termination",
    "TrialStatus",
    "read_journal",
    "read_outcome",
    "read_record",
    "record_bytes",
    "require_each_once",
    "run_names",
    "subgoal_segments",
    "told_apart",
    "write_record",
]

if not TYPE_CHECKING:
    __getattr__ = lazy_names(
        __name__,
        {
            "builder": ("RecordBuilder",),
            "columns": ("Contacts",),
            "demonstration": ("Demonstrator", "SkillWindow", "SubgoalSegment"),
            "journal": ("Journal", "JournalEntry", "TrialStatus", "read_journal"),
            "metadata": ("SCHEMA_VERSION", "Outcome", "RecordMetadata", "Termination"),
            "parquet": ("read_outcome", "read_record", "record_bytes", "write_record"),
            "record": ("Record",),
            "run": ("RunFolder",),
            "naming": ("require_each_once", "run_names", "told_apart"),
            "segmenting": ("subgoal_segments",),
        },
    )
