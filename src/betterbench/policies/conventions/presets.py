"""Presets (adapters for known policies), and the options of a policy address that override parts of an adapter."""

from __future__ import annotations

import contextlib
import math
from dataclasses import replace
from pathlib import Path
from typing import get_args

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.interface.actions import (
    JOINT_SPACES,
    PLAYED_IN,
    ROTATION_PER_UNIT_RAD,
    TRANSLATION_PER_UNIT_M,
    WORLD_ACTION_SPACES,
)
from betterbench.policies.address import CAMERA, CONSTANT, PolicyAddress
from betterbench.policies.conventions.adapter import Adapter, ConstantRule, InstructionRule
from betterbench.policies.conventions.answers import AnswerKind, AnswerPart, AnswerRule, Polarity, twist
from betterbench.policies.conventions.image_rule import EVERY_CAMERA, Fit, ImageRule, QuarterTurn
from betterbench.policies.conventions.in_calvin import CALVIN_PRESETS, in_calvin
from betterbench.policies.conventions.in_calvin import CONTROL_RATE_HZ as CALVIN_RATE_HZ
from betterbench.policies.conventions.in_libero import SHORT_STATE, in_libero
from betterbench.policies.conventions.libero import (
    BASES_M,
    MEASURED_ROTATION_RAD,
    MEASURED_TRANSLATION_M,
    trained_on_libero,
)
from betterbench.policies.conventions.proprioception import MotorPart, StateRule
from betterbench.policies.conventions.rotation import RotationFormat

_UNITS: dict[str, tuple[float, float]] = {
    "libero": (TRANSLATION_PER_UNIT_M, ROTATION_PER_UNIT_RAD),
    "libero_measured": (MEASURED_TRANSLATION_M, MEASURED_ROTATION_RAD),
    "physical": (1.0, 1.0),
}
"""Translation [m] and rotation [rad] per action unit, for each value of the option ``units``."""

_TURNS: dict[str, QuarterTurn] = {"0": 0, "90": 90, "180": 180, "270": 270}


def _twist_by_axis(translation: tuple[str, str, str], rotation: tuple[str, str, str], gripper: str) -> AnswerRule:
    """Return an answer rule for replies with a separate array for each axis, in LIBERO's units."""
    kinds: tuple[AnswerKind, ...] = ("translation_x", "translation_y", "translation_z")
    kinds += ("rotation_x", "rotation_y", "rotation_z")
    axes = tuple(AnswerPart((key,), kind) for key, kind in zip((*translation, *rotation), kinds, strict=True))
    return AnswerRule("ee_delta", (*axes, AnswerPart((gripper,), "gripper")))


NATIVE = Adapter(
    "native",
    views=(ImageRule(("better/images/{camera}",), EVERY_CAMERA),),
    states=(
        StateRule(("better/step",), ("step",), "int64", scalar=True),
        StateRule(("better/joint_positions",), ("joint_positions",), "float64"),
        StateRule(("better/joint_velocities",), ("joint_velocities",), "float64"),
        StateRule(("better/ee_position",), ("ee_position",), "float64"),
        StateRule(("better/ee_quaternion",), ("ee_quaternion_wxyz",), "float64"),
        StateRule(("better/gripper_width",), ("gripper_width",), "float64", scalar=True),
    ),
    instruction=InstructionRule(("prompt",)),
    episode_key=("better/episode",),
)
"""Layout of betterbench's own policy servers. Requests contain the complete observation, and actions are executed
unchanged.
"""

OPENPI_LIBERO = Adapter(
    "openpi_libero",
    views=(
        ImageRule(("observation/image",), "front", 224, 224),
        ImageRule(("observation/wrist_image",), "wrist", 224, 224),
    ),
    states=(StateRule(("observation/state",), ("ee_position", "ee_axis_angle", "gripper_fingers")),),
    instruction=InstructionRule(("prompt",)),
    answer=AnswerRule("ee_delta", twist("actions")),
    horizon=5,
)
"""LIBERO layout of openpi (``src/openpi/policies/libero_policy.py`` and ``examples/libero/main.py``).

Use this preset for a policy that was fine-tuned on betterbench demonstrations, and ``openpi_libero_SUITE`` for a
checkpoint that was trained on LIBERO itself (:mod:`betterbench.policies.conventions.libero`). betterbench's images are
upright, so they must not be rotated by 180 degrees. The state consists of the position [m] and rotation vector [rad] of
the end effector and the positions [m] of the two finger joints. The execution horizon is the same as in openpi's
example client.
"""

