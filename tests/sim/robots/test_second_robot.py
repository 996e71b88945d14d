"""A second robot is one registration: a scene, its conventions and the expert take it from its description."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import replace

import pytest

from betterbench.errors import InvalidInputError
from betterbench.evaluation import evaluate, make_plan
from betterbench.evaluation.running.replay import check_record
from betterbench.records import read_record
from betterbench.sim.robots import PANDA, build_robot_spec, register_robot, robot, robot_names, spec
from betterbench.tasks import get_task
from betterbench.tasks.authoring.registry import registered_for_now

SECOND = replace(PANDA, name="second_panda", title="A second Panda")


def _build(*, visuals, progress):
    return build_robot_spec("panda", visuals=visuals, progress=progress)


@pytest.fixture
def second(monkeypatch):
    monkeypatch.setattr(spec, "_ROBOTS", dict(spec._ROBOTS))
    register_robot(SECOND, _build)


@contextmanager
def coffee_of(name):
    """Register a copy of morning_coffee that is laid out for a robot."""
    with registered_for_now(replace(get_task("morning_coffee"), id="coffee_copy", robot=name)) as made:
        yield made


@pytest.mark.usefixtures("second")
def test_a_trial_is_run_with_a_second_robot(tmp_path):
    assert set(robot_names()) >= {"panda", "second_panda", "so101"}
    assert robot("second_panda") is SECOND
    with coffee_of("second_panda") as task:
        plan = make_plan("expert", tasks=(task.id,), trials=1, observation="state_only")
        trials = tuple(t for t in plan.trials if t.variation is None)[:1]
        run = evaluate(replace(plan, trials=trials), tmp_path / "run", workers=1)
        (entry,) = run.entries()
        assert (entry.status, run.outcome(entry).success) == ("done", True)
        assert run.plan["robot"] == "second_panda"
        assert run.context["conventions"]["robot"]["title"] == "A second Panda"


def test_a_record_of_the_so101_is_replayed_bit_for_bit(tmp_path):
    plan = make_plan("noop", tasks=("fruit_basket",), trials=1, observation="state_only", action_space="ee_delta")
    trials = tuple(t for t in plan.trials if t.variation == "T1")  # the shortest: 10 s
    run = evaluate(replace(plan, trials=trials), tmp_path / "run", workers=1)
    (entry,) = run.entries()
    path = run.record_path(entry.task, entry.condition, entry.seed)
    assert read_record(path).joint_positions.shape[1] == 5
    assert check_record(path).identical


@pytest.mark.usefixtures("second")
def test_the_name_of_a_robot_is_taken_once():
    with pytest.raises(InvalidInputError, match="a robot with this name is already registered"):
        register_robot(SECOND, _build)
