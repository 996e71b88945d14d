"""``better real plan``: write the plan of a diagnostic protocol for a real robot arm."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

from betterbench.cli.console import say
from betterbench.errors import InvalidInputError

if TYPE_CHECKING:
    from betterbench.real.plan import RealPolicy


def plan_command(
    *,
    out: Path,
    policies: tuple[str, ...],
    task: str = "fruit_basket",
    conditions: tuple[str, ...] = (),
    trials: int = 1,
    seed: int = 0,
    unit: Literal["degrees", "normalized"] = "degrees",
    rate_hz: float = 20.0,
    time_limit_s: float = 30.0,
) -> None:
    """Plan a protocol on a real robot arm: randomized blocks of conditions and policies, and a code for each trial.

    Each block contains every condition once for every policy. The policies are run one after the other in a condition,
    in varying order, so that changes of light or calibration affect all of them. A plan cannot be changed later.

    Example: better real plan --out bench --policies ours=openpi://127.0.0.1:8000 base=lerobot:checkpoint --trials 3

    Args:
        out: Folder of the protocol.
        policies: Policies as NAME=ADDRESS; their actions must be joint positions of the SO-101 in the unit set by
            --unit.
        task: Task of the suite.
        conditions: Conditions of the task; default: one condition for each cell of the task's diagnostic matrices.
        trials: Number of trials per condition and policy.
        seed: Random seed for the order of the trials and for their codes.
        unit: Unit of joint positions as in LeRobot: degrees, or normalized (-100 to 100).
        rate_hz: Number of actions per second, as in the training of the policies.
        time_limit_s: Maximum duration of a trial in seconds.
    """
    from betterbench.real.plan import make_plan, write_plan
    from betterbench.wording import plural

    plan = make_plan(
        [_policy(text) for text in policies],
        task=task,
        conditions=conditions or None,
        repeats=trials,
        seed=seed,
        unit=unit,
        rate_hz=rate_hz,
        time_limit_s=time_limit_s,
    )
    path = write_plan(out, plan)
    sides = plural(len(plan.conditions), "condition"), plural(len(plan.policies), "policy", "policies")
    count = " x ".join((*sides, str(trials)))
    say(f"wrote {path} with {plural(len(plan.trials), 'trial')} ({count}); next: better real run {out}", whole=True)


def _policy(text: str) -> RealPolicy:
    """Parse a policy given as NAME=ADDRESS, and check its address."""
    from betterbench.policies.kinds.kind import kind_of
    from betterbench.real.asking import require_images_suffice
    from betterbench.real.plan import RealPolicy

    name, separator, address = text.partition("=")
    if not separator or not name or not address:
        raise InvalidInputError(
            "--policies", f"expected NAME=ADDRESS, got {text!r}", "Write, for example, ours=openpi://127.0.0.1:8000"
        )
    policy = RealPolicy(name, address)
    kind_of(address).parse(address)  # check now, because a plan cannot be changed later
    require_images_suffice(policy)
    return policy
