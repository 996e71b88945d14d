"""Import and audit of tasks in the YAML format of the BeTTER release (github.com/BeingBeyond/BeTTER, July 2026).

- ``files``: the strict reader of the files of a task; ``resolved``: variations with inherited values.
- ``matching``: categories of our library for its objects; ``layout``: positions on our table.
- ``building``: the task in our form, with variations as operations on the nearest training condition.
- ``sentence``: objects named in an instruction; ``predicates``: relations in the initial scene.
- ``audit``: violations of kinematic isolation, and mismatches of instruction and scene; ``pages``: the report.
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
