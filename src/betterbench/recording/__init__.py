"""Records of episodes and the folders of runs: the privileged truth on disk, readable without a simulator."""

from betterbench.recording.builder import RecordBuilder
from betterbench.recording.columns import Contacts
from betterbench.recording.demonstration import Demonstrator, SkillWindow, SubgoalSegment
from betterbench.recording.durable import write_durably
from betterbench.recording.journal import Journal, JournalEntry, TrialStatus, read_journal
from betterbench.recording.line_journal import LineJournal
from betterbench.recording.lock import RunLock
from betterbench.recording.metadata import SCHEMA_VERSION, Outcome, RecordMetadata, Termination
from betterbench.recording.parquet import read_outcome, read_record, record_bytes, write_record
from betterbench.recording.record import Record
from betterbench.recording.retries import RetryLedger
from betterbench.recording.run import RunFolder, first_difference
from betterbench.recording.run_names import run_names, told_apart
from betterbench.recording.segmenting import subgoal_segments

__all__ = [
    "SCHEMA_VERSION",
    "Contacts",
    "Demonstrator",
    "Journal",
    "JournalEntry",
    "LineJournal",
    "Outcome",
    "Record",
    "RecordBuilder",
    "RecordMetadata",
    "RetryLedger",
    "RunFolder",
    "RunLock",
    "SkillWindow",
    "SubgoalSegment",
    "Termination",
    "TrialStatus",
    "first_difference",
    "read_journal",
    "read_outcome",
    "read_record",
    "record_bytes",
    "run_names",
    "subgoal_segments",
    "told_apart",
    "write_durably",
    "write_record",
]
