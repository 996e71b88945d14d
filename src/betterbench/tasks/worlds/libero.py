"""LIBERO, LIBERO-PRO and LIBERO-Plus as data: suites, and the protocols that existing projects use to evaluate them.

Sources: openpi ``examples/libero/main.py``; lerobot ``envs/libero.py`` (7427f31); Isaac-GR00T's LIBERO example. For
settings that the last example does not document, openpi's values are used.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from betterbench.errors import UnknownNameError
from betterbench.json_form import strict_form
from betterbench.tasks.worlds.facts import Suite, WorldFacts, register_facts

IMAGE_SIDE = 256
"""Width and height of a camera image [pixel]."""

SEED = 7

SETTLING_STEPS = 10

CONTROL_RATE_HZ = 20.0

STATES = 50
"""Number of initial states of every task."""

_STEPS = {"libero_spatial": 220, "libero_object": 280, "libero_goal": 300, "libero_10": 520, "libero_90": 400}
CHANGES: Mapping[str, str] = {
    "swap": "objects stand at each other's places",
    "object": "objects are replaced by others of their kind",
    "lan": "the instruction is paraphrased",
    "task": "the instruction is for another task",
}
"""Descriptions of the changes that LIBERO-PRO makes to a suite, by name."""


_BASES = (
    Suite("libero_spatial", "libero_spatial", None, 10, "the same bowl at ten positions"),
    Suite("libero_object", "libero_object", None, 10, "ten objects into one basket"),
    Suite("libero_goal", "libero_goal", None, 10, "ten goals in one scene"),
    Suite("libero_10", "libero_10", None, 10, "ten long tasks"),
    Suite("libero_90", "libero_90", None, 90, "ninety short tasks"),
)

SUITES: Mapping[str, Suite] = {
    suite.name: suite
    for suite in (
        *_BASES,
        *(
            Suite(f"{base.name}_{change}", base.name, change, base.tasks, f"{base.name}: {said}")
            for base in _BASES
            if base.name != "libero_90"
            for change, said in CHANGES.items()
        ),
    )
}
"""The five suites of LIBERO and the sixteen suites of LIBERO-PRO whose resources are complete in the wheel, by name."""

PLUS_SUITES: Mapping[str, Suite] = {
    suite.name: suite
    for suite in (
        Suite(
            base.name.replace("libero_", "libero_plus_"),
            base.name,
            "plus",
            base.tasks,
            f"{base.name}: {variants:,} variants on seven axes",
        )
        for base, variants in zip(_BASES, (2402, 2518, 2591, 2519), strict=False)
    )
}
"""The four suites of LIBERO-Plus, by name."""


_STATEMENTS = {
    "Scenes": "The scenes are LIBERO's own. If a premise of the instruction is false in a scene, the run stops or its "
    "records state this; trials are not certified.",
    "Calibration": "The labels of scripted policies with known faults in LIBERO are counted in docs/worlds.md; better "
    "calibrate measures only betterbench's own scenes.",
}

LIBERO = register_facts(
    WorldFacts(name="libero", title="LIBERO", suites=SUITES, reading="goals", statements=_STATEMENTS)
)
LIBERO_PLUS = register_facts(
    WorldFacts(name="libero_plus", title="LIBERO-Plus", suites=PLUS_SUITES, reading="goals", statements=_STATEMENTS)
)


@strict_form
@dataclass(frozen=True, slots=True)
class FieldProtocol:
    """Evaluation protocol of an existing project, with step limits, number of trials and seed.

    Attributes:
        name: Name of the protocol.
        steps: Number of control steps after settling, by base suite.
        trials: Number of initial states of each task that are used, starting with the first.
        settling_steps: Number of steps with an open gripper before the first observation.
        seed: Seed of LIBERO's random numbers.
        differences: Differences from openpi's protocol. Empty for openpi's own protocol.
    """

    name: str
    steps: Mapping[str, int]
    trials: int
    settling_steps: int = SETTLING_STEPS
    seed: int = SEED
    differences: str = ""

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        return asdict(self)


PROTOCOLS: Mapping[str, FieldProtocol] = {
    protocol.name: protocol
    for protocol in (
        FieldProtocol("openpi", _STEPS, 50),
        FieldProtocol(
            "lerobot",
            {**_STEPS, "libero_spatial": 280},
            10,
            differences="libero_spatial has 280 steps instead of 220; 10 initial states of each task instead of 50",
        ),
        FieldProtocol(
            "gr00t",
            dict.fromkeys(_STEPS, 720),
            20,
            differences="720 steps in every suite instead of 220 to 520; 20 initial states of each task instead of 50",
        ),
    )
}
"""Existing protocols, by name. The results of different protocols cannot be compared."""

OURS = (
    "the random numbers of LIBERO are seeded before each reset, not once per task, so that a trial does not depend on "
    "earlier trials"
)
"""Difference between betterbench's runs and all of these protocols."""


def suite_named(name: str) -> Suite:
    """Return a suite of LIBERO, LIBERO-PRO or LIBERO-Plus by its name.

    Raises:
        UnknownNameError: If there is no such suite.
    """
    known = {**SUITES, **PLUS_SUITES}
    if name not in known:
        raise UnknownNameError("LIBERO suite", name, known)
    return known[name]


def protocol_named(name: str) -> FieldProtocol:
    """Return a protocol by its name.

    Raises:
        UnknownNameError: If there is no such protocol.
    """
    try:
        return PROTOCOLS[name]
    except KeyError:
        raise UnknownNameError("protocol", name, PROTOCOLS) from None
