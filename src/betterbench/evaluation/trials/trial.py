"""Execution of one trial in a worker: build the scene, run the episode and write the record."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from betterbench.episodes import EpisodeResult, Observer, Question, Reply, TrialContext, episode_steps, run_episode
from betterbench.errors import (
    HandshakeError,
    InvalidInputError,
    PolicyKilledError,
    PolicyUnavailableError,
    PremiseError,
    StorageError,
    described,
    encodable,
    place_of,
)
from betterbench.evaluation.trials.shared_policy import POLICY_TIMEOUT_S
from betterbench.interface import PolicyInfo, observation_spec
from betterbench.interface.actions import action_space
from betterbench.interface.state import AnyPolicy
from betterbench.jobs.durable import on_disk
from betterbench.jobs.lock import HeldFolder, held_folders
from betterbench.jobs.retries import MAX_DEATHS
from betterbench.json_form import file_digest
from betterbench.policies.factory import PolicyFactory, answer_limit_s, close_policy
from betterbench.records import JournalEntry, RunFolder, TrialStatus
from betterbench.sim.worlds import OWN_WORLD, SceneOptions, TrialScene, World, WorldProcesses
from betterbench.tasks import Looks
from betterbench.tasks.trial import Trial
from betterbench.tasks.user_files import TaskFile, load_sources, loaded_files

if TYPE_CHECKING:  # importing the plan also imports statistics, which a worker does not need
    from betterbench.evaluation.planning.plan import Plan

logger = logging.getLogger(__name__)

_SPARE_RENDERERS = 3

TrialSteps = Generator[Question | None, Reply | None, JournalEntry]
"""Generator that runs a trial.

