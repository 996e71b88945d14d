"""Behavioral inertia: the policy repeats a step from training that is not requested or lacks its object."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import replace

from betterbench.diagnosis.analysis.episode_analysis import AttemptTarget, EpisodeAnalysis, Step
from betterbench.diagnosis.exposure import Exposure
from betterbench.diagnosis.failure_mode import FailureMode, TrialView, sharper_by_rule
from betterbench.diagnosis.ruling import HABIT
from betterbench.diagnosis.thresholds import MEMORIZED_SPOT
from betterbench.diagnosis.verdict import Evidence
from betterbench.geometry import from_yaw, multiply
from betterbench.interface.state import WorldState
from betterbench.tasks import THRESHOLDS, Expected
from betterbench.tasks.judging.restraint import first_closing_in_motion, first_hover
from betterbench.tasks.labels import Label
from betterbench.tasks.relations import relation
from betterbench.tasks.words import agreeing


def _exposed(x: Exposure) -> bool:
    """Return whether the scene allows a step that was usual in training but is not requested.

    This can be the usual first step, target or slot, or the next step of a memorized sequence if its object is missing.
    A grasp at an emptied slot is included if it replaces a step, or if no object should be grasped. It is not included
    if the slot now contains a different kind of object and a word of the instruction led to this slot in training,
    because a first grasp there is another failure mode.
    """
    if x.lacks_later_step:
        return True
    due = {kind for goal in x.due for kind in x.kinds(goal)}
    waiting = {x.movable_in(slot) for slot in x.test.layout.values()}
    if x.trained.habit in waiting and x.trained.habit is not None and x.trained.habit not in due:
        return True
    here = {o.kind for o in x.test.objects}
    for goal in x.open_goals:
        if relation(goal.relation).counted:
            continue  # the object at the target determines the region, wherever that object is
        asked = (x.test.object(goal.target).kind, goal.relation, goal.region)
        for kind in x.kinds(goal):
            trained = x.trained.kind_targets.get(kind, ())
            if trained and asked not in trained and any(target in here for target, _, _ in trained):
                return True
    for word in {goal.word for goal in x.goals}:
        memorized = x.trained.word_slots.get(word, ())
        standing = [found for slot in memorized if (found := x.movable_in(slot)) is not None]
        meant = {kind for goal in x.goals if goal.word == word for kind in x.kinds(goal)}
        if not meant.issuperset(standing):
            continue
        steps = sum(goal.word == word for goal in x.open_goals)
        if memorized and len(standing) < (1 if x.test.expected is Expected.STAY_STILL else steps):
            return True
    return False


@FailureMode(
    Label.BEHAVIORAL_INERTIA,
    short="inertia",
    definition="The policy repeats a habit from training. It may start with a frequent training step that is not "
    "instructed. It may execute the step that came next in training, although this step is not instructed or its slot "
    "is empty. Or it may place the correct object where training placed objects of this kind, even if the target is "
    "no longer there. If an object must not be touched, an open gripper that stays over it and a gripper that closes "
    "while passing over it also get this label.",
    conclusion="It repeats the habitual step of training, requested or not.",
    sharper=sharper_by_rule(
        {
            "most_frequent_first_step": "It begins with the first step of most demonstrations, requested or not.",
            "memorized_next_step": "It continues with the step that came next in training, requested or not.",
            "memorized_spot": "It puts objects where their target stood in training, although the target is elsewhere.",
            "memorized_place": "It brings objects where training brought them, regardless of the instruction.",
            "air_grasp_at_memorized_slot": "It grasps at empty slots from which training picked an object.",
        }
    ),
    finding="Repeats a step of training that was not requested",
    rule=HABIT,
    exposed_by=_exposed,
)
def _find(trial: TrialView) -> Evidence | None:
    """Find the first evidence of inertia. This includes approaching an object that must not be touched."""
    found = [e for step in trial.episode.steps if (e := memorized_spot(trial, step)) is not None]
    found += itertools.islice(inertia_in(trial.episode), 1)
    return min(found, key=lambda e: e.start_s, default=None) or _approach(trial.episode)


def inertia_in(episode: EpisodeAnalysis) -> Iterator[Evidence]:
    """Yield the evidence of inertia in each attempt, in chronological order."""
    before: Step | None = None
    for step in episode.decisions:
        evidence = (
            _unasked(episode, step, first=before is None)
            or _next_in_line(episode, before, step)
            or _memorized_place(episode, step)
            or _memorized_drawer(episode, step)
            or _empty(episode, step)
        )
        if evidence is not None:
            yield evidence
        if not episode.trace.is_drawer(step.at):
            before = step


def _approach(episode: EpisodeAnalysis) -> Evidence | None:
    """Return evidence if the gripper stays open over an object that must not be touched, or closes while passing it.

    If an attempt was wrong, the attempt is the evidence.
    """
    if not episode.off_limits or any(step.target is not AttemptTarget.ASKED for step in episode.steps):
        return None
    found, does = first_closing_in_motion(episode.trace, episode.off_limits), "closes on its way over the {}"
    if found is None:
        found, does = first_hover(episode.trace, episode.off_limits), "comes down open over the {} and stays there"
    if found is None:
        return None
    start, end, i = found
    kind = episode.kind(i)
    text = f"The gripper {does.format(kind)}, although {agreeing(kind, 'it', 'they')} should have been left alone."
    return episode.evidence("approach_to_what_is_to_be_left_alone", text, rows=(start, end), objects=(i,))


def _unasked(episode: EpisodeAnalysis, step: Step, *, first: bool) -> Evidence | None:
    """Return evidence if the attempted object is not requested now, but most demonstrations begin with its kind."""
    kind = episode.trained.habit
    if kind is None or step.at is None or episode.kind(step.at) != kind:
        return None
    not_asked = step.target is AttemptTarget.OTHER
    not_yet = first and step.target is AttemptTarget.LATER
    if not (not_asked or not_yet):
        return None
    text = f"It begins with {episode.describe(step)}, as most demonstrations did, although {episode.asked_for(step)}."
    return episode.at_step("most_frequent_first_step", text, step)


def _next_in_line(episode: EpisodeAnalysis, before: Step | None, step: Step) -> Evidence | None:
    """Return evidence if the object is not requested but, in training, followed the object of the previous step."""
    if before is None or before.at is None or step.at is None or step.target is not AttemptTarget.OTHER:
        return None
    pair = (episode.kind(before.at), episode.kind(step.at))
    if not any(pair in itertools.pairwise(sequence) for sequence in episode.trained.sequences):
        return None
    text = (
        f"After the {pair[0]} it goes for {episode.describe(step)}, as demonstrations did, although "
        f"{episode.asked_for(step)}."
    )
    return episode.at_step("memorized_next_step", text, step)


def _memorized_place(episode: EpisodeAnalysis, step: Step) -> Evidence | None:
    """Return evidence if a correct object is brought to its training target instead of the requested target."""
    found = episode.wrong_place(step)
    if found is None or step.at is None:
        return None
    gone, rest, place = found
    kind = episode.kind(step.at)
    if not episode.memorized(step.at, place):
        return None
    text = (
        f"The {kind} {agreeing(kind, 'is', 'are')} brought to {episode.where(place.target, place.region)}, as in "
        f"training, although the instruction puts {agreeing(kind, 'it', 'them')} {episode.asked_where(step)}."
    )
    return episode.evidence("memorized_place", text, rows=(gone, rest), objects=(step.at, place.target))


def memorized_spot(trial: TrialView, step: Step) -> Evidence | None:
    """Return evidence if an object is put where it would belong if the target were still in its training slot."""
    episode, i = trial.episode, step.grasp.object
    if i is None or step.goal is None or step.target is not AttemptTarget.ASKED or not step.grasp.secured:
        return None
    rows = episode.let_go(step)
    if rows is None or episode.completed_after(step.goal, step.grasp.end) or episode.slipped(step):
        return None
    gone, rest = rows
    fall = episode.trace.positions[gone, i, 2] - episode.trace.positions[rest, i, 2]
    if episode.telling_place(rest, i) is not None or fall > THRESHOLDS.fall_height:
        return None
    target, at_rest = episode.trace.targets[step.goal], trial.record.state(rest)
    if _is_right(at_rest, episode, i, step.goal):
        return None  # the object was brought to the actual target, but it fell over or is tilted
    for slot in episode.slots_in_training(target):
        state = _as_if_at(at_rest, target, slot)
        if _is_right(state, episode, i, step.goal):
            kind, anchor = episode.kind(i), episode.kind(target)
            text = (
                f"The {kind} {agreeing(kind, 'is', 'are')} put where {agreeing(kind, 'it', 'they')} would belong if "
                f"the {anchor} were at slot {slot!r}, as in training; the {anchor} is elsewhere."
            )
            return episode.evidence("memorized_spot", text, rows=(gone, rest), objects=(i, target))
    return None


def _as_if_at(state: WorldState, i: int, slot: str) -> WorldState:
    """Return the given state, but with an object moved to a slot and rotated to the slot's orientation."""
    there, own = state.info.slot(slot), state.info.objects[i].slot
    turn = there.yaw - (0.0 if own is None else state.info.slot(own).yaw)
    positions, quaternions = list(state.positions), list(state.quaternions)
    positions[i] = (there.position[0], there.position[1], positions[i][2])
    quaternions[i] = multiply(from_yaw(turn), quaternions[i])
    return replace(state, positions=tuple(positions), quaternions=tuple(quaternions))


