"""Container Loading: things go into drawers that have to be opened before and closed after."""

from __future__ import annotations

from betterbench.tasks.template import ObjectGroup, Template

CONTAINER_LOADING = Template(
    name="container_loading",
    title="Container Loading",
    description="Put the named objects into the named drawers and close these.",
    challenge="Articulated containers whose state decides what can be done next.",
    goal=(
        "The named objects are in the named drawers, nothing else is in a drawer, and the named drawers "
        "are pushed home, all at rest and let go."
    ),
    premise="The named objects stand in their slots, and each drawer is drawn out as far as the condition says.",
    groups=(
        ObjectGroup("cabinet", "What carries the drawers.", ("cabinet",), (1, 1), role="fixture"),
        ObjectGroup(
            "drawers",
            "What is loaded; each slides on rails with friction and stops.",
            ("drawer",),
            (1, 2),
            role="drawer",
        ),
        ObjectGroup("items", "What may be asked for.", ("office supply", "small object"), (1, 4), role="item"),
        ObjectGroup(
            "distractors", "What stays on the table.", ("office supply", "small object"), (0, 4), role="distractor"
        ),
    ),
    relation="inside",
    exclusive=True,
    order="free",
    also=("closed",),
    steps_per_subgoal=260,
)
