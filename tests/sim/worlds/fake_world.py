"""A simulator with LIBERO's interface and none of its physics: a cube that moves as it is told.

It runs where betterbench is not installed, as LIBERO's process does. ``FAKE_FAULT`` (fake_faults.py) names an initial
state.
"""

import json
import os
import sys

import numpy as np
from fake_faults import fail, fault_due

from betterbench.sim.worlds.rows import RowForm, form_of, row_of
from betterbench.sim.worlds.simulator_loop import answer_requests

SENTENCE = "pick up the cube and place it on the plate"


class FakeSimulator:
    def __init__(self) -> None:
        print("this is printed to standard output")  # noqa: T201 - what simulators do
        self.images = False
        self.at = np.zeros(3)
        self.state = 0
        self.steps = 0
        self.wrong = None

    def suite(self, name):
        assert name.startswith("libero_")
        one = {"name": "cube", "instruction": SENTENCE, "file_instruction": "shove the cube", "bddl_sha256": "0" * 64}
        one["steps"] = [["on", "cube_1", "cube", "plate"]]
        one["starts"] = {"cube_1": ["cube", "x 0 y 0"], "plate_1": ["plate", "x 30 y 0"]}
        return {"tasks": [{**one, "states": 50}] * 10, "versions": {"fake": "1"}}

    def premises(self, request):
        if request["task"] == 7:
            raise RuntimeError("the tray is gone")
        holds = np.arange(50) != 40
        moved = np.zeros((50, 2))
        moved[2, 1] = 0.05
        document = {"premises": ["on(cube_1, tray_1)"], "objects": ["cube_1", "plate_1"]}
        return {**document, "engine": {"fake": "1"}}, {"holds": holds[:, None], "moved": moved}

    def start(self, request):
        print("so is this")  # noqa: T201 - what simulators do
        self.state, self.steps, self.images = request["state"], 0, request["images"]
        self.at = np.array([0.01 * self.state, 0.0, 0.0])
        thing = {"fixed": False, "mass": 0.1, "size": [0.04, 0.04, 0.04], "of_interest": True}
        thing |= {"regions": [], "start": "x 0 y 0"}
        fixed = {
            "objects": [{**thing, "name": "cube_1", "kind": "cube"}, {**thing, "name": "plate_1", "kind": "plate"}],
            "relations": ["on(cube_1, tray_1)", "on(cube_1, plate_1)"],
            "goal": ["on(cube_1, plate_1)"],
            "premises": ["on(cube_1, tray_1)"],
            "places": [["x 0 y 0", [0.0, 0.0, 0.0]]],
            "arena": "table",
            "base": [0.0, 0.0, 0.0],
            "bddl": "(define (problem cube))",
            "engine": {"mujoco": "3.3.7"},
            "pairs": [["cube_1", "table"], ["cube_1", "plate_1"]],
            "row": form_of(self.numbers()),
        }
        document, arrays = self.row(look=self.images)
        kind = fault_due(lambda state: self.state == int(state)) if os.environ.get("FAKE_START") else None
        if kind is not None:
            name, _, value = kind.partition("=")
            del fixed[name]
            fixed |= {name: json.loads(value)} if value else {}
        return {**fixed, **document}, arrays

    def step(self, action, *, look):
        self.steps += 1
        self.at = self.at + 0.0125 * action[:3]
        if self.steps == 3:
            self.fail()
        return self.row(look=look)

    def fail(self):
        kind = fault_due(lambda state: int(state) == self.state)
        if kind == "nan":
            self.at = self.at * np.nan
        self.wrong = kind
        fail(kind)

    def row(self, *, look):  # noqa: C901 - one line for each fault
        there = bool(self.at[0] > 0.2)
        arrays = {"row": row_of(self.numbers()), "touching": np.array([1]), "forces": np.array([1.5])}
        arrays["holds"] = np.array([self.state != 40, there])
        wrong, self.wrong = self.wrong, None
        if wrong == "short row":
            arrays["row"] = arrays["row"][:-1]
        if wrong == "no rotation":
            arrays["row"][self.places["quaternions"]] = 0.0
        if wrong == "row of floats":
            arrays["row"] = arrays["row"].astype(np.float32)
        if wrong == "two rows":
            arrays["row"] = np.stack([arrays["row"]] * 2)
        if wrong == "unknown pair":
            arrays["touching"] = np.array([9])
        if wrong == "pair from the end":
            arrays["touching"] = np.array([-1])
        if wrong == "pair without force":
            arrays["forces"] = np.zeros(0)
        if wrong == "endless force":
            arrays["forces"] = np.array([np.inf])
        if wrong == "few truths":
            arrays["holds"] = arrays["holds"][:1]
        if wrong == "no row":
            del arrays["row"]
        if wrong == "truths that are numbers":
            arrays["holds"] = np.array([np.nan, 0.5])
        if wrong == "contacts in a table":
            arrays["touching"], arrays["forces"] = np.zeros((1, 1), int), np.zeros((1, 1))
        if look:
            draw = np.random.default_rng([self.state, self.steps])
            arrays["image_front"], arrays["image_wrist"] = draw.integers(0, 256, (2, 256, 256, 3), dtype=np.uint8)
            if wrong == "image of numbers":
                arrays["image_front"] = np.full((256, 256, 3), np.nan)
        if wrong == "done in words":
            return {"done": "false"}, arrays
        return ({} if wrong == "done is missing" else {"done": there}), arrays

    @property
    def places(self):
        return RowForm(form_of(self.numbers())).places

    def numbers(self):
        arrays = {name: np.arange(3.0) + self.steps for name in ("qpos", "qvel", "ctrl")}
        arrays |= {"act": np.zeros(0), "velocities": np.zeros((2, 6)), "fingers": np.array([0.0262, -0.0261])}
        arrays |= {
            "positions": np.array([self.at, [0.3, 0.0, 0.0]]),
            "quaternions": np.array([[1.0, 0.0, 0.0, 0.0]] * 2),
        }
        arrays |= {
            "ee_position": self.at,
            "ee_rotation": np.eye(3),
            "goal_position": self.at,
            "goal_rotation": np.eye(3),
        }
        arrays |= {"joints": np.arange(7.0), "joint_speeds": np.zeros(7)}
        arrays |= {"native_position": self.at, "native_gripper": np.array([0.0262, -0.0261])}
        arrays |= {"controller_position": self.at, "controller_rotation": np.eye(3)}
        arrays["native_quaternion"] = np.array([0.99930133, -0.00474019, -0.03628211, -0.0076154])
        return arrays


def main():
    answer_requests(FakeSimulator(), int(sys.argv[1]))
