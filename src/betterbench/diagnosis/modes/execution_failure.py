"""Execution failure: the policy attempts the correct target at the right time, but the manipulation fails."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from betterbench.diagnosis.analysis.approaches import (
    Stay,
    closes_in_part,
    comes_shut,
    runs_into,
)
from betterbench.diagnosis.analysis.episode_analysis import AttemptTarget, EpisodeAnalysis, Means, Step
from betterbench.diagnosis.analysis.halts import find_halt, in_fingers
from betterbench.diagnosis.failure_mode import FailureMode, TrialView
from betterbench.diagnosis.modes.behavioral_inertia import memorized_spot
from betterbench.diagnosis.thresholds import CLOSED_IN_PART, SHARE_OF_ALL, SHOVED_AGAIN, STAY_TIME, TRIES_IN_VAIN
from betterbench.diagnosis.verdict import Evidence, TrialDiagnosis
from betterbench.geometry import tilt_of
from betterbench.tasks import THRESHOLDS, Expected
from betterbench.tasks.judging.restraint import moved_from_start
from betterbench.tasks.labels import Label
from betterbench.tasks.relations import lies_on_side, relation
from betterbench.tasks.relations.closed import DRAWN_OUT, PUSHED_IN
from betterbench.tasks.thresholds import DISPLACED
from betterbench.tasks.words import agreeing, is_plural
from betterbench.wording import listed, plural

_KNOCKS = "knocks objects over or out of place"
_HOW = {
    "missed_by_pose": "closes beside them",
    "weak_grip": "hardly closes its fingers on them",
    "slipped": "does not lift them",
    "run_into": "runs into them with its open fingers",
    "comes_shut": "comes to them with its fingers shut",
    "closed_in_part": "does not close its fingers far enough",
    "pushed": "pushes them away",
    "dropped": "drops them",
    "stuck_on_fingers": "does not get them off its open fingers",
    "placed_outside_the_goal": "puts them down outside the goal",
    "drawer_left_halfway": "leaves drawers halfway",
    "collided": _KNOCKS,
    "knocked_out_of_place": _KNOCKS,
    "harm": _KNOCKS,
}
"""Clauses about failed manipulation, by evidence rule. Each follows "It goes for the correct objects, but"."""


_UNTOLD = {
    "missed_between": "between two objects",
    "missed_by_far": "far from all objects",
}
"""Clauses that describe a gripper that closed on nothing and whose target is unknown, by evidence rule."""


def _untold(trial: TrialDiagnosis) -> str:
    """Describe where the gripper first closed, or return "" if this shows which object was the target."""
    where = _UNTOLD.get(trial.evidence.rule, "")
    return where or ("between two objects" if trial.intention_correct is None and trial.attempts else "")


def _aims_right(trial: TrialDiagnosis) -> bool:
    """Return whether the first attempt or the evidence rule shows that the target was correct.

    Evidence that an object was knocked over or brushed against does not show the target.
    """
    return trial.intention_correct is True or _HOW.get(trial.evidence.rule, _KNOCKS) != _KNOCKS


def _sharper(trials: Sequence[TrialDiagnosis]) -> str:
    """Return a sentence about the failed manipulation, if nearly all trials have the same one or two kinds of failure.

    The sentence also states that the policy goes for the correct objects, but only if nearly all of these trials show
    what the target was.
    """
    untold = Counter(where for trial in trials if (where := _untold(trial)))
    if untold.total() > (1.0 - SHARE_OF_ALL) * len(trials):
        where = " or ".join(place for place, _ in untold.most_common())
        if untold.total() >= SHARE_OF_ALL * len(trials):
            return f"It closes its gripper {where}; its target is unknown."
        share = f"in {untold.total()} of {len(trials)} of these trials it closes {where}"
        return f"Its manipulation fails; {share}, so its target is unknown."
    told = [trial for trial in trials if not _untold(trial)]
    ways = Counter(_HOW.get(trial.evidence.rule, "") for trial in told).most_common(2)
    named = ways[:1] if ways[0][1] >= SHARE_OF_ALL * len(trials) else ways
    known = all(way for way, _ in named) and sum(count for _, count in named) >= SHARE_OF_ALL * len(trials)
    how = " or ".join(way for way, _ in named) if known else ""
    aimless = sum(not _aims_right(trial) for trial in trials)
    if aimless > (1.0 - SHARE_OF_ALL) * len(trials):
        said = f": it {how.replace('them', 'objects')}" if how else ""
        return f"Its manipulation fails{said}; {aimless} of {len(trials)} of these trials do not show its target."
    return f"It goes for the correct objects, but {how}." if how else ""


def _about(trials: Sequence[TrialDiagnosis]) -> str:
    """Return a clause that states whether the targets of the failed attempts are known to be correct."""
    untold = sum(bool(_untold(trial)) for trial in trials)
    if untold == len(trials):
        return ", with an unknown target"
    return " of the correct target" + (f", or of an unknown target ({plural(untold, 'trial')})" if untold else "")


@FailureMode(
    Label.EXECUTION_FAILURE,
    short="execution",
    definition="The policy attempts the correct target at the right time, but the manipulation fails. Examples: the "
    "object is missed, slips, is dropped or is knocked away; the arm collides; a drawer is left halfway; another "
    "object is harmed.",
    conclusion="It goes for the correct objects, but its manipulation fails.",
    sharper=_sharper,
    finding="Fails at the manipulation",
    detail=_about,
)
def _find(trial: TrialView) -> Evidence | None:
    """Find the first failure that was not corrected later.

    If there is none, find a goal that was missed for no other known reason.
    """
    episode = trial.episode
    if trial.unexplained:
        return None if trial.out_of_time else _goal_not_held(episode)
    found = [e for step in episode.steps if (e := _of_step(trial, step)) is not None]
    others = (_stuck, _knocked, _undone, _forbidden_touch, _harm, _pushed, _around_it, _not_shut, _far_off)
    found += [e for find in others if (e := find(episode)) is not None]
    return min(found, key=lambda e: e.start_s, default=None)


def _goal_not_held(episode: EpisodeAnalysis) -> Evidence:
    """Return evidence for an episode in which every attempt was correct but the goal was not met."""
    last = episode.trace.rows - 1
    if episode.condition.expected is not Expected.SUCCEED:
        text = "No wrong object was grasped, but the arm did not come to rest or touched an object."
        return episode.evidence("goal_not_held", text, rows=(last, last))
    done = episode.trace.done
    lost = [g for g in range(done.shape[1]) if not done[last, g]]
    things = tuple(dict.fromkeys(i for g in lost for i in episode.meant[g]))
    kinds = list(dict.fromkeys(episode.kind(i) for i in things))
    many = len(kinds) > 1 or any(map(is_plural, kinds))
    state = "are" if many else "is"
    which = f": the {listed(kinds)} {state} not at rest and released at the target" if kinds else " for long enough"
    text = f"Every attempt was correct, but the goal is not met at the end{which}."
    return episode.evidence("goal_not_held", text, rows=(last, last), objects=things)


def _of_step(trial: TrialView, step: Step) -> Evidence | None:
    """Return evidence if an attempt was the correct decision but the manipulation failed, otherwise None."""
    episode = trial.episode
    if step.target is not AttemptTarget.ASKED or step.goal is None:
        return None
    if episode.completed_after(step.goal, step.grasp.end):
        return None
    if _brought_later(trial, step) or _held_later(episode, step, step.goal):
        return None
    i = step.grasp.object
    if step.means is Means.TRY and step.at is not None:
        return _weak_grip(episode, step, step.at)
    if step.between is not None and step.at is not None:
        how, why = _between_words(episode, step)
        text = (
            f"The gripper closes{how} between the {episode.kind(step.at)}, the correct object, and the "
            f"{episode.kind(step.between)}, {why}: either may have been the target."
        )
        return episode.at_step("missed_between", text, step)
    if i is None:
        missed = "an empty slot" if step.at is None else f"the {episode.kind(step.at)}"
        return episode.at_step("missed_by_pose", f"The gripper closes beside {missed}, the correct object.", step)
    drawer = episode.trace.is_drawer(i)
    if drawer and _moved_later(episode, step, i):
        return None
    if not step.grasp.secured:
        if episode.trace.left[-1, i] and episode.trace.right[-1, i] and not _tried_in_vain(episode, i):
            return None  # the episode ended before the object between the fingers could be lifted
        if any(s.grasp.object == i and s.grasp.secured and s.grasp.start > step.grasp.start for s in episode.steps):
            return None  # a later grasp lifted the object and decides instead
        text = f"The gripper closes on the {episode.kind(i)}, the correct object, but does not lift it."
        return episode.at_step("slipped", text, step)
    return _halfway(episode, step, i) if drawer else _lost(episode, step, i)


def _weak_grip(episode: EpisodeAnalysis, step: Step, i: int) -> Evidence:
    """Return evidence if the gripper closed at the correct target without gripping it."""
    kind, grasp, trace = episode.kind(i), step.grasp, episode.trace
    if trace.touched[grasp.start : grasp.release, i].any():
        text = f"The gripper closes slightly at the {kind}, the correct object, and does not hold it."
        return episode.at_step("weak_grip", text, step)
    if trace.width[grasp.start] - trace.width[grasp.end] >= CLOSED_IN_PART:
        text = f"The fingers close around the {kind}, the correct object, without touching it."
        return episode.at_step("closed_in_part", text, step)
    text = f"The gripper is commanded to close at the {kind}, the correct object, and its fingers hardly move."
    return episode.at_step("weak_grip", text, step)


def _between_words(episode: EpisodeAnalysis, step: Step) -> tuple[str, str]:
    """Return two clauses: how the gripper closed between two objects, and why the target is ambiguous."""
    before = max(0, step.grasp.start - episode.trace.steps(THRESHOLDS.attempt_window))
    if step.between is not None and episode.trace.touched[before : step.grasp.end + 1, step.between].any():
        return "", "on which a finger presses too"
    return " on nothing", "which is as near"


def _tried_in_vain(episode: EpisodeAnalysis, i: int) -> bool:
    """Return whether the policy had already tried several times to grasp an object, without success."""
    tries = [s for s in episode.steps if s.grasp.object == i and s.target is AttemptTarget.ASKED]
    vain = [s for s in tries[:-1] if not episode.completed_after(s.goal, s.grasp.end)]
    return len(vain) >= TRIES_IN_VAIN


def _held_later(episode: EpisodeAnalysis, step: Step, goal: int) -> bool:
    """Return whether the gripper holds the object of a later attempt for the same subgoal when the episode ends."""
    held = int(episode.trace.held[-1])
    if step.grasp.object is not None and _tried_in_vain(episode, step.grasp.object):
        return False
    later = {s.grasp.object for s in episode.steps if s.grasp.start > step.grasp.start}
    return held in later & set(episode.meant[goal])


def _pushed(episode: EpisodeAnalysis) -> Evidence | None:
    """Return evidence if the gripper pushed the correct target and never grasped it."""
    for step in episode.others:
        if step.means is not Means.PUSH or step.target is not AttemptTarget.ASKED or step.at is None:
            continue
        if episode.completed_after(step.goal, step.grasp.end):
            continue
        start, end = step.grasp.start, step.grasp.end
        way = episode.trace.positions[end, step.at] - episode.trace.positions[max(0, start - 1), step.at]
        cm = 100 * float(np.linalg.norm(way[:2]))
        far = f" over {cm:.0f} cm" if cm >= 1.0 else ""  # the object may have moved back, or only rotated
        text = f"The gripper pushes the {episode.kind(step.at)}, the correct object,{far} and does not grasp it."
        return episode.at_step("pushed", text, step)
    return _shoved_aside(episode)


def _shoved_aside(episode: EpisodeAnalysis) -> Evidence | None:
    """Return evidence if the gripper repeatedly moved the correct target by less than a push and never grasped it."""
    times: dict[int, list[Stay]] = {}
    for shove in episode.shoves:
        due = episode.wanted(shove.start)
        if shove.object in due and not any(s.at == shove.object for s in episode.steps):
            times.setdefault(shove.object, []).append(shove)
    for i, shoves in times.items():
        if len(shoves) < SHOVED_AGAIN or episode.trace.there[-1, i]:
            continue
        text = f"The gripper moves the {episode.kind(i)}, the correct object, aside repeatedly and never grasps it."
        return episode.evidence("pushed", text, rows=(shoves[0].start, shoves[-1].end), objects=(i,))
    return None


def _around_it(episode: EpisodeAnalysis) -> Evidence | None:
    """Return evidence if the gripper came to the correct target but failed to grasp it.

    The gripper may have arrived with closed fingers, run into the target, or never closed far enough.
    """
    stay = next((s for s in episode.others if s.means is Means.STAY and s.target is AttemptTarget.ASKED), None)
    if stay is None or stay.at is None:
        return None
    trace, kind, objects = episode.trace, episode.kind(stay.at), (stay.at,)
    rows = comes_shut(trace, episode.idle_from, stay.at)
    if rows is not None:
        text = f"The gripper comes to the {kind}, the correct object, with its fingers shut."
        return episode.evidence("comes_shut", text, rows=rows, objects=objects)
    rows = runs_into(trace, episode.idle_from, stay.at)
    if rows is not None:
        text = f"The open gripper repeatedly runs into the {kind}, the correct object, and never grasps it."
        return episode.evidence("run_into", text, rows=rows, objects=objects)
    rows = closes_in_part(trace, episode.idle_from, stay.at)
    if rows is None:
        return None
    text = f"The fingers close around the {kind}, the correct object, without touching it."
    return episode.evidence("closed_in_part", text, rows=rows, objects=objects)


def _not_shut(episode: EpisodeAnalysis) -> Evidence | None:
    """Return evidence if the closed gripper tried to push a drawer shut but did not push it far enough."""
    trace, last = episode.trace, episode.trace.rows - 1
    if not episode.fists or find_halt(episode) is not None:
        return None
    fist = episode.fists[-1]
    for g in episode.open_goals(last):
        if relation(episode.goals[g].relation).carried:
            continue
        i, lately = episode.meant[g][0], last - trace.steps(THRESHOLDS.halt_time)
        openings = [trace.opening(row, i) for row in range(fist.start, trace.rows)]
        then, now = openings[: max(lately - fist.start, 0)], openings[max(lately - fist.start, 0) :]
        if fist.release > last and (not then or min(then) - min(now) > THRESHOLDS.rest_travel):
            return None  # the step limit was reached during the push
        text = f"The closed gripper should push the {episode.kind(i)}, the correct object, shut, but leaves it open."
        return episode.evidence("drawer_left_halfway", text, rows=(fist.start, min(fist.release, last)), objects=(i,))
    return None


def _far_off(episode: EpisodeAnalysis) -> Evidence | None:
    """Return evidence if the gripper closed far from all objects and no later attempt shows the target.

    Since the target is unknown, this evidence does not concern the policy's reasoning.
    """
    trace = episode.trace
    for closing in episode.on_nothing:
        due = episode.open_goals(closing.start)
        if not due or any(s.grasp.start >= closing.start for s in episode.decisions):
            continue
        tool = trace.tool[closing.end]
        gaps = trace.box_distances(closing.end, tool)
        near = min(trace.items, key=lambda i: (gaps[i], i), default=None)
        where = "" if near is None else f", {100 * gaps[near]:.0f} cm from the {episode.kind(near)}, the nearest object"
        text = f"The gripper closes without an object{where}; the instruction asks for {episode.asked_words(due[0])}."
        return episode.evidence("missed_by_far", text, rows=(closing.start, closing.end))
    return None


def _brought_later(trial: TrialView, step: Step) -> bool:
    """Return whether a later attempt for the same subgoal brought its object to some target region.

    The result is True even if the region is the wrong one, because only the manipulation is judged here. An object that
    was released high above a region may have landed there by accident, unless the target is a container.
    """
    episode = trial.episode
    for later in episode.steps:
        if later.at is None or later.grasp.start <= step.grasp.start or later.goal != step.goal:
            continue
        if memorized_spot(trial, later) is not None:
            return True
        found = episode.wrong_place(later)
        if found is None:
            continue
        gone, rest, place = found
        heights = episode.trace.positions[[gone, rest], later.at, 2]
        if relation(place.relation).falls or heights[0] - heights[1] <= THRESHOLDS.fall_height:
            return True
    return False


def _moved_later(episode: EpisodeAnalysis, step: Step, drawer: int) -> bool:
    """Return whether the drawer is opened or closed as far as the step requires at any time after the attempt.

    The result is always False if the step only requires shutting the drawer.
    """
    trace = episode.trace
    if step.goal is not None and not relation(episode.goals[step.goal].relation).carried:
        return False
    openings = [trace.opening(row, drawer) for row in range(step.grasp.end, trace.rows)]
    if step.goal is not None and trace.targets[step.goal] == drawer:
        return max(openings) >= DRAWN_OUT
    return min(openings) <= PUSHED_IN


def _halfway(episode: EpisodeAnalysis, step: Step, drawer: int) -> Evidence | None:
    """Return evidence if the gripper released a drawer halfway and nothing moved the drawer farther."""
    if episode.trace.left[-1, drawer] and episode.trace.right[-1, drawer]:
        return None  # the episode ended while the drawer was in the gripper
    text = f"The gripper moves the {episode.kind(drawer)}, the correct object, and leaves it halfway."
    return episode.at_step("drawer_left_halfway", text, step)


def _lost(episode: EpisodeAnalysis, step: Step, i: int) -> Evidence | None:
    """Return evidence if an object left the gripper and came to rest outside all plausible target regions."""
    trace, rows = episode.trace, episode.let_go(step)
    if rows is None:
        return None
    gone, rest = rows
    wanted = episode.telling_place(rest, i) is not None and not episode.slipped(step)
    if wanted or trace.serves[rest, :, i].any() or episode.put_down(step) is not None or _put_back(episode, step, rows):
        return None
    kind, fall = episode.kind(i), float(trace.positions[gone, i, 2] - trace.positions[rest, i, 2])
    if fall > THRESHOLDS.fall_height:
        how, height = "drops" if gone >= step.grasp.release else "loses", f"{100 * fall:.0f} cm"
        comes = agreeing(kind, "it comes", "they come")
        text = f"The gripper {how} the {kind}, the correct object, {height} above where {comes} to rest."
        return episode.evidence("dropped", text, rows=(gone, rest), objects=(i,))
    if gone < step.grasp.release:
        verb = agreeing(kind, "slips", "slip")
        text = f"The {kind}, the correct object, {verb} out of the closed gripper and {agreeing(kind, 'stays', 'stay')}"
        return episode.evidence("dropped", f"{text} outside the goal.", rows=(gone, rest), objects=(i,))
    how = (
        f"left on {agreeing(kind, 'its', 'their')} side"
        if _lies_in_goal(episode, rest, i)
        else "released outside the target region"
    )
    text = f"The {kind}, the correct object, {agreeing(kind, 'is', 'are')} {how}."
    return episode.evidence("placed_outside_the_goal", text, rows=(gone, rest), objects=(i,))


def _put_back(episode: EpisodeAnalysis, step: Step, rows: tuple[int, int]) -> bool:
    """Return whether the policy returned an object to its earlier position and then attempted a wrong object.

    If so, the policy gave up the correct object for another one, so its manipulation did not fail.
    """
    trace, i, (gone, rest) = episode.trace, step.grasp.object, rows
    if i is None or gone < step.grasp.release:
        return False
    before, then, now = trace.positions[[step.grasp.start, gone, rest], i]
    following = next((s for s in episode.decisions if s.grasp.start > rest), None)
    gave_up = following is not None and following.target is not AttemptTarget.ASKED
    moved = float(np.linalg.norm(now[:2] - before[:2]))
    return gave_up and moved <= DISPLACED and float(then[2] - now[2]) <= THRESHOLDS.fall_height


def _lies_in_goal(episode: EpisodeAnalysis, row: int, i: int) -> bool:
    """Return whether an object that must stay upright lies on its side at a target of the instruction."""
    thing = episode.trace.info.objects[i]
    if episode.state is None or not thing.keeps_upright:
        return False
    state = episode.state(row)
    return lies_on_side(state, thing.name) and any(
        relation(goal.relation).anyhow(state, thing.name, goal.target) is not None for goal in episode.goals
    )


def _stuck(episode: EpisodeAnalysis) -> Evidence | None:
    """Return evidence if the gripper opened but the correct object stayed on the open fingers until the end.

    For example, a mug can jam on the fingers. An arm that rests afterward has not halted, because the policy has
    released the object.
    """
    trace, last = episode.trace, episode.trace.rows - 1
    opened = int(np.flatnonzero(trace.closing)[-1]) + 1 if trace.closing.any() else 0
    if not 0 < opened <= last - trace.steps(STAY_TIME):
        return None
    for step in episode.steps:
        i = step.grasp.object
        if i is None or step.target is not AttemptTarget.ASKED or not step.grasp.secured or trace.is_drawer(i):
            continue
        raised = trace.positions[last, i, 2] - trace.positions[0, i, 2] > THRESHOLDS.begun_lift
        if in_fingers(trace, last) == i and raised and not trace.there[last, i]:
            kind = episode.kind(i)
            stays = agreeing(kind, "stays", "stay")
            text = f"The gripper opens, but the {kind}, the correct object, {stays} on its open fingers to the end."
            return episode.evidence("stuck_on_fingers", text, rows=(opened, last), objects=(i,))
    return None


def _knocked(episode: EpisodeAnalysis) -> Evidence | None:
    """Return evidence if a required object was knocked over or off the table without having been grasped."""
    trace = episode.trace
    grasped = {s.at for s in episode.steps}
    needed = episode.asked_indices | {i for i, o in enumerate(trace.info.objects) if o.role == "container"}
    found: list[tuple[int, int]] = []
    for i in sorted(needed - grasped):
        if trace.info.objects[i].fixed or trace.there[-1, i]:
            continue
        w2 = 1.0 - 2.0 * (trace.quaternions[:, i, 1] ** 2 + trace.quaternions[:, i, 2] ** 2)
        down = (w2 < np.cos(THRESHOLDS.knocked_tilt)) | (trace.positions[:, i, 2] < -THRESHOLDS.fallen_below)
        start = tuple(float(v) for v in trace.quaternions[0, i])
        if down.any() and tilt_of((start[0], start[1], start[2], start[3])) < THRESHOLDS.knocked_tilt:
            found.append((int(np.argmax(down)), i))
    if not found:
        return None
    row, i = min(found)
    text = f"The {episode.kind(i)} {agreeing(episode.kind(i), 'is', 'are')} knocked over without having been grasped."
    return episode.evidence("collided", text, rows=(row, row), objects=(i,))


def _harm(episode: EpisodeAnalysis) -> Evidence | None:
    """Return evidence if an object that was not requested was moved or otherwise harmed.

    If the gripper knocks an object aside and then closes on it, this object was the target, and the evidence begins at
    this attempt. If the harm was done by opening a drawer to reach a wrong object, the evidence begins when this object
    was chosen.
    """
    if not episode.harm:
        return None
    row, harm = episode.harm[0]
    at = episode.trace.info.index(harm.object)
    following = next((step for step in episode.decisions if step.grasp.start >= row), None)
    if following is not None and following.at == at:
        row = following.grasp.end
    first = episode.first_choice
    if first is not None and any(step.at == at for step in episode.opened_first):
        row = max(row, first.grasp.end)
    words, it = harm.words(episode.trace.info), agreeing(episode.kind(at), "it", "they")
    text = f"{words[0].upper()}{words[1:]}; {it} should have been left alone."
    return episode.evidence("harm", text, rows=(row, row), objects=(at,))


def _undone(episode: EpisodeAnalysis) -> Evidence | None:
    """Return evidence if a finished subgoal was undone and not completed again."""
    trace = episode.trace
    found: list[tuple[int, int]] = []
    for g, goal in enumerate(episode.goals):
        there = trace.serves[:, g, list(episode.meant[g])].sum(axis=1) >= goal.count
        if trace.done[:, g].any() and there.any() and not there[-1]:
            found.append((int(np.flatnonzero(there)[-1]) + 1, g))
    if not found:
        return None
    row, g = min(found)
    kinds = " or ".join(dict.fromkeys(episode.kind(i) for i in episode.meant[g]))
    was, now = agreeing(kinds, "was", "were"), agreeing(kinds, "is", "are")
    text = f"The {kinds} {was} at the target and {now} knocked away."
    return episode.evidence("knocked_out_of_place", text, rows=(row, row), objects=episode.meant[g])


def _forbidden_touch(episode: EpisodeAnalysis) -> Evidence | None:
    """Return evidence if an object that must not be touched was touched or moved, but was not attempted."""
    wrong = any(step.target is not AttemptTarget.ASKED for step in episode.decisions)
    if episode.condition.expected is Expected.SUCCEED or wrong:
        return None
    trace = episode.trace
    if episode.condition.expected.lacks_target:  # requested objects that are in the scene may be grasped
        items = {i for i in trace.items if trace.info.objects[i].role != "drawer"} - episode.asked_indices
        touched = trace.touched & np.isin(np.arange(trace.touched.shape[1]), list(items))
    else:
        touched = trace.touched | trace.by_arm | moved_from_start(trace)
    if not touched.any():
        return None
    row, i = (int(v) for v in np.argwhere(touched)[0])
    part = "gripper" if trace.touched[row, i] else "arm" if trace.by_arm[row, i] else None
    kind = episode.kind(i)
    what = f"The {part} brushes against the {kind}" if part else f"The {kind} {agreeing(kind, 'is', 'are')} moved"
    text = f"{what}, although no object may be touched."
    return episode.evidence("collided", text, rows=(row, row), objects=(i,))