OPENPI_DROID = Adapter(
    "openpi_droid",
    views=(
        ImageRule(("observation/exterior_image_1_left",), "left_shoulder", 224, 224),
        ImageRule(("observation/wrist_image_left",), "wrist", 224, 224),
    ),
    states=(
        StateRule(("observation/joint_position",), ("joint_positions",)),
        StateRule(("observation/gripper_position",), ("gripper_closed_fraction",)),
    ),
    instruction=InstructionRule(("prompt",)),
    answer=AnswerRule(
        "joint_delta",
        (AnswerPart(("actions",), "joints"), AnswerPart(("actions",), "gripper")),
        joint_unit_rad=0.2,
        step_rate_hz=15.0,
        gripper="closed_fraction",
    ),
    horizon=8,
)
"""DROID layout of openpi (``src/openpi/policies/droid_policy.py`` and ``examples/droid/main.py``).

A DROID action consists of seven joint velocities and a gripper position. One unit of velocity is 0.2 rad per step at
15 Hz, or 3 rad/s (``droid/robot_ik/robot_ik_solver.py``: ``max_joint_delta``, ``control_hz``). The gripper position
ranges from 0 (open) to 1 (closed), and the client thresholds it at 0.5. betterbench also executes the actions as
velocities: at its control rate of 20 Hz, one unit is 0.15 rad per step. The action space ``joint_delta`` is clipped at
0.1 rad per step (2 rad/s, the limit of the slowest joint), so velocities above two thirds of a unit are reduced and
counted as clipped. DROID adds each step to the measured joint positions, whereas betterbench adds it to the last
commanded positions.

DROID's exterior camera is at the side of the robot. The closest camera in betterbench is ``left_shoulder``, which
``--observation droid`` renders. To use the front view instead, add ``camera.observation/exterior_image_1_left=front``
to the policy address. The execution horizon is the same as in openpi's example client.
"""

GR00T_NEW_EMBODIMENT = Adapter(
    "gr00t_new_embodiment",
    views=(ImageRule(("video", "front"), "front", 256, 256), ImageRule(("video", "wrist"), "wrist", 256, 256)),
    states=(
        StateRule(("state", "ee_position"), ("ee_position",)),
        StateRule(("state", "ee_rotation"), ("ee_axis_angle",)),
        StateRule(("state", "gripper"), ("gripper_width",)),
    ),
    instruction=InstructionRule(("language", "annotation.human.action.task_description"), depth=2),
    answer=AnswerRule("ee_delta", twist("ee_position", "ee_rotation", "gripper")),
    leading_axes=2,
)
"""Layout of GR00T with the embodiment tag ``new_embodiment`` (Isaac-GR00T, ``getting_started/data_preparation.md``).

The keys of a new embodiment are defined in the ``meta/modality.json`` of the fine-tuning data. This preset uses the
keys of betterbench's data export. The handshake compares them with the keys that the server declares.
"""

_XYZ = ("x", "y", "z")
_ROLL_PITCH_YAW = ("roll", "pitch", "yaw")
_TASK_DESCRIPTION = InstructionRule(("language", "annotation.human.action.task_description"), depth=2)

