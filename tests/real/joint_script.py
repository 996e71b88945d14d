"""Joint states of a real arm, written step by step: waits, turns of joints, and motions of the jaw."""

from __future__ import annotations

import numpy as np

from betterbench.real.plan import ACTION_SPACES
from betterbench.real.record import Samples
from betterbench.real.signals import JointTrack, signals_of
from betterbench.sim.robots.spec import robot

HOME = np.degrees(robot("so101").home_joints)
STEP_DEGREES = 360.0 / 4096


class Script:
    """Samples at a rate, in a unit, with the noise of the encoders if a seed is given."""

    def __init__(self, *, rate_hz=20.0, unit="degrees", noise=None, load=None):
        self.rate_hz, self.unit = rate_hz, unit
        self._rng = None if noise is None else np.random.default_rng(noise)
        self._arm, self._jaw, self._rows, self._load = HOME.copy(), 60.0, [], load

    def _add(self, seconds, arm, jaw, command, load):
        steps = max(1, round(seconds * self.rate_hz))
        for k in range(1, steps + 1):
            share = k / steps
            now = self._arm + share * (arm - self._arm)
            opening = self._jaw + share * (jaw - self._jaw)
            self._rows.append((*now, opening, *now, opening if command is None else command, load))
        self._arm, self._jaw = np.array(arm, dtype=float), float(jaw)
        return self

    def wait(self, seconds, *, command=None, load=0.0):
        return self._add(seconds, self._arm, self._jaw, command, load)

    def turn(self, seconds, *, command=None, load=0.0, **degrees):
        """Turn joints by angles [degree]."""
        names = ("pan", "lift", "elbow", "flex", "roll")
        arm = self._arm + np.array([degrees.get(name, 0.0) for name in names])
        return self._add(seconds, arm, self._jaw, command, load)

    def jaw(self, opening, *, command=None, seconds=0.4, load=0.0):
        """Move the jaw to an opening; ``command`` is where it was told to go."""
        return self._add(seconds, self._arm, opening, command, load)

    def grasp(self, *, load=0.0, opening=36.0, command=27.0, hold_s=1.0):
        return self.jaw(opening, command=command, load=load).wait(hold_s, command=command, load=load)

    def dip(self, *, degrees=25.0):
        """Lower the tool and rise again."""
        return self.turn(0.8, lift=degrees).turn(0.8, lift=-degrees)

    def samples(self):
        rows = np.array(self._rows)
        state, command = rows[:, :6].copy(), rows[:, 6:12].copy()
        if self._rng is not None:
            step = np.array([STEP_DEGREES] * 5 + [100.0 * STEP_DEGREES / 110.0])
            state = np.round(state / step + self._rng.uniform(-1.0, 1.0, state.shape)) * step
        factor = np.radians(1.0) / np.array(ACTION_SPACES[self.unit].scale[:5])
        for values in (state, command):
            values[:, :5] *= factor
        load = np.full(state.shape, np.nan)
        if self._load is not None:
            load[:, 5] = rows[:, 12]
        no = np.zeros(len(rows), dtype=bool)
        return Samples(np.arange(len(rows)) / self.rate_hz, state, command, command.copy(), load, no, no.copy())

    def signals(self):
        return signals_of(JointTrack.of(self.samples(), unit=self.unit, rate_hz=self.rate_hz))
