"""Open loop: play the actions of a recorded trial, whatever happens."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from betterbench.errors import InvalidInputError, RecordError
from betterbench.interface import EpisodeStart, Observation, PolicyInfo
from betterbench.policies.conventions.handshake import space_cure
from betterbench.records import RunFolder


class Replay:
    """Plays the record of the same seed from another run: of the same condition if it is there, else of its twin.

    Past the end of the record it holds still.
    """

    def __init__(self, folder: str, *, task: str, condition: str, base: str, seed: int) -> None:
        """Load the actions; raise InvalidInputError if the run has neither record, or no folder was named."""
        if not folder:
            raise InvalidInputError("policy replay", "no run was named", "Write replay:RUN with the folder of a run")
        run = RunFolder.open(Path(folder))
        self._actions: np.ndarray | None = None
        for name in (condition, base):
            try:
                record = run.read_record(task, name, seed)
            except RecordError:
                continue
            self._actions = record.applied[1:]
            self._space = record.metadata.action_space
            break
        if self._actions is None:
            raise InvalidInputError(
                f"policy replay:{folder}",
                f"the run has no record of {task} {condition} or {base} with seed {seed}",
                "Evaluate a policy with that seed into it first",
            )
        self.info = PolicyInfo(f"replay:{folder}", action_space=self._space, needs_images=False)

    def reset(self, start: EpisodeStart) -> None:
        """Go back to the first action; raise InvalidInputError if the run uses another action space than the record."""
        if start.action_space != self._space:
            raise InvalidInputError(
                "action space",
                f"the record was made with {self._space!r}, the run uses {start.action_space!r}",
                space_cure(self._space),
            )

    def act(self, observation: Observation) -> np.ndarray:
        """Return the recorded action of this step, or hold still after the last one."""
        actions = self._actions
        if actions is None:
            raise AssertionError("the constructor has loaded the actions")
        if observation.step < len(actions):
            return np.array(actions[observation.step])
        still = np.zeros(actions.shape[1])
        if len(actions) and self._space.endswith(("pose", "position")):
            still[:] = actions[-1]
        elif len(actions):
            still[-1] = actions[-1][-1]
        return still
