"""Metadata for the records of episodes."""

from __future__ import annotations

from dataclasses import dataclass

from betterbench.records import Demonstrator, RecordMetadata
from betterbench.sim.worlds import Tracker, TrialScene
from betterbench.version import __version__


@dataclass(frozen=True, slots=True)
class TrialContext:
    """Information about a trial that is not part of its scene.

    For a training condition, the fields that only apply to variations are None. ``camera_preset`` is the name of the
    observation preset, or None if the policy does not use images.
    """

    policy: str
    variation: str | None = None
    axis: str | None = None
    base_condition: str | None = None
    interventions: tuple[str, ...] = ()
    camera_preset: str | None = None
    demonstrator: Demonstrator | None = None


def describe(scene: TrialScene, tracker: Tracker, context: TrialContext) -> RecordMetadata:
    """Return the metadata for the record of an episode.

    The metadata depends only on the trial, not on the time or the machine.
    """
    found = scene.described(images=context.camera_preset is not None)
    return RecordMetadata(
        task=scene.task.id,
        package_version=__version__,
        condition=scene.condition.name,
        variation=context.variation,
        axis=context.axis,
        base_condition=context.base_condition,
        interventions=context.interventions,
        seed=scene.seed,
        policy=context.policy,
        expected=scene.condition.expected.value,
        action_space=scene.action_space.name,
        action_components=scene.action_space.components,
        control_rate_hz=scene.control_rate_hz,
        camera_preset=context.camera_preset,
        scene_hash=scene.content_hash,
        scene=scene.info,
        task_version=found.task_version,
        suite_version=found.suite_version,
        instruction=found.instruction,
        render_quality=found.render_quality,
        engine=found.engine,
        looks=found.looks,
        room=found.room,
        view_jitter=found.view_jitter,
        robot_dynamics=found.dynamics,
        predicate_names=tracker.relation_names,
        subgoal_names=tracker.subgoal_names,
        demonstrator=context.demonstrator,
    )
