"""Small plans: episodes of `morning_coffee/T1`, the shortest of the suite, and an uninterrupted run to compare with."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.evaluation.few_steps import in_few_steps

from betterbench.evaluation import Plan, evaluate, make_plan
from betterbench.evaluation.planning.plan import Trial
from betterbench.records import RunFolder

FEW_STEPS = 24


def tiny(policy: str = "random", *, trials: int = 4) -> Plan:
    """Returns the plan of some trials of one condition."""
    plan = make_plan(
        policy, tasks=["morning_coffee"], variations=["T1"], trials=trials, observation="state_only", quality="fast"
    )
    return dataclasses.replace(plan, trials=tuple(t for t in plan.trials if t.variation == "T1"))


def content(run: Path) -> dict[str, bytes]:
    """Returns every record and scene of a run by name."""
    files = [p for folder in ("records", "scenes") for p in sorted((run / folder).rglob("*")) if p.is_file()]
    return {str(p.relative_to(run)): p.read_bytes() for p in files}


def check_steps(told: list[tuple[str, int]]) -> None:
    """Checks what ``on_progress`` and ``on_steps`` told, as ("trial", done) and ("steps", count)."""
    kinds = [kind for kind, _ in told]
    assert kinds[0] == "trial"
    assert kinds.index("steps") < kinds.index("trial", 1), "steps are told before the first trial ends"
    steps = [count for kind, count in told if kind == "steps"]
    assert steps == sorted(steps)
    assert len(set(steps)) == len(steps)


@pytest.fixture
def short_trials() -> Iterator[None]:
    """Ends the trials that are simulated in this process after a few steps."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Trial, "resolve", in_few_steps(FEW_STEPS))
        yield


@pytest.fixture
def tiny_plan():
    return tiny


@pytest.fixture
def run_content():
    return content


@pytest.fixture(scope="session")
def uninterrupted(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    """The tiny plan, run in one go by one process."""
    return evaluate(tiny(), tmp_path_factory.mktemp("uninterrupted") / "run")
