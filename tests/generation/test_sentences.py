"""Requests of users: accepted with a goal that the built task holds, or refused with the word that it does not."""

from __future__ import annotations

import re

import pytest
from tests.daily import others_slow
from tests.looping import each

from betterbench.errors import InvalidInputError
from betterbench.generation.building.casting import cast_of
from betterbench.generation.choosing import Chosen, scenarios_about
from betterbench.generation.patterns import pattern_of
from betterbench.sim.assets.catalogue.search import Catalogue

INSTRUCTION, REWORDED = True, False
"""Whether the sentence is the instruction, or the grammar words it."""

ACCEPTED = [
    # sides of an anchor: kind of the object and region
    ("Put the mug to the left of the laptop", INSTRUCTION, {"mug": "left"}),
    ("Put the computer mouse to the right of the laptop and the mug to the left", INSTRUCTION,
     {"computer mouse": "right", "mug": "left"}),
    ("Put the mug on the left side of the laptop and the speaker behind it", INSTRUCTION,
     {"mug": "left", "speaker": "behind"}),
    ("Put the mouse behind the laptop", INSTRUCTION, {"computer mouse": "behind"}),
    ("Put the mouse right of the laptop, the mug left of the laptop and the speaker behind the laptop", INSTRUCTION,
     {"computer mouse": "right", "mug": "left", "speaker": "behind"}),
    ("Put the fork to the left and the spoon to the right of the plate", INSTRUCTION,
     {"fork": "left", "spoon": "right"}),
    ("Put the spoon to the left of the plate", INSTRUCTION, {"spoon": "left"}),
    ("Put the glass at the upper right of the plate", INSTRUCTION, {"tumbler": "upper_right"}),
    # the direction of cutlery, and the words of the suite
    ("Put the fork left of the plate with its handle to the front", INSTRUCTION, {"fork": "left"}),
    ("Put the fork to the left and the spoon to the right of the plate, with their handles toward the front",
     INSTRUCTION, {"fork": "left", "spoon": "right"}),
    (("Put the fork next to the plate on the left and the cup next to the plate at the upper right, with the handle of "
      "the fork pointing to the front, not to a side"), INSTRUCTION, {"fork": "left", "cup": "upper_right"}),
    (("Put the fork next to the plate on the left and the spoon next to the plate on the right, with the handles of "
      "the cutlery pointing to the front, not to a side"), INSTRUCTION, {"fork": "left", "spoon": "right"}),
    ("Put the mug next to the laptop on the left and the speaker next to it on the right", INSTRUCTION,
     {"mug": "left", "speaker": "right"}),
    ("Put the mug next to the laptop", INSTRUCTION, {"mug": None}),
    ("Set the mug close to the laptop", INSTRUCTION, {"mug": None}),
    ("Put a mug left of the black laptop and a speaker right of it", INSTRUCTION, {"mug": "left", "speaker": "right"}),
    ("Set the table for breakfast around the plate", INSTRUCTION, {"fork": "left", "spoon": "right"}),
    ("Arrange the mug, the mouse and the speaker around the laptop", REWORDED, {"mug": None, "speaker": None}),
    # into a container
    ("Pack the apple into the lunchbox", INSTRUCTION, {"apple": ""}),
    ("Pack the red apple and the lemon into the blue lunchbox", INSTRUCTION, {"apple": "", "lemon": ""}),
    ("Pack two apples into the lunchbox", INSTRUCTION, {"red apple": "", "yellow apple": ""}),
    ("Pack all fruit into the lunchbox", INSTRUCTION, {"apple": "", "orange": "", "lemon": ""}),
    ("Pack the apple on the counter into the lunchbox", INSTRUCTION, {"apple": ""}),
    ("Fill the lunchbox with an apple and a lemon", INSTRUCTION, {"apple": "", "lemon": ""}),
    ("Put the apple back in the lunchbox", INSTRUCTION, {"apple": ""}),
    ("Throw the napkin away in the bin", INSTRUCTION, {"napkin": ""}),
    ("Add an apple to the lunchbox", INSTRUCTION, {"apple": ""}),
    ("Please put the apple into the lunchbox!", INSTRUCTION, {"apple": ""}),
    ("First put the apple into the lunchbox, then the orange", REWORDED, {"apple": "", "orange": ""}),
    ("Pack the orange and then the apple into the lunchbox", REWORDED, {"orange": "", "apple": ""}),
    ("Throw the trash into the bin", INSTRUCTION, {"crushed can": ""}),
    ("Collect the trash from the table into the bin", INSTRUCTION, {"crushed can": ""}),
    ("Put the burger into the takeout box", INSTRUCTION, {"burger": ""}),
    ("Put the burger into the takeaway box", INSTRUCTION, {"burger": ""}),
    # on the ring
    ("Put the red mug on the ring of the coffee machine", INSTRUCTION, {"red mug": ""}),
    ("Place the mug on the coffee machine's ring", INSTRUCTION, {"white mug": ""}),
    ("Put a mug under the spout of the coffee machine", INSTRUCTION, {"blue mug": ""}),
    ("Center the mug on the ring of the coffee machine", INSTRUCTION, {"white mug": ""}),
    # drawers
    ("Put the stapler into the upper drawer", INSTRUCTION, {"stapler": "upper"}),
    ("Put the stapler into the lower drawer", INSTRUCTION, {"stapler": "lower"}),
    ("Put the stapler into the top drawer and the tape into the bottom drawer", INSTRUCTION,
     {"stapler": "upper", "tape": "lower"}),
    ("Put the stapler and the tape into the drawers", INSTRUCTION, {"stapler": None, "tape": None}),
    ("Put the stapler into the drawer, then close it", REWORDED, {"stapler": None}),
    ("Put two staplers into the drawers", INSTRUCTION, {"red stapler": None, "black stapler": None}),
    # layers
    ("Build a cheeseburger on the bottom bun", INSTRUCTION, {"patty": "1", "top bun": "3"}),
    ("Make a burger", INSTRUCTION, {"patty": "1", "top bun": "3"}),
    ("Make a sandwich for lunch", INSTRUCTION, {"patty": "1", "top bun": "3"}),
    ("Stack the patty, then the cheese on the bottom bun", REWORDED, {"patty": "1", "cheese slice": "2"}),
    ("Build a tower of three blocks on the plate", INSTRUCTION, {"red round block": "1"}),
    # holes
    ("Put the salt jar into the left hole of the rack", INSTRUCTION, {"salt jar": "hole_1"}),
    ("Put the salt into the right hole and the pepper into the left hole of the rack", INSTRUCTION,
     {"salt jar": "hole_3", "pepper jar": "hole_1"}),
    ("Put the paprika into the center hole of the rack", INSTRUCTION, {"paprika jar": "hole_2"}),
    ("Insert the jars into the holes", INSTRUCTION, {"salt jar": None}),
    # plates on plates, with the kind and the target
    ("Put the red plate on the blue plate", INSTRUCTION, {"red dinner plate": "blue_serving_plate"}),
    ("Put the blue plate on the red plate", INSTRUCTION, {"blue dinner plate": "red_serving_plate"}),
    ("Put the red plate on the blue plate and the white plate on the red plate", INSTRUCTION,
     {"red dinner plate": "blue_serving_plate", "white dinner plate": "red_dinner_plate"}),
    ("Put the red plate and the blue plate on the white plate", INSTRUCTION,
     {"red dinner plate": "white_serving_plate", "blue dinner plate": "white_serving_plate"}),
    ("Stack the clean plates in one pile", INSTRUCTION, {}),
]  # fmt: skip
"""Sentences with the kinds that training requests, and their regions (None: any) or targets of plates."""

