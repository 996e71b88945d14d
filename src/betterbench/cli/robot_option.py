"""``--robot``: one option for all subcommands that build scenes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import tyro


@dataclass(frozen=True, slots=True)
class RobotOption:
    """The robot in the scenes.

    Attributes:
        robot: Robot in the scenes: panda or so101; default: the robot for which the (first) task is laid out.
    """

    robot: str | None = None

    @property
    def words(self) -> list[str]:
        """The option as command-line words, empty if it was not given."""
        return [] if self.robot is None else ["--robot", self.robot]

    def of(self, tasks: Sequence[str]) -> str:
        """Return the chosen robot, or that of the first task, or the default robot if there are no tasks."""
        from betterbench.interface.actions import USUAL_ROBOT
        from betterbench.tasks import get_task

        if self.robot is not None:
            return self.robot
        return get_task(tasks[0]).robot if tasks else USUAL_ROBOT


ChosenRobot = Annotated[RobotOption, tyro.conf.arg(name="")]

USUAL_OPTION = RobotOption()
