"""``better demo``: evaluate the expert and three faulty policies on two tasks, and report their failures."""

from __future__ import annotations

from pathlib import Path

from betterbench.cli.console import OUT, say

POLICIES = ("expert", "zoo:lexical", "zoo:inertia", "zoo:progress-cue")

TASKS = ("morning_coffee", "fast_food")
"""The two tasks in the paper's detailed tables, which together reveal the faults of all three policies."""


def demo_command(
    *,
    out: Path = Path("runs/demo"),
    trials: int = 4,
    workers: int | None = None,
    films: int = 24,
    overwrite: bool = False,
) -> None:
    """Evaluate the expert and three policies with known faults on two tasks, and write one report page.

    Example: better demo --out runs/demo

    Args:
        out: Folder for the runs and the report.
        trials: Trials per variation.
        workers: Number of worker processes; default: one per CPU core.
        films: Maximum number of videos in the report; other failures are shown as one image. 0 renders nothing.
        overwrite: Write to OUT/report even if better did not make this folder, and replace files with the same names
            there.
    """
    from betterbench.api.report import report_into
    from betterbench.cli.output.page import LISTENER, print_verdicts
    from betterbench.cli.verbs.evaluate import default_folder, run_with_bar
    from betterbench.evaluation import make_plan

    runs = []
    for number, policy in enumerate(POLICIES, 1):
        plan = make_plan(policy, tasks=TASKS, trials=trials)
        which = f"policy {number} of {len(POLICIES)}: {policy}"
        say(f"{which}, {len(plan.trials)} trials")
        runs.append(run_with_bar(plan, out / default_folder(policy), label=which, workers=workers))
    page, verdicts = report_into(runs, out / "report", films=films, overwrite=overwrite, listener=LISTENER)
    OUT.print(f"report: {page}", markup=False, soft_wrap=True)
    print_verdicts(verdicts)
