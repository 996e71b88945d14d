"""Images of training and test scenes."""

from __future__ import annotations

import pytest
from PIL import Image

from betterbench.evaluation.figures import show
from betterbench.tasks import get_task


@pytest.fixture
def drawn(monkeypatch):
    """Draw blank scenes, and return their number."""
    made = []

    def blank(task, condition, *, seed, size, outlined=(), robot):
        made.append(condition.name)
        return Image.new("RGB", (size, size))

    monkeypatch.setattr(show, "show_condition", blank)
    return made


def test_training_conditions_are_shown_in_rows_of_four(drawn):
    image = show.show_training("desk_meeting", size=96)
    assert len(drawn) == 12
    assert image.width == 4 + 4 * (96 + 4)
    assert image.height > 3 * 96


def test_a_card_says_what_each_variation_changes():
    fast_food, coffee = get_task("fast_food"), get_task("morning_coffee")
    assert show.card_title(fast_food.variation("L1")) == "L1: burger and fries exchanged"
    assert show.card_title(fast_food.variation("R1")) == "R1: fries, then drink (B>C)"
    assert show.card_title(coffee.variation("T1")) == "T1: red mug already on the ring (correct: stay still)"


def test_captions_are_wrapped_to_the_width_of_their_image(drawn):
    short, long = (show._side_by_side("", (title, "Go.", Image.new("RGB", (96, 96)))) for title in ("L1", "L1 " * 60))
    assert long.width == short.width
    assert long.height >= short.height + 2 * 5
