"""A model with its state and a controller, stepped by actions."""

from __future__ import annotations

import mujoco
import numpy as np

from betterbench.interface.actions import ActionSpace
from betterbench.sim.robots import PANDA, ArmController, RobotSpec


class Bench:
    """A model with its state and a controller, stepped by actions."""

    def __init__(self, model: mujoco.MjModel, space: ActionSpace, robot: RobotSpec = PANDA) -> None:
        self.model = model
        self.data = mujoco.MjData(model)
        self.controller = ArmController(model, robot, space)
        self.controller.home(self.data)
        mujoco.mj_forward(model, self.data)

    def step(self, action: object, times: int = 1) -> np.ndarray:
        """Apply an action several times; return the TCP positions after each, shape (times, 3) [m]."""
        positions = []
        for _ in range(times):
            self.controller.apply(self.data, action)
            mujoco.mj_step(self.model, self.data, nstep=self.controller.substeps)
            positions.append(self.controller.measured_pose(self.data).position)
        return np.array(positions)
