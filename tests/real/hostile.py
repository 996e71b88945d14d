"""Policies that do what no policy should, for tests of the loop; ``how`` names the fault."""

import time

import numpy as np

from betterbench.interface import PolicyInfo


class Vanish(BaseException):
    """An exception that is no Exception, as of a library that ends its thread."""


class Hostile:
    """Answers well until ``at`` steps, and then as ``how`` says."""

    def __init__(self, *, how="good", at=4, hang_s=60.0):
        self.info = PolicyInfo("hostile", action_space="so101_degrees")
        self._how, self._at, self._hang_s = how, at, hang_s
        self.busy = 0

    def reset(self, start):  # noqa: ARG002 - of the protocol
        if self._how == "hangs_at_reset":
            time.sleep(self._hang_s)

    def act(self, observation):  # noqa: C901 - one case for each fault
        here = [*np.degrees(observation.joint_positions), 60.0]
        if observation.step < self._at:
            return here
        match self._how:
            case "strings":
                return ["left"] * 6
            case "numbers_as_text":
                return ["1.0"] * 6
            case "infinite":
                return [*here[:5], np.inf]
            case "short":
                return here[:5]
            case "empty":
                return np.zeros((0, 6))
            case "ragged":
                return [here, here[:3]]
            case "none":
                return None
            case "deep":
                return np.zeros((2, 2, 6))
            case "complex":
                return np.array(here) * 1j
            case "vanishes":
                raise Vanish("gone")
            case "exits":
                raise SystemExit(3)
            case "interrupts":
                raise KeyboardInterrupt
            case "hangs":
                time.sleep(self._hang_s)
            case "jumps":
                sign = 1.0 if observation.step % 2 else -1.0
                return [sign * 1e6] * 6
            case "tiny_and_huge":
                return [1e300, -1e300, 1e-300, 5e-324, -1e308, 1e308]
        return here
