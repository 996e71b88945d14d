"""Benchmark for vla-evaluation-harness, so that ``vla-eval run`` can evaluate a policy on betterbench's tasks.

The harness controls the loop, the model server and its own result file. The benchmark also writes a run folder with the
same records as ``better eval``. Each condition is one task of the harness. Episode i of this task is the trial with
seed ``seed + i``.
"""

from __future__ import annotations

import json
import logging
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from betterbench.episodes.selection import select_conditions
from betterbench.errors import (
    InvalidInputError,
    PolicyError,
    PremiseError,
    RunConflictError,
    StorageError,
)
from betterbench.evaluation.planning.plan import Plan, make_plan
from betterbench.evaluation.running.external_run import ExternalRun
from betterbench.installation import missing_extra
from betterbench.interface import Observation, observation_spec
from betterbench.interface.actions import action_space
from betterbench.policies.conventions.adapter import Adapter
from betterbench.policies.conventions.presets import PRESETS, VLA_EVAL, own_preset
from betterbench.records import Outcome
from betterbench.tasks import TrialId, get_task
from betterbench.tasks.trial import Trial

try:
    from vla_eval.benchmarks.base import StepBenchmark, StepResult
    from vla_eval.recording import NullEpisodeRecorder, RecordingError
    from vla_eval.render import configure_mujoco_render
    from vla_eval.specs import DimSpec
except ImportError as missing:
    raise missing_extra(f"vla-evaluation-harness is not installed ({missing})", "vla-eval") from missing

from betterbench.evaluation.integrations.vla_eval_specs import action_specs, observation_specs

logger = logging.getLogger(__name__)

ADDRESS = "vla-eval:"
"""Prefix of the policy name in records and reports of runs made by the harness."""


