"""``better real``: overview of the nested commands. Each nested command has its own module."""

from __future__ import annotations

from typing import Annotated, Literal

import tyro

What = Literal["sheet", "check-cameras", "plan", "run", "status", "judge", "report"]


def real_command(what: Annotated[What, tyro.conf.Positional, tyro.conf.arg(metavar="COMMAND")]) -> None:
    """Run the diagnostic protocol on a real robot arm.

    sheet writes a sheet with the markers and object positions of the scene, for printing.

    check-cameras measures the pose of the front camera from the markers.

    plan randomizes the trials of conditions and policies.

    run guides an operator through the trials, in the browser or in the terminal.

    status shows the progress and the next trial.

    judge shows the videos to another person, without the condition and the policy.

    report writes both diagnostic matrices, with labels, evidence and agreement between people.

    Use `better real COMMAND --help` to see the options of a command.

    Example: better real plan --out bench --policies ours=openpi://127.0.0.1:8000 base=lerobot:checkpoint

    Args:
        what: Nested command: sheet, check-cameras, plan, run, status, judge or report.
    """
    raise AssertionError(f"this function cannot run 'better real {what}'; call betterbench.cli.main instead")
