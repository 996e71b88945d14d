"""Causal confusion: the policy skips a required step although its object is present, or repeats a finished step."""

from __future__ import annotations

from collections import Counter

from betterbench.diagnosis.analysis.approaches import shuts
from betterbench.diagnosis.analysis.episode_analysis import AttemptTarget, EpisodeAnalysis, Step, finished_on
from betterbench.diagnosis.analysis.halts import find_halt
from betterbench.diagnosis.exposure import Exposure
from betterbench.diagnosis.failure_mode import FailureMode, TrialView, sharper_by_rule
from betterbench.diagnosis.verdict import Evidence
from betterbench.tasks import THRESHOLDS
from betterbench.tasks.authoring.training_distribution import on_table
from betterbench.tasks.labels import Label
from betterbench.tasks.relations import relation


def _exposed(x: Exposure) -> bool:
    """Return whether the initial scene has fewer objects than training scenes, or whether a step can be repeated.

    Scenes that have fewer objects on the table because steps are already done are not considered, since a policy that
    only counts objects acts correctly in them.
    """
    fewer = not x.test.preplaced and len(on_table(x.test)) < x.trained.initial_items
    asked = Counter(goal.reference for goal in x.goals)
    spare = any(len(x.test.resolve(goal.reference)) > asked[goal.reference] for goal in x.goals[:-1])
    return len(x.open_goals) > 1 and (fewer or spare)


@FailureMode(
    Label.CAUSAL_CONFUSION,
    short="causal",
    definition="A required step whose object is present is skipped for a later step, or a finished step is repeated.",
    conclusion="It loses track of its progress: it skips open steps or repeats finished steps.",
    sharper=sharper_by_rule(
        {
            "finished_step_repeated": "It repeats finished steps: it loses track of its progress.",
            "required_step_skipped": "It skips steps that are still open: it loses track of its progress.",
        }
    ),
    finding="Skips a required step or repeats a finished one",
    exposed_by=_exposed,
)
def _find(trial: TrialView) -> Evidence | None:
    episode = trial.episode
    for step in episode.decisions:
        if step.target is AttemptTarget.REPEATED and not _takes_up_a_drop(episode, step):
            missing = _missing_content(episode, step)
            if missing is not None and _fills_another(episode, step.at, missing, step.grasp.start):
                continue
            if missing is not None:
                return episode.at_step("required_step_skipped", _without(episode, step, missing), step)
            on_it = finished_on(episode.trace, episode.instruction, step.grasp.start, step.at)
            done = f"the {episode.kind(on_it[0])} already lies there" if on_it else "that step is done"
            text = f"It goes for {episode.describe(step)}, although {done}; {episode.asked_for(step)}."
            return episode.at_step("finished_step_repeated", text, step)
        if step.target is AttemptTarget.LATER and step.goal is not None:
            if episode.attempted_after(step.goal, step.grasp.start):
                continue
            text = (
                f"It goes for {episode.describe(step)} and never for {episode.asked_words(step.goal)}, "
                "which comes first and is present."
            )
            return episode.at_step("required_step_skipped", text, step)
    return _shut_empty(episode)


def _missing_content(episode: EpisodeAnalysis, step: Step) -> int | None:
    """Return the open subgoal that must be done before the attempted drawer is shut, or None if there is none."""
    drawers = (g for g, names in enumerate(episode.meant) if step.at in names)
    fills = {j for g in drawers for j in episode.fills(g)}
    return next((j for j in episode.open_goals(step.grasp.start) if j in fills), None)


def _without(episode: EpisodeAnalysis, step: Step, missing: int) -> str:
    """Return a sentence about an attempt to shut a drawer before the required object is inside."""
    does = "shuts" if episode.pushes_in(step) else "goes for"
    content, late = episode.asked_words(missing), episode.attempted_after(missing, step.grasp.start)
    if late:
        return f"It {does} {episode.describe(step)} before it goes for {content}, which must be inside first."
    more = "which must be inside first and is present."
    return f"It {does} {episode.describe(step)} and never goes for {content}, {more}"


def _fills_another(episode: EpisodeAnalysis, drawer: int | None, content: int, row: int) -> bool:
    """Return whether the policy shuts a drawer and later puts its intended content into a different drawer.

    If so, the policy chose the wrong target, and shut the first drawer because an open drawer blocks the drawer below
    it. The wrong target then decides the label.
    """
    later = (s for s in episode.steps if s.grasp.start > row and s.at in episode.meant[content])
    places = (found[2].target for s in later if (found := episode.wrong_place(s)) is not None)
    return any(episode.trace.is_drawer(target) and target != drawer for target in places)


def _takes_up_a_drop(episode: EpisodeAnalysis, step: Step) -> bool:
    """Return whether an attempt picks up an object that slipped from the gripper and landed at its target by accident.

    The policy did not place this object, so picking it up again is not a mistake. An object that was dropped into a
    container counts as placed.
    """
    before = [s for s in episode.steps if s.grasp.start < step.grasp.start and s.grasp.object == step.at]
    rows = episode.let_go(before[-1]) if before else None
    i = step.at
    if rows is None or i is None:
        return False
    gone, rest = rows
    trace = episode.trace
    fall = float(trace.positions[gone, i, 2] - trace.positions[rest, i, 2])
    served = [goal for g, goal in enumerate(episode.goals) if trace.serves[rest, g, i]]
    return fall > THRESHOLDS.fall_height and not any(relation(goal.relation).falls for goal in served)


def _shut_empty(episode: EpisodeAnalysis) -> Evidence | None:
    """Return evidence if a drawer is shut, and stays shut, before its content is inside."""
    trace = episode.trace
    pairs = [(goal, j) for goal in range(len(episode.goals)) for j in episode.fills(goal)]
    for goal, j in pairs:
        i = trace.targets[j]
        rows = shuts(trace, i, trace.serves[:, goal, i])
        if rows is None or j not in episode.open_goals(rows[1]):
            continue
        late = episode.attempted_after(j, rows[0])
        if late and (episode.instruction.ordered or episode.attempted_before(j, rows[0])):
            continue  # this is another failure mode: a wrong order, or an earlier miss
        if _fills_another(episode, i, j, rows[0]) or any(step.at == i for step in episode.shut_first):
            continue
        if not trace.closing[rows[1]] and (late or find_halt(episode) is None):
            continue  # an open gripper may have bumped into the drawer in passing
        text = (
            f"It shuts the {episode.kind(i)} before it goes for {episode.asked_words(j)}, which must be inside first."
            if late
            else f"It shuts the {episode.kind(i)} and never goes for {episode.asked_words(j)}, "
            "which must be inside first and is present."
        )
        return episode.evidence("required_step_skipped", text, rows=rows, objects=(i,))
    return None
