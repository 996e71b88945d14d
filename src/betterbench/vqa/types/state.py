"""Questions about states: open and closed drawers, the gripper and the held object, and fallen objects."""

from __future__ import annotations

from collections.abc import Iterator

from betterbench.geometry import tilt_of
from betterbench.interface.state import GRIPPER
from betterbench.tasks.relations.closed import CLOSED, PUSHED_IN
from betterbench.vqa.episode import CARRY_M, Act
from betterbench.vqa.moment import Moment
from betterbench.vqa.nouns import definite
from betterbench.vqa.question import Form, QuestionDraft
from betterbench.vqa.types.relation import yes

WIDELY_OPEN, SHUT = 0.75, 0.15
"""Minimum opening of an open gripper and maximum opening of a closed empty gripper, as fractions of the full opening.

People disagree on whether a gripper with an opening in between is open.
"""
FALLEN_RAD = 1.0
"""Minimum tilt of an object that has fallen, about 60 degrees [rad].

There are no questions about objects that lean by less than this.
"""
UPRIGHT_RAD = 0.1
LEAST_SLENDER = 0.9
"""Minimum ratio of height to width of objects that look different when they stand and when they lie."""


def object_state(moment: Moment) -> Iterator[QuestionDraft]:
    """Yield questions about drawers, about the gripper, and about objects that can stand upright."""
    yield from _drawers(moment)
    yield from _gripper(moment)
    for kind, o in moment.things.items():
        if o.size_m[2] >= LEAST_SLENDER * max(o.size_m[:2]) and moment.state.held != o.name:
            tilt = tilt_of(moment.state.pose(o.name).quaternion)
            if tilt <= UPRIGHT_RAD or tilt >= FALLEN_RAD:
                words = {"a": definite(kind)}
                yield QuestionDraft(Form.YES_NO, "fallen over", (kind,), yes(tilt >= FALLEN_RAD), words, (o.name,))


def _drawers(moment: Moment) -> Iterator[QuestionDraft]:
    trace = moment.episode.trace
    for drawer, cabinet, _ in trace.drawers:
        info, fixed = trace.info.objects[drawer], trace.info.objects[cabinet]
        if info.kind not in moment.single or not moment.is_large(info.name) or not moment.is_clear(fixed.name):
            continue
        shut = CLOSED.where(moment.state, info.name, fixed.name) is not None
        if shut or trace.opening(moment.row, drawer) >= 2.0 * PUSHED_IN:
            words = {"a": definite(info.kind)}
            yield QuestionDraft(Form.YES_NO, "is it open", (info.kind,), yes(not shut), words, (info.name, fixed.name))


def _gripper(moment: Moment) -> Iterator[QuestionDraft]:
    trace, state = moment.episode.trace, moment.state
    if not moment.is_clear(GRIPPER):
        return
    touched = bool(trace.touched[moment.row].any())
    opening = state.finger_width_m / state.info.gripper_opening_m
    if not touched and (opening >= WIDELY_OPEN or opening <= SHUT):
        yield QuestionDraft(
            Form.CHOICE, "gripper open", (), "open" if opening >= WIDELY_OPEN else "closed", {}, (GRIPPER,)
        )
    doing = moment.episode.doing(moment.row)
    held = trace.info.objects[doing.object] if doing is not None and doing.act is Act.CARRYING else None
    if held is None and (touched or state.held is not None):
        return
    if held is not None and (held.kind not in moment.named or _lift(moment, held.name) < CARRY_M):
        return
    items = sorted(k for k, o in moment.single.items() if o.role in ("item", "distractor") and not o.fixed)
    names = (GRIPPER,) if held is None else (GRIPPER, held.name)
    yield QuestionDraft(Form.CHOICE, "what is held", tuple(items), "nothing" if held is None else held.kind, {}, names)
    for kind in moment.things:
        is_it = held is not None and held.kind == kind
        words = {"a": definite(kind)}
        yield QuestionDraft(Form.YES_NO, "is it held", (kind,), yes(is_it), words, (moment.things[kind].name, GRIPPER))


def _lift(moment: Moment, name: str) -> float:
    """Return the height of an object above its lowest position so far in the episode [m]."""
    i = moment.state.info.index(name)
    heights = moment.episode.trace.positions[: moment.row + 1, i, 2]
    return float(heights[-1] - heights.min())
