"""Questions about the execution: the activity of the robot, the finished steps, and the next step."""

from __future__ import annotations

from collections.abc import Iterator

from betterbench.tasks import Subgoal
from betterbench.tasks.relations import relation
from betterbench.tasks.relations.beside import CLOSE_TO, HANDLES_TO_FRONT, SIDES, is_laid
from betterbench.vqa.episode import Act
from betterbench.vqa.moment import Moment
from betterbench.vqa.nouns import definite
from betterbench.vqa.question import Form, QuestionDraft
from betterbench.vqa.types.containment import IN_WORDS
from betterbench.vqa.types.relation import yes

NOTHING_YET, EVERYTHING, NOTHING_LEFT = "nothing yet", "all of it", "nothing, all of it is done"
_ON_WORDS = {**IN_WORDS, "layer": "on", "on_plate": "on"}


def execution(moment: Moment) -> Iterator[QuestionDraft]:
    """Yield questions about the activity of the robot and about its progress in the instruction."""
    yield from _doing(moment)
    goals = moment.condition.instruction.subgoals
    words = {"instruction": moment.condition.instruction.text}
    done = [bool(v) for v in moment.episode.record.subgoals[moment.row]]
    names = evidence_of(moment, done)
    if names is None:
        return
    group = (words["instruction"],)
    for number, goal in enumerate(goals):
        told = {**words, "step": step_words(moment, goal)}
        answer = yes(done[number])
        yield QuestionDraft(Form.YES_NO, "is step done", (*group, told["step"]), answer, told, names, ("over time",))
    answer = done_words(moment, done)
    yield QuestionDraft(Form.CHOICE, "what is done", group, answer, words, names, ("over time",))
    left = [g for g in range(len(goals)) if not done[g]]
    if moment.state.held is None and (len(left) <= 1 or moment.condition.instruction.ordered):
        answer = step_words(moment, goals[left[0]]) if left else NOTHING_LEFT
        yield QuestionDraft(Form.CHOICE, "what is next", group, answer, words, names, ("over time",))


def _doing(moment: Moment) -> Iterator[QuestionDraft]:
    doing = moment.episode.doing(moment.row)
    if doing is None:
        return
    o = moment.objects[doing.object]
    if o.kind not in moment.named:
        return
    items = sorted(k for k, x in moment.single.items() if x.role in ("item", "distractor") and not x.fixed)
    verb = "carrying" if doing.act is Act.CARRYING else "reaching for"
    yield QuestionDraft(Form.CHOICE, "what is it doing", tuple(items), f"{verb} {definite(o.kind)}", {}, (o.name,))


def evidence_of(moment: Moment, done: list[bool]) -> tuple[str, ...] | None:
    """Return the objects that show the progress in an instruction, or None if an image does not show it.

    All objects and targets of the steps must be clearly visible, and an unfinished step must not look finished. For
    example, an object at its target that is still in the gripper or moving would look finished.
    """
    goals, info = moment.condition.instruction.subgoals, moment.state.info
    if len(done) != len(goals) or [_looks_done(moment, g) for g in range(len(goals))] != done:
        return None
    names: dict[str, None] = {}
    for g, goal in enumerate(goals):
        meant = [info.objects[i].name for i in moment.episode.trace.meant[g]]
        target = info.objects[moment.episode.trace.targets[g]].name
        if len(meant) < goal.count or not all(moment.is_clear(n) for n in (*meant, target)):
            return None
        names |= dict.fromkeys((*meant, target))
    return tuple(names)


def _looks_done(moment: Moment, g: int) -> bool:
    """Return whether a step looks done.

    For the closing of a drawer, the objects that belong in the drawer must also be inside.
    """
    trace, goals = moment.episode.trace, moment.condition.instruction.subgoals
    if int(trace.serves[moment.row, g, list(trace.meant[g])].sum()) < goals[g].count:
        return False
    if relation(goals[g].relation).carried:
        return True
    return all(_looks_done(moment, j) for j in range(g) if trace.targets[j] in trace.meant[g])


def step_words(moment: Moment, goal: Subgoal) -> str:
    """Return a step as an imperative phrase, such as "put the burger in the box"."""
    info = moment.state.info
    number = moment.condition.instruction.subgoals.index(goal)
    anchor = info.objects[moment.episode.trace.targets[number]]
    target, meant = anchor.kind, moment.episode.trace.meant[number]
    thing = info.objects[meant[0]].kind if meant else goal.word
    if not relation(goal.relation).carried:
        return f"close {definite(thing)}"
    if goal.relation == "in_hole":
        where = f"in hole {goal.region.rpartition('_')[2]} of {definite(target)}"
    elif goal.relation == "beside" and meant and is_laid(info.objects[meant[0]], anchor):
        where = f"{CLOSE_TO[goal.region].format(definite(target))}, {HANDLES_TO_FRONT[0].format(thing)}"
    elif goal.relation == "beside":
        where = f"{SIDES[goal.region]} {definite(target)}"
    elif goal.relation == "layer":
        where = f"on {definite(target)} as layer {goal.region}"
    else:
        where = f"{_ON_WORDS.get(goal.relation, 'at')} {definite(target)}"
    article = definite(thing) if goal.count == 1 else f"the {_ORDINALS.get(goal.count, 'next')} {thing}"
    return f"put {article} {where}"


_ORDINALS = {2: "second", 3: "third", 4: "fourth"}


def done_words(moment: Moment, done: list[bool]) -> str:
    """Describe the finished steps in the wording of an answer option."""
    goals = moment.condition.instruction.subgoals
    if all(done):
        return EVERYTHING
    steps = [step_words(moment, goal) for goal, is_done in zip(goals, done, strict=True) if is_done]
    return f"only: {'; '.join(steps)}" if steps else NOTHING_YET
