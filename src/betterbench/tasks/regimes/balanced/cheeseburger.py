"""Balanced conditions of the task cheeseburger.

Every layer occurs in every slot, and stacks have one or two layers below the top bun.
"""

from betterbench.tasks import authoring as a
from betterbench.tasks.condition import Condition
from betterbench.tasks.suite.cheeseburger import (
    BASE,
    CHEESE,
    FIRST,
    FOURTH,
    LETTUCE,
    PATTY,
    SECOND,
    STAND,
    THIRD,
    TOP,
    stack,
)

CROSSED = (
    "each layer lies in each slot equally often",
    "patty, cheese and lettuce are each the first layer and the second, and the top bun is the second and the third",
    "all layers on the table at the start, or without one that is not requested",
)
STACKS = (
    (PATTY, CHEESE, TOP),
    (PATTY, LETTUCE, TOP),
    (LETTUCE, PATTY, TOP),
    (LETTUCE, CHEESE, TOP),
    (CHEESE, PATTY),
    (CHEESE, LETTUCE),
    (PATTY, TOP),
    (LETTUCE, TOP),
    (CHEESE, TOP),
)
SLOTS = (FIRST, SECOND, THIRD, FOURTH)


def balanced_cheeseburger() -> list[Condition]:
    """Return four layouts, each with nine stacks. The layers rotate through the slots from layout to layout.

    Every second condition lacks a layer that is not requested.
    """
    found = []
    for turn in range(4):
        for number, asked in enumerate(STACKS):
            things = (PATTY, CHEESE, LETTUCE, TOP)
            layout = {thing: SLOTS[(place + turn) % 4] for place, thing in enumerate(things)}
            if (turn + number) % 2:
                del layout[next(thing for thing in things if thing not in asked)]
            found.append(a.condition({**layout, BASE: STAND}, stack(*asked)))
    return found
