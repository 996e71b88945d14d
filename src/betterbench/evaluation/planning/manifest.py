"""Manifest of a run, stored in ``run.json``: command, machine, software versions, conventions and policy.

When a run is resumed, the current description of the policy is compared with the description in the manifest. This
prevents a run from mixing two policies if the same address now serves another checkpoint. Other entries are not
compared, because a run may be resumed on another machine.
"""

from __future__ import annotations

import json
import platform
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from betterbench.errors import RunConflictError, encodable
from betterbench.evaluation.planning.machine import describe_machine, describe_renderer, package_lock, source_revision
from betterbench.evaluation.planning.plan import Plan
from betterbench.interface import observation_spec
from betterbench.interface.actions import action_space
from betterbench.jobs.conflict import first_difference
from betterbench.json_form import dump_json
from betterbench.records import RunFolder
from betterbench.tasks.user_files import loaded_files


def run_context(plan: Plan, *, policy: Mapping[str, Any], engine: Mapping[str, Any]) -> dict[str, Any]:
    """Return the manifest of a new run.

    ``policy`` is the description of the policy from :func:`describe_policy`. ``engine`` has the keys "name", "workers"
    and "envs" and, if a warm-up determines the number of environments, the key "most_envs".
    """
    images = bool(observation_spec(plan.observation).cameras) and bool(policy.get("needs_images", False))
    unseen = {"problem": "no images are rendered in this run"}
    if images and plan.world.drawn_by:
        images, unseen = False, {"problem": f"{plan.world.drawn_by} renders the images"}
    machine = describe_machine()
    context = {
        "python": platform.python_version(),
        "platform": platform.platform(),
        "processors": str(machine["processors"]),
        "command": encodable(" ".join(sys.argv[:1] and [Path(sys.argv[0]).name, *sys.argv[1:]])),
        "started_utc": _now(),
        "machine": machine,
        "renderer": describe_renderer() if images else unseen,
        "packages": list(package_lock()),
        "source_revision": source_revision(Path.cwd()),
        "task_files": [{"path": file.path, "sha256": file.sha256} for file in loaded_files()],
        "engine": dict(engine),
        "conventions": run_conventions(plan),
        "policy": dict(policy),
    }
    plain: dict[str, Any] = json.loads(dump_json(context))  # converts tuples to lists, as they are in the file
    return plain


def run_conventions(plan: Plan) -> dict[str, Any]:
    """Return the conventions of a run: the action space, the observation preset and the conventions of the world."""
    return {
        "action_space": action_space(plan.action_space).to_json(),
        "observation": observation_spec(plan.observation).to_json(),
        **plan.world.conventions(plan.robot),
    }


def policy_difference(run: RunFolder, policy: Mapping[str, Any]) -> str | None:
    """Return the first difference between a policy's description and the description stored in a run.

    Return None if the two descriptions are equal.
    """
    changes = run.context.get("policy_changes", [])
    known = changes[-1].get("policy") if changes else run.context.get("policy")
    if not isinstance(known, dict):
        return None  # runs of earlier versions do not contain a description of the policy
    difference = first_difference(known, json.loads(dump_json(policy)), "policy")
    if difference is None:
        return None
    where, there, here = difference
    return f"{where} was {there} and is {here}"


def same_policy(run: RunFolder, policy: Mapping[str, Any], *, allow_changed: bool) -> RunFolder:
    """Check that a policy's description equals the description stored in the run, and return the run.

    If the description has changed and ``allow_changed`` is True, store the change in the run.

    Raises:
        RunConflictError: If the description has changed and ``allow_changed`` is False. The message quotes the old and
            the new value.
    """
    difference = policy_difference(run, policy)
    if difference is None:
        return run
    if not allow_changed:
        raise RunConflictError(
            f"{run.path}: the policy at {policy.get('address')} is not the policy of this run: {difference}. "
            "Start the original policy, choose another folder, or use --allow-changed-policy to continue "
            "with both policies in one run."
        )
    entry = {
        "at_utc": _now(),
        "trials_before": sum(e.status == "done" for e in run.entries()),
        "difference": difference,
        "policy": dict(policy),
    }
    return run.amended({"policy_changes": [*run.context.get("policy_changes", []), entry]})


def _now() -> str:
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
