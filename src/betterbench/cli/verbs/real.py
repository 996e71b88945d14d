"""``better real``: the overview of its commands, each in a separate module."""

from __future__ import annotations

from typing import Annotated, Literal

import tyro

What = Literal["sheet", "check-cameras", "plan", "run", "status", "judge", "report"]


def real_command(what: Annotated[What, tyro.conf.Positional, tyro.conf.arg(metavar="COMMAND")]) -> None:
    """Run the diagnostic protocol on a real arm: plan it, run it with an operator, judge its films, report it.

    sheet writes the markers and places of the scene, to print.

    check-cameras measures from the markers how to move the front camera.

    plan writes randomized trials of conditions and policies.

    run guides an operator through the trials, in the browser or by keys in the terminal.

    status shows what is done and what comes next.

    judge shows the films to a second person, who knows neither condition nor policy.

    report writes both diagnostic matrices with labels, evidence and agreement.

    better real COMMAND --help explains a command.

    Example: better real plan --out bench --policies ours=openpi://127.0.0.1:8000 base=lerobot:checkpoint

    Args:
        what: sheet, check-cameras, plan, run, status, judge or report.
    """
    raise AssertionError(f"better real {what} is dispatched by betterbench.cli.main")
