"""Presets that reproduce the requests and actions of existing evaluation clients for CALVIN.

CALVIN's images are upright. In CALVIN's ``robot_obs``, the entries 0 to 2 are ``ee_position``, 3 to 5 are ``ee_rpy``, 6
is ``gripper_width`` and 14 is ``gripper_command``.

Sources: starVLA ``examples/simBenchmarks/calvin/eval_files/eval_calvin.py``; vla-evaluation-harness
``benchmarks/calvin/benchmark.py``; X-VLA ``evaluation/calvin/calvin_client.py``; RLinf
``toolkits/eval_scripts_openpi/calvin_eval.py`` for openpi; VLA-Adapter ``vla-scripts/evaluate_calvin.py`` for the
OpenVLA family. No client for GR00T or Being-H in CALVIN has been published. Their presets follow the layout of
starVLA's training data (``train_files/modality.json``) and Being-H's convention that a gripper value of 1 opens.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from betterbench.interface.actions import CALVIN_ABSOLUTE, CALVIN_ABSOLUTE_QUATERNION, CALVIN_DELTA, CALVIN_RELATIVE
from betterbench.policies.conventions.adapter import Adapter, ConstantRule, Feedback, InstructionRule
from betterbench.policies.conventions.answers import AnswerKind, AnswerPart, AnswerRule, twist
from betterbench.policies.conventions.image_rule import ImageRule
from betterbench.policies.conventions.proprioception import StatePart, StateRule

CONTROL_RATE_HZ = 30.0
"""Control rate of CALVIN [Hz]."""

_ROBOT_OBS: tuple[StatePart, ...] = ("ee_position", "ee_rpy", "gripper_width", "gripper_command")


STARVLA_CALVIN = Adapter(
    "starvla_calvin",
    views=(ImageRule(("image", "front"), "front", 224, 224), ImageRule(("image", "wrist"), "wrist", 224, 224)),
    states=(),
    instruction=InstructionRule(("lang",)),
    answer=AnswerRule(CALVIN_RELATIVE.name, twist("actions"), precision="float32"),
    control_rate_hz=CONTROL_RATE_HZ,
)
"""Layout of starVLA's CALVIN client: relative actions; gripper values above 0 open the gripper."""

OPENPI_CALVIN = Adapter(
    "openpi_calvin",
    views=(ImageRule(("observation/image",), "front"), ImageRule(("observation/wrist_image",), "wrist")),
    states=(
        StateRule(("observation/state",), ("ee_position", "ee_rpy", "gripper_width"), "float64"),
        StateRule(("observation/state_ee_pos",), ("ee_position",), "float64"),
        StateRule(("observation/state_ee_rot",), ("ee_rpy",), "float64"),
        StateRule(("observation/state_gripper",), ("gripper_width",), "float64"),
    ),
    instruction=InstructionRule(("prompt",)),
    answer=AnswerRule(CALVIN_RELATIVE.name, twist("actions")),
    control_rate_hz=CONTROL_RATE_HZ,
    horizon=5,
)
"""Layout of RLinf's openpi client for CALVIN: relative actions, an execution horizon of 5, and images in CALVIN's
original sizes.
"""

VLA_EVAL_CALVIN = Adapter(
    "vla_eval_calvin",
    views=(
        ImageRule(("images", "rgb_static"), "front", 200, 200),
        ImageRule(("images", "rgb_gripper"), "wrist", 200, 200),
    ),
    states=(StateRule(("states",), _ROBOT_OBS),),
    instruction=InstructionRule(("task_description",)),
    answer=AnswerRule(CALVIN_DELTA.name, twist("actions")),
    control_rate_hz=CONTROL_RATE_HZ,
)
"""Layout of vla-evaluation-harness in CALVIN: deltas in meters and radians, which are accumulated to absolute poses.

The harness scales images to [-1, 1] and back, which can change a pixel value by 1. This preset sends unchanged images.
"""

VLA_EVAL_CALVIN_ABSOLUTE = replace(
    VLA_EVAL_CALVIN,
    name="vla_eval_calvin_absolute",
    answer=AnswerRule(
        CALVIN_ABSOLUTE.name,
        twist("actions"),
        rotation="axis_angle",
        gripper="closed_fraction",
        gripper_threshold=0.0,
        precision="float32",
    ),
)
""":data:`VLA_EVAL_CALVIN` for servers that declare ``absolute_action``, such as the harness's X-VLA server.

Gripper values above 0 close the gripper.
"""

X_VLA_CALVIN = Adapter(
    "x_vla_calvin",
    views=(ImageRule(("image0",), "front"), ImageRule(("image1",), "wrist")),
    states=(
        StateRule(
            ("proprio",),
            ("ee_position", "ee_rotation_6d_interleaved", "gripper_command_closed", *("zero",) * 10),
            "float64",
        ),
    ),
    instruction=InstructionRule(("language_instruction",)),
    answer=AnswerRule(
        CALVIN_ABSOLUTE_QUATERNION.name,
        (*twist("action"), AnswerPart(("action",), "unused", 10)),
        rotation="rotation_6d_interleaved",
        gripper="closed_at_least",
        gripper_threshold=0.8,
    ),
    control_rate_hz=CONTROL_RATE_HZ,
    horizon=25,
    constants=(ConstantRule(("domain_id",), 2), ConstantRule(("steps",), 10)),
    feedback=Feedback(("proprio",), ("action",), 10),
)
"""Layout of X-VLA's CALVIN client: absolute poses, an execution horizon of 25, and domain ID 2.

After the first answer, the state is the last commanded pose. X-VLA's own evaluation allows 720 steps per instruction.
When the instruction changes, it executes the current chunk to the end. In betterbench, each instruction has CALVIN's
limit of 360 steps and begins with a new chunk.
"""

