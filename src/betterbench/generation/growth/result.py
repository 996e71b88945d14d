"""Stored outcome of growing a suite. It can be read without a simulator."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from betterbench.generation.building.result import Result
from betterbench.generation.growth.proposals import Proposal
from betterbench.wording import plural

Stop = Literal["reached", "exhausted", "attempts"]
"""Reason why the growth stopped.

reached: the suite has the requested number of tasks. exhausted: no new scenario is left. attempts: the maximum number
of scenarios has been built.
"""


@dataclass(frozen=True, slots=True)
class QuotaStanding:
    """A quota with its current and required amounts.

    Attributes:
        quota: The quota as written in the option.
        kind: Property, such as "template".
        value: Value of the property.
        have: Current number of tasks; for an axis, the current percentage of the variations.
        least: Minimum amount in the same unit.
        most: Maximum amount in the same unit, or None if there is no maximum.
        unit: "tasks", or "% of the variations".
        is_open: Whether the quota is not fulfilled yet.
    """

    quota: str
    kind: str
    value: str
    have: float
    least: float
    most: float | None
    unit: str
    is_open: bool


@dataclass(frozen=True, slots=True)
class GrownTask:
    """Certified task of a growing suite.

    Attributes:
        result: Result of building the task.
        context: Context of the task's scenario.
        key: Key that is equal for near-duplicates of the task.
        difficulty: Level of difficulty.
        expert_s: Median time of the expert in the variations of the task [s].
        variations: Number of variations by axis.
        set_aside: Reason why the certified task is not part of the suite. Empty if it is part of it.
    """

    result: Result
    context: str
    key: str
    difficulty: str
    expert_s: float
    variations: dict[str, int]
    set_aside: str = ""


@dataclass(frozen=True, slots=True)
class Growth:
    """Outcome of growing a suite.

    Attributes:
        until: Requested number of tasks.
        stop: Reason why the growth stopped.
        tasks: Certified tasks, in order. Tasks with a ``set_aside`` reason are not part of the suite.
        refused: Results of the scenarios that could not be certified.
        proposals: All proposals. Those whose outcome is not "drawn" were not built.
        quotas: All quotas, each with its current amount.
        goals: Number of different goals in the author's scenarios, or None if it is not known.
        near_duplicates: Number of scenarios that were left out because they are near-duplicates.
        known_goals: Number of goals that were left out because a task in another suite has them.
        suite: Folder of the suite. None if no task was accepted.
    """

    until: int
    stop: Stop
    tasks: tuple[GrownTask, ...]
    refused: tuple[Result, ...]
    proposals: tuple[Proposal, ...]
    quotas: tuple[QuotaStanding, ...]
    goals: int | None
    near_duplicates: int
    known_goals: int
    suite: Path | None

    @property
    def accepted(self) -> tuple[GrownTask, ...]:
        """Tasks that are part of the suite."""
        return tuple(task for task in self.tasks if not task.set_aside)

    @property
    def open_quotas(self) -> tuple[QuotaStanding, ...]:
        """Quotas that are not fulfilled yet."""
        return tuple(quota for quota in self.quotas if quota.is_open)

    @property
    def variations(self) -> int:
        """Number of variations in the suite, over all tasks."""
        return sum(sum(task.variations.values()) for task in self.accepted)

    @property
    def reason(self) -> str:
        """Text that explains why the growth stopped and lists the quotas that are not fulfilled."""
        number = len(self.accepted)
        match self.stop:
            case "reached":
                text = f"{plural(number, 'task')} {'is' if number == 1 else 'are'} certified."
            case "exhausted":
                text = (
                    f"{number} of {self.until} tasks are certified, and no new scenario is left for the remaining ones."
                )
            case _:
                built = len(self.tasks) + len(self.refused)
                text = f"{number} of {self.until} tasks are certified after {built} attempts, which is the maximum."
        if self.open_quotas:
            listed = ", ".join(f"{q.quota} (has {q.have:.3g})" for q in self.open_quotas)
            text += f" Open quotas: {listed}."
        return text

    def to_json(self) -> dict[str, Any]:
        """Return the outcome as a JSON-serializable dict."""
        return {
            "schema_version": 1,
            "until": self.until,
            "stop": self.stop,
            "reason": self.reason,
            "suite": None if self.suite is None else self.suite.name,
            "variations": self.variations,
            "tasks": [
                {
                    "task": task.result.task_id,
                    "template": task.result.template,
                    "context": task.context,
                    "goal": task.key,
                    "difficulty": task.difficulty,
                    "expert_s": task.expert_s,
                    "variations": task.variations,
                    "set_aside": task.set_aside,
                }
                for task in self.tasks
            ],
            "refused": {result.task_id: result.attempts[0].reason for result in self.refused},
            "left_out": [
                {"number": p.number, "template": p.template, "outcome": p.outcome, "problem": p.problem}
                for p in self.proposals
                if not p.is_drawn
            ],
            "quotas": [asdict(quota) for quota in self.quotas],
            "goals": self.goals,
            "near_duplicates": self.near_duplicates,
            "known_goals": self.known_goals,
        }