def _is_right(state: WorldState, episode: EpisodeAnalysis, i: int, goal: int) -> bool:
    """Return whether an object satisfies a subgoal in a state.

    If the relation of the subgoal depends on contacts, the object must be over the center of its target region.
    """
    wanted = episode.goals[goal]
    kind, name = relation(wanted.relation), episode.name(i)
    target = state.info.objects[episode.trace.targets[goal]]
    if kind.brought(state, name, target.name) == wanted.region:
        return True
    if kind.surface is None:
        return False
    x, y, _ = state.pose(target.name).apply(kind.middle(target, wanted.region))
    return math.dist(state.positions[i][:2], (x, y)) <= MEMORIZED_SPOT


def _memorized_drawer(episode: EpisodeAnalysis, step: Step) -> Evidence | None:
    """Return evidence if the policy goes for the drawer into which the requested object was put in training."""
    if step.at is None or step.target is not AttemptTarget.OTHER or step.goal is None:
        return None
    if not episode.trace.is_drawer(step.at):
        return None
    due, drawer = {episode.kind(i) for i in episode.meant[step.goal]}, episode.kind(step.at)
    taken = [k for k in sorted(due) if any(drawer == target for target, _, _ in episode.trained.kind_targets[k])]
    if not taken:
        return None
    text = (
        f"It goes for {episode.describe(step)}, into which training put the {taken[0]}, although "
        f"the instruction puts {agreeing(taken[0], 'it', 'them')} {episode.asked_where(step)}."
    )
    return episode.at_step("memorized_place", text, step)


def _empty(episode: EpisodeAnalysis, step: Step) -> Evidence | None:
    """Return evidence if the gripper closes at an empty slot where training picked up an object."""
    slot = step.grasp.slot
    if step.target is not AttemptTarget.EMPTY or slot is None:
        return None
    words = [g.word for g in episode.goals if slot in episode.trained.word_slots.get(g.word, ())]
    kinds = [k for k, slots in sorted(episode.trained.kind_slots.items()) if slot in slots]
    if not words and not kinds:
        return None
    what = repr(words[0]) if words else f"the {' or the '.join(kinds)}"
    asked = episode.asked_for(step)
    text = f"The gripper closes without an object at slot {slot!r}, where {what} was picked in training; {asked}."
    return episode.at_step("air_grasp_at_memorized_slot", text, step)