_AXES: tuple[tuple[str, AnswerKind], ...] = (
    ("x", "translation_x"),
    ("y", "translation_y"),
    ("z", "translation_z"),
    ("roll", "rotation_x"),
    ("pitch", "rotation_y"),
    ("yaw", "rotation_z"),
    ("gripper", "gripper"),
)
_AXIS_STATES: tuple[tuple[str, StatePart], ...] = (
    ("x", "ee_x"),
    ("y", "ee_y"),
    ("z", "ee_z"),
    ("roll", "ee_roll"),
    ("pitch", "ee_pitch"),
    ("yaw", "ee_yaw"),
    ("pad", "zero"),
    ("gripper", "gripper_command"),
)

GR00T_CALVIN = Adapter(
    "gr00t_calvin",
    views=(
        ImageRule(("video", "primary_image"), "front", 224, 224),
        ImageRule(("video", "wrist_image"), "wrist", 224, 224),
    ),
    states=tuple(StateRule(("state", key), (part,)) for key, part in _AXIS_STATES),
    instruction=InstructionRule(("language", "annotation.human.action.task_description"), depth=2),
    answer=AnswerRule(CALVIN_RELATIVE.name, tuple(AnswerPart((key,), kind) for key, kind in _AXES)),
    leading_axes=2,
    control_rate_hz=CONTROL_RATE_HZ,
)
"""Layout of a GR00T checkpoint trained on CALVIN's data in starVLA's format: relative actions; gripper values above 0
open the gripper.
"""

BEING_H_CALVIN = Adapter(
    "being_h_calvin",
    views=(ImageRule(("video.top_view",), "front"), ImageRule(("video.wrist_view",), "wrist")),
    states=(
        StateRule(("state.eef_position",), ("ee_position",)),
        StateRule(("state.eef_rotation",), ("ee_rpy",)),
        StateRule(("state.gripper_position",), ("gripper_width",)),
    ),
    instruction=InstructionRule(("language.instruction",), depth=1),
    answer=AnswerRule(
        CALVIN_RELATIVE.name,
        twist("action.eef_position", "action.eef_rotation", "action.gripper_position"),
        gripper="open_linear",
    ),
    leading_axes=1,
    control_rate_hz=CONTROL_RATE_HZ,
    horizon=8,
)
"""Layout of a Being-H checkpoint trained on CALVIN's data: relative actions; a gripper value of 1 opens the gripper."""

OPENVLA_CALVIN = Adapter(
    "openvla_calvin",
    views=(ImageRule(("image",), "front", 224, 224),),
    states=(),
    instruction=InstructionRule(("instruction",)),
    answer=AnswerRule(CALVIN_RELATIVE.name, twist("actions"), gripper="closed_at_least"),
    control_rate_hz=CONTROL_RATE_HZ,
)
"""Layout of the OpenVLA family in CALVIN: relative actions; gripper values of at least 0.5 close the gripper."""

OPENVLA_OFT_CALVIN = replace(
    OPENVLA_CALVIN,
    name="openvla_oft_calvin",
    views=(ImageRule(("full_image",), "front", 224, 224), ImageRule(("wrist_image",), "wrist", 224, 224)),
    states=(StateRule(("state",), _ROBOT_OBS),),
)
""":data:`OPENVLA_CALVIN` with two images and CALVIN's state, for OpenVLA-OFT and similar models."""

CALVIN_PRESETS: Mapping[str, Adapter] = {
    adapter.name: adapter
    for adapter in (
        *(STARVLA_CALVIN, OPENPI_CALVIN, VLA_EVAL_CALVIN, VLA_EVAL_CALVIN_ABSOLUTE, X_VLA_CALVIN, GR00T_CALVIN),
        *(BEING_H_CALVIN, OPENVLA_CALVIN, OPENVLA_OFT_CALVIN),
    )
}
"""Presets by name. Their actions can only be executed in CALVIN."""

_NAMED: Mapping[str, Adapter] = {
    "starvla": STARVLA_CALVIN,
    "vla_eval": VLA_EVAL_CALVIN,
    "vla_eval_absolute": VLA_EVAL_CALVIN_ABSOLUTE,
    "x_vla": X_VLA_CALVIN,
    "openvla": OPENVLA_CALVIN,
    "openvla_oft": OPENVLA_OFT_CALVIN,
}
_USUAL: Mapping[str, Adapter] = {"gr00t_new_embodiment": GR00T_CALVIN, "being_h_libero": BEING_H_CALVIN}


def in_calvin(adapter: Adapter, *, chosen: bool) -> Adapter:
    """Return the CALVIN adapter that corresponds to a general adapter, such as ``x_vla_calvin`` for ``x_vla``.

    If there is no corresponding adapter, return the given adapter. ``chosen`` is True if the policy address explicitly
    names the preset.
    """
    if adapter.name == "native":
        return adapter.in_space(CALVIN_RELATIVE.name)
    return _NAMED.get(adapter.name) or (adapter if chosen else _USUAL.get(adapter.name, adapter))
