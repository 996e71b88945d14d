"""Repetition of a run from its ``run.json``, after a check for differences that would change the results."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from betterbench.errors import InvalidInputError, RecordError, RunConflictError
from betterbench.evaluation.planning.manifest import policy_difference
from betterbench.evaluation.planning.plan import Plan
from betterbench.evaluation.planning.trust import require_trust
from betterbench.interface.actions import USUAL_ROBOT
from betterbench.jobs.conflict import first_difference
from betterbench.json_form import dump_json, open_form, read_form
from betterbench.records import RunFolder
from betterbench.statistics import StoppingRule
from betterbench.tasks import Looks, TrialId
from betterbench.tasks.trial import Trial

_NOT_COMPARED = ("policy", "trials", "package_version")
"""Fields of a plan that are not compared.

The policy and the trials are copied to the new plan, and the package version does not affect results.
"""


@open_form
@dataclass(frozen=True, slots=True)
class _Preset:
    name: str


@open_form
@dataclass(frozen=True, slots=True)
class _Plan:
    """Fields that are read from the plan in ``run.json``.

    All other fields of the stored plan are only compared with the new plan.
    """

    policy: str
    trials: tuple[Trial, ...]
    action_space: str
    observation: _Preset
    quality: _Preset
    robot: str = USUAL_ROBOT
    looks: Looks = "seen"
    until_decided: StoppingRule | None = None

    def __post_init__(self) -> None:
        seen: set[TrialId] = set()
        for number, trial in enumerate(self.trials):
            if trial.id in seen:
                raise InvalidInputError(
                    f"trials[{number}]", "this trial is planned twice", "Remove one of its two entries"
                )
            seen.add(trial.id)
        if not seen:
            raise InvalidInputError("trials", "the list is empty", "Restore the original file run.json")


_PLAN = TypeAdapter(_Plan)


def repeated_plan(
    path: Path, *, policy: str | None = None, allow_other_versions: bool = False, trust: bool = False
) -> Plan:
    """Return a plan that repeats an earlier run with the same policy or with a different one.

    ``path`` is the folder of the run or its file ``run.json``. If ``trust`` is True, the policy named in the run is
    accepted even if it runs code or sends a secret key.

    Raises:
        InvalidInputError: If the policy named in the run would run code or send a secret key, and ``trust`` is False.
        RecordError: If the file is not the ``run.json`` of a run, or the plan in it is malformed.
        RunConflictError: If versions or conventions that affect results differ, unless other versions are allowed.
        UnknownNameError: If a task, condition, preset or action space does not exist in this installation.
    """
    run = _open(path)
    where = run.path / "run.json"
    if not run.world.measured:
        problem = f"{where} is a run in {run.world.title}, but only runs in betterbench's own world can be repeated"
        raise InvalidInputError("--from", problem, "Use --suite and the other options of that run instead")
    stored = read_form(_PLAN, run.plan, where=f"{where}: plan", cure="Restore the file", raises=RecordError)
    if policy is None and not trust:
        require_trust(stored.policy, where=str(where))
    plan = Plan(
        policy or stored.policy,
        stored.trials,
        stored.action_space,
        stored.observation.name,
        stored.quality.name,
        stored.robot,
        stored.looks,
        stored.until_decided,
    )
    for trial in {(t.task, t.condition): t for t in plan.trials}.values():
        trial.resolve()
    differences = list(version_differences(run.plan, plan))
    if differences and not allow_other_versions:
        raise RunConflictError(
            f"{where}: results would differ from the original run, because {'; '.join(differences)}. "
            "Install the versions of the original run, or use --allow-other-versions and treat the results as a "
            "separate run."
        )
    return plan


def require_same_policy(path: Path, policy: Mapping[str, Any]) -> None:
    """Raise RunConflictError if the description of a policy differs from that in the run at the given path.

    The message quotes the stored and the current value.
    """
    difference = policy_difference(_open(path), policy)
    if difference is not None:
        raise RunConflictError(
            f"{path}: the policy at {policy.get('address')} is not the policy of this run: {difference}. Start "
            "the original policy again, or use --allow-changed-policy and treat the results as a different policy."
        )


def _open(path: Path) -> RunFolder:
    return RunFolder.open(path.parent if path.name == "run.json" else path)


def version_differences(there: Mapping[str, Any], plan: Plan) -> Iterator[str]:
    """Yield the differences between a stored plan and a new plan that would change the results, each with both values.

    A stored plan without the name of a robot uses the Panda, which was the only robot in early versions.
    """
    there = {"robot": USUAL_ROBOT} | dict(there)
    here = json.loads(dump_json(plan.to_json()))
    for name in sorted((set(there) | set(here)) - set(_NOT_COMPARED)):
        old, new = there.get(name), here.get(name)
        groups = sorted(set(old) | set(new)) if isinstance(old, dict) and isinstance(new, dict) else [None]
        for inner in groups:
            pair = (old, new) if inner is None else (old.get(inner), new.get(inner))  # type: ignore[union-attr]
            found = first_difference(*pair, name if inner is None else f"{name}.{inner}")
            if found is not None:
                yield f"{found[0]} was {found[1]} there and is {found[2]} here"
