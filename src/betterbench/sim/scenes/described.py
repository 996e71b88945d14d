"""Description of a scene that is stored in the record of an episode."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from betterbench.interface.state import NO_JITTER, ViewJitter
from betterbench.tasks import Looks


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneDescription:
    """Description of a scene: versions, instruction and appearance. A record's metadata has the same fields.

    Attributes:
        instruction: All instructions of the episode, as one string.
        render_quality: Name of the render preset or of another world's renderer. None if there are no images.
        engine: Versions of the software that can change the numbers in the record.
        dynamics: Drawn dynamics of the robot by quantity, with one value per joint. Empty if the dynamics do not vary.
    """

    task_version: int
    suite_version: str
    instruction: str
    render_quality: str | None
    engine: Mapping[str, str]
    looks: Looks = "seen"
    room: str = ""
    view_jitter: ViewJitter = NO_JITTER
    dynamics: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
