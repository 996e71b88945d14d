"""Balanced conditions of the task seasoning_rack.

Every jar starts in every slot and goes to every hole, first or second.
"""

import itertools

from betterbench.tasks import authoring as a
from betterbench.tasks.condition import Condition
from betterbench.tasks.suite.seasoning_rack import (
    FIRST,
    HOLES,
    PAPRIKA,
    PEPPER,
    RACK,
    SALT,
    SECOND,
    STAND,
    THIRD,
    insert,
)

CROSSED = (
    "each jar stands in each slot equally often, also for each instruction",
    "each jar goes into each hole equally often, alone and with another one",
    "each jar comes first or second; all jars on the table, or without one that is not requested",
)
JARS, SLOTS = (SALT, PEPPER, PAPRIKA), (FIRST, SECOND, THIRD)


def balanced_seasoning_rack() -> list[Condition]:
    """Return conditions for each jar and hole, and for each ordered pair of jars and two holes.

    Each instruction occurs in three layouts, in which the jars rotate through the slots. It therefore does not
    determine where its jars start.
    """
    holes = tuple(HOLES)
    found = []
    for shift, turn in itertools.product(range(3), repeat=2):
        into = {jar: holes[(place + shift) % 3] for place, jar in enumerate(JARS)}
        asked = [(jar,) for jar in JARS] + list(itertools.permutations(JARS, 2))
        for number, jars in enumerate(asked):
            layout = {jar: SLOTS[(place + turn) % 3] for place, jar in enumerate(JARS)}
            if (number + shift + turn) % 2:
                del layout[next(jar for jar in JARS if jar not in jars)]
            found.append(a.condition({**layout, RACK: STAND}, insert(*((jar, into[jar]) for jar in jars))))
    return found
