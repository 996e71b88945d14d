"""Conventions that affect outcomes, such as versions and control rates.

They are read from the plan and the records of a run.
"""

from __future__ import annotations

from typing import Any

_PLAIN = ("suite_version", "package_version", "robot", "action_space", "control_rate_hz", "looks")
"""Conventions that have a single value in a plan."""


def side_conventions(plan: Any, versions: dict[str, str]) -> dict[str, str]:  # noqa: ANN401 -- JSON of a file
    """Return the conventions that are declared in a plan and in the records of the run.

    Args:
        plan: Plan as JSON. Conventions that the plan does not state are skipped.
        versions: Versions in the records. They take precedence over versions in the plan.
    """
    found = {name: _shown(plan[name]) for name in _PLAIN if name in plan}
    for prefix, group in (("engine", "engine"), ("task_version", "task_versions")):
        listed = plan.get(group)
        if isinstance(listed, dict):
            found |= {f"{prefix}:{name}": _shown(value) for name, value in listed.items()}
    return found | versions


def _shown(value: object) -> str:
    return f"{value:g}" if isinstance(value, int | float) and not isinstance(value, bool) else str(value)
