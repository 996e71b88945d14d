"""A simulator with LIBERO's interface: two things, a basket, and a gripper that carries what it closes around.

The base suite has the cube on the left and the ball on the right; under "swap" they stand at each other's places.
``FAKE_LAYOUT=basket`` lets the ball and the basket change places instead, and as many grasps as ``FAKE_MISSES`` says
get hold of nothing.
"""

import os
import sys

import numpy as np

from betterbench.sim.worlds.rows import form_of, row_of
from betterbench.sim.worlds.simulator_loop import answer_requests

PLACES = {"x -12 y -24": (-0.12, -0.24), "x 5 y -10": (0.05, -0.10), "x 0 y 26": (0.0, 0.26)}
BASE = {"cube_1": "x -12 y -24", "ball_1": "x 5 y -10", "basket_1": "x 0 y 26"}
SWAPPED = {"cube_1": "x 5 y -10", "ball_1": "x -12 y -24", "basket_1": "x 0 y 26"}
BASKET_MOVED = {"cube_1": "x -12 y -24", "ball_1": "x 0 y 26", "basket_1": "x 5 y -10"}
SIDE, TALL = 0.04, 0.05
PAIRS = [["basket_1", "floor"]]
PAIRS += [[thing, other] for thing in ("ball_1", "cube_1") for other in ("floor", "left_finger", "right_finger")]
DOWN = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


def layout_of(suite):
    if "swap" not in suite:
        return BASE
    return BASKET_MOVED if os.environ.get("FAKE_LAYOUT") == "basket" else SWAPPED


class FakeTable:
    def __init__(self) -> None:
        self.names = list(BASE)
        self.at: dict[str, np.ndarray] = {}
        self.tool, self.width, self.held = np.zeros(3), 0.08, None
        self.wanted, self.steps = "cube_1", 0

    def suite(self, name):
        starts = {thing: [thing[:-2], place] for thing, place in layout_of(name).items()}
        tasks = []
        for i in range(10):
            kind = ("cube", "ball")[i % 2]
            said = f"pick up the {kind} and place it in the basket"
            tasks.append(
                {
                    "name": kind,
                    "instruction": said,
                    "file_instruction": said,
                    "bddl_sha256": str(i % 2) * 64,
                    "states": 50,
                    "steps": [["in", f"{kind}_1", kind, "basket"]],
                    "starts": starts,
                }
            )
        return {"tasks": tasks, "versions": {"fake": "1"}}

    def start(self, request):
        layout = layout_of(request["suite"])
        self.misses = int(os.environ.get("FAKE_MISSES") or 0)
        self.wanted = ("cube_1", "ball_1")[request["task"] % 2]
        shift = 0.001 * request["state"]
        self.at = {n: np.array([PLACES[place][0] + shift, PLACES[place][1], 0.0]) for n, place in layout.items()}
        self.tool, self.width, self.held, self.steps = np.array([-0.15, 0.0, 0.26]), 0.08, None, 0
        goal = f"in({self.wanted}, basket_1_contain_region)"
        hole = {"name": "contain_region", "position": [0.0, 0.0, 0.07], "half_size": [0.06, 0.06, 0.07]}
        objects = [
            {
                "name": name,
                "kind": name[:-2],
                "fixed": False,
                "mass": 0.1,
                "start": layout[name],
                "size": [0.17, 0.17, 0.15] if name == "basket_1" else [SIDE, SIDE, TALL],
                "regions": [hole] if name == "basket_1" else [],
                "of_interest": name in (self.wanted, "basket_1"),
            }
            for name in self.names
        ]
        fixed = {"objects": objects, "relations": [goal], "goal": [goal], "premises": [], "arena": "floor"}
        fixed |= {"places": [[name, [*place, 0.0]] for name, place in PLACES.items()], "base": [0.0, 0.0, 0.0]}
        fixed |= {"bddl": "(define)", "engine": {"mujoco": "3.3.7"}}
        document, arrays = self.row()
        return {**fixed, **document, "pairs": PAIRS, "row": form_of(self.numbers())}, arrays

    def draw(self, request, qpos):
        assert request["suite"].startswith("libero_object")
        size = request["size"]
        return {}, {"images": np.full((len(qpos), size, size, 3), 40 + 100 * request["task"], np.uint8)}

    def step(self, action, *, look):
        del look
        self.steps += 1
        self.tool = self.tool + 0.3 * 0.05 * action[:3]
        if action[6] > 0.0:
            within = [
                n
                for n in ("cube_1", "ball_1")
                if not self.misses
                and np.abs(self.tool[:2] - self.at[n][:2]).max() < 0.018
                and 0.0 < self.tool[2] - self.at[n][2] < TALL
            ]
            self.width = max(SIDE if within else 0.0, self.width - 0.02)
            if within and self.width <= SIDE:
                self.held = within[0]
        else:
            self.misses -= int(self.misses > 0 and self.width == 0.0)
            self.width = min(0.08, self.width + 0.04)
            if self.held is not None:
                over = np.abs(self.at[self.held][:2] - self.at["basket_1"][:2]).max() < 0.06
                self.at[self.held][2] = 0.01 if over else 0.0
                self.held = None
        if self.held is not None:
            self.at[self.held] = self.at[self.held] + 0.3 * 0.05 * action[:3]
        return self.row()

    def row(self):
        apart = self.at[self.wanted] - self.at["basket_1"]
        inside = bool(np.abs(apart[:2]).max() < 0.06 and self.at[self.wanted][2] == 0.01 and self.held is None)
        touching = [0]
        for i, name in enumerate(("ball_1", "cube_1")):
            touching += [3 * i + 2, 3 * i + 3] if name == self.held else [3 * i + 1]
        arrays = {"row": row_of(self.numbers()), "touching": np.array(touching), "forces": np.ones(len(touching))}
        return {"done": inside}, {**arrays, "holds": np.array([inside])}

    def numbers(self):
        arrays = {name: np.zeros(3) for name in ("qpos", "qvel", "ctrl")}
        arrays |= {"act": np.zeros(0), "velocities": np.zeros((3, 6)), "fingers": np.full(2, 0.5 * self.width)}
        arrays |= {"positions": np.array([self.at[n] for n in self.names]), "joints": np.zeros(7)}
        arrays |= {"quaternions": np.array([[1.0, 0.0, 0.0, 0.0]] * 3), "joint_speeds": np.zeros(7)}
        arrays |= {"ee_position": self.tool, "ee_rotation": DOWN, "goal_position": self.tool, "goal_rotation": DOWN}
        arrays |= {"native_position": self.tool, "native_gripper": np.zeros(2)}
        arrays |= {"controller_position": self.tool, "controller_rotation": np.eye(3)}
        arrays["native_quaternion"] = np.array([1.0, 0.0, 0.0, 0.0])
        return arrays


def main():
    answer_requests(FakeTable(), int(sys.argv[1]))
