"""``--robot``: one option for all verbs that build scenes."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class RobotOption:
    """The robot in the scenes.

    Attributes:
        robot: Robot in the scenes: panda or so101.
    """

    robot: str = "panda"

    @property
    def words(self) -> list[str]:
        """The option as command-line words, empty for the default."""
        return [] if self == RobotOption() else ["--robot", self.robot]
