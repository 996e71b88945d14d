"""Requests and actions of existing evaluation clients in LIBERO, by preset.

In betterbench's own scenes, a preset such as ``starvla`` is for a policy that was fine-tuned on betterbench
demonstrations. In LIBERO, the same name is for a checkpoint that was trained on LIBERO. The checkpoint's answers are
executed in the same way as by the policy's own client: the numbers passed to ``env.step`` are the same
(tests/sim/worlds/test_answers.py).

Sources: starVLA ``examples/simBenchmarks/LIBERO/eval_files/eval_libero.py`` (``_binarize_gripper_open``); Being-H
``BeingH/benchmark/libero/run_libero_eval.py``; Isaac-GR00T's LIBERO environments, openvla and openvla-oft
``experiments/robot/libero`` (``normalize_gripper_action``, ``invert_gripper_action``); vla-evaluation-harness
``benchmarks/libero/benchmark.py``; X-VLA ``evaluation/libero/libero_client.py``. The clients of openpi and LeRobot pass
actions on unchanged.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from betterbench.interface.actions import LIBERO_ABSOLUTE
from betterbench.policies.conventions.adapter import Adapter, ConstantRule
from betterbench.policies.conventions.answers import AnswerRule
from betterbench.policies.conventions.proprioception import StatePart

SHORT_STATE: tuple[StatePart, ...] = ("ee_position", "ee_axis_angle_short", "gripper_fingers")
"""LIBERO's eight-dimensional state as vla-evaluation-harness sends it: the length of the rotation vector is at most pi.
"""

_CHANGES: Mapping[str, Callable[[AnswerRule], AnswerRule]] = {
    "starvla": lambda rule: replace(rule, gripper="open_fraction", precision="float32"),
    "starvla_state": lambda rule: replace(rule, gripper="open_fraction", precision="float32"),
    "being_h_libero": lambda rule: replace(rule, gripper="open_linear"),
    "gr00t_libero_panda": lambda rule: replace(rule, gripper="open_sign"),
    "openvla": lambda rule: replace(rule, gripper="open_sign"),
    "openvla_oft": lambda rule: replace(rule, gripper="open_sign"),
    # A negative gripper value opens, any other value closes.
    "vla_eval": lambda rule: replace(rule, gripper="closed_at_least", gripper_threshold=0.0),
}


def in_libero(adapter: Adapter) -> Adapter:
    """Return the adapter that existing evaluation clients for LIBERO use for the policy of a preset.

    If the preset already matches these clients, its adapter is returned unchanged.
    """
    if adapter.name == "x_vla":
        return _x_vla(adapter)
    if adapter.name not in _CHANGES:
        return adapter
    states = adapter.states
    if adapter.name == "vla_eval":
        states = tuple(replace(rule, parts=SHORT_STATE) for rule in states)
    return replace(adapter, states=states, answer=_CHANGES[adapter.name](adapter.answer))


def _x_vla(adapter: Adapter) -> Adapter:
    """Return the adapter that corresponds to X-VLA's LIBERO client.

    It uses absolute poses, the pose measured by robosuite's controller, and the domain ID 3. The front image is rotated
    by 180 degrees, and the wrist image is used as robosuite renders it.
    """
    front, wrist = adapter.views
    measured: tuple[StatePart, ...] = ("controller_position", "controller_rotation_6d", *("zero",) * 11)
    return replace(
        adapter,
        views=(front, replace(wrist, turn=180)),
        states=tuple(replace(rule, parts=measured, dtype="float64") for rule in adapter.states),
        answer=replace(adapter.answer, space=LIBERO_ABSOLUTE.name),
        constants=(ConstantRule(("domain_id",), 3),),
    )