class BetterBench(StepBenchmark):  # type: ignore[misc] # the harness has no type information
    """Benchmark for vla-evaluation-harness with all or some conditions of the suite better60.

    Args:
        run: Run folder. If it contains an interrupted run, that run is resumed, and the results of finished trials are
            taken from their records.
        policy: Name of the policy in the report ("pi0-libero"). It is required because the harness does not pass the
            policy's name to a benchmark.
        conditions: Tasks ("fast_food", which stands for all conditions of the task) and single conditions
            ("fast_food/T1", "fast_food/train1"), as a list or one comma-separated string. By default, all conditions of
            better60.
        trials: Number of trials per condition. It must equal ``episodes_per_task``.
        seed: First seed.
        adapter: Name of an adapter preset, or path of a JSON file with an adapter. An adapter describes the format of
            requests and answers.
        cameras: Cameras to use instead of the adapter's cameras, by key in the request ({"images/agentview":
            "left_shoulder"}).
        observation: Name of an observation preset. "state_only" renders no images.
        quality: Name of a rendering preset.
        send_wrist_image: Whether to send the wrist image. Model servers usually request it themselves.
        send_state: Whether to send the state of the robot. Model servers usually request it themselves.
        absolute_action: Whether the model server answers with absolute poses. Absolute poses require an adapter that
            reads ``ee_pose``. Model servers usually declare this setting themselves.
        quat_no_antipodal: Must be True. Model servers also request this value. Rotation vectors in the state are then
            continuous while the tool points down, as in robosuite's data.
    """

    render_backends: ClassVar[frozenset[str]] = frozenset({"gpu", "cpu"})
    _ALL_RECORD_FIELDS = frozenset({"reward", "done", "success", "action"})

    @classmethod
    def configure_render(cls, mode: str) -> dict[str, str]:
        """Choose the renderer. Mode "cpu" selects OSMesa.

        Mode "gpu" selects the renderer in MUJOCO_GL, by default EGL.
        """
        if mode == "cpu" and "mujoco.egl" in sys.modules:
            raise InvalidInputError(
                "render",
                "EGL is already loaded, so cpu rendering cannot be chosen",
                "Unset the environment variable MUJOCO_GL",
            )
        applied: dict[str, str] = configure_mujoco_render(mode)
        return applied

    def __init__(
        self,
        run: str,
        policy: str,
        *,
        conditions: str | Sequence[str] | None = None,
        trials: int = 20,
        seed: int = 0,
        adapter: str = VLA_EVAL.name,
        cameras: dict[str, str] | None = None,
        observation: str = "default",
        quality: str = "standard",
        send_wrist_image: bool = False,
        send_state: bool = False,
        absolute_action: bool = False,
        quat_no_antipodal: bool = True,
    ) -> None:
        """Check all names. The run folder is created when the first episode starts."""
        super().__init__()
        if not quat_no_antipodal:
            raise InvalidInputError("quat_no_antipodal", "must be True", "Omit this argument")
        self._recorder = NullEpisodeRecorder()
        self.adapter = _shaped(
            own_preset(adapter) if adapter in PRESETS else Adapter.load(Path(adapter)),
            cameras or {},
            observation,
            wrist=send_wrist_image,
            state=send_state,
        )
        if absolute_action and self.adapter.answer.space != "ee_pose":
            raise InvalidInputError(
                "absolute_action",
                f"the model server answers with absolute poses, but adapter {self.adapter.name} reads "
                f"{self.adapter.answer.space}",
                "Choose an adapter whose answer has the space ee_pose and the model's rotation format",
            )
        self._out = Path(run).resolve()  # the harness may change the working directory
        self._seed, self._trials = seed, trials
        self.plan = _plan(
            f"{ADDRESS}{policy}",
            select_conditions(conditions),
            trials=trials,
            seed=seed,
            action_space=self.adapter.answer.space,
            observation=observation,
            quality=quality,
        )
        self._run: ExternalRun | None = None
        self._seen: Observation | None = None
        self._current: Trial | None = None
        self._outcome: Outcome | None = None
        self._in_episode = False

    def get_tasks(self) -> list[dict[str, Any]]:
        """Return each condition as a task of the harness.

        For example, "fast_food/T1" is a task in the suite "fast_food".
        """
        named = dict.fromkeys((t.task, t.condition, t.expected) for t in self.plan.trials if not t.ambiguous)
        return [
            {"name": f"{task}/{condition}", "suite": task, "condition": condition, "expected": expected}
            for task, condition, expected in named
        ]

    def reset(self, task: dict[str, Any]) -> Observation:
        """Begin an episode of a task from :meth:`get_tasks`. The number of the episode selects the trial.

        Raises:
            InvalidInputError: If the plan has no trial for this episode.
            PolicyError: If the trial failed with an error.
            RecordingError: If the run must stop, because the disk is full or the folder contains a different run.
        """
        trial = self._current = self._trial(task)
        self._outcome = None
        with _stop_run():
            run = self._open()
            if run.is_done(trial):
                self._outcome = run.outcome(trial)
                logger.warning(
                    "%s seed %d has been run before; the result is taken from its record", task["name"], trial.seed
                )
            self._seen = run.begin(trial)
        self._in_episode = True
        self._record_image()
        return self._seen

    def step(self, action: dict[str, Any]) -> StepResult:
        """Execute the actions that the model server returned.

        As in ``better eval``, an invalid action ends the episode.
        """
        run, seen = self._run, self._seen
        if run is None or seen is None:
            raise InvalidInputError("step", "there is no current episode", "Call reset first")
        after: Observation | None = None
        played: np.ndarray | None = None
        if self._outcome is None:
            with _stop_run():
                try:
                    actions = self.adapter.actions(action, seen)
                except PolicyError as problem:
                    run.fail(str(problem))
                else:
                    after = run.act(actions[0] if len(actions) == 1 else actions)
                    played = actions[0].astype(np.float32)
        self._in_episode = after is not None
        if after is None:
            result = self._end()
        else:
            self._seen = after
            self._record_image()
            result = StepResult(obs=after, reward=0.0, done=False, info={"step": after.step})
        if played is not None:
            won = result.reward > 0.0
            self._recorder.record_step(reward=result.reward, done=result.done, success=won, action=played)
        return result

    def make_obs(self, raw_obs: Observation, task: dict[str, Any]) -> dict[str, Any]:
        """Return the message for the model server, with images, the instruction and, if requested, the robot state."""
        del task
        return self.adapter.request(raw_obs)

    def get_step_result(self, step_result: StepResult) -> dict[str, Any]:
        """Return the result of the episode, in the form that the harness expects.

        If the harness itself ended the episode early (``max_steps``), the harness counts the episode as a failure.
        betterbench's report counts the trial as not run, because the policy might have succeeded later.
        """
        if self._in_episode and self._run is not None:
            self._in_episode = False
            with _stop_run():
                self._run.abandon(f"the harness ended the episode at step {step_result.info.get('step', 0)}")
            return {"success": False, "policy_error": False, "cut_short": True}
        outcome = step_result.info.get("outcome")
        broken = outcome is None or outcome.termination == "policy_error"
        return {"success": _won(outcome), "policy_error": broken, "cut_short": False}

    def get_metric_keys(self) -> dict[str, str]:
        """Return the metrics that the harness averages: success, policy errors, and episodes that were cut short."""
        return {"success": "mean", "policy_error": "mean", "cut_short": "mean"}

    def get_action_spec(self) -> dict[str, DimSpec]:
        """Return the format of each component of the actions (for example position, rotation and gripper)."""
        return action_specs(self.adapter.answer)

    def get_observation_spec(self) -> dict[str, DimSpec]:
        """Return the format of each component of the observations (for example images and the instruction)."""
        return observation_specs(self.adapter)

    def get_metadata(self) -> dict[str, Any]:
        """Return the metadata of the benchmark, including the largest step limit of its tasks.

        The harness ends episodes at this limit unless it was given ``max_steps``.
        """
        conditions = {(t.task, t.condition): t for t in self.plan.trials}
        limits = [found.task.step_limit(found.condition) for found in (t.resolve() for t in conditions.values())]
        return {
            "suite": "better60",
            "max_steps": max(limits),
            "max_episodes_per_task": self._trials,
            "task_versions": {name: get_task(name).version for name in sorted({t.task for t in self.plan.trials})},
        }

    def get_hold_action(self, last_action: dict[str, Any] | None) -> dict[str, Any]:
        """Return an action that keeps the robot still, for the harness's live mode.

        For absolute actions, this is the last action.

        Raises:
            NotImplementedError: If the actions are absolute and there is no last action yet, or if no gripper command
                leaves the gripper unchanged.
        """
        neutral = action_space(self.adapter.answer.space).neutral
        if neutral is not None and self.adapter.answer.gripper.endswith("positive"):
            columns = self.adapter.answer.columns
            return {key[-1]: np.zeros(count, dtype=np.float32) for key, count in columns.items()}
        if last_action is not None and neutral is None:
            return last_action
        raise NotImplementedError(
            "the live mode needs an action that keeps the robot still, but this adapter does not define one"
        )

    def render(self) -> np.ndarray | None:
        """Return the current image of the first camera, or None if the observations contain no images."""
        return None if self._seen is None else next(iter(self._seen.images.values()), None)

    def cleanup(self) -> None:
        """Abandon the current episode and close the renderers."""
        if self._run is not None:
            self._run.close()
            self._run = None

    def _open(self) -> ExternalRun:
        if self._run is None:
            self._run = ExternalRun(
                self.plan,
                self._out,
                needs_images=bool(self.adapter.views),
                metadata={"adapter": json.dumps(self.adapter.to_json())},
                engine=f"vla-eval {version('vla-eval')}",
            )
        return self._run

    def _trial(self, task: dict[str, Any]) -> Trial:
        episode = int(task.get("episode_idx", 0))
        for trial in self.plan.trials:
            if trial.id == TrialId(task["suite"], task["condition"], self._seed + episode):
                return trial
        raise InvalidInputError(
            "episodes_per_task",
            f"the plan has {self._trials} trials per condition, so {task['name']} has no episode {episode} "
            "(episodes are numbered from 0)",
            f"Set params.trials and episodes_per_task to the same number, which must be at least {episode + 1}",
        )

    def _end(self) -> StepResult:
        """Return the result of the episode that has just ended."""
        outcome, run, trial = self._outcome, self._run, self._current
        if outcome is None and run is not None and trial is not None and run.entry is not None:
            if run.entry.status == "error":
                raise PolicyError(f"{trial.task}/{trial.condition} seed {trial.seed}: {run.entry.message}")
            outcome = run.outcome(trial)
        return StepResult(obs=self._seen, reward=float(_won(outcome)), done=True, info={"outcome": outcome})

    def _record_image(self) -> None:
        image = self.render()
        if image is not None:
            self._recorder.record_video(image)