GR00T_LIBERO_PANDA = Adapter(
    "gr00t_libero_panda",
    views=(ImageRule(("video", "image"), "front", 256, 256), ImageRule(("video", "wrist_image"), "wrist", 256, 256)),
    states=(
        StateRule(("state", "x"), ("ee_x",)),
        StateRule(("state", "y"), ("ee_y",)),
        StateRule(("state", "z"), ("ee_z",)),
        StateRule(("state", "roll"), ("ee_axis_angle_x",)),
        StateRule(("state", "pitch"), ("ee_axis_angle_y",)),
        StateRule(("state", "yaw"), ("ee_axis_angle_z",)),
        StateRule(("state", "gripper"), ("gripper_fingers",)),
    ),
    instruction=_TASK_DESCRIPTION,
    answer=replace(_twist_by_axis(_XYZ, _ROLL_PITCH_YAW, "gripper"), gripper="open_fraction"),
    leading_axes=2,
)
"""Layout of GR00T with the embodiment tag ``libero_panda`` (N1.6; ``libero_sim`` in N1.7,
``gr00t/configs/data/embodiment_configs.py``), and of the LIBERO example of N1.5
(``examples/Libero/custom_data_config.py``).

In the state and in the action, the values named roll, pitch and yaw are a rotation vector (``quat2axisangle`` in
GR00T's LIBERO clients). In the training data, a gripper value of 1 means open, but the clients invert it. Use
``gr00t_libero_panda_SUITE`` for a checkpoint that was trained on LIBERO itself
(:mod:`betterbench.policies.conventions.libero`).
"""

GR00T_OXE_WIDOWX = Adapter(
    "gr00t_oxe_widowx",
    views=(ImageRule(("video", "image_0"), "front", 256, 256),),
    states=(
        StateRule(("state", "x"), ("ee_x",)),
        StateRule(("state", "y"), ("ee_y",)),
        StateRule(("state", "z"), ("ee_z",)),
        StateRule(("state", "roll"), ("ee_roll_from_down",)),
        StateRule(("state", "pitch"), ("ee_pitch_from_down",)),
        StateRule(("state", "yaw"), ("ee_yaw_from_down",)),
        StateRule(("state", "pad"), ("zero",)),
        StateRule(("state", "gripper"), ("gripper_open_fraction",)),
    ),
    instruction=_TASK_DESCRIPTION,
    answer=replace(
        _twist_by_axis(_XYZ, _ROLL_PITCH_YAW, "gripper"),
        rotation="rpy",
        translation_unit_m=1.0,
        rotation_unit_rad=1.0,
        step_rate_hz=5.0,
        gripper="open_fraction",
    ),
    leading_axes=2,
)
"""Layout of GR00T with the embodiment tag ``oxe_widowx`` (N1.6; ``simpler_env_widowx`` in N1.7), and of the WidowX
example of N1.5 (``examples/SimplerEnv/custom_data_config.py``).

The conventions follow BridgeData V2: translations in meters, rotations as angles about the base axes, and a
control rate of 5 Hz. A gripper value of 1 means open. Rotations in the state are relative to a tool that points
straight down (``bridge_data_robot``, ``widowx_controller.py``: ``DEFAULT_ROTATION``; SimplerEnv's clients do the same).
Deltas are executed as velocities: each control step at 20 Hz executes a quarter of a delta.
"""

GR00T_OXE_DROID = Adapter(
    "gr00t_oxe_droid",
    views=(
        ImageRule(("video", "exterior_image_1_left"), "left_shoulder", 320, 180),
        ImageRule(("video", "wrist_image_left"), "wrist", 320, 180),
    ),
    states=(
        StateRule(("state", "joint_position"), ("joint_positions",)),
        StateRule(("state", "gripper_position"), ("gripper_closed_fraction",)),
    ),
    instruction=InstructionRule(("language", "annotation.language.language_instruction"), depth=2),
    answer=AnswerRule(
        "joint_position",
        (AnswerPart(("joint_position",), "joints"), AnswerPart(("gripper_position",), "gripper")),
        gripper="closed_fraction",
    ),
    leading_axes=2,
)
"""Layout of GR00T N1.6 with the embodiment tag ``oxe_droid`` (``examples/DROID``): joint angles as input and output.

The server converts the model's relative joint angles to absolute angles. A gripper value of 1 means closed.

GR00T's client executes the angles at 15 Hz, but betterbench executes them at 20 Hz, which is a third faster. This
preset does not support N1.7's tag ``oxe_droid_relative_eef_relative_joint``, which has two additional entries
(``eef_9d``) in a tool frame of DROID. See :data:`OPENPI_DROID` for the choice of the camera.
"""

