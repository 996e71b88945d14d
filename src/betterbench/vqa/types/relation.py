"""Questions about spatial relations: left or right (in the image or for the robot), nearer, and outermost."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

from betterbench.geometry import horizontal_distance
from betterbench.tasks.relations import is_at
from betterbench.tasks.relations.beside import BESIDE, SIDES, is_laid, side_of
from betterbench.tasks.relations.placing import foot
from betterbench.vqa.moment import Moment
from betterbench.vqa.nouns import definite
from betterbench.vqa.question import Form, QuestionDraft
from betterbench.vqa.types.grounding import chunks

IMAGE_MARGIN = 0.08
"""Minimum horizontal distance between two centers for "left of", as a fraction of the width of the image.

This is 20 of 256 pixels, or about the width of an object.
"""
CAMERA_MARGIN_M = 0.06
"""Minimum difference between the distances of two objects from the camera for "nearer" [m].

This is about the smallest difference that people can judge.
"""
ROBOT_MARGIN_M = 0.05
"""Minimum difference between two objects in the robot frame, in the lateral direction or in distance from the base [m].

Objects are 4 to 8 cm wide.
"""


def spatial_relation(moment: Moment) -> Iterator[QuestionDraft]:
    """Yield questions about pairs of objects, and about the leftmost and rightmost of several objects."""
    for (a, first), (b, second) in itertools.combinations(moment.named.items(), 2):
        names = first.name, second.name
        both_small = a in moment.things and b in moment.things
        if both_small or _apart(moment, *names):
            yield from _in_image(moment, (a, b), names)
        if both_small:
            yield from _from_camera(moment, (a, b), names)
            yield from _from_robot(moment, (a, b), names)
        for (k, o), (anchor, target) in itertools.permutations(((a, first), (b, second))):
            if BESIDE.regions(target) and o.role in ("item", "distractor"):
                yield from _beside(moment, (k, o.name), (anchor, target.name))
    for kinds in chunks(sorted(moment.things)):
        yield from _outermost(moment, kinds)


def _apart(moment: Moment, a: str, b: str) -> bool:
    """Return whether two objects are clearly side by side in the image.

    The center of neither object may be above, below or within the other object.
    """
    first, second = moment.view.objects[a], moment.view.objects[b]
    return not any(
        y.box[0] <= x.centroid[0] <= y.box[2] for x, y in ((first, second), (second, first))
    )  # fmt: skip


def _in_image(moment: Moment, kinds: tuple[str, str], names: tuple[str, str]) -> Iterator[QuestionDraft]:
    (ax, _), (bx, _) = (moment.view.objects[name].centroid for name in names)
    if abs(ax - bx) < IMAGE_MARGIN * moment.view.width:
        return
    for side, holds in (("left", ax < bx), ("right", ax > bx)):
        words = {"a": definite(kinds[0]), "b": definite(kinds[1]), "side": side}
        yield QuestionDraft(Form.YES_NO, "side in image", (side, *kinds), yes(holds), words, names)


def _from_camera(moment: Moment, kinds: tuple[str, str], names: tuple[str, str]) -> Iterator[QuestionDraft]:
    near, far = (moment.view.depth_m(moment.center(name)) for name in names)
    if abs(near - far) >= CAMERA_MARGIN_M:
        words = {"a": definite(kinds[0]), "b": definite(kinds[1])}
        yield QuestionDraft(Form.CHOICE, "closer to camera", kinds, kinds[0] if near < far else kinds[1], words, names)


def _from_robot(moment: Moment, kinds: tuple[str, str], names: tuple[str, str]) -> Iterator[QuestionDraft]:
    """Yield questions in the robot's frame. The robot looks along x from the origin, and y points to its left."""
    a, b = (moment.center(name) for name in names)
    words = {"a": definite(kinds[0]), "b": definite(kinds[1])}
    if abs(a[1] - b[1]) >= ROBOT_MARGIN_M:
        for side, holds in (("left", a[1] > b[1]), ("right", a[1] < b[1])):
            told = {**words, "side": side}
            yield QuestionDraft(
                Form.YES_NO, "side for robot", (side, *kinds), yes(holds), told, names, ("robot frame",)
            )  # fmt: skip
    near, far = horizontal_distance(a, (0.0, 0.0)), horizontal_distance(b, (0.0, 0.0))
    if abs(near - far) >= ROBOT_MARGIN_M:
        answer = kinds[0] if near < far else kinds[1]
        yield QuestionDraft(Form.CHOICE, "closer to robot", kinds, answer, words, names, ("robot frame",))


def _beside(moment: Moment, thing: tuple[str, str], anchor: tuple[str, str]) -> Iterator[QuestionDraft]:
    """Yield the question of whether an object is on a side of an anchor, for each side.

    The sides are relative to the front of the anchor.
    """
    try:
        side = moment.place(BESIDE, thing[1], anchor[1])
    except LookupError:
        return
    info = moment.state.info.object(anchor[1])
    if side is None and is_laid(moment.state.info.object(thing[1]), info):
        # The object is at the side, but points in another direction. A person would say yes although the instruction is
        # not fulfilled.
        x, y, _ = moment.state.pose(anchor[1]).inverse().apply(foot(moment.state, thing[1]))
        if side_of(info, x, y) is not None:
            return
    for region in BESIDE.regions(info):
        words = {"a": definite(thing[0]), "b": definite(anchor[0]), "side": SIDES[region]}
        group = (region, thing[0], anchor[0])
        yield QuestionDraft(
            Form.YES_NO, "side of anchor", group, yes(is_at(side, region)), words, (thing[1], anchor[1])
        )


def _outermost(moment: Moment, kinds: tuple[str, ...]) -> Iterator[QuestionDraft]:
    """Yield questions that ask which object is leftmost or rightmost in the image."""
    if len(kinds) < 3:
        return
    across = sorted((moment.view.objects[moment.things[k].name].centroid[0], k) for k in kinds)
    margin = IMAGE_MARGIN * moment.view.width
    names = tuple(moment.things[k].name for k in kinds)
    for side, (best, following) in (("leftmost", across[:2]), ("rightmost", across[:-3:-1])):
        if abs(best[0] - following[0]) >= margin:
            words = {"side": side, "things": ", ".join(definite(k) for k in kinds)}
            yield QuestionDraft(Form.CHOICE, "outermost", (side, *kinds), best[1], words, names)


def yes(holds: bool) -> str:
    """Return the answer "Yes" or "No" for a truth value."""
    return "Yes" if holds else "No"
