"""Privileged state of a scene. Evaluated policies do not get it."""

from betterbench.interface.state.info import ObjectInfo, Region, SceneInfo, SlotInfo
from betterbench.interface.state.seen import GRIPPER, Box, FrameView, SeenObject, in_runs, inner_pixel
from betterbench.interface.state.view_jitter import NO_JITTER, CameraOffset, ViewJitter
from betterbench.interface.state.world import GRIPPER_BODIES, AnyPolicy, Contact, PrivilegedPolicy, WorldState

__all__ = [
    "GRIPPER",
    "GRIPPER_BODIES",
    "NO_JITTER",
    "AnyPolicy",
    "Box",
    "CameraOffset",
    "Contact",
    "FrameView",
    "ObjectInfo",
    "PrivilegedPolicy",
    "Region",
    "SceneInfo",
    "SeenObject",
    "SlotInfo",
    "ViewJitter",
    "WorldState",
    "in_runs",
    "inner_pixel",
]