BEING_H_LIBERO = Adapter(
    "being_h_libero",
    views=(ImageRule(("video.top_view",), "front"), ImageRule(("video.wrist_view",), "wrist")),
    states=(
        StateRule(("state.eef_position",), ("ee_position",)),
        StateRule(("state.eef_rotation",), ("ee_axis_angle",)),
        StateRule(("state.libero_gripper_position",), ("gripper_fingers",)),
    ),
    instruction=InstructionRule(("language.instruction",), depth=1),
    answer=AnswerRule("ee_delta", twist("action.eef_position", "action.eef_rotation", "action.gripper_position")),
    leading_axes=1,
    horizon=8,
)
"""Layout of Being-H0.5 with its LIBERO data config ``libero_nonorm`` (BeingBeyond/Being-H, ``configs/data_config.py``).

As in Being-H's client (``BeingH/benchmark/utils/policy.py``), the execution horizon is 8, and the images are resized by
the server.

Use ``being_h_libero_SUITE`` for a checkpoint that was trained on LIBERO itself. In its training data, a gripper value
of 1 means open (``BeingH/benchmark/libero/run_libero_eval.py`` inverts it).
"""

VLA_EVAL = Adapter(
    "vla_eval",
    views=(ImageRule(("images", "agentview"), "front"), ImageRule(("images", "wrist"), "wrist")),
    states=(StateRule(("states",), ("ee_position", "ee_axis_angle", "gripper_fingers")),),
    instruction=InstructionRule(("task_description",)),
    answer=AnswerRule("ee_delta", twist("actions")),
)
"""LIBERO layout of vla-evaluation-harness (``src/vla_eval/benchmarks/libero/benchmark.py``).

A request contains one image per camera, an eight-dimensional state, and the instruction. Nearly all model servers of
the harness accept this layout. The server resizes the images. A server with a single image input uses the first image.
Use ``vla_eval_libero_SUITE`` for models that were trained on LIBERO itself.
"""

VLA_EVAL_ABSOLUTE = replace(
    VLA_EVAL,
    name="vla_eval_absolute",
    states=(
        StateRule(("states",), SHORT_STATE),
        StateRule(("controller_states",), ("controller_position", "controller_axis_angle", "gripper_fingers")),
    ),
    answer=AnswerRule("libero_absolute", twist("actions"), gripper="closed_at_least", gripper_threshold=0.0),
)
"""LIBERO layout of vla-evaluation-harness for servers that declare ``absolute_action``, such as its X-VLA server."""

_STARVLA_VIEWS = (ImageRule(("image", "front"), "front", 224, 224), ImageRule(("image", "wrist"), "wrist", 224, 224))

STARVLA = Adapter(
    "starvla",
    views=_STARVLA_VIEWS,
    states=(),
    instruction=InstructionRule(("lang",)),
    answer=AnswerRule("ee_delta", twist("actions")),
)
"""Layout of starVLA's requests without a state (``deployment/model_server``).

The images are sent as a list, with the order and the sizes of starVLA's LIBERO client. Some starVLA models add every
state that they receive to the prompt, so only a separate preset (:data:`STARVLA_STATE`) sends a state. Use
``starvla_libero_SUITE`` or ``starvla_state_libero_SUITE`` for checkpoints that were trained on LIBERO itself, where a
gripper value of 1 means open.
"""

STARVLA_STATE = replace(
    STARVLA,
    name="starvla_state",
    states=(StateRule(("state",), ("ee_position", "ee_axis_angle", "gripper_fingers")),),
)
"""Layout of starVLA's requests with LIBERO's eight-dimensional state, for models that were trained with a state."""

OPENVLA = Adapter(
    "openvla",
    views=(ImageRule(("image",), "front", 224, 224),),
    states=(),
    instruction=InstructionRule(("instruction",)),
    answer=AnswerRule("ee_delta", twist("actions"), gripper="open_fraction"),
)
"""Layout of OpenVLA's ``POST /act`` (``vla-scripts/deploy.py``): one image and the instruction.

A gripper value of 1 means open. For a checkpoint trained on several data sets, select the normalization statistics with
``send.unnorm_key=NAME``. A checkpoint trained with random crops needs a center crop of 0.9 of the image area. If the
server does not crop the images itself, add ``keep=0.9`` to the policy address. Use ``openvla_libero_SUITE`` for
checkpoints that were trained on LIBERO itself.
"""

