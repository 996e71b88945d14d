"""Conversion of action and observation formats to the terms of vla-evaluation-harness."""

from __future__ import annotations

from vla_eval import specs
from vla_eval.specs import DimSpec

from betterbench.interface.actions import action_space
from betterbench.policies.conventions.adapter import Adapter
from betterbench.policies.conventions.answers import AnswerRule
from betterbench.policies.conventions.rotation import ROTATION_SIZES

_ROTATIONS = {
    "axis_angle": specs.ROTATION_AA,
    "rpy": specs.ROTATION_EULER,
    "quaternion_xyzw": specs.ROTATION_QUAT,
    "rotation_6d_interleaved": specs.ROTATION_ROT6D_INTERLEAVED,
}
_GRIPPERS = {
    "close_positive": specs.GRIPPER_CLOSE_POS,
    "open_positive": specs.GRIPPER_CLOSE_NEG,
    "closed_fraction": specs.GRIPPER_CLOSE_01,
    "open_fraction": specs.GRIPPER_01,
}
_STATES = {
    ("ee_position", "ee_axis_angle", "gripper_fingers"): specs.STATE_EEF_POS_AA_GRIP,
    ("ee_position", "ee_rpy", "gripper_fingers"): specs.STATE_EEF_POS_EULER_GRIP,
    ("ee_position", "ee_quaternion_xyzw", "gripper_width"): specs.STATE_EEF_POS_QUAT_GRIP,
    ("joint_positions",): specs.STATE_JOINT,
}


def action_specs(answer: AnswerRule) -> dict[str, DimSpec]:
    """Return the format of each component of an adapter's actions.

    If the harness has no name for a format, betterbench's name is used.
    """
    space = action_space(answer.space)
    text = space.convention
    if answer.as_is or answer.space.startswith("joint"):
        return {"action": DimSpec("action", space.dim, f"betterbench_{space.name}", description=text)}
    position = specs.POSITION_ABSOLUTE if answer.space == "ee_pose" else specs.POSITION_DELTA
    rotation = _ROTATIONS.get(
        answer.rotation, DimSpec("rotation", ROTATION_SIZES[answer.rotation], answer.rotation, description=text)
    )
    return {"position": position, "rotation": rotation, "gripper": _GRIPPERS[answer.gripper]}


def observation_specs(adapter: Adapter) -> dict[str, DimSpec]:
    """Return the formats of the images (by camera), the instruction and, if it is sent, the robot state."""
    found = {view.key[-1]: specs.IMAGE_RGB for view in adapter.views}
    found["language"] = specs.LANGUAGE
    for i, rule in enumerate(adapter.states):
        name = "state" if i == 0 else "_".join(rule.key)
        found[name] = _STATES.get(rule.parts, DimSpec(name, rule.size, "+".join(rule.parts)))
    return found
