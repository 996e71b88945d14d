"""The script that fits thresholds to the judged scenes."""

from __future__ import annotations

import importlib
import math
from pathlib import Path

import pytest

TOOLS = Path(__file__).resolve().parents[2] / "tools"


@pytest.fixture
def fits(monkeypatch):
    monkeypatch.syspath_prepend(str(TOOLS))
    return importlib.import_module("judged_thresholds")


def points(fits, *told):
    """Returns points from triples of set, value and vote, each of weight 1."""
    return [fits.Point(name, value, vote == "y", 1.0) for name, value, vote in told]


def test_the_best_interval_lies_between_accepted_and_denied_scenes(fits):
    found = points(fits, ("a", 1.0, "y"), ("a", 3.0, "y"), ("b", 7.0, "n"), ("b", 9.0, "n"))
    assert fits.best_interval(found) == (3.0, 7.0)
    assert (fits.wrong(found, 5.0), fits.wrong(found, 2.0), fits.wrong(found, 8.0)) == (0, 1, 1)


def test_without_a_denied_scene_there_is_no_upper_limit(fits):
    found = points(fits, ("a", 1.0, "y"), ("b", 3.0, "y"))
    assert fits.best_interval(found) == (3.0, math.inf)
    assert fits.wrong(found, fits.middle_of((3.0, math.inf))) == 0
    assert fits.middle_of((-math.inf, 2.0)) == 2.0


def test_a_scene_of_sure_judges_outweighs_one_of_a_single_judge(fits):
    found = [
        fits.Point("a", 2.0, True, 2.0),
        fits.Point("blind", 1.0, False, 1.0 / 3.0),
        fits.Point("a", 5.0, False, 1.0),
    ]
    assert fits.best_interval(found) == (2.0, 5.0)


def test_each_set_is_judged_by_thresholds_of_the_other_sets(fits):
    """The scene of set b alone says that 4 is accepted, so it is wrong without its own set."""
    found = points(fits, ("a", 1.0, "y"), ("a", 5.0, "n"), ("b", 4.0, "y"))
    assert fits.wrong(found, fits.middle_of(fits.best_interval(found))) == 0
    assert fits.wrong_in_other_sets(found) >= 1


def test_rules_measure_the_scenes_that_they_decide(fits):
    """A mug 26.6 cm to the left of the laptop, and a plate 4.7 cm off the middle of another plate, of the fifth set."""
    for name, index, expected in (("side_reach", 25, 0.2663), ("plate_offset", 19, 0.0467)):
        scene = fits.SETS["fifth"][index]
        posed = fits.Judged("fifth", scene, *fits.arranging.arranged(scene.setting, scene.arrangement))
        measured = {rule: fits.RULES[rule](posed) for rule in ("side_reach", "plate_offset", "ring_radius", "turned")}
        assert measured.pop(name) == pytest.approx(expected, abs=1e-3)
        assert set(measured.values()) == {None}
    assert set(fits.RULES) <= set(fits.THRESHOLDS.to_json())


def test_rules_of_harm_measure_the_object_that_was_moved_wherever_it_is_listed(fits):
    """A keyboard pushed by 3.7 cm and turned by 13 degrees, listed last, and a plate pushed by 7.2 cm."""
    for name, start, rule, expected in (
        ("seventh", "napkin bin.inside x=0.0 y=5.0 z=5.0 settle; keyboard from", "outermost_moved", 0.0631),
        ("harm", "plate from x=59.8 y=-39.5", "anchor_moved", 0.0717),
    ):
        scene = next(s for s in fits.SETS[name] if s.arrangement.startswith(start))
        posed = fits.Judged(name, scene, *fits.arranging.arranged(scene.setting, scene.arrangement))
        assert fits.RULES[rule](posed) == pytest.approx(expected, abs=1e-3)
        assert fits.RULES["target_moved"](posed) is None
