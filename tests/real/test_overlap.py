"""The live camera against the twin: the right scene is accepted under any light, a moved object is found."""

import numpy as np
import pytest
from tests.daily import others_slow

from betterbench.errors import InvalidInputError
from betterbench.real.overlap import measure_agreement
from betterbench.real.plan import RealPolicy, make_plan
from betterbench.real.robots.mock import MockFaults, MockRobot
from betterbench.real.twin import Twin

pytestmark = pytest.mark.render
SIZE = (320, 240)


@pytest.fixture(scope="module")
def plan():
    return make_plan((RealPolicy("a", "noop"),), conditions=["train1", "O1", "T3", "train3"], seed=3)


@pytest.fixture(scope="module")
def trials(plan):
    return {trial.condition: trial for trial in plan.trials}


@pytest.fixture(scope="module")
def twin(plan):
    made = Twin(plan, size=SIZE)
    yield made
    made.close()


def live(plan, trial, size=SIZE, **faults):
    robot = MockRobot(plan, faults=MockFaults(**faults), cameras=("front",), size=size)
    robot.set_up(trial)
    image = robot.read().frames["front"].image
    robot.disconnect()
    return image


@pytest.fixture(scope="module")
def compare(plan, trials, twin):
    """Return a function that compares a condition with itself, with faults."""
    return lambda name, **faults: measure_agreement(live(plan, trials[name], **faults), twin.view(trials[name]))


@pytest.mark.parametrize("condition", others_slow(["train1", "O1"], 2))
@pytest.mark.parametrize("light", [{}, {"light": 0.6, "tint": (1.0, 0.9, 0.75)}, {"light": 1.3}])
def test_the_right_scene_is_accepted_under_another_light(compare, condition, light):
    found = compare(condition, **light)
    assert found.accepted
    assert found.sentences == ()
    assert found.score > 0.85
    assert "basket" in {o.name for o in found.objects}


@pytest.mark.parametrize(
    ("shift", "says"),
    [
        ((0.03, 0.0), "too far from the arm"),
        ((-0.03, 0.0), "too close to the arm"),
        ((0.0, 0.03), "too far to the arm's left"),
        ((0.0, -0.03), "too far to the arm's right"),
    ],
)
@pytest.mark.parametrize("name", others_slow(["lemon", "soap_bar"], 2))
def test_an_object_3_cm_off_is_named_with_its_direction(compare, name, shift, says):
    found = compare("train1", moved={name: shift})
    assert not found.accepted
    (sentence,) = found.sentences
    assert name.replace("_", " ") in sentence
    assert says in sentence
    worst = found.objects[0]
    assert worst.name == name
    np.testing.assert_allclose(worst.off_m, shift, atol=0.006)
    assert found.score < 0.6


def test_an_object_that_is_missing_or_another_one_is_not_found(plan, trials, twin):
    found = measure_agreement(live(plan, trials["T3"]), twin.view(trials["train1"]))  # neither fruit on the table
    assert {o.name for o in found.objects if not o.accepted} >= {"lemon", "mangosteen"}
    assert any("was not found at its planned position" in sentence for sentence in found.sentences)


def test_a_camera_of_another_size_is_scaled_and_one_of_another_shape_refused(plan, trials, twin):
    view = twin.view(trials["train1"])
    assert measure_agreement(live(plan, trials["train1"], size=(640, 480)), view).accepted
    with pytest.raises(InvalidInputError, match="front camera: its images have shape"):
        measure_agreement(np.zeros((240, 240, 3), np.uint8), view)
    assert not measure_agreement(np.zeros((240, 320, 3), np.uint8), view).accepted


def test_the_steps_say_what_to_put_where_and_what_to_take_away(trials, twin):
    steps = {step.name: step for step in twin.steps(trials["T3"])}
    assert steps["lemon"].text == "lemon: into the fruit basket"
    assert steps["mangosteen"].text == "mangosteen: take it away"
    assert steps["block"].place == "table"
    x, y = steps["block"].position_m
    assert steps["block"].text == f"block: {100 * x:.1f} cm ahead of the base, {100 * y:.1f} cm to the arm's left"
    assert twin.cloth(trials["T3"]) == "blue"
    basket = steps["basket"]
    assert "to the arm's right" in basket.text
    assert next(iter(twin.steps(trials["O1"]))).place != "absent"


def test_the_wrong_tablecloth_is_noticed(plan, trials, twin):
    found = measure_agreement(live(plan, trials["train3"]), twin.view(trials["train1"]))  # the same objects, on green
    assert found.sentences == ("The tablecloth is not blue.",)
    assert not found.accepted
    assert all(o.accepted for o in found.objects)
