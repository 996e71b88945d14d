"""Policies for tests of the loop, as users write them: named in an address with python:FILE:CLASS?key=value."""

import time

import numpy as np

from betterbench.interface import PolicyInfo


class Reach:
    """Swings the base and closes the gripper; ``amount`` in units of the arm."""

    def __init__(self, *, amount=8.0, space="so101_degrees", slow_s=0.0, horizon=4, fail_at=-1, nan_at=-1):
        self.info = PolicyInfo("reach", action_space=space)
        self._amount, self._slow_s, self._horizon = amount, slow_s, horizon
        self._fail_at, self._nan_at = fail_at, nan_at
        self.seen = []

    def reset(self, start):
        self.seen = [start]

    def act(self, observation):
        self.seen.append(observation)
        time.sleep(self._slow_s)
        if 0 <= self._fail_at <= observation.step:
            raise ValueError("out of memory")
        arm = np.degrees(observation.joint_positions) if "degrees" in self.info.action_space else np.zeros(5)
        chunk = np.tile([*arm, 60.0], (self._horizon, 1))
        chunk[:, 0] += self._amount
        if 0 <= self._nan_at <= observation.step:
            chunk[:, 1] = np.nan
        return chunk
