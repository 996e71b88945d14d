"""Attempts to build a certified task from a scenario.

A task that fails its certificate is changed and checked again: first without the variations that failed, then with more
demonstrations, then with other slots, and finally with other assets.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

from betterbench.errors import BetterError, one_line
from betterbench.generation.building.casting import cast_of
from betterbench.generation.building.choice import Choice
from betterbench.generation.building.proving import Proof, prove, provisional, without
from betterbench.generation.building.result import Attempt, Failure, Settings
from betterbench.generation.building.viewing import badly_framed
from betterbench.generation.patterns import GeneratedTask, pattern_of
from betterbench.generation.scenario import Scenario
from betterbench.generation.sense import require_groups
from betterbench.generation.stated_goal import goal_problems
from betterbench.sim.assets.catalogue.search import Catalogue
from betterbench.tasks import Task, task_to_json
from betterbench.tasks.authoring.regimes import ListedRegime
from betterbench.tasks.authoring.templates import TEMPLATES
from betterbench.tasks.demonstrated import measured_so_far
from betterbench.tasks.interventions import vary

_UNSEEN = "a training condition is not in view"
FEWEST_VARIATIONS, FEWEST_AXES = 4, 3
"""Minimum number of variations of a task, and minimum number of axes that they cover."""


@dataclass(frozen=True, slots=True)
class _Change:
    """Change to a task that is tried after an attempt to build the task has failed.

    Attributes:
        words: Description of the change.
        slots: Seed for choosing the slots at random.
        assets: Index of the choice of assets, starting at 0. Each choice uses different assets.
        demonstrations: Factor for the number of demonstrations.
    """

    words: str
    slots: int = 0
    assets: int = 0
    demonstrations: int = 1


CHANGES = (
    _Change("as described"),
    _Change("three times the demonstrations", demonstrations=3),
    _Change("other slots", slots=1),
    _Change("other slots", slots=2),
    _Change("other assets for the same descriptions", assets=1),
)
"""Changes in the order in which they are tried.

More demonstrations help only if a pose is outside the training distribution (clause b).
"""


@dataclass(frozen=True, slots=True)
class Built:
    """Result of all attempts to build a task from a scenario.

    Attributes:
        scenario: Scenario that the task should be built from.
        task_id: Identifier of the task.
        made: Task of the successful attempt. None if every attempt failed.
        proof: Demonstrations and certificates of the task. None if every attempt failed.
        choices: Assets chosen for the descriptions.
        attempts: All attempts. The last attempt succeeded if ``made`` is not None.
        left_out: Variations that were left out because they failed their certificate.
    """

    scenario: Scenario
    task_id: str
    made: GeneratedTask | None
    proof: Proof | None
    choices: tuple[Choice, ...]
    attempts: tuple[Attempt, ...]
    left_out: tuple[Failure, ...] = ()


def build_task(
    scenario: Scenario,
    task_id: str,
    catalogue: Catalogue,
    *,
    settings: Settings,
) -> Built:
    """Build a certified task from a scenario, or return the reason why every attempt failed.

    A scenario is rejected without an attempt if its groups are not the groups of the template, or if its instruction
    states a goal that the template does not support.
    """
    problem = _problem_of(scenario)
    if problem:
        return Built(scenario, task_id, None, None, (), (Attempt(CHANGES[0].words, problem),))
    attempts: list[Attempt] = []
    tried: list[GeneratedTask] = []
    for change in CHANGES:
        more = change.demonstrations > 1
        if more and not (attempts and attempts[-1].failures and all(f.clause == "b" for f in attempts[-1].failures)):
            continue
        try:
            cast, chosen = cast_of(scenario, catalogue, seed=change.slots, attempt=change.assets)
            made = pattern_of(scenario.template)(cast)
            if made in tried and not more:
                attempts.append(Attempt(change.words, "there are none"))
                continue
            tried.append(made)
            balanced = ListedRegime(made.balanced, made.crossed, made.aside)
            regimes = {"balanced": balanced} if made.balanced else {}
            task = dataclasses.replace(made.task, id=task_id, regimes=regimes)
            lacking = _lacking(task)
            if lacking:
                reasons = "; ".join(f"{u.title}: {u.reason}" for u in made.unbuilt)
                attempts.append(Attempt(change.words, f"{lacking} ({reasons})" if reasons else lacking))
                continue
            with provisional(task) as known:
                # Before the long examination, reject a task that cannot be written to a file.
                task_to_json(known)
                # Conditions with pre-placed objects cannot be built yet, because they start in final states of
                # demonstrations.
                bare = [c for c in known.training if not c.preplaced]
                unseen = badly_framed(known, bare, seeds=settings.seeds)
                if unseen:
                    attempts.append(Attempt(change.words, _UNSEEN, unseen))
                    continue
                number = max(settings.demonstrations, len(known.training)) * change.demonstrations
                proof = prove(known, settings.seeds, number)
                proven = without(known, [f.condition for f in proof.failures])
                with measured_so_far(known.id, proof.demonstrated):
                    others = [c for c in known.training if c.preplaced] + [vary(known, v)[0] for v in proven.variations]
                    unseen = badly_framed(known, others, seeds=settings.seeds)
        except BetterError as error:
            attempts.append(Attempt(change.words, one_line(str(error), most=600)))
            continue
        failures = (*proof.failures, *unseen)
        reduced = without(known, [f.condition for f in failures])
        lacking = _untrained(known, proof.failures, unseen) or _lacking(reduced)
        if failures and lacking:
            attempts.append(Attempt(change.words, lacking, failures))
            continue
        attempts.append(Attempt(change.words, "", failures))
        kept = {c.name for c in reduced.training} | {v.name for v in reduced.variations}
        passed = dataclasses.replace(proof, trials=tuple(t for t in proof.trials if t.condition in kept))
        final = dataclasses.replace(made, task=reduced)
        return Built(scenario, task_id, final, passed, tuple(chosen), tuple(attempts), failures)
    return Built(scenario, task_id, None, None, (), tuple(attempts))


def _problem_of(scenario: Scenario) -> str:
    """Return the reason why no task can be built from a scenario, or an empty string if an attempt may succeed."""
    try:
        require_groups(scenario)
    except BetterError as error:
        return one_line(str(error), most=600)
    asked = goal_problems(scenario, TEMPLATES[scenario.template])
    return next((one_line(f"instruction: {problem}. {cure}.", most=600) for problem, cure in asked), "")


def _untrained(task: Task, failures: Sequence[Failure], unseen: Sequence[Failure]) -> str:
    """Return the reason why the training conditions of a task are unusable, or an empty string if they are usable."""
    training = {c.name for c in task.training}
    if any(f.condition in training for f in failures):
        return "a training condition is not certified"
    return _UNSEEN if any(f.condition in training for f in unseen) else ""


def _lacking(task: Task) -> str:
    """Return a message if too few variations of a task are left, or an empty string."""
    axes = {v.axis for v in task.variations}
    if len(task.variations) >= FEWEST_VARIATIONS and len(axes) >= FEWEST_AXES:
        return ""
    return (
        f"{len(task.variations)} variations over {len(axes)} axes are left, but {FEWEST_VARIATIONS} over "
        f"{FEWEST_AXES} are needed"
    )
