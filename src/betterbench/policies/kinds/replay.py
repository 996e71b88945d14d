"""Policy kind ``replay``: open-loop replay of the actions recorded in another run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from betterbench.errors import InvalidInputError, RecordError
from betterbench.interface import EpisodeStart, Observation, PolicyInfo
from betterbench.policies.address import AddressForm, PolicyAddress
from betterbench.policies.kinds.kind import PlannedTrial, PolicyKind, PolicyNeeds, register

if TYPE_CHECKING:
    from betterbench.sim.worlds import TrialScene


class Replay:
    """Policy that replays the actions of a record from another run.

    The record has the same seed as the current trial and, if possible, the same condition. If the other run has no such
    record, the record of the training twin is replayed (the training trial with the same seed). After the last recorded
    action, the robot stays still.
    """

    def __init__(self, folder: str, *, task: str, condition: str, base: str, seed: int) -> None:
        """Load the recorded actions.

        Raises InvalidInputError if the run contains neither a record of the trial nor one of its training twin, or if
        no run folder is given.
        """
        from betterbench.records import RunFolder

        if not folder:
            raise InvalidInputError("policy replay", "no run was given", "Write replay:RUN with the folder of a run")
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
                f"the run has no record of {task} with condition {condition} or {base} and seed {seed}",
                "First evaluate a policy with this seed in that run",
            )
        self.info = PolicyInfo(f"replay:{folder}", action_space=self._space, needs_images=False)

    def reset(self, start: EpisodeStart) -> None:
        """Begin the replay with the first action.

        Raises InvalidInputError if the record uses a different action space than the run.
        """
        if start.action_space != self._space:
            from betterbench.policies.conventions.handshake import space_cure

            raise InvalidInputError(
                "action space",
                f"the record uses {self._space!r}, but the run uses {start.action_space!r}",
                space_cure(self._space),
            )

    def act(self, observation: Observation) -> np.ndarray:
        """Return the recorded action for this step. After the last one, return an action that keeps the robot still."""
        actions = self._actions
        if actions is None:
            raise AssertionError("unreachable: the constructor loads the actions")
        if observation.step < len(actions):
            return np.array(actions[observation.step])
        still = np.zeros(actions.shape[1])
        if len(actions) and self._space.endswith(("pose", "position")):
            still[:] = actions[-1]
        elif len(actions):
            still[-1] = actions[-1][-1]
        return still


_FORM = AddressForm(scheme="replay", example="replay:RUN")


def _read(text: str, world: str) -> PolicyAddress:
    folder = text.partition(":")[2]  # everything after the colon: a folder name may contain "?"
    if not folder:
        raise InvalidInputError("policy replay", "no run was given", "Write replay:RUN with the folder of a run")
    return PolicyAddress(text, _FORM, folder, {}, world)


def _describe(address: PolicyAddress) -> PolicyInfo:
    """Return the description of a replay policy, as far as it is known before a trial.

    The action space is left empty, since it depends on the record.
    """
    from betterbench.records import RunFolder

    RunFolder.open(Path(address.target))
    return PolicyInfo(address.text, action_space="", needs_images=False)


def _make_for(address: PolicyAddress, scene: TrialScene, trial: PlannedTrial | None) -> Replay:
    del scene
    if trial is None:
        raise address.error("a replay policy can only replay trials of a run", "Use it with better eval")
    base = trial.base_condition or trial.condition
    return Replay(address.target, task=trial.task, condition=trial.condition, base=base, seed=trial.seed)


REPLAY = register(
    PolicyKind(
        form=_FORM,
        shown="replay:RUN",
        summary="Replays the recorded actions of another run, open loop.",
        needs=PolicyNeeds(trial=True),
        read=_read,
        make_for=_make_for,
        describe=_describe,
    )
)
