"""Import and audit of tasks in the YAML format of the BeTTER release (github.com/BeingBeyond/BeTTER, July 2026).

- ``files``: strict reader for the files of a task. ``resolved``: variations with their inherited values.
- ``matching``: search for library assets that represent the objects. ``layout``: transfer of object positions to our
  table.
- ``building``: conversion of a task to our format, with each variation as operations on a training condition.
- ``sentence``: objects named in an instruction. ``predicates``: relations that hold in the initial scene.
- ``audit``: search for test motions that do not occur in training, and for instructions that do not match the scene.
  ``pages``: the output files of the audit.
"""

from betterbench.generation.better_release.audit import Audit, Finding, audit_release
from betterbench.generation.better_release.building import Built, build_task
from betterbench.generation.better_release.files import ReleaseTask, find_tasks, read_release_task
from betterbench.generation.better_release.matching import Match, library_catalogue, match_instances
from betterbench.generation.better_release.pages import Imported, audit_form, audit_markdown, certified_text, counts_of
from betterbench.generation.better_release.resolved import Resolved, resolve

__all__ = [
    "Audit",
    "Built",
    "Finding",
    "Imported",
    "Match",
    "ReleaseTask",
    "Resolved",
    "audit_form",
    "audit_markdown",
    "audit_release",
    "build_task",
    "certified_text",
    "counts_of",
    "find_tasks",
    "library_catalogue",
    "match_instances",
    "read_release_task",
    "resolve",
]