OPENVLA_OFT = Adapter(
    "openvla_oft",
    views=(ImageRule(("full_image",), "front", 224, 224), ImageRule(("wrist_image",), "wrist", 224, 224)),
    states=(StateRule(("state",), ("ee_position", "ee_axis_angle", "gripper_fingers")),),
    instruction=InstructionRule(("instruction",)),
    answer=AnswerRule("ee_delta", twist("actions"), gripper="open_fraction"),
)
"""Layout of OpenVLA-OFT's ``POST /act``, with two images and LIBERO's state.

The answer is an action chunk. All other conventions are as in :data:`OPENVLA`. Use ``openvla_oft_libero_SUITE`` for
checkpoints that were trained on LIBERO itself.
"""

X_VLA = Adapter(
    "x_vla",
    views=(ImageRule(("image0",), "front", 256, 256), ImageRule(("image1",), "wrist", 256, 256)),
    states=(StateRule(("proprio",), ("ee_position", "ee_rotation_6d", *("zero",) * 11)),),
    instruction=InstructionRule(("language_instruction",)),
    answer=AnswerRule(
        "ee_pose",
        (
            AnswerPart(("action",), "translation"),
            AnswerPart(("action",), "rotation"),
            AnswerPart(("action",), "gripper"),
            AnswerPart(("action",), "unused", 10),
        ),
        rotation="rotation_6d",
        gripper="closed_fraction",
    ),
    constants=(ConstantRule(("domain_id",)), ConstantRule(("steps",), 10)),
)
"""Layout of X-VLA's ``POST /act`` (``models/modeling_xvla.py``, ``evaluation/libero/libero_client.py``).

The request contains images and a state with ten values for each of two arms. For a robot with one arm, only nine values
are set, and the others are zero. The answer consists of absolute end-effector poses. Arrays are sent as strings
(``arrays=text``). ``domain_id`` selects the data set whose soft prompt the model uses (3 is LIBERO). It has no default,
so add it to the policy address, for example ``send.domain_id=3``. X-VLA's client sends the last commanded pose, whereas
this preset sends the measured pose.
"""

DEXBOTIC = Adapter(
    "dexbotic",
    views=(
        ImageRule(("observation", "images", "1"), "front", 256, 256),
        ImageRule(("observation", "images", "2"), "wrist", 256, 256),
    ),
    states=(StateRule(("observation", "state"), ("ee_position", "ee_axis_angle", "gripper_fingers")),),
    instruction=InstructionRule(("observation", "prompt")),
    answer=AnswerRule("ee_delta", twist("actions")),
)
"""Layout of Dexbotic's ``POST /v1/infer`` for its pi0, pi0.5 and DM0 models on LIBERO (dexmal/dexbotic-benchmark,
``evaluation/policies/base_vla_agent.py``, ``evaluation/configs/libero``).

A request contains two images by camera slot, LIBERO's state and the unmodified instruction. ``POST /process_frame``
takes the same data as a form (:mod:`betterbench.policies.clients.dexbotic`). Dexbotic's clients pass the actions to
LIBERO unchanged, so a gripper value of +1 closes the gripper. Their execution horizons range from 5 (pi0) to 12 (DM0).
Use ``dexbotic_libero_SUITE`` for checkpoints that were trained on LIBERO itself.
"""

DEXBOTIC_COGACT = replace(
    DEXBOTIC,
    name="dexbotic_cogact",
    views=DEXBOTIC.views[:1],
    states=(),
    instruction=InstructionRule(("observation", "prompt"), template="What action should the robot take to {}?"),
)
"""Layout of the requests to Dexbotic's CogACT, MemVLA and OFT models.

A request contains one image and the instruction in the prompt template of the training data, but no state. Use
``dexbotic_cogact_libero_SUITE`` for checkpoints that were trained on LIBERO itself.
"""

