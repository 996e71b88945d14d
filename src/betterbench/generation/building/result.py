"""Stored results of a build, which can be read without a simulator."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from betterbench.certification.certificate import TrialCertificate
from betterbench.json_form import NO_TRUTH, strict_form
from betterbench.tasks.demonstrated import Demonstrated


@dataclass(frozen=True, slots=True)
class Settings:
    """Build settings that affect the results.

    Attributes:
        seeds: Number of certified trials per variation. Their seeds start at 0.
        demonstrations: Number of measured demonstrations per task. Each training condition has at least one.
    """

    seeds: int = 3
    demonstrations: int = 24


@dataclass(frozen=True, slots=True)
class Failure:
    """Condition of a task that fails a clause of the certificate.

    Attributes:
        condition: Name of the condition.
        seeds: Seeds of the failed trials.
        clause: Letter of the first clause that failed.
        meaning: Requirement of that clause.
        text: Measured result of that clause for the first failed seed.
    """

    condition: str
    seeds: tuple[int, ...]
    clause: str
    meaning: str
    text: str


@dataclass(frozen=True, slots=True)
class Attempt:
    """Attempt to build a certified task from a scenario.

    Attributes:
        change: Difference from the first attempt ("other slots").
        reason: Reason why the attempt failed. Empty if it succeeded.
        failures: Conditions that failed a clause of the certificate.
    """

    change: str
    reason: str
    failures: tuple[Failure, ...] = ()


@strict_form
@dataclass(frozen=True, slots=True)
class ChosenAsset:
    """Asset chosen for the description of an object.

    Attributes:
        group: Object group of the description.
        description: Description of the object.
        query: Search query of the object.
        asset: Identifier of the chosen catalogue row.
        score: Search score of the asset.
        passed_over: Better search results that were rejected, with the reason.
    """

    group: str
    description: str
    query: str
    asset: str
    score: float
    passed_over: tuple[str, ...]


@strict_form
@dataclass(frozen=True, slots=True)
class UnbuiltVariation:
    """Variation of a template that could not be derived for a task, with the reason."""

    axis: str
    title: str
    reason: str


@strict_form
@dataclass(frozen=True, slots=True)
class Result:
    """Stored result of building one scenario.

    Attributes:
        key: Digest of the scenario, the settings and the versions.
        task_id: Identifier of the task.
        template: Name of the template.
        title: Name of the scenario.
        attempts: All attempts, with the reasons of failures.
        left_out: Variations that were left out because they failed their certificate.
        unbuilt: Variations of the template that could not be derived for the task.
        confounds: Regularities in the training conditions, one sentence each.
        chosen: Chosen assets, with their search scores.
        task: Task in JSON form. None if no attempt succeeded.
        demonstrated: Measurements of the task's demonstrations.
        trials: Certificates of the task's trials.
    """

    schema_version: Annotated[int, NO_TRUTH, Field(ge=1, le=1)]
    key: str
    task_id: str
    template: str
    title: str
    attempts: tuple[Attempt, ...]
    left_out: tuple[Failure, ...]
    unbuilt: tuple[UnbuiltVariation, ...]
    confounds: tuple[str, ...]
    chosen: tuple[ChosenAsset, ...]
    task: dict[str, Any] | None
    demonstrated: Demonstrated | None
    trials: tuple[TrialCertificate, ...]

    @property
    def certified(self) -> bool:
        """Whether an attempt succeeded, so that the task is part of the suite."""
        return self.task is not None


@dataclass(frozen=True, slots=True)
class BuildReport:
    """Outcome of a build.

    Attributes:
        results: One result for each scenario, in order.
        suite: Folder of the suite. None if no task was certified.
    """

    results: tuple[Result, ...]
    suite: Path | None
