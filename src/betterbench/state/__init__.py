"""The privileged state of a scene, which no policy under test ever sees."""

from betterbench.state.info import ObjectInfo, Region, SceneInfo, SlotInfo
from betterbench.state.view_jitter import NO_JITTER, CameraOffset, ViewJitter
from betterbench.state.world import GRIPPER_BODIES, Contact, PrivilegedPolicy, WorldState

__all__ = [
    "GRIPPER_BODIES",
    "NO_JITTER",
    "CameraOffset",
    "Contact",
    "ObjectInfo",
    "PrivilegedPolicy",
    "Region",
    "SceneInfo",
    "SlotInfo",
    "ViewJitter",
    "WorldState",
]