LEROBOT = Adapter(
    "lerobot",
    views=(
        ImageRule(("observation.images.front",), "front", 256, 256),
        ImageRule(("observation.images.wrist",), "wrist", 256, 256),
    ),
    states=(StateRule(("observation.state",), ("ee_position", "ee_axis_angle", "gripper_fingers")),),
    instruction=InstructionRule(("task",)),
    answer=AnswerRule("ee_delta", twist("action")),
)
"""Layout with LeRobot's feature names.

It equals the adapter that ``lerobot:CHECKPOINT`` derives from a checkpoint trained on betterbench's data export. The
state is the same as in betterbench's LeRobot environment (:mod:`betterbench.episodes.lerobot_env`).
"""

LEROBOT_SO101: dict[str, Adapter] = {
    f"lerobot_{space}": replace(
        LEROBOT,
        name=f"lerobot_{space}",
        states=(StateRule(("observation.state",), (space,)),),
        answer=AnswerRule(space, (AnswerPart(("action",), "action"),)),
    )
    for space in get_args(MotorPart)
}
"""Layouts for LeRobot's ``so101_follower``. The state and the action are the positions of the six motors, in degrees or
in LeRobot's normalized units.
"""

_LIBERO_LAYOUTS: tuple[tuple[Adapter, str, Polarity], ...] = (
    (OPENPI_LIBERO, "openpi_libero", "close_positive"),
    (BEING_H_LIBERO, "being_h_libero", "open_fraction"),
    (VLA_EVAL, "vla_eval_libero", "close_positive"),
    (GR00T_LIBERO_PANDA, "gr00t_libero_panda", "open_fraction"),
    (STARVLA, "starvla_libero", "open_fraction"),
    (STARVLA_STATE, "starvla_state_libero", "open_fraction"),
    (OPENVLA, "openvla_libero", "open_fraction"),
    (OPENVLA_OFT, "openvla_oft_libero", "open_fraction"),
    (DEXBOTIC, "dexbotic_libero", "close_positive"),
    (DEXBOTIC_COGACT, "dexbotic_cogact_libero", "close_positive"),
)

_LAYOUTS = (
    *(NATIVE, OPENPI_LIBERO, OPENPI_DROID, GR00T_NEW_EMBODIMENT, GR00T_LIBERO_PANDA, GR00T_OXE_WIDOWX),
    *(GR00T_OXE_DROID, BEING_H_LIBERO, VLA_EVAL, STARVLA, STARVLA_STATE, OPENVLA, OPENVLA_OFT, X_VLA, LEROBOT),
    *(DEXBOTIC, DEXBOTIC_COGACT),
    *LEROBOT_SO101.values(),
)

PRESETS: dict[str, Adapter] = {
    adapter.name: adapter
    for adapter in (
        *_LAYOUTS,
        VLA_EVAL_ABSOLUTE,
        *CALVIN_PRESETS.values(),
        *(
            trained_on_libero(layout, f"{name}_{suite}", suite, gripper=gripper)
            for layout, name, gripper in _LIBERO_LAYOUTS
            for suite in BASES_M
        ),
    )
}

OWN_PRESETS = {name: adapter for name, adapter in PRESETS.items() if adapter.answer.space not in WORLD_ACTION_SPACES}
"""Presets by name, without those whose actions can only be executed in LIBERO or CALVIN."""

UNTRANSLATED = {f"{name}_{suite}": layout.name for layout, name, _ in _LIBERO_LAYOUTS for suite in BASES_M}
"""Name of the general preset for each preset ``..._SUITE``.

The presets ``..._SUITE`` convert betterbench's observations to LIBERO's conventions. In LIBERO itself, this conversion
is not needed, so the policy address must name the general preset.
"""


def preset(name: str) -> Adapter:
    """Return the preset with the given name. Raises UnknownNameError if the name is unknown."""
    try:
        return PRESETS[name]
    except KeyError:
        raise UnknownNameError("preset", name, PRESETS) from None


def own_preset(name: str) -> Adapter:
    """Return the preset with the given name, for use in betterbench's own scenes.

    Raises UnknownNameError if the name is unknown, and InvalidInputError if the actions of the preset can only be
    executed in LIBERO or CALVIN.
    """
    found = preset(name)
    if name not in OWN_PRESETS:
        raise InvalidInputError(
            f"preset {name}",
            f"the action space {found.answer.space} is not available in betterbench's own scenes",
            f"Use one of {', '.join(presets_in(''))}",
        )
    return found