REFUSED = [
    # relations that no pattern has
    ("Put the mug in front of the laptop", "in front of"),
    ("Put the mug at the upper right of the laptop", "at the upper right of"),
    ("Put the stapler between the laptop and the mug", "between"),
    ("Put the mug on top of the laptop", "on top of"),
    ("Put the laptop to the left of the mug", "to the left of"),
    ("Put the mouse to the left of the mug next to the laptop", "to the left of"),
    ("Put the mug and the mouse to the left of the laptop", "to the left of"),
    ("Put the apple behind the lunchbox", "behind"),
    ("Put the apple on top of the lemon in the lunchbox", "on top of"),
    ("Pack the apple into the left side of the lunchbox", "left"),
    ("Take the apple out of the lunchbox", "out of"),
    ("Put the mug next to the coffee machine", "next to"),
    ("Put the mug in front of the coffee machine", "in front of"),
    ("Put the mug behind the coffee machine on the ring", "behind"),
    ("Put the left mug on the ring of the coffee machine", "left"),
    ("Put the stapler on top of the cabinet", "on top of"),
    ("Put the stapler into the left drawer of the cabinet", "left"),
    ("Put the stapler and the tape into the lower drawer", "into"),
    ("Build a burger with the cheese on top of the patty", "on top of"),
    ("Put the lettuce under the patty on the bottom bun", "under"),
    ("Put the cheese between the patty and the lettuce on the bun", "between"),
    ("Build a tower of blocks on the plate with the red block at the bottom", "at the bottom"),
    ("Stack the red block on the blue block", "on"),
    ("Stack the red block next to the blue block on the plate", "next to"),
    ("Build the tower next to the plate", "next to"),
    ("Put the salt and the pepper into the left hole of the rack", "into"),
    ("Put the salt jar on top of the rack", "on top of"),
    ("Put the salt jar next to the rack", "next to"),
    ("Put the salt left of the pepper in the rack", "left of"),
    ("Stack the plates with the red plate on top", "on top"),
    ("Put the red plate under the blue plate", "under"),
    ("Put the serving plate on the dinner plate", "on"),
    ("Put the red mug on the ring and the blue mug back", "back"),
    ("Put the apple in the lunchbox and the orange away", "away"),
    ("Put the stapler in the upper drawer, and the sponge back", "back"),
    # what layers make
    ("Make two burgers", "burgers"),
    ("Make both burgers on the bottom bun", "burgers"),
    ("Build sandwiches on the bottom bun", "sandwiches"),
    ("Build towers on the white plate", "towers"),
    ("Make a hamburger on the white plate", "hamburger"),
    ("Build a burger out of blocks", "burger"),
    ("Make a burger with lettuce on the plate", "burger"),
    ("Make a cake of round blocks", "cake"),
    # numbers
    ("Pack five apples into the lunchbox", "five"),
    ("Pack a dozen apples into the lunchbox", "dozen"),
    ("Pack some apples into the lunchbox", "some"),
    ("Put both mugs on the ring of the coffee machine", "both"),
    ("Put the mugs on the ring of the coffee machine", "mugs"),
    ("Put the red mug and the blue mug on the ring of the coffee machine", "on"),
    ("Build a tower of two blocks on the plate", "two"),
    ("Stack two plates", "two"),
    ("Set the table for two around the plate", "two"),
    # negations, choices, order, poses, comparisons
    ("Pack the fruit without the lemon into the lunchbox", "without"),
    ("Put the fork next to the plate, but not the spoon", "but"),
    ("Put the mug on the ring, not under the spout of the machine", "not"),
    ("Build a burger without lettuce on the bottom bun", "without"),
    ("Put the apple or the orange into the lunchbox", "or"),
    ("Put the fork left of the plate, then the spoon right of it", "then"),
    ("Pack the apple, then the orange, then the lemon into the lunchbox", "then"),
    ("Pack the orange into the lunchbox after the apple", "after"),
    ("Stack the patty, then the cheese, then the lettuce on the bottom bun", "then"),
    ("Put the salt into the first hole of the rack", "first"),
    ("Put the biggest mug next to the laptop", "biggest"),
    ("Stack the plates from largest to smallest", "largest"),
    ("Stack the plates sideways", "sideways"),
    ("Put the apple into the lunchbox and close it", "close"),
    ("Don't put the apple into the lunchbox", "goals cannot exclude objects"),
    ("Open the drawer and put the stapler into it", "open"),
    ("Put the top bun on the bottom bun", "on"),
    ("Close both drawers of the cabinet", "Close"),
    ("Put the stapler into the second drawer", "second"),
    ("Move the mug away from the laptop", "away from"),
    ("Put a salt jar in every hole of the rack", "every"),
    # words that are not read
    ("Put the mug upside down next to the plate", "upside"),
    ("Put the mug next to the laptop with its handle to the right", "handle"),
    ("Put the mug left of the plate with its handle to the front", "handle"),
    ("Put the fork and the cup next to the plate, with their handles to the front", "their"),
    ("Put the fork left of the plate with the handle of the cup to the front", "handle"),
    ("Put the fork left of the plate with its handle to the left", "handle"),
    ("Put the fork left of the plate with its handle to the front and its head to the left", "head"),
    ("Put the red mug on the ring of the coffee machine with its handle to the front", "handle"),
    ("Put the red and the blue plate on the white plate", "red"),
    ("Put the banana into the lunchbox", "banana"),
    ("Put the purple mug on the ring of the coffee machine", "purple"),
    ("Unpack the lunchbox", "unpack"),
    ("Build a pyramid of blocks on the plate", "pyramid"),
    ("Sort the fruit into the lunchbox by color", "sort"),
    ("Swap the mug and the mouse next to the laptop", "swap"),
    ("Quickly pack the apple into the lunchbox", "quickly"),
    ("Wash the apple and put it into the lunchbox", "wash"),
    ("Turn on the laptop and put the mug next to it", "turn"),
    ("Put the stapler into the drawer and leave it open", "leave"),
    ("Put the small apple into the lunchbox", "small"),
    # two tasks in one
    ("Put the apple into the lunchbox and the mug on the ring of the coffee machine", "apple"),
    ("Put the crushed can into the bin and the burger into the takeout box", "takeout box"),
    ("Stack the plates and put the fork on the red plate", "fork"),
    ("Insert four jars into the holes", "jar"),
]  # fmt: skip
"""Sentences with the word that the error names."""


