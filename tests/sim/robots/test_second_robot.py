"""A second robot is one registration: a scene, its conventions and the expert take it from its description."""

from __future__ import annotations

from dataclasses import replace

import pytest

from betterbench.errors import InvalidInputError
from betterbench.evaluation import evaluate, make_plan
from betterbench.sim.robots import PANDA, build_robot_spec, register_robot, robot, robot_names, spec

SLOW = replace(
    PANDA, name="slow_panda", title="Panda with a slow hand", gripper_speed_m_s=0.5 * PANDA.gripper_speed_m_s
)


def _build(*, visuals, progress):
    return build_robot_spec("panda", visuals=visuals, progress=progress)


@pytest.fixture
def second(monkeypatch):
    monkeypatch.setattr(spec, "_ROBOTS", dict(spec._ROBOTS))
    register_robot(SLOW, _build)


@pytest.mark.usefixtures("second")
def test_a_trial_is_run_with_a_second_robot(tmp_path):
    assert robot_names() == ("panda", "slow_panda")
    assert robot("slow_panda") is SLOW
    plan = make_plan("expert", tasks=("morning_coffee",), trials=1, observation="state_only")
    trials = tuple(t for t in plan.trials if t.variation is None)[:1]
    run = evaluate(replace(plan, trials=trials, robot="slow_panda"), tmp_path / "run", workers=1)
    (entry,) = run.entries()
    assert (entry.status, run.outcome(entry).success) == ("done", True)
    assert run.plan["robot"] == "slow_panda"
    assert run.context["conventions"]["robot"]["gripper_speed_m_s"] == SLOW.gripper_speed_m_s
    usual = evaluate(replace(plan, trials=trials), tmp_path / "usual", workers=1)
    slow, fast = (len(next(found.records())) for found in (run, usual))
    assert slow > fast


@pytest.mark.usefixtures("second")
def test_the_name_of_a_robot_is_taken_once():
    with pytest.raises(InvalidInputError, match="the name is taken"):
        register_robot(SLOW, _build)