def _won(outcome: Outcome | None) -> bool:
    return outcome is not None and outcome.success


@contextmanager
def _stop_run() -> Iterator[None]:
    """Context manager that stops the whole evaluation after an error that would also occur in every later episode.

    The harness catches all other errors of an episode and continues with the next episode.
    """
    try:
        yield
    except (StorageError, RunConflictError, PremiseError) as problem:
        raise RecordingError(str(problem)) from problem


def _shaped(adapter: Adapter, cameras: dict[str, str], observation: str, *, wrist: bool, state: bool) -> Adapter:
    """Return a copy of the adapter without the images and states that are not sent to the model server."""
    shown = adapter.with_cameras(cameras)
    views = tuple(v for v in shown.views if wrist or "wrist" not in v.key[-1])
    if not observation_spec(observation).cameras:
        views = ()
    return replace(shown, views=views, states=shown.states if state else ())


def _plan(
    policy: str,
    conditions: Sequence[tuple[str, str]],
    *,
    trials: int,
    seed: int,
    action_space: str,
    observation: str,
    quality: str,
) -> Plan:
    """Return a plan that contains the same number of trials for each of the given conditions.

    The trials have the same seeds as in ``better eval``.
    """
    tasks = list(dict.fromkeys(task for task, _ in conditions))
    whole = make_plan(
        policy,
        tasks=tasks,
        trials=trials,
        seed=seed,
        action_space=action_space,
        observation=observation,
        quality=quality,
    )
    kept = [t for t in whole.trials if (t.task, t.condition) in conditions and t.seed < seed + trials]
    order = {condition: i for i, condition in enumerate(conditions)}
    return replace(whole, trials=tuple(sorted(kept, key=lambda t: (order[t.task, t.condition], t.seed))))
