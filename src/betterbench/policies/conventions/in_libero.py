"""Presets that reproduce the requests and actions of existing evaluation clients for LIBERO.

In betterbench's own scenes, a preset such as ``starvla`` is for a policy that was fine-tuned on betterbench
demonstrations. In LIBERO, the same name is for a checkpoint that was trained on LIBERO. betterbench then passes exactly
the same actions to ``env.step`` as the policy's own evaluation client (tests/sim/worlds/test_answers.py).

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
"""LIBERO's eight-dimensional state in vla-evaluation-harness, where the length of the rotation vector is at most pi."""

_CHANGES: Mapping[str, Callable[[AnswerRule], AnswerRule]] = {
    "starvla": lambda rule: replace(rule, gripper="open_fraction", precision="float32"),
    "starvla_state": lambda rule: replace(rule, gripper="open_fraction", precision="float32"),
    "being_h_libero": lambda rule: replace(rule, gripper="open_linear"),
    "gr00t_libero_panda": lambda rule: replace(rule, gripper="open_sign"),
    "openvla": lambda rule: replace(rule, gripper="open_sign"),
    "openvla_oft": lambda rule: replace(rule, gripper="open_sign"),
    # Negative values open the gripper, all other values close it.
    "vla_eval": lambda rule: replace(rule, gripper="closed_at_least", gripper_threshold=0.0),
}


def in_libero(adapter: Adapter) -> Adapter:
    """Return an adapter that reproduces the requests and actions of the policy's own evaluation client for LIBERO.

    If the given adapter already matches this client, it is returned unchanged.
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
    """Return an adapter that matches X-VLA's evaluation client for LIBERO.

    Actions are absolute poses, the state is the pose measured by robosuite's controller, and the domain ID is 3. The
    wrist image is rotated by 180 degrees, because X-VLA's client uses it as robosuite renders it.
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
