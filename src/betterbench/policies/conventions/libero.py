"""Conventions of LIBERO, for checkpoints that were trained on LIBERO and are evaluated in betterbench's own scenes.

- **Units.** robosuite's controller OSC_POSE adds 0.05 m or 0.5 rad per unit to the measured pose and follows the
  resulting goal with a low gain. In one control step, the end effector therefore moves only 0.0125 m or 0.1 rad per
  unit (measured with robosuite 1.4.0 on every axis, with actions of 0.1 to 1.0). betterbench's controller executes a
  delta exactly, so this module uses the measured values as units.
- **Origin.** Positions are given in LIBERO's world frame, in which the position of the robot base depends on the kind
  of scene (``libero/libero/envs/robots``: ``base_xpos_offset``, with the table lengths in ``envs/problems``).
- **Tool point.** LIBERO's tool point (robosuite's ``grip_site``) is 0.097 m from the hand. betterbench's tool point is
  0.1034 m from the hand, which is 6.4 mm lower.
- **Images.** LIBERO's renderer returns the rows from bottom to top (robosuite's "opengl" convention), and policies for
  LIBERO rotate the images by 180 degrees. The training images are therefore upright and *mirrored* (openvla/openvla
  issue 295, huggingface/lerobot issue 3830, ARISE-Initiative/robosuite issue 56).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from betterbench.policies.conventions.adapter import Adapter
from betterbench.policies.conventions.answers import Polarity

MEASURED_TRANSLATION_M = 0.0125
"""Measured end-effector translation per action unit in one LIBERO control step [m]."""

MEASURED_ROTATION_RAD = 0.1
"""Measured end-effector rotation per action unit in one LIBERO control step [rad]."""

TOOL_OFFSET_M = (0.0, 0.0, 0.097 - 0.1034)
"""Position of LIBERO's tool point in betterbench's tool frame [m].

The z axis points from the hand to the fingertips.
"""

_TABLE, _FLOOR, _STUDY = (-0.66, 0.0, 0.912), (-0.6, 0.0, 0.0), (-0.75, 0.0, 0.912)
_LIVING_ROOM = (-0.51, 0.0, 0.42)

BASES_M: Mapping[str, tuple[float, float, float]] = {
    "spatial": _TABLE,
    "object": _FLOOR,
    "goal": _TABLE,
    "10": _TABLE,
    "90": _TABLE,
    "study": _STUDY,
    "living_room": _LIVING_ROOM,
}
"""Position of the robot base in LIBERO's world frame [m], by suite or by scene type.

LIBERO-10 and LIBERO-90 contain kitchens, living rooms and studies. The entries "10" and "90" apply to the kitchens.
"""


def trained_on_libero(adapter: Adapter, name: str, suite: str, *, gripper: Polarity = "close_positive") -> Adapter:
    """Return an adapter for a checkpoint that was trained on a LIBERO suite.

    Args:
        adapter: Adapter for a policy of the same type that was fine-tuned on betterbench demonstrations.
        name: Name of the returned adapter.
        suite: LIBERO suite or scene type, which is a key of :data:`BASES_M`.
        gripper: Gripper convention in the checkpoint's training data.
    """
    return replace(
        adapter,
        name=name,
        views=tuple(replace(view, mirror=True) for view in adapter.views),
        answer=replace(
            adapter.answer,
            translation_unit_m=MEASURED_TRANSLATION_M,
            rotation_unit_rad=MEASURED_ROTATION_RAD,
            gripper=gripper,
        ),
        ee_offset_m=BASES_M[suite],
        tool_offset_m=TOOL_OFFSET_M,
    )
