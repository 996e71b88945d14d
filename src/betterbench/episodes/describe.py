"""The metadata of a record."""

from __future__ import annotations

import platform
from dataclasses import dataclass
from typing import Any

from betterbench.records import Demonstrator, RecordMetadata
from betterbench.sim.scenes import Scene, engine_version
from betterbench.sim.worlds import ForeignScene
from betterbench.tasks import SUITE_VERSION, GoalTracker
from betterbench.version import __version__


@dataclass(frozen=True, slots=True)
class TrialContext:
    """Facts of a trial besides its scene; fields are None on a training condition or without images."""

    policy: str
    variation: str | None = None
    axis: str | None = None
    base_condition: str | None = None
    interventions: tuple[str, ...] = ()
    camera_preset: str | None = None
    demonstrator: Demonstrator | None = None


def describe(scene: Scene, tracker: GoalTracker, context: TrialContext) -> RecordMetadata:
    """Return the metadata of an episode's record; a pure function of the trial, free of clocks and machine names."""
    return RecordMetadata(
        **_of_trial(scene, context),
        task_version=scene.task.version,
        suite_version=SUITE_VERSION,
        instruction=scene.condition.instruction.text,
        render_quality=None if context.camera_preset is None else scene.quality.name,
        engine={
            "simulator": "mujoco",
            "mujoco": engine_version(),
            "machine": platform.machine(),
            "model": scene.compiled.content_hash,
        },
        looks=scene.looks,
        room=scene.room.name,
        view_jitter=scene.view_jitter,
        predicate_names=tracker.relation_names,
        subgoal_names=tracker.subgoal_names,
        demonstrator=context.demonstrator,
    )


def describe_foreign(scene: ForeignScene, context: TrialContext) -> RecordMetadata:
    """Return the metadata of an episode in a foreign world, after its reset; otherwise like :func:`describe`."""
    engine = {**scene.engine, "machine": platform.machine()}
    if scene.broken_premises:
        engine["scene_broken_premises"] = ", ".join(scene.broken_premises)
    return RecordMetadata(
        **_of_trial(scene, context),
        task_version=1,
        suite_version=scene.task.suite,
        instruction=scene.whole_instruction,
        render_quality=None if context.camera_preset is None else scene.settings.world,
        engine=engine,
        predicate_names=scene.relation_names,
        subgoal_names=scene.subgoal_names,
    )


def _of_trial(scene: Scene | ForeignScene, context: TrialContext) -> dict[str, Any]:
    """Return the metadata of a trial that are common to all worlds."""
    return {
        "task": scene.task.id,
        "package_version": __version__,
        "condition": scene.condition.name,
        "variation": context.variation,
        "axis": context.axis,
        "base_condition": context.base_condition,
        "interventions": context.interventions,
        "seed": scene.seed,
        "policy": context.policy,
        "expected": scene.condition.expected.value,
        "action_space": scene.action_space.name,
        "action_components": scene.action_space.components,
        "control_rate_hz": scene.control_rate_hz,
        "camera_preset": context.camera_preset,
        "scene_hash": scene.content_hash,
        "scene": scene.info,
    }
