"""Functions that print the preflight check (``better doctor --policy``)."""

from __future__ import annotations

from betterbench.cli.console import OUT, print_json, print_table
from betterbench.evaluation import Convention, PreflightCheck
from betterbench.evaluation.preflight.proof import ReplayProof
from betterbench.evaluation.preflight.view import numbers_text


def print_conventions(conventions: tuple[Convention, ...]) -> None:
    """Print the conventions that this program and the policy declare (such as the action space) side by side."""
    rows = [
        [c.name, "differs" if c.differs else "same" if c.ours and c.theirs else "", c.ours or "–", c.theirs or "–"]
        for c in conventions
    ]
    print_table(["convention", "", "this side", "the policy"], rows)


def print_preflight(found: PreflightCheck, *, json: bool) -> None:
    """Print the observation sent to the policy, the policy's answer, and the response times."""
    if json:
        print_json(found.to_json())
        return
    first = numbers_text(found.actions[0])
    assumed = found.info.metadata.get("assumed")
    rows = [
        *([["assumed", assumed]] if assumed else []),
        ["prompt", found.prompt],
        *[[f"image {s.key}", s.note] for s in found.shown],
        *[[f"state {key}", numbers_text(values)] for key, values in found.state],
        ["answer", f"{len(found.actions)} x {found.actions.shape[1]} in {found.info.action_space}; first: {first}"],
        *(
            [["out of range", f"{found.clipped} of {len(found.actions)} actions would be clipped in a run"]]
            * bool(found.clipped)
        ),
        ["first request", f"{1000 * found.first_s:.1f} ms"],
        ["next requests", f"{1000 * found.p50_s:.1f} ms median, {1000 * found.max_s:.1f} ms at most"],
    ]
    OUT.print()
    print_table(["asked", "found"], rows)
    if found.proof is not None:
        _print_proof(found.proof)


def _print_proof(proof: ReplayProof) -> None:
    """Print the agreement of the policy's answers with the replayed demonstration, one row per axis of motion."""
    rows = [
        [
            axis.name,
            _length(axis.range, axis.unit),
            "hardly moves" if axis.factor is None else f"{axis.factor:.2f}",
            "–" if axis.agreement is None or axis.factor is None else f"{axis.agreement:.2f}",
            _length(axis.apart, axis.unit),
        ]
        for axis in proof.axes
    ]
    OUT.print()
    print_table(["axis", "demonstration moves", "factor", "agreement", "distance between paths"], rows)
    OUT.print(
        f"Replayed {proof.steps} steps of a demonstration in {proof.requests} requests. The gripper command is the "
        f"same in {100 * proof.gripper:.0f} % of the steps. When executed, the answers end "
        f"{_length(proof.executed_off_m, 'm')} from where the demonstration ended. "
        f"Verdict: {proof.verdict.rstrip('.')}.",
        markup=False,
        soft_wrap=not OUT.is_terminal,
    )


def _length(value: float, unit: str) -> str:
    """Format a length [m] in centimeters, or an angle [rad]."""
    return f"{100.0 * value:.1f} cm" if unit == "m" else f"{value:.2f} rad"
