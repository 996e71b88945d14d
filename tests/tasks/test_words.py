"""Words for sentences about objects."""

from __future__ import annotations

import pytest

from betterbench.tasks.words import agreeing, is_plural, place_words


@pytest.mark.parametrize(
    ("kind", "many"),
    [("fries", True), ("burger", False), ("glass", False), ("cactus", False), ("red mug", False), ("chassis", False)],
)
def test_a_verb_agrees_with_the_name_of_a_kind(kind, many):
    assert is_plural(kind) is many
    assert agreeing(kind, "is", "are") == ("are" if many else "is")


@pytest.mark.parametrize(
    ("region", "said"),
    [("", "the laptop"), ("upper_right", "the laptop (upper right)"), ("2", "the laptop (layer 2)")],
)
def test_a_place_is_named_with_its_region(region, said):
    assert place_words("laptop", region) == said