def adapter_of(address: PolicyAddress, default: Adapter | None = None) -> Adapter:
    """Return the adapter that a policy address selects, with the changes that its options request.

    If the address names neither a preset nor a file, the default is used. In LIBERO and CALVIN, a preset is replaced by
    an adapter that matches the policy's own evaluation client for this benchmark.

    Raises:
        InvalidInputError: If the address names both a preset and a file, if it names neither and there is no default,
            if an option is malformed, or if the benchmark does not support the action space.
        UnknownNameError: If a preset or another name does not exist.
    """
    options, where = address.options, f"policy {address}"
    if "preset" in options and "adapter" in options:
        raise InvalidInputError(where, "the address has both a preset and an adapter", "Use only one of them")
    named = preset(options["preset"]) if "preset" in options else default
    if "adapter" in options:
        adapter = Adapter.load(Path(options["adapter"]))
    elif named is not None:
        adapter = _in_world(named, address)
    else:
        trained = ", ".join(f"{name}_SUITE" for _, name, _ in _LIBERO_LAYOUTS)
        also = "" if address.world else f"; trained on LIBERO: {trained}"
        raise InvalidInputError(
            where,
            "neither the address nor the server declares the images and state that the policy needs",
            f"Add ?preset=NAME ({', '.join(presets_in(address.world))}{also}) or ?adapter=FILE",
        )
    cameras = {k.removeprefix(CAMERA.name): v for k, v in options.items() if k.startswith(CAMERA.name)}
    if cameras:
        adapter = adapter.with_cameras(cameras)
    adapter = _with_constants(adapter, address)
    answer = _answer(adapter.answer, address)
    played = PLAYED_IN[address.world]
    if answer.space not in played:
        raise _not_played(adapter.name, answer.space, address)
    adapter = _with_offset(adapter, answer, address)
    rate_hz = CALVIN_RATE_HZ if address.world == "calvin" else adapter.control_rate_hz
    views = tuple(_image(rule, address) for rule in adapter.views)
    return replace(adapter, views=views, answer=answer, control_rate_hz=rate_hz)


def _with_offset(adapter: Adapter, answer: AnswerRule, address: PolicyAddress) -> Adapter:
    """Apply the option ``ee_offset`` to an adapter.

    Raises InvalidInputError if the adapter uses no end-effector position, so that the offset would have no effect.
    """
    if "ee_offset" not in address.options:
        return adapter
    if adapter.name == NATIVE.name:
        reason = "the native layout uses the robot's base frame"
    elif not any(rule.holds_position for rule in adapter.states) and answer.space != "ee_pose":
        reason = f"{adapter.name} does not contain the end-effector position"
    else:
        return replace(adapter, ee_offset_m=_offset(address))
    raise address.error(f"ee_offset has no effect, because {reason}", "Omit ee_offset")


def _in_world(adapter: Adapter, address: PolicyAddress) -> Adapter:
    """Adapt a preset to the benchmark for which the policy address was parsed."""
    if address.world.startswith("libero"):
        usual = adapter is GR00T_NEW_EMBODIMENT and "preset" not in address.options
        return in_libero(GR00T_LIBERO_PANDA if usual else adapter)  # default: layout of NVIDIA's LIBERO checkpoints
    if address.world == "calvin":
        return in_calvin(adapter, chosen="preset" in address.options)
    return adapter


def _not_played(name: str, space: str, address: PolicyAddress) -> InvalidInputError:
    """Return the error for an action space that a benchmark does not support. Its message proposes other presets."""
    world, offered = _WORLD_NAMES[address.world], f"Use preset=NAME ({', '.join(presets_in(address.world))})"
    if space in WORLD_ACTION_SPACES and not address.world:
        suite = "calvin" if space in PLAYED_IN["calvin"] else "libero_object"
        offered = f"Use it with --suite {suite}; in betterbench's own scenes, {offered[0].lower()}{offered[1:]}"
    elif address.world:
        offered += f", or action_space={PLAYED_IN[address.world][0]} if the policy uses {world}'s own action space"
    return address.error(f"{name} returns actions in {space}, which {world} does not support", offered)


