"""Suites of CALVIN: chains with CALVIN's own starts, and chains with resampled block positions."""

from __future__ import annotations

from collections.abc import Mapping

from betterbench.tasks.worlds.facts import Suite, WorldFacts, register_facts

OFFICIAL, RESAMPLED = "calvin", "calvin_resampled"


CHAIN_SUITES: Mapping[str, Suite] = {
    suite.name: suite
    for suite in (
        Suite(OFFICIAL, OFFICIAL, None, 1, "ABC→D: 1,000 chains of five instructions"),
        Suite(RESAMPLED, OFFICIAL, "resampled", 1, "calvin: the same chains, blocks anywhere in the training range"),
    )
}
"""Suites of CALVIN, by name."""

CALVIN = register_facts(WorldFacts(name="calvin", title="CALVIN", suites=CHAIN_SUITES, reading="chains"))
