"""One kind of thing that a policy goes for wherever it stands, where no two tasks share a scene."""

from __future__ import annotations

import numpy as np
import pytest
from tests.looping import each

from betterbench.diagnosis.favorite_thing import favorite_thing
from betterbench.diagnosis.trial import Choice

KINDS = ("soup", "butter", "cheese", "ketchup", "milk", "sauce", "juice", "pudding")


def trial(asked, standing, thing):
    """Return the first attempt of a trial in which things stand in slots of their own."""
    slots = {kind: f"slot {i}" for i, kind in enumerate(standing)}
    return Choice(
        layout=frozenset((slot, kind) for kind, slot in slots.items()), right=frozenset({slots[asked]}),
        slot=slots[thing], correct=thing == asked, word_slots=frozenset(), habit_slots=frozenset(),
        later_slots=frozenset(), places=len(standing), thing=thing,
    )  # fmt: skip


def run(choose, *, trials=2, asked=KINDS, seed=0):
    """Return the first attempts of a policy in scenes of their own: one for each kind that is asked for."""
    rng = np.random.default_rng(seed)
    found = {}
    for kind in asked:
        others = [k for k in KINDS if k != kind]
        standing = [kind, *rng.permutation(others)[:5].tolist()]
        for n in range(trials):
            found[f"{kind}/{n}"] = trial(kind, standing, choose(kind, standing, rng))
    return found


def milk(asked, standing, rng):
    return "milk" if "milk" in standing else asked


def test_the_milk_in_every_scene_that_holds_one_is_a_favorite():
    found = favorite_thing(run(milk, trials=3))
    assert found is not None
    assert (found.kind, found.rate.k) == ("milk", found.rate.n)
    assert found.rate.n >= 10
    assert found.asked == found.rate.n // 3
    assert (
        f"{found.rate.n} of {found.rate.n} trials whose instructions name {found.asked} other kinds"
        in found.finding("suite")
    )


def test_a_favorite_that_is_taken_almost_always_is_found():
    def mostly(asked, standing, rng):
        return "milk" if "milk" in standing and rng.random() < 0.9 else asked

    assert favorite_thing(run(mostly, trials=5)).kind == "milk"


def as_asked(asked, *_):
    return asked


def second(_, standing, *__):
    return standing[1]


def sometimes_milk(asked, standing, rng):
    return milk(asked, standing, rng) if rng.random() < 0.4 else asked


@pytest.mark.parametrize(
    ("choose", "options"),
    [
        (milk, {"asked": KINDS[:2], "trials": 10}),  # two words that may be mistaken for "milk"
        (milk, {"trials": 1}),  # fewer than ten trials
        (as_asked, {"trials": 5}),
        (second, {"trials": 5}),  # another thing in each scene
        (sometimes_milk, {"trials": 5}),
    ],
)
def test_others_are_not_said_to_have_a_favorite(choose, options):
    assert favorite_thing(run(choose, **options)) is None


@each("seed", range(40))
def test_a_policy_that_picks_at_random_has_no_favorite(seed):
    def anything(asked, standing, rng):
        return standing[rng.integers(len(standing))]

    assert favorite_thing(run(anything, trials=3, seed=seed)) is None