def presets_in(world: str) -> tuple[str, ...]:
    """Return the names of the presets for a benchmark such as "libero", or for betterbench's own scenes ("")."""
    if world == "calvin":
        return tuple(CALVIN_PRESETS)
    layouts = _LAYOUTS if world == "" else (*_LAYOUTS, VLA_EVAL_ABSOLUTE)
    shown = {layout.name: in_libero(layout) if world else layout for layout in layouts}
    return tuple(name for name, layout in shown.items() if layout.answer.space in PLAYED_IN[world])


_WORLD_NAMES = {"": "betterbench's own scene", "libero": "LIBERO", "calvin": "CALVIN"}


def _with_constants(adapter: Adapter, address: PolicyAddress) -> Adapter:
    """Set the constants of an adapter from the ``send.KEY`` options of a policy address.

    Raises InvalidInputError if a constant has neither a default nor a value in the address.
    """
    given = {k.removeprefix(CONSTANT.name): v for k, v in address.options.items() if k.startswith(CONSTANT.name)}
    if given:
        adapter = adapter.with_constants({key: _constant(text) for key, text in given.items()})
    for rule in adapter.constants:
        if rule.value is None:
            name = "/".join(rule.key)
            raise address.error(
                f"{adapter.name} sends {name}, which has no safe default", f"Add {CONSTANT.name}{name}=VALUE"
            )
    return adapter


def _constant(text: str) -> bool | int | float | str:
    """Convert text to a number or a boolean if possible. Return any other text unchanged."""
    if text in ("true", "false"):
        return text == "true"
    for kind in (int, float):
        with contextlib.suppress(ValueError):
            value = kind(text)
            return value if math.isfinite(value) else text
    return text


def _image(rule: ImageRule, address: PolicyAddress) -> ImageRule:
    width, height = _size(address) if "size" in address.options else (rule.width, rule.height)
    return replace(
        rule,
        width=width,
        height=height,
        fit=address.choice("fit", get_args(Fit), rule.fit),
        keep=address.number("keep", rule.keep),
        turn=_TURNS[address.choice("turn", tuple(_TURNS), str(rule.turn))],
        mirror=address.choice("mirror", ("true", "false"), str(rule.mirror).lower()) == "true",
    )


def _answer(rule: AnswerRule, address: PolicyAddress) -> AnswerRule:
    space = address.choice("action_space", PLAYED_IN[address.world], rule.space)
    rule = rule.in_space(space)
    translation, rotation = _UNITS.get(
        address.choice("units", (*_UNITS, "preset"), "preset"), (rule.translation_unit_m, rule.rotation_unit_rad)
    )
    for name in ("rotation", "units", "frame"):
        meaningless = space in JOINT_SPACES or (name == "units" and (space == "ee_pose" or "absolute" in space))
        if meaningless and name in address.options:
            raise address.error(f"{name} has no effect for {space}", f"Leave out {name}")
    return replace(
        rule,
        space=space,
        translation_unit_m=translation,
        rotation_unit_rad=rotation,
        frame=address.choice("frame", ("base", "tool"), rule.frame),
        rotation=address.choice("rotation", get_args(RotationFormat), rule.rotation),
        gripper=address.choice("gripper", get_args(Polarity), rule.gripper),
    )


def _size(address: PolicyAddress) -> tuple[int, int]:
    text = address.options["size"]
    width, _, height = text.partition("x")
    sides = (width, height or width)
    if not all(s.isdecimal() and s.isascii() and len(s) <= 4 for s in sides):
        raise address.error(f"size={text} is not an image size", "Write size=224 or size=320x240")
    return int(sides[0]), int(sides[1])


def _offset(address: PolicyAddress) -> tuple[float, float, float]:
    text = address.options["ee_offset"]
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise address.error(
            f"ee_offset={text} does not consist of three numbers in meters", "Write ee_offset=-0.66,0,0.912"
        ) from None
    return x, y, z
