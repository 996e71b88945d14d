"""Mutations of files and frames, drawn from a generator: of bytes, of JSON values, and of JSON text with its keys."""

from __future__ import annotations

import copy
import json

from betterbench.json_form import sealed_form


def deep(levels):
    form = []
    for _ in range(levels):
        form = [form]
    return form


HOSTILE = [
    *(None, True, False, -1, 0, 1, 3, 2**31, 2**63, 10**400, -(10**25), 1e308, -0.0, 0.1, float("nan"), float("inf")),
    *("", "1", "0.5", "true", "nan", "300", "x" * 100_000, "../../../etc/passwd", "\x1b[31mred", "\ud800", "a\x00b"),
    *([], {}, [[]], [None], {"": {}}, deep(150), deep(290)),
]


def places(form, path=()):
    yield path
    if isinstance(form, dict):
        for key, value in form.items():
            yield from places(value, (*path, key))
    elif isinstance(form, list):
        for i, value in enumerate(form[:50]):
            yield from places(value, (*path, i))


def at(form, path):
    for key in path:
        form = form[key]
    return form


def nudged(value, draw):
    """Returns a value like another one, and yet not the same."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float):
        more = value + 1e-9 if isinstance(value, float) or abs(value) < 2**53 else value - 1
        return [str(value), -value, value + 1, value * 10, more, [value], bool(value)][draw.integers(7)]
    if isinstance(value, str):
        return [value + " ", value[:-1], value.upper(), value[::-1], [value], 0][draw.integers(6)]
    if isinstance(value, bytes):
        return [value[:-1], value + b"\0", value[::-1], value.decode("latin-1"), b"", list(value[:20])][
            draw.integers(6)
        ]
    if isinstance(value, list):
        return [value[::-1], value[:-1], value + value[-1:], dict(enumerate(value))][draw.integers(4)]
    if isinstance(value, dict):
        return [list(value.items()), dict.fromkeys(value), dict(list(value.items())[:-1])][draw.integers(3)]
    return "null"


def mutated_form(form, draw):
    """Returns a copy of a JSON value with one or two places replaced, nudged, left out, doubled, swapped or added."""
    form = copy.deepcopy(form)
    for _ in range(int(draw.integers(1, 3))):
        everywhere = list(places(form))[1:]
        if not everywhere:
            return form
        *way, last = everywhere[draw.integers(len(everywhere))]
        inner = at(form, way)
        value = copy.deepcopy(HOSTILE[draw.integers(len(HOSTILE))])
        match int(draw.integers(7)):
            case 0:
                del inner[last]
            case 1 if isinstance(inner, list):
                inner.append(copy.deepcopy(inner[last]))
            case 1:
                inner[last + b" " if isinstance(last, bytes) else f"{last} "] = inner.pop(last)
            case 2:
                *way, other = everywhere[draw.integers(len(everywhere))]
                theirs = copy.deepcopy(at(form, [*way, other]))
                inner[last] = theirs
            case 3 | 4 | 5:
                inner[last] = nudged(inner[last], draw)
            case _:
                inner[last] = value
    return form


def json_bytes(form):
    return json.dumps(form).encode()


def with_key_twice(form, draw):
    """Returns JSON in which one key of one map stands twice, with two values."""
    maps = [path for path in places(form) if isinstance(at(form, path), dict) and at(form, path)]
    if not maps:
        return json_bytes(form)
    path = maps[draw.integers(len(maps))]
    inner = copy.deepcopy(at(form, path))
    key = list(inner)[draw.integers(len(inner))]
    other = nudged(inner[key], draw)
    pairs = [f"{json.dumps(k)}: {json.dumps(v)}" for k, v in inner.items()]
    pairs.insert(int(draw.integers(len(pairs) + 1)), f"{json.dumps(key)}: {json.dumps(other)}")
    text, marked = "{" + ", ".join(pairs) + "}", copy.deepcopy(form)
    if not path:
        return text.encode()
    at(marked, path[:-1])[path[-1]] = "@@here@@"
    return json.dumps(marked).replace('"@@here@@"', text).encode()


def mutated_bytes(data, draw):
    """Returns bytes of which some are flipped, changed, left out, doubled, swapped, put in or cut off."""
    data = bytearray(data)
    for _ in range(int(draw.integers(1, 4))):
        place = int(draw.integers(max(1, len(data))))
        more = int(draw.integers(1, 40))
        match int(draw.integers(8)):
            case 0:
                data[place : place + 1] = bytes([draw.integers(256)])
            case 1 | 2 if data:
                data[place % len(data)] ^= 1 << int(draw.integers(8))
            case 3:
                del data[place : place + more]
            case 4:
                data[place:place] = data[place : place + more]
            case 5:
                other = int(draw.integers(max(1, len(data))))
                a, b = data[place : place + more], data[other : other + more]
                data[place : place + more], data[other : other + more] = b, a
            case 6:
                data[place:place] = [b"\x00", b"9" * 400, b"[" * 3000, b"\xff\xfe", b"\n", b'"'][draw.integers(6)]
            case _:
                del data[place:]
    return bytes(data)


def mutated_json(data, draw):
    """Returns JSON with a mutated value, with a key that stands twice, or with mutated bytes."""
    kind = draw.uniform()
    if kind < 0.6:
        return json_bytes(mutated_form(json.loads(data), draw))
    return with_key_twice(json.loads(data), draw) if kind < 0.75 else mutated_bytes(data, draw)


def mutated_sealed(data, draw):
    """Returns a sealed JSON document with a mutated value and a seal that fits it."""
    form = mutated_form(json.loads(data), draw)
    try:
        return json_bytes(sealed_form(form))
    except (TypeError, ValueError, AttributeError):  # it is no JSON object any more
        return json_bytes(form)


def mutated_lines(data, draw):
    """Returns lines of JSON of which one is mutated, left out, doubled or moved."""
    lines = data.splitlines()
    place = int(draw.integers(len(lines)))
    match int(draw.integers(6)):
        case 0:
            del lines[place]
        case 1:
            lines.insert(place, lines[place])
        case 2:
            lines.insert(int(draw.integers(len(lines))), lines.pop(place))
        case _:
            lines[place] = mutated_json(lines[place], draw)
    return b"\n".join(lines) + b"\n" * int(draw.integers(2))


def unique(pairs):
    if len({key for key, _ in pairs}) < len(pairs):
        raise ValueError("a key stands twice")
    return dict(pairs)


def agree(file, told):
    """Tells whether what was read is what a file says, wherever the file says something that is read."""
    if isinstance(file, dict) and isinstance(told, dict):
        return all(agree(value, told[key]) for key, value in file.items() if key in told)
    if isinstance(file, list) and isinstance(told, list | tuple):
        return len(file) == len(told) and all(map(agree, file, told))
    if isinstance(file, bool) or isinstance(told, bool):
        return file is told
    return file == told and isinstance(file, str) == isinstance(told, str)
