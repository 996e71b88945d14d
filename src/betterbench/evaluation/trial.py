"""One trial in one worker: build the scene, run the episode, write the record."""

from __future__ import annotations

import functools
import os
import time
from dataclasses import dataclass
from pathlib import Path

from betterbench.episodes import Observer, TrialContext, run_episode
from betterbench.errors import PremiseError
from betterbench.evaluation.agents import Minds, is_privileged
from betterbench.evaluation.plan import Trial
from betterbench.interface import Policy, observation_spec
from betterbench.interface.actions import action_space
from betterbench.recording import JournalEntry, RunFolder, Status
from betterbench.scenes import Scene
from betterbench.scenes.stage import quality_preset


@dataclass(frozen=True, slots=True)
class Setting:
    """What all trials of a run share; small and picklable, so that a worker can be told.

    Attributes:
        run: Folder of the run.
        policy: Address of the policy.
        action_space: Name of the action space.
        observation: Name of the observation preset.
        quality: Name of the render preset.
        robot: Name of the robot.
    """

    run: str
    policy: str
    action_space: str
    observation: str
    quality: str
    robot: str


@functools.lru_cache(maxsize=1)
def _workshop(setting: Setting) -> tuple[RunFolder, Minds, Observer]:
    return RunFolder.open(Path(setting.run)), Minds(setting.policy), Observer(observation_spec(setting.observation))


def run_trial(setting: Setting, trial: Trial) -> JournalEntry:
    """Run one trial and write its record and, once, its scene.

    Args:
        setting: What all trials of the run share.
        trial: The trial.

    Returns:
        The line for the journal; the caller writes it, so that one process alone appends.

    Raises:
        PremiseError: If the scene does not show what the instruction presupposes; the run has to stop.
    """
    began = time.perf_counter()
    run, minds, observer = _workshop(setting)
    status: Status = "done"
    message: str | None = None
    wall: dict[str, float] = {}
    remarks: dict[str, str] = {}
    try:
        task, condition, interventions = trial.resolve()
        scene = Scene(
            task,
            condition,
            seed=trial.seed,
            action_space=action_space(setting.action_space),
            quality=quality_preset(setting.quality),
            robot_name=setting.robot,
        )
        mind = minds.mind(scene, trial)
        seen = None if is_privileged(setting.policy) else _observer_for(mind, observer)  # type: ignore[arg-type]
        context = TrialContext(
            policy=setting.policy,
            variation=trial.variation,
            axis=trial.axis,
            base_condition=trial.base_condition,
            interventions=interventions,
            camera_preset=None if seen is None or not seen.spec.cameras else seen.spec.name,
        )
        result = run_episode(scene, mind, context=context, observer=seen)
        run.write_record(result.record)
        if not run.scene_path(scene.compiled.content_hash).exists():
            run.store_scene(scene.compiled.content_hash, scene.files())
        wall = result.wall
        remarks = dict(getattr(mind, "remarks", {}))
        message = result.record.outcome.error
    except PremiseError:
        raise
    except Exception as error:  # noqa: BLE001 - a trial that breaks down is listed and run again, the run goes on
        status, message = "error", f"{type(error).__name__}: {error}"
    wall = {**wall, "total_s": round(time.perf_counter() - began, 6), "worker": float(os.getpid())}
    return JournalEntry(trial.task, trial.condition, trial.variation, trial.seed, status, message, wall, remarks)


def _observer_for(policy: Policy, observer: Observer) -> Observer:
    """Return the observer, or one without cameras for a policy that never looks at a picture."""
    return observer if policy.info.needs_images else Observer(observation_spec("state_only"))
