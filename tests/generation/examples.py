"""A good answer of a model, and changes of it."""

from __future__ import annotations

import copy
import json


def described(name, query, mass, size, *tags, description=None):
    return {
        "description": description or f"A {query}",
        "asset_query": query,
        "instance_name": name,
        "estimated_mass": mass,
        "estimated_size": size,
        "tags": list(tags),
    }


GOOD = {
    "scenario_name": "Packing a hiking lunch",
    "instruction": "Pack the hiking lunch into the blue lunchbox.",
    "scene_context": "kitchen",
    "instantiation": {
        "container": [described("lunchbox", "blue lunchbox", [0.3, 0.6], [0.25, 0.35], "box")],
        "items": [
            described("apple", "red apple", [0.1, 0.2], [0.06, 0.075], "food"),
            described("lemon", "lemon", [0.08, 0.15], [0.06, 0.09], "food"),
            described("soda", "green soda can", [0.2, 0.4], [0.09, 0.13], "food"),
        ],
        "distractors": [],
    },
}
"""A scenario of loose_packing with objects of the library."""


def changed(path=(), value=None):
    """Return the good answer with the value at a path replaced; a deleted key for ``...``."""
    form = copy.deepcopy(GOOD)
    place = form
    for step in path[:-1]:
        place = place[step]
    if path and value is ...:
        del place[path[-1]]
    elif path:
        place[path[-1]] = value
    return form


def item(number, **fields):
    """Return the good answer with fields of an item replaced."""
    form = copy.deepcopy(GOOD)
    form["instantiation"]["items"][number].update(fields)
    return form


def text(form):
    """Return an answer with one scenario."""
    return json.dumps([form])
