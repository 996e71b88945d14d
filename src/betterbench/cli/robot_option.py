"""The ``--robot`` option, shared by all subcommands that build scenes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

import betterbench


def _robot_folders() -> list[str]:
    """Return the names of the robots, read from folder names so that the help text does not import MuJoCo."""
    folder = Path(betterbench.__file__).parent / "sim" / "robots"
    return sorted(path.parent.name for path in folder.glob("*/__init__.py"))


@dataclass(frozen=True, slots=True)
class RobotOption:
    """Option that selects the robot in the scenes."""

    robot: Annotated[
        str | None,
        tyro.conf.arg(
            help=f"Robot in the scenes: {' or '.join(_robot_folders())}; default: the robot for which the first task "
            "was designed."
        ),
    ] = None

    @property
    def words(self) -> list[str]:
        """Command-line arguments that select the same robot in another command; empty if the option was not given."""
        return [] if self.robot is None else ["--robot", self.robot]

    def of(self, tasks: Sequence[str]) -> str:
        """Return the chosen robot.

        If no robot was chosen, return the robot of the first task, or the default robot if there are no tasks.
        """
        from betterbench.interface.actions import USUAL_ROBOT
        from betterbench.tasks import get_task

        if self.robot is not None:
            return self.robot
        return get_task(tasks[0]).robot if tasks else USUAL_ROBOT


ChosenRobot = Annotated[RobotOption, tyro.conf.arg(name="")]

USUAL_OPTION = RobotOption()
