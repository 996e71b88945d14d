"""Assembling a cheeseburger with the SO-101: the task of the Panda, laid out within the reach of this arm."""

from betterbench.tasks import authoring as a
from betterbench.tasks.suite.cheeseburger import cheeseburger


@a.task
def cheeseburger_so101() -> a.Task:
    """Stack the named layers on the bottom bun with the SO-101, in the order in which they are named.

    The slots of `cheeseburger` from a base at (0.28, -0.13) m, and 15 % closer together, so that the arm reaches every
    slot with a tool that hardly tilts. Between the two nearest slots, the open gripper starts above the empty table.

    Randomizations: each layer within 15 mm and 9 degrees of its slot; all looks.
    """
    return a.laid_out(
        cheeseburger(),
        "cheeseburger_so101",
        robot="so101",
        robot_title="SO-101",
        base_m=(0.28, -0.13),
        scale=0.85,
    )
