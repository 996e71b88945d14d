"""Relations that each task template supports in an instruction, and the reasons for rejecting other relations."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from betterbench.generation.stated_goal.reading import Reader, Said
from betterbench.generation.stated_goal.relations import HOLES, RING, SIDES


def _item(r: Reader, said: Said, regions: Mapping[str, str]) -> tuple[str, str]:
    """Return the single item that a relation in an instruction refers to.

    Returns:
        The name of the item and an empty string; or an empty string and the reason why there is no single item.
    """
    named = [m for m in said.subjects if r.is_item(m)]
    if len(named) != 1 or named[0].number > 1:
        count = "no item" if not named else "several items"
        return "", f"it refers to {count}, and each target takes one"
    items = [n for n in named[0].objects if r.role_of[n] == "item"]
    free = [n for n in items if n not in regions]
    return (free or items or [""])[0], ""


def _enter(r: Reader, said: Said, region: str, regions: dict[str, str]) -> Iterator[str]:
    """Record the target region of an item, or yield the reason why this is impossible."""
    name, reason = _item(r, said, regions)
    if reason or not name:
        yield reason or "it does not refer to an item"
    elif regions.get(name, region) != region:
        yield "the item already has another target"
    elif any(taken == region and other != name for other, taken in regions.items()):
        yield "another item already has this target"
    else:
        regions[name] = region


def _arranged(r: Reader, said: Said, regions: dict[str, str], _onto: object) -> Iterator[str]:
    on_anchor = said.target is None and said.place in ("", "it")
    on_anchor |= said.target is not None and r.receiver(said)
    if r.is_on_surface(said):
        return
    if said.meaning in SIDES and on_anchor:
        moved, offered = r.moved(said), r.sides()
        if moved:
            yield moved
        elif said.meaning not in offered:
            yield f"the anchor has these sides: {', '.join(side.replace('_', ' ') for side in offered)}"
        else:
            yield from _enter(r, said, said.meaning, regions)
    elif said.meaning in ("beside", "around") and on_anchor:
        yield r.moved(said)
    elif said.meaning in ("beside", "around", *SIDES) and said.target is not None:
        yield f"targets are beside the anchor and not beside the {r.raw[said.target.end - 1]}"
    else:
        yield "this is not part of the goal"


def _packed(r: Reader, said: Said, _regions: object, _onto: object) -> Iterator[str]:
    if r.is_on_surface(said):
        if said.meaning != "from" and said.subjects and all(map(r.is_item, said.subjects)) and not _goes_on(r, said):
            yield "the items start there already"
    elif (
        (said.meaning == "in" or (said.meaning == "to" and r.tokens[0] in ("add", "transfer"))) and r.receiver(said)
    ) or (said.meaning == "in" and said.target is None and said.place in ("trash", "garbage", "litter")):
        yield r.moved(said)
    else:
        yield "this is not part of the goal"


def _goes_on(r: Reader, said: Said) -> bool:
    """Return whether the supported relation follows later, as in "the apple on the table into the lunchbox"."""
    words = said.words.split()[0]
    after = r.raw[r.raw.index(words) + 1 :]
    return bool({"into", "in", "inside"} & set(after))


def _positioned(r: Reader, said: Said, _regions: object, _onto: object) -> Iterator[str]:
    spot = said.position or said.place
    if r.is_on_surface(said) and not said.subjects:
        return
    held = (said.meaning in ("on", "in") and spot in RING) or (said.meaning == "under" and spot == "spout")
    if not held:
        yield "this is not part of the goal"
    elif sum(map(r.is_item, said.subjects)) > 1:
        yield "only one item is put there"
    else:
        yield r.moved(said)


def _loaded(r: Reader, said: Said, regions: dict[str, str], _onto: object) -> Iterator[str]:
    if said.meaning != "in" or not r.receiver(said):
        yield "this is not part of the goal"
    elif r.moved(said):
        yield r.moved(said)
    elif said.target is not None:
        drawers = [n for n in said.target.objects if r.role_of[n] == "drawer"]
        words = r.tokens[said.target.at : said.target.end]
        mount = next((m for m, named in _MOUNTS.items() if named & set(words)), "")
        if len(drawers) == 1 and mount:
            yield from _enter(r, said, mount, regions)


_MOUNTS = {"upper": {"upper", "top"}, "lower": {"lower", "bottom"}}


def _assembled(r: Reader, said: Said, _regions: object, _onto: object) -> Iterator[str]:
    if r.is_on_surface(said) and said.meaning != "from":
        return
    if said.meaning == "from" and said.target is not None and r.is_item(said.target):
        return  # "a burger from patty, cheese and lettuce"
    if said.meaning == "on" and r.receiver(said):
        alone = said.subjects[0] if len(said.subjects) == 1 else None
        last = alone is not None and r.tokens[alone.at : alone.end] == ["top", "bun"]
        yield "a top bun is put on other layers" if last else r.moved(said)
    elif said.meaning == "on" and said.target is not None:
        yield (
            f"the order of the layers is random, so it is unknown which layer is put on the "
            f"{r.raw[said.target.end - 1]}"
        )
    else:
        yield "this is not part of the goal"


def _inserted(r: Reader, said: Said, regions: dict[str, str], _onto: object) -> Iterator[str]:
    hole = said.position or said.place
    into = r.receiver(said) or hole in ("hole", "slot") or said.position in HOLES
    if said.meaning != "in" or not into:
        yield "this is not part of the goal"
    elif r.moved(said):
        yield r.moved(said)
    elif said.position in HOLES:
        yield from _enter(r, said, HOLES[said.position], regions)


def _stacked(r: Reader, said: Said, _regions: object, onto: list[tuple[str, str]]) -> Iterator[str]:
    if r.is_on_surface(said) and said.meaning != "from":
        return
    if said.meaning != "on" or said.target is None:
        yield "this is not part of the goal"
        return
    lower = said.target.objects[0]
    uppers = [n for m in said.subjects for n in m.objects if n != lower]
    if len(said.target.objects) > 1 and len(uppers) < 1:
        yield "the plates are not distinguished"
    for upper in uppers:
        if (lower, upper) in onto:
            yield "a plate cannot be above and below another"
        elif sum(r.objects[upper].size_m) > sum(r.objects[lower].size_m):
            yield "a plate is only put on one that is at least as wide"
        onto.append((upper, lower))


_RULES = {
    "patterned_arrangement": _arranged,
    "loose_packing": _packed,
    "constrained_positioning": _positioned,
    "container_loading": _loaded,
    "logical_assembly": _assembled,
    "precision_insertion": _inserted,
    "recursive_stacking": _stacked,
}


def read_goal(r: Reader) -> tuple[dict[str, str], tuple[tuple[str, str], ...], list[tuple[str, str]]]:
    """Return the stated goal: the target regions of items, and the pairs of plates.

    Also return the unsupported relations, with the reason for each.
    """
    regions: dict[str, str] = {}
    onto: list[tuple[str, str]] = []
    problems: list[tuple[str, str]] = []
    for said in r.relations():
        read = _RULES[r.scenario.template]
        problems += [(said.words, reason) for reason in read(r, said, regions, onto) if reason]
    positions = [(r.raw[i], "it does not refer to a position in the goal") for i in r.positions]
    return regions, tuple(onto), [*problems, *positions]
