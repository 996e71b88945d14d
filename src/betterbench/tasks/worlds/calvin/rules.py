"""Success rules of CALVIN's subtasks. They compare the scene with the scene at the beginning of the subtask.

The rules are taken from ``calvin_env/envs/tasks.py`` in calvin_env@797142c. In earlier versions of that file, the rules
differ: a lifted block must not have touched the robot at the beginning, and a pushed block must keep exactly the same
contacts.
"""

from __future__ import annotations

import math

from betterbench.geometry import distance, turn_between
from betterbench.tasks.worlds.calvin.play_table import BlockInfo, PlayTable
from betterbench.tasks.worlds.calvin.subtasks import (
    Lift,
    MoveDoor,
    Place,
    Push,
    PushInto,
    Rotate,
    Rule,
    StackBlocks,
    Switch,
    UnstackBlocks,
)

MOST_TILT_DEG = 30.0
MOST_SHIFT_M = 0.1
"""Maximum tilt about x or y [degree] and maximum displacement [m] of a block that counts as rotated."""

REST = 1.0
"""Largest absolute value of each component of the velocity [m/s, rad/s] of a block at rest."""


def done(rule: Rule, start: PlayTable, now: PlayTable) -> bool:
    """Return whether a subtask is done.

    Args:
        rule: Success rule of the subtask.
        start: Scene at the beginning of the subtask.
        now: Current scene.
    """
    match rule:
        case Rotate():
            return _rotated(rule, start, now)
        case Push():
            return _pushed(rule, start, now)
        case MoveDoor():
            moved = now.doors[rule.door] - start.doors[rule.door]
            return moved > rule.by_m if rule.by_m > 0 else moved < rule.by_m
        case Lift():
            return _lifted(rule, start, now)
        case Place():
            return _placed(rule, start, now)
        case PushInto():
            return any(_fell(rule, start, now, name) for name in start.blocks)
        case StackBlocks():
            return any(not _on(b, start) and _stacked(now.blocks[n], now) for n, b in start.blocks.items())
        case UnstackBlocks():
            return any(_stacked(b, start) and not _on(now.blocks[n], now) for n, b in start.blocks.items())
        case Switch():
            return start.lights[rule.light] == rule.before and now.lights[rule.light] == rule.after


def _rotated(rule: Rotate, start: PlayTable, now: PlayTable) -> bool:
    before, after = start.blocks[rule.block], now.blocks[rule.block]
    if distance(before.position, after.position) > MOST_SHIFT_M or after.bodies <= {start.robot}:
        return False
    w, x, y, z = turn_between(before.rotation, after.rotation)
    # Angles about the fixed axes x, y, z in this order.
    roll = math.degrees(math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)))
    pitch = math.degrees(math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x)))))
    yaw = math.degrees(math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
    # The official rule requires strictly less than half a turn.
    turned = rule.degrees < yaw < 180.0 if rule.degrees > 0 else rule.degrees > yaw > -180.0
    return turned and abs(roll) < MOST_TILT_DEG and abs(pitch) < MOST_TILT_DEG


def _pushed(rule: Push, start: PlayTable, now: PlayTable) -> bool:
    before, after = start.blocks[rule.block], now.blocks[rule.block]
    surface = {contact for contact in before.contacts if contact[0] != start.robot}
    if not surface or not surface <= after.contacts:
        return False
    moved = after.position[0] - before.position[0]
    return moved > rule.along_x_m if rule.along_x_m > 0 else moved < rule.along_x_m


def _lifted(rule: Lift, start: PlayTable, now: PlayTable) -> bool:
    before, after = start.blocks[rule.block], now.blocks[rule.block]
    return (
        after.position[2] - before.position[2] > rule.by_m
        and after.bodies == {start.robot}
        and start.table[rule.link] in before.contacts
    )


def _placed(rule: Place, start: PlayTable, now: PlayTable) -> bool:
    held = [name for name, block in start.blocks.items() if start.touched == {block.body}]
    return (
        len(held) == 1
        and start.blocks[held[0]].body not in now.touched
        and start.blocks[held[0]].bodies == {start.robot}
        and now.table[rule.link] in now.blocks[held[0]].contacts
    )


def _fell(rule: PushInto, start: PlayTable, now: PlayTable, name: str) -> bool:
    before, after = start.blocks[name], now.blocks[name]
    # Contacts with the robot are not checked. The official rule looks for the robot's body index in a list of (body,
    # link) pairs, so it never finds such a contact.
    return before.contacts == {start.table[rule.from_link]} and now.table[rule.link] in after.contacts


def _on(block: BlockInfo, scene: PlayTable) -> bool:
    """Return whether a block touches another block."""
    return any(other.body in block.bodies for other in scene.blocks.values())


def _stacked(block: BlockInfo, scene: PlayTable) -> bool:
    """Return whether a block is at rest and touches only other blocks."""
    bodies = {other.body for other in scene.blocks.values()}
    return _on(block, scene) and block.bodies <= bodies and all(abs(part) < REST for part in block.velocity)
