"""Policy of the independent family: a habit with a motion style, acting on the privileged state."""

from __future__ import annotations

import numpy as np

from betterbench.interface.state import WorldState
from betterbench_calibration.independent.body import Body
from betterbench_calibration.independent.controller import Actions


class IndependentAgent:
    """Privileged policy of the independent family for one episode."""

    def __init__(self, name: str, body: Body, script: Actions[None]) -> None:
        """Create the policy. ``body`` contains the ground truth, and ``script`` generates the actions."""
        self.name, self.body = name, body
        self._script = script
        self._begun = False

    def act_on_state(self, state: WorldState) -> np.ndarray:
        """Return the next ``ee_delta`` action (7,). After the end of the script, the arm stays where it is."""
        try:
            if self._begun:
                return self._script.send(state)
            self._begun = True
            return next(self._script)
        except StopIteration:
            self._script = self.body.arm.stay()
            return next(self._script)

    @property
    def ground_truth(self) -> dict[str, str]:
        """Ground truth of the policy about its own episode.

        ``stated`` (a label) and ``first_attempt`` are fixed before the first action. ``truth`` is the label of the
        trial if its goal is not reached, after the corrections in :mod:`betterbench_calibration.independent.truth`.
        ``rule`` is the rule that corrected the stated label.
        """
        ledger = self.body.ledger
        for name in self.body.harmed():
            if name not in ledger.open_mishaps:
                ledger.mishap(name, "it was displaced by more than 5 cm without being requested")
        label, rule = ledger.final()
        stated = ledger.stated
        first = "none" if stated.first_right is None else ("right" if stated.first_right else "wrong")
        return {
            "truth": label,
            "stated": stated.label or "honest",
            "first_attempt": first,
            "fault": self.name.partition(":")[2],
            "rule": rule,
            "debatable": stated.debatable,
            "left_out": stated.left_out,
            "mishap": "; ".join(ledger.notes),
        }
