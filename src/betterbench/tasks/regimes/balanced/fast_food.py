"""Balanced conditions of the task fast_food.

Every food occurs in every slot, and a burger is first, second or not requested.
"""

from betterbench.tasks import authoring as a
from betterbench.tasks.condition import Condition
from betterbench.tasks.suite.fast_food import (
    BOX,
    BURGER,
    BURGER_2,
    BURGER_DRINK,
    BURGER_FRIES,
    DRINK,
    FIRST,
    FOURTH,
    FRIES,
    SECOND,
    STAND,
    THIRD,
    order,
)

CROSSED = (
    "each food stands in each slot equally often",
    "a burger comes first, second or not at all",
    "the fries and the drink come first, second or alone",
    "two burgers and four objects at the start, or one less of either",
)
FRIES_BURGER = order("the fries into the takeaway box, then a burger", FRIES, BURGER)
DRINK_BURGER = order("the drink into the takeaway box, then a burger", DRINK, BURGER)
FRIES_ALONE, DRINK_ALONE = (
    order("the fries into the takeaway box", FRIES),
    order("the drink into the takeaway box", DRINK),
)
ASKED = (
    (BURGER_FRIES, DRINK),
    (BURGER_DRINK, FRIES),
    (FRIES_BURGER, DRINK),
    (DRINK_BURGER, FRIES),
    (FRIES_ALONE, DRINK),
    (DRINK_ALONE, FRIES),
)
SLOTS = (FIRST, SECOND, THIRD, FOURTH)


def balanced_fast_food() -> list[Condition]:
    """Return four layouts, each with six orders. The food rotates through the slots from layout to layout.

    Every second condition lacks an object that is not needed.

    The tests R1 and R2 ask for the fries and the drink together, so a meal without a burger contains only one of the
    two.
    """
    found = []
    for turn in range(4):
        for number, (asked, unasked) in enumerate(ASKED):
            things = (BURGER, BURGER_2, FRIES, DRINK)
            layout = {thing: SLOTS[(place + turn) % 4] for place, thing in enumerate(things)}
            if (turn + number) % 4 == 1:
                del layout[unasked]
            if (turn + number) % 4 == 3:
                del layout[BURGER]
            found.append(a.condition({**layout, BOX: STAND}, asked))
    return found