def goals_of(chosen: Chosen, catalogue: Catalogue) -> dict[str, set[tuple[str, str]]]:
    """Return the targets and regions of each kind that training requests."""
    (scenario,) = chosen.scenarios
    made = pattern_of(chosen.template)(cast_of(scenario, catalogue)[0])
    found: dict[str, set[tuple[str, str]]] = {}
    for condition in made.task.training:
        for goal in condition.instruction.subgoals:
            target = condition.object(goal.target)
            region = target.category.partition("_")[0] if target.role == "drawer" else goal.region
            found.setdefault(str(goal.reference.kind), set()).add((goal.target, region))
    return found


@pytest.mark.parametrize(
    ("sentence", "is_instruction", "goals"), others_slow(ACCEPTED, 4), ids=[s for s, *_ in ACCEPTED]
)
def test_the_built_goal_is_the_stated_one(catalogue, sentence, is_instruction, goals):
    chosen = scenarios_about(sentence, 1)
    assert (chosen.reworded == "") is is_instruction, chosen.reworded
    built = goals_of(chosen, catalogue)
    for kind, place in goals.items():
        assert kind in built
        if place is not None:
            assert any(place in where for where in built[kind]), (kind, built[kind])
        if place not in (None, "") and chosen.template in ("patterned_arrangement", "container_loading"):
            assert {region for _, region in built[kind]} == {place}, "the only place in training"


