"""``better doctor``: check this installation and print remedies, or try out a policy before a run."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from betterbench.cli.console import OUT, print_json, print_table, say
from betterbench.cli.robot_option import USUAL_OPTION, ChosenRobot
from betterbench.errors import BetterError, HandshakeError

if TYPE_CHECKING:
    from betterbench.evaluation.preflight.check import PreflightCheck


def doctor_command(
    *,
    policy: str | None = None,
    suite: str | None = None,
    task: str | None = None,
    condition: str | None = None,
    seed: int = 0,
    action_space: str | None = None,
    observation: str = "default",
    quality: str = "standard",
    arm: ChosenRobot = USUAL_OPTION,
    proof: bool = True,
    out: Path | None = None,
    overwrite: bool = False,
    json: bool = False,
) -> None:
    """Check this installation, and print a remedy for each failed check. The exit status is 2 if a check fails.

    With --policy: compare conventions, request actions for one observation, measure the latency, and draw the
    observation and the motion that the actions would cause. Then send the observations of a demonstration to the
    policy, and compare its actions with the demonstration. This comparison checks the conventions and determines a
    scale factor per axis.

    Example: better doctor --policy openpi://localhost:8000?preset=openpi_libero

    Args:
        policy: Policy address to check (see `better list policies`).
        suite: Name of a packaged suite, or folder with a suite in JSON.
        task: Task whose initial observation is sent to the policy; default: the first task of --suite, or fast_food.
        condition: Condition of that task; default: its first training condition.
        seed: Trial seed.
        action_space: Action space of the planned run; default: the action space that the policy declares.
        observation: Observation preset of the planned run: default, official or state_only.
        quality: Render preset: fast, standard or high.
        arm: The robot of the planned run.
        proof: Replay a demonstration, which takes up to 100 requests.
        out: PNG file to write; doctor-POLICY.png if not given.
        overwrite: Replace a file that `better doctor` did not write.
        json: Print one JSON document instead of a table.
    """
    if policy is None:
        _check_machine(json=json)
        return
    from betterbench.cli.output.preflight import print_conventions, print_preflight
    from betterbench.cli.verbs.evaluate import default_folder
    from betterbench.evaluation import named_trial, run_preflight
    from betterbench.evaluation.preflight.view import preflight_view
    from betterbench.jobs.outputs import OutputFile
    from betterbench.report.pages.preflight_sheet import write_preflight_sheet
    from betterbench.tasks import suite_tasks

    of_suite = ("fast_food",) if suite is None else suite_tasks(suite)
    task = task or of_suite[0]
    out = out or Path(f"doctor-{default_folder(policy)}.png")
    with OutputFile(out, "doctor", overwrite=overwrite):
        found = run_preflight(
            policy,
            named_trial(task, condition, seed),
            action_space_name=action_space,
            observation=observation,
            quality=quality,
            proof=proof,
            robot=arm.of([task]),
            on_conventions=None if json else print_conventions,
        )
        write_preflight_sheet(preflight_view(found), out)
    print_preflight(found, json=json)
    say(f"wrote {out}", whole=True)
    _require_proof(found)


def _require_proof(found: PreflightCheck) -> None:
    if found.proof is not None and found.proof.wrong:
        raise HandshakeError(f"The replayed demonstration shows: {found.proof.verdict}")


def _check_machine(*, json: bool) -> None:
    """Print the features that work on this machine. Raise BetterError if a check fails."""
    from betterbench.cli.checks import run_checks

    checks = run_checks()
    broken = [check for check in checks if not check.works]
    if json:
        print_json([asdict(check) for check in checks])
    else:
        print_table(["", "what", "found"], [["ok" if c.works else "NO", c.name, c.detail] for c in checks])
        missing = [check for check in checks if check.works and check.cure]
        if missing:
            OUT.print("\nTo install an extra:")
        for check in missing:  # a terminal breaks a long line without a line feed, so the command can be copied
            OUT.print(
                f"{check.name.removeprefix('extra ')}: {check.cure}", markup=False, highlight=False, soft_wrap=True
            )
        for cure in dict.fromkeys(check.cure for check in broken):
            names = ", ".join(check.name for check in broken if check.cure == cure)
            OUT.print(f"\n{names}: {cure}", markup=False, soft_wrap=not OUT.is_terminal)
    if broken:
        names = ", ".join(check.name for check in broken)
        raise BetterError(f"These checks fail on this machine: {names}. The remedies are printed above.")
