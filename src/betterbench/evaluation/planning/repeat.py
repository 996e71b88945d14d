"""Repeating a run: its plan is read from ``run.json``, and whatever would change the results is named."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from pydantic import ConfigDict, TypeAdapter, ValidationError, with_config

from betterbench.errors import RecordError, RunConflictError
from betterbench.evaluation.planning.manifest import policy_difference
from betterbench.evaluation.planning.plan import Plan, Trial
from betterbench.recording import RunFolder, first_difference
from betterbench.recording.metadata import dump_json

_NOT_COMPARED = ("policy", "trials", "package_version")
"""Parts of a plan that are read back, or that alone change no result: the suite and every task have their versions."""


def repeated_plan(path: Path, *, policy: str | None = None, allow_other_versions: bool = False) -> Plan:
    """Return the plan of a run, to be run again: same trials, seeds, conventions and policy.

    Args:
        path: ``run.json`` of the run, or its folder.
        policy: Address of another policy to run the same trials with; None for the same.
        allow_other_versions: True to run it although versions or conventions differ that decide about results.

    Returns:
        The plan.

    Raises:
        RecordError: If the file is no run, or its plan is malformed.
        RunConflictError: If versions or conventions differ and that is not allowed; the text names all of them.
        UnknownNameError: If a task, condition, preset or action space is unknown here.
    """
    run = _open(path)
    where = run.path / "run.json"
    plan = Plan(
        policy=policy or _text(run.plan, "policy", where),
        trials=tuple(_trials(run.plan, where)),
        action_space=_text(run.plan, "action_space", where),
        observation=_preset(run.plan, "observation", where),
        quality=_preset(run.plan, "quality", where),
        robot=_text(run.plan, "robot", where),
    )
    for trial in {(t.task, t.condition): t for t in plan.trials}.values():
        trial.resolve()
    differences = list(version_differences(run.plan, plan))
    if differences and not allow_other_versions:
        raise RunConflictError(
            f"{where}: this betterbench would not repeat the run, because {'; '.join(differences)}. "
            "Install the versions that its context lists, or give --allow-other-versions and read the results as a "
            "run of its own."
        )
    return plan


def require_same_policy(path: Path, policy: Mapping[str, Any]) -> None:
    """Check that a policy is still the one of a run.

    Args:
        path: ``run.json`` of the run, or its folder.
        policy: What the policy declares now.

    Raises:
        RunConflictError: If it declares something else; the text names both.
    """
    difference = policy_difference(_open(path), policy)
    if difference is not None:
        raise RunConflictError(
            f"{path}: the policy at {policy.get('address')} is not the one of this run: {difference}. Bring the first "
            "one back, or give --allow-changed-policy and read the results as those of another policy."
        )


def _open(path: Path) -> RunFolder:
    return RunFolder.open(path.parent if path.name == "run.json" else path)


def version_differences(there: Mapping[str, Any], plan: Plan) -> Iterator[str]:
    """Yield every version and convention that decides about results and differs, with both values.

    Args:
        there: JSON form of the plan of the run that is repeated.
        plan: The plan as it would be run here.
    """
    here = json.loads(dump_json(plan.to_json()))
    for name in sorted((set(there) | set(here)) - set(_NOT_COMPARED)):
        old, new = there.get(name), here.get(name)
        groups = sorted(set(old) | set(new)) if isinstance(old, dict) and isinstance(new, dict) else [None]
        for inner in groups:
            pair = (old, new) if inner is None else (old.get(inner), new.get(inner))  # type: ignore[union-attr]
            found = first_difference(*pair, name if inner is None else f"{name}.{inner}")
            if found is not None:
                yield f"{found[0]} was {found[1]} there and is {found[2]} here"


def _trials(form: Mapping[str, Any], where: Path) -> Iterator[Trial]:
    listed = form.get("trials")
    if not isinstance(listed, list) or not listed:
        raise RecordError(f"{where}: plan.trials is missing, empty or no list. Restore the file.")
    seen = set()
    for number, entry in enumerate(listed):
        if not isinstance(entry, dict) or set(entry) != {f.name for f in fields(Trial)}:
            raise RecordError(f"{where}: plan.trials[{number}] has not the fields of a trial. Restore the file.")
        for name, kind in _TRIAL_KINDS.items():
            if not isinstance(entry[name], kind) or isinstance(entry[name], bool):
                raise RecordError(f"{where}: plan.trials[{number}].{name} is {entry[name]!r}. Restore the file.")
        if entry["seed"] < 0:
            raise RecordError(f"{where}: plan.trials[{number}].seed is {entry['seed']}. Restore the file.")
        trial = Trial(**entry)
        key = (trial.task, trial.condition, trial.seed)
        if key in seen:
            raise RecordError(f"{where}: plan.trials[{number}] is planned twice. Remove one of the two.")
        seen.add(key)
        yield trial


def _text(form: Mapping[str, Any], name: str, where: Path) -> str:
    value = form.get(name)
    if not isinstance(value, str):
        raise RecordError(f"{where}: plan.{name} is missing or no text. Restore the file.")
    return value


def _preset(form: Mapping[str, Any], name: str, where: Path) -> str:
    value = form.get(name)
    if not isinstance(value, dict) or not isinstance(value.get("name"), str):
        raise RecordError(f"{where}: plan.{name}.name is missing or no text. Restore the file.")
    return str(value["name"])
