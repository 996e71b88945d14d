"""``--robot``: one option for all verbs that build scenes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import tyro

from betterbench.interface.actions import USUAL_ROBOT


@dataclass(frozen=True, slots=True)
class RobotOption:
    """The robot in the scenes.

    Attributes:
        robot: Robot in the scenes: panda or so101.
    """

    robot: str = USUAL_ROBOT

    @property
    def words(self) -> list[str]:
        """The option as command-line words, empty for the usual robot."""
        return [] if self == USUAL_OPTION else ["--robot", self.robot]


ChosenRobot = Annotated[RobotOption, tyro.conf.arg(name="")]

USUAL_OPTION = RobotOption()
