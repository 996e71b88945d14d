"""A question about where an object is does not say that it stands: the gripper may hold it in the air."""

from __future__ import annotations

import re

import pytest

from betterbench.vqa import phrasings

ABOUT_PLACES = ("closer to camera", "closer to robot", "side in image", "side for robot", "outermost")


def wordings():
    tables = [value for value in vars(phrasings).values() if isinstance(value, dict)]
    return {name: texts for table in tables for name, texts in table.items() if name in ABOUT_PLACES}


@pytest.mark.parametrize("name", ABOUT_PLACES)
def test_no_question_about_a_place_presupposes_that_the_object_stands(name):
    texts = wordings()[name]
    assert texts
    for text in texts:
        about = re.sub(r"where the robot stands", "", str(text))
        assert not re.search(r"\b(stands?|standing|lies|lying|rests?)\b", about), text
