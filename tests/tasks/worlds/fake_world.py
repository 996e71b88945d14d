"""A world without physics for chains: an action names a subtask, and the scene then is as its rule wants it.

It holds CALVIN's symbolic state, and shows it as poses, contacts, doors and lights in the form of ``get_info`` of
calvin_env. The rules of success see nothing else.
"""

from __future__ import annotations

import math

import numpy as np

from betterbench.tasks.worlds.calvin import ChainStart, PlayTable, read_play_table, subtasks
from betterbench.tasks.worlds.calvin.subtasks import Push, Rotate

ROBOT, TABLE = 0, 5
BODIES = {"red": 2, "blue": 3, "pink": 4}
LINKS = {"base_link": -1, "drawer_link": 0, "slide_link": 1, "plank_link": 2}
SURFACE = {"table": "base_link", "slider_left": "plank_link", "slider_right": "plank_link", "drawer": "drawer_link"}
HEIGHT = {"table": 0.46, "slider_left": 0.46, "slider_right": 0.46, "drawer": 0.36, "grasped": 0.6}


def contact(own: int, body: int, link: int) -> tuple[int, ...]:
    return (0, own, body, -1, link)


class FakeWorld:
    """A ChainWorld; the observation is the instruction-independent number of steps."""

    def __init__(self) -> None:
        self.steps = 0

    def reset(self, start: ChainStart) -> int:
        scene = start.scene
        self.slider, self.drawer = float(scene[0]), float(scene[1])
        self.lights = {"lightbulb": int(scene[4]), "led": int(scene[5])}
        self.at, self.position, self.yaw = {}, {}, {}
        for i, color in enumerate(BODIES):
            x, y, z = scene[6 + 6 * i : 9 + 6 * i].tolist()
            self.at[color] = "table" if y < 0 else ("slider_left" if x < 0 else "slider_right")
            self.position[color], self.yaw[color] = [x, y, z], float(scene[11 + 6 * i])
        self.steps = 0
        return self.steps

    def symbolic(self) -> dict[str, object]:
        """The state in the words of the chains."""
        return {
            **self.lights,
            "slider": "left" if self.slider > 0.14 else "right",
            "drawer": "open" if self.drawer > 0.11 else "closed",
            **{f"{color}_block": place for color, place in self.at.items()},
            "grasped": int("grasped" in self.at.values()),
        }

    def info(self) -> PlayTable:
        held = [color for color, place in self.at.items() if place == "grasped"]
        scene = {
            "movable_objects": {f"block_{color}": self._block(color) for color in BODIES},
            "fixed_objects": {"table": {"uid": TABLE, "links": LINKS}},
            "doors": {"base__slide": {"current_state": self.slider}, "base__drawer": {"current_state": self.drawer}},
            "lights": {name: {"logical_state": state} for name, state in self.lights.items()},
        }
        robot = {"uid": ROBOT, "contacts": [contact(ROBOT, BODIES[color], -1) for color in held]}
        return read_play_table({"robot_info": robot, "scene_info": scene})

    def _block(self, color: str) -> dict[str, object]:
        place, own = self.at[color], BODIES[color]
        if place == "grasped":
            contacts = [contact(own, ROBOT, 9)]
        elif place in {"stacked_top", "stacked_bottom"}:
            other = next(c for c, p in self.at.items() if p != place and p in {"stacked_top", "stacked_bottom"})
            contacts = [contact(own, BODIES[other], -1)]
            contacts += [contact(own, TABLE, -1)] if place == "stacked_bottom" else []
        else:
            contacts = [contact(own, TABLE, LINKS[SURFACE[place]])]
        half = 0.5 * self.yaw[color]
        return {
            "uid": own,
            "current_pos": tuple(self.position[color]),
            "current_orn": (0.0, 0.0, math.sin(half), math.cos(half)),
            "current_lin_vel": (0.0, 0.0, 0.0),
            "current_ang_vel": (0.0, 0.0, 0.0),
            "contacts": contacts,
        }

    def step(self, action: np.ndarray) -> int:
        """Do the subtask whose number is 100 times the first component; a negative one does nothing."""
        self.steps += 1
        number = round(float(action[0]) * 100)
        if number < 0:
            return self.steps
        subtask = subtasks()[number]
        after = subtask.after(self.symbolic())
        assert after is not None, subtask.name
        self.slider, self.drawer = 0.28 * (after["slider"] == "left"), 0.22 * (after["drawer"] == "open")
        self.lights = {name: int(after[name]) for name in self.lights}
        for color in BODIES:
            place = str(after[f"{color}_block"])
            if place != self.at[color]:
                self.at[color] = place
                self.position[color][2] = HEIGHT.get(place, 0.46)
        if isinstance(subtask.rule, Rotate):
            self.yaw[subtask.rule.block.removeprefix("block_")] += math.radians(1.2 * subtask.rule.degrees)
        if isinstance(subtask.rule, Push):
            self.position[subtask.rule.block.removeprefix("block_")][0] += 1.2 * subtask.rule.along_x_m
        return self.steps


class FakePolicy:
    """Knows each sentence; does nothing for what it cannot do, and waits ``delay`` steps before the rest."""

    def __init__(self, *, cannot: frozenset[str] = frozenset(), delay: int = 0) -> None:
        self.numbers = {s.instruction: -1 if s.name in cannot else i for i, s in enumerate(subtasks())}
        self.delay, self.waited, self.resets = delay, 0, 0

    def reset(self) -> None:
        self.waited = 0
        self.resets += 1

    def act(self, observation: int, instruction: str) -> np.ndarray:  # noqa: ARG002 - a ChainPolicy
        self.waited += 1
        number = self.numbers[instruction] if self.waited > self.delay else -1
        return np.array([number / 100 if number >= 0 else -1.0, *[0.0] * 5, 1.0])