Like :data:`betterbench.episodes.Steps`, it yields requests to the policy. It returns the journal entry of the trial.
"""


@dataclass(frozen=True, slots=True)
class WorkerSettings:
    """Settings that apply to all trials of a run. They can be pickled and sent to workers.

    Attributes:
        run: Run folder.
        policy: Policy address that is written to the records.
        action_space: Name of the action space.
        observation: Name of the observation preset.
        quality: Name of the rendering preset.
        robot: Name of the robot.
        envs: Number of environments per worker, or the initial number if there is a warm-up.
        policy_timeout_s: Maximum time that a policy in the worker process may take for one response [s]. Policy
            servers have their own limits.
        served_at: Address of the host process that serves the policy to all workers, or None.
        task_files: User files that workers load first.
        held: Folders that contain the run folder and are locked by the main process.
        looks: Appearance of objects and rooms ("seen" or "unseen").
        known: Description of the policy at the start of the run, if the policy runs on a server that the user has
            started, or else None.
        world: Benchmark in whose simulator the trials are run.
        most_envs: Maximum number of environments that a warm-up may choose. Without a warm-up, it is at most ``envs``.
        workers: Number of workers in the run. They share the memory of the machine.
        trials: Number of unfinished trials when the run started or was resumed, or 0 if this is not known.
        turn: Index of the worker. It determines the worker's EGL device.
    """

    run: str
    policy: str
    action_space: str
    observation: str
    quality: str
    robot: str
    envs: int = 1
    policy_timeout_s: float = POLICY_TIMEOUT_S
    served_at: str | None = None
    task_files: tuple[TaskFile, ...] = field(default_factory=loaded_files)
    held: tuple[HeldFolder, ...] = field(default_factory=held_folders)
    looks: Looks = "seen"
    known: PolicyInfo | None = None
    world: World = OWN_WORLD
    most_envs: int = 0
    workers: int = 1
    trials: int = 0
    turn: int = 0

    @classmethod
    def of(cls, plan: Plan, run: Path, *, envs: int = 1, policy_timeout_s: float = POLICY_TIMEOUT_S) -> WorkerSettings:
        """Return the settings for a plan and a run folder."""
        return cls(
            str(run.absolute()),
            plan.policy,
            plan.action_space,
            plan.observation,
            plan.quality,
            plan.robot,
            envs,
            policy_timeout_s,
            looks=plan.looks,
            world=plan.world,
        )

    @property
    def asked(self) -> str:
        """Policy address that the workers use."""
        return self.served_at or self.policy

    @property
    def answer_limit_s(self) -> float:
        """Maximum time for a reply of the policy [s].

        For a policy server, the address contains this time. For other policies, it is ``policy_timeout_s``.
        """
        return answer_limit_s(self.policy, self.policy_timeout_s)


class TrialRunner:
    """Runner of the trials of one worker. The trials share the policies, the observer and the simulator processes."""

    def __init__(
        self,
        settings: WorkerSettings,
        *,
        policies: PolicyFactory | None = None,
        on_step: Callable[[int], None] | None = None,
    ) -> None:
        """Create the policy factory, and determine the needs of the policy. Raises a BetterError if this fails."""
        self.settings, self._on_step = settings, on_step
        load_sources(settings.task_files)
        self.run = RunFolder(Path(settings.run), {}, {})
        self.policies = policies or PolicyFactory(
            settings.asked,
            apart=True,
            known=settings.known,
            timeout_s=settings.policy_timeout_s,
            world=settings.world.dialect,
        )
        rate_hz = settings.world.control_rate_hz
        self.info: PolicyInfo = self.policies.check(settings.action_space, settings.observation, rate_hz=rate_hz)
        images = settings.observation if self.info.needs_images else "state_only"
        shown = observation_spec(images).only(self.info.cameras)
        self._observer = Observer(shown, renderers=max(settings.envs, settings.most_envs) + _SPARE_RENDERERS)
        self._processes = WorldProcesses(settings.world.command, trials=settings.trials)

    def steps(self, trial: Trial) -> TrialSteps:
        """Run a trial, and write its record. The scene is also written, unless it is already stored.

        The generator yields the same items as :func:`betterbench.episodes.episode_steps`, or nothing if the policy
        needs no thread. It returns the journal entry, which the caller writes to the journal, because only one process
        may append to the journal.

        Raises:
            PremiseError: If the scene violates an assumption of the instruction. The run must stop.
            StorageError: If the disk is full. The run must stop.
        """
        began = time.perf_counter()
        status: TrialStatus = "done"
        message: str | None = None
        wall: dict[str, float] = {}
        ground_truth: dict[str, str] = {}
        digest: str | None = None
        stored: str | None = None
        scene: TrialScene | None = None
        try:
            scene, context = self._set_up(trial)
            wall["setup_s"] = round(time.perf_counter() - began, 6)
            if not self.policies.needs.thread:
                result, ground_truth = self._run_here(scene, trial, context)
            else:
                result = yield from self._run_asking(scene, context)
            ended = time.perf_counter()
            digest, stored = self._write(scene, result)
            wall |= {**result.wall, "write_s": round(time.perf_counter() - ended, 6)}
            message = result.record.outcome.error
        except (PremiseError, StorageError):
            raise
        except PolicyKilledError as error:
            status, message = "error", f"{error}, {MAX_DEATHS} times; run the same command again to retry it"
        except (PolicyUnavailableError, HandshakeError) as error:
            status, message = "error", str(error)
        except Exception as error:  # noqa: BLE001 - the trial is listed as an error; the run continues
            status, message = "error", described(error)
        finally:
            if scene is not None:
                scene.close(well=digest is not None)
        wall |= {"total_s": round(time.perf_counter() - began, 6), "worker": float(os.getpid())}
        return JournalEntry(
            trial.task,
            trial.condition,
            trial.variation,
            trial.seed,
            status,
            None if message is None else encodable(message),
            wall,
            ground_truth,
            digest,
            stored,
        )

    def close(self) -> None:
        """Close the renderers and unused instances of the policy."""
        self._observer.close()
        self.policies.close()
        self._processes.close()

    @property
    def _shown_by(self) -> Observer | None:
        """Return the observer for the policy, or None for a privileged policy, which gets the state instead."""
        return None if self.policies.needs.state else self._observer

    def _run_here(self, scene: TrialScene, trial: Trial, context: TrialContext) -> tuple[EpisodeResult, dict[str, str]]:
        """Run an episode of a policy that needs no thread.

        Return the result and, for a faulty policy, the ground truth about its fault in this episode.
        """
        policy: AnyPolicy = self.policies.policy(scene, trial)
        try:
            result = run_episode(scene, policy, context=context, observer=self._shown_by, on_step=self._on_step)
            return result, dict(getattr(policy, "ground_truth", {}))
        finally:
            if self.policies.needs.state:
                close_policy(policy)

    def _run_asking(
        self, scene: TrialScene, context: TrialContext
    ) -> Generator[Question | None, Reply | None, EpisodeResult]:
        """Run an episode, and yield its requests to the policy.

        If the policy's process is killed, repeat the episode.
        """
        for left in reversed(range(MAX_DEATHS)):
            try:
                return (
                    yield from episode_steps(
                        scene,
                        context=context,
                        observer=self._shown_by,
                        execution=self.info.execution,
                        on_step=self._on_step,
                    )
                )
            except PolicyKilledError as error:
                if not left:
                    raise
                logger.warning("%s seed %d: %s; the trial is repeated", scene.condition.id, scene.seed, error)
        raise AssertionError("unreachable: the last attempt either returns or raises")

    def _set_up(self, trial: Trial) -> tuple[TrialScene, TrialContext]:
        settings, spec = self.settings, self._observer.spec
        shown = self._shown_by is not None and bool(spec.cameras)
        scene = settings.world.open_scene(
            self._processes,
            task=trial.task,
            condition=trial.condition,
            seed=trial.seed,
            action_space=action_space(settings.action_space),
            images=shown,
            depth=spec.depth,
            options=SceneOptions(settings.quality, settings.robot, settings.looks),
        )
        if not hasattr(scene, "reset"):
            where = place_of(settings.world, "open_scene")
            raise InvalidInputError(where, f"it returned {scene!r:.60}", "Return the scene of the trial")
        context = TrialContext(
            policy=settings.policy,
            variation=trial.variation,
            axis=trial.axis,
            base_condition=trial.base_condition,
            interventions=settings.world.interventions(trial),
            camera_preset=spec.name if shown else None,
        )
        return scene, context

    def _write(self, scene: TrialScene, result: EpisodeResult) -> tuple[str, str]:
        """Write the record of a trial and, unless the file exists, the scene. Return the digests of both files."""
        with on_disk(self.run.path):
            path = self.run.write_record(result.record)
            return file_digest(path), self.run.keep_scene(scene)


def broken_entry(trial: Trial, reason: str) -> JournalEntry:
    """Return the journal entry for a trial that was lost together with its worker."""
    return JournalEntry(trial.task, trial.condition, trial.variation, trial.seed, "error", reason, {})