@each("sentence, word", REFUSED)
def test_a_goal_that_no_pattern_holds_is_refused_with_its_word(sentence, word):
    with pytest.raises(InvalidInputError, match=f"(?i){re.escape(word)}") as caught:
        scenarios_about(sentence, 1)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("sentence", others_slow((s for s, _ in REFUSED), 4))
def test_the_sentence_that_a_refusal_offers_is_accepted(sentence):
    with pytest.raises(InvalidInputError) as caught:
        scenarios_about(sentence, 1)
    offered = re.search(r"a sentence such as '([^']+)'", str(caught.value))
    if offered:
        assert scenarios_about(offered[1], 1).reworded == ""


def test_the_table_has_sentences_for_every_template(catalogue):
    assert len(ACCEPTED) + len(REFUSED) >= 60
    assert {scenarios_about(s, 1).template for s, *_ in ACCEPTED} >= {
        "patterned_arrangement", "loose_packing", "constrained_positioning", "container_loading", "logical_assembly",
        "precision_insertion", "recursive_stacking",
    }  # fmt: skip


def test_the_order_of_a_sentence_is_the_order_of_the_first_training_condition(catalogue):
    for sentence, text in (
        ("Pack the orange and then the apple into the lunchbox", "Put the orange into the lunchbox, then the apple."),
        (
            "Stack the patty, then the cheese on the bottom bun",
            "Stack the patty on the bottom bun, then the cheese slice",
        ),
    ):
        chosen = scenarios_about(sentence, 1)
        made = pattern_of(chosen.template)(cast_of(chosen.scenarios[0], catalogue)[0])
        assert made.task.training[0].instruction.text.startswith(text)
