"""Listed regimes as data: any task may carry them, and a regime that contains a test is refused."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.tasks import authoring as a
from betterbench.tasks import get_task, task_from_json, task_to_json
from betterbench.tasks.authoring.no_test import require_no_test
from betterbench.tasks.authoring.regimes import PREFIXES, named_regimes
from betterbench.tasks.authoring.registry import _BUILDERS
from betterbench.tasks.interventions import resolve_condition, vary
from betterbench.tasks.interventions.regimes import conditions_of, in_regime


def coffee_form():
    return json.loads(json.dumps(task_to_json(get_task("morning_coffee"))))


@pytest.fixture
def registered():
    """Register tasks for one test."""
    added = []

    def add(made):
        def build():
            return made

        build.__name__ = made.id
        a.task(build)
        added.append(made.id)
        return get_task(made.id)

    yield add
    for name in added:
        del _BUILDERS[name]
    resolve_condition.cache_clear()


def test_a_form_carries_both_regimes_with_their_slots():
    form = coffee_form()
    assert list(form["regimes"]) == ["balanced", "diverse-confounded"]
    assert [slot["name"] for slot in form["regimes"]["balanced"]["slots"]] == ["in_front"]
    read = task_from_json({**form, "id": "other"})
    assert {c.name for c in read.regimes["diverse-confounded"].conditions} >= {"diverse1", "diverse32"}
    assert {c.task for listed in read.regimes.values() for c in listed.conditions} == {"other"}
    assert "in_front" not in {slot.name for slot in read.slots}
    assert task_to_json(read) == {**form, "id": "other"}


def test_a_form_of_earlier_versions_has_no_regimes():
    form = coffee_form()
    del form["regimes"]
    read = task_from_json(form)
    assert read.regimes == {}
    assert "regimes" not in task_to_json(read)


def test_a_users_task_has_its_regimes_like_one_of_the_suite(registered):
    base = get_task("morning_coffee")
    made = registered(task_from_json({**coffee_form(), "id": "json_coffee"}))
    shown, mine = in_regime(base, "balanced"), in_regime(made, "balanced")
    assert [c.with_(task="") for c in mine.training] == [c.with_(task="") for c in shown.training]
    assert mine.slots == shown.slots
    found = resolve_condition("json_coffee", "balanced3")
    assert found.condition == made.regimes["balanced"].conditions[2]
    assert "in_front" in {slot.name for slot in found.task.slots}


def test_a_task_in_python_lists_its_regimes(registered):
    base = get_task("fruit_lunch")
    some = tuple(c.with_(task="", name="") for c in base.regimes["balanced"].conditions[:3])
    made = registered(replace(base, id="py_lunch", regimes={"balanced": a.ListedRegime(some, ("slots",))}))
    assert [c.id for c in conditions_of(made, "balanced")] == [f"py_lunch/balanced{i}" for i in (1, 2, 3)]
    assert made.regimes["balanced"].crossed == ("slots",)
    with pytest.raises(InvalidInputError, match="py_lunch has no diverse-confounded conditions"):
        conditions_of(made, "diverse-confounded")


def test_a_derived_task_takes_over_only_the_regimes_that_are_given(registered):
    base = get_task("fruit_lunch")
    assert registered(replace(base, id="derived_lunch")).regimes == {}
    given = {"balanced": base.regimes["balanced"]}
    assert registered(replace(base, id="given_lunch", regimes=given)).regimes["balanced"].conditions


def test_a_test_in_a_regime_is_refused_with_its_name(registered):
    base = get_task("fruit_lunch")
    test, _ = vary(base, base.variation("R1"))
    listed = a.ListedRegime((base.regimes["balanced"].conditions[0], test))
    with pytest.raises(InvalidInputError, match=r"regimes.balanced.conditions\[1\]: balanced2 is the test .*/R1"):
        registered(replace(base, id="leaking_lunch", regimes={"balanced": listed}))
    form = json.loads(json.dumps(task_to_json(base)))
    leaking = {**task_to_json(replace(base, training=(test,), variations=()))}["training"]
    form["regimes"]["balanced"]["conditions"] = leaking
    with pytest.raises(InvalidInputError, match=r"task: regimes.balanced.conditions\[0\].*fruit_lunch/R1"):
        task_from_json(form)


def test_what_training_contains_too_is_not_refused():
    base = get_task("morning_coffee")
    require_no_test(replace(base, regimes={"balanced": a.ListedRegime(base.training)}))


def test_an_unknown_regime_is_refused():
    with pytest.raises(UnknownNameError, match="Did you mean 'balanced'"):
        named_regimes({"balance": a.ListedRegime(())}, "task")
    form = coffee_form()
    form["regimes"]["balance"] = form["regimes"]["balanced"]
    with pytest.raises(InvalidInputError, match="regimes"):
        task_from_json(form)
    assert set(PREFIXES) == {"balanced", "diverse-confounded"}


WRONG = {
    "regimes.balanced.slots: 'near' is given twice": lambda r: r["slots"].append({"name": "near", "x": 0.5, "y": 0.0}),
    "regimes.balanced.conditions[0].layout.red_can: Unknown slot 'in_frnt'": lambda r: r["conditions"][0][
        "layout"
    ].update(red_can="in_frnt"),
    "regimes.balanced.conditions[0]: group 'items'": lambda r: r["conditions"][0].update(
        objects=["coffee_machine"], layout={"coffee_machine": "machine"}
    ),
    "regimes.balanced.conditions": lambda r: r.update(conditions=[]),
}


@pytest.mark.parametrize("problem", WRONG)
def test_a_wrong_field_of_a_regime_is_named(problem):
    form = coffee_form()
    WRONG[problem](form["regimes"]["balanced"])
    with pytest.raises(InvalidInputError) as caught:
        task_from_json(form)
    assert problem in str(caught.value)
