"""Assembling a cheeseburger with the SO-101: the task of the Panda, laid out within the reach of this arm."""

from betterbench.tasks import authoring as a
from betterbench.tasks.suite.cheeseburger import cheeseburger


@a.task
def cheeseburger_so101() -> a.Task:
    """Stack the named layers on the bottom bun with the SO-101, in the order in which they are named.

    The slots are those of `cheeseburger`, seen from a base at (0.28, -0.13) m and 15 % closer together, so that the arm
    reaches every slot with a nearly vertical tool. The open gripper starts above the empty table between the two
    nearest slots.

    Randomizations: each layer is within 15 mm and 9 degrees of its slot. The looks of all objects vary.
    """
    return a.laid_out(
        cheeseburger(),
        "cheeseburger_so101",
        robot="so101",
        robot_title="SO-101",
        base_m=(0.28, -0.13),
        scale=0.85,
    )
