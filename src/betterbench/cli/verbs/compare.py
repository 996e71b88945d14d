"""``better compare``: compare policies, overall and by group, and state the smallest detectable differences."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from betterbench.cli.console import OUT, print_json, progress_bar
from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.installation import calibration_module

if TYPE_CHECKING:
    from betterbench.records import RunFolder
    from betterbench.vlm.prediction import PredictionTable


def compare_command(
    runs: Annotated[tuple[Path, ...], tyro.conf.Positional],
    *,
    name: tyro.conf.UseAppendAction[tuple[str, ...]] = (),
    alpha: float = 0.05,
    sequential: bool = False,
    allow_mixed: bool = False,
    fail_if_worse: bool = False,
    column: str | None = None,
    paper: bool = False,
    out: Path | None = None,
    overwrite: bool = False,
    json: bool = False,
) -> None:
    """Compare policies pairwise, on the trials that their runs share.

    Runs of several suites or of CALVIN are shown in one table instead. It contains success in LIBERO's four suites and
    CALVIN's chains, comparisons on the same initial states, and each policy's drop in success when the scene changes.
    Runs with the same name count as one policy. Runs of `better vlm` are compared in order, each with the previous one.
    You can also pass one run of `better vlm` and one run of `better eval` for each policy, with the same names or in
    the same order. The command then tests whether a better static score predicts a smaller illusion gap.

    Example: better compare runs/pi05 runs/gr00t

    Args:
        runs: Two or more run folders, or files written by `better export`.
        name: Run names in the tables, one per run, in order; default: the policy names. Across
            suites, runs of one policy share one name.
        alpha: Significance level of the tests; intervals have confidence 1 - alpha.
        sequential: Also print tests that remain valid however often unfinished runs are inspected.
        allow_mixed: Compare runs even if their versions or engines differ.
        fail_if_worse: For continuous integration: exit with status 1 if the first run is significantly worse than
            another run over all variations.
        column: For runs of `better vlm`: scores to compare, from strictly parsed answers (strict), all parsed answers
            (parsed, the default), or answers read by an extractor model (extracted).
        paper: For runs of `better vlm`: add the findings of `better audit-paper` about the table of static benchmarks
            in the BeTTER paper (part of betterbench-calibration).
        out: Across suites: folder for the tables as CSV and LaTeX.
        overwrite: Write even to a folder that `better compare` did not make, and replace files with the same names
            there.
        json: Print one JSON document instead of sentences and tables.
    """
    from betterbench.cli.output.comparison import print_comparison
    from betterbench.comparison import compare, load_sides
    from betterbench.comparison.across import is_across
    from betterbench.records import RunFolder
    from betterbench.vlm.stored import is_static_run

    for path in runs:
        if not path.exists():
            raise InvalidInputError(
                str(path), "the path does not exist", "Pass run folders, or files written by `better export`"
            )
    static = [path for path in runs if is_static_run(path)]
    if static:
        given = {"--sequential": sequential, "--allow-mixed": allow_mixed, "--fail-if-worse": fail_if_worse}
        for option in (*(name for name, is_given in given.items() if is_given), *(["--out"] if out else [])):
            raise InvalidInputError(
                option, "this option is not used for runs made with `better vlm`", f"Leave out {option}"
            )
        _static(runs, static, name, alpha=alpha, column=column or "parsed", paper=paper, json=json)
        return
    if paper:
        raise InvalidInputError(
            "--paper", "this option applies only to runs made with `better vlm`", "Leave out --paper"
        )
    if column is not None:
        raise InvalidInputError(
            "--column", "this option applies only to runs made with `better vlm`", "Leave out --column"
        )
    folders = [RunFolder.open(path) for path in runs if path.is_dir()]
    if len(folders) == len(runs) and is_across(folders):
        if sequential or fail_if_worse:
            option = "--sequential" if sequential else "--fail-if-worse"
            raise InvalidInputError(option, "this option applies only to runs of one suite", f"Leave out {option}")
        _across(folders, name, alpha=alpha, allow_mixed=allow_mixed, out=out, overwrite=overwrite, json=json)
        return
    if out is not None:
        raise InvalidInputError(
            "--out", "this option applies only to runs of several suites", "Leave out --out, or use `better report`"
        )
    with progress_bar("diagnosing", 0, stays=False) as (bar, task):

        def told(run: str, done: int, planned: int) -> None:
            bar.update(task, description=f"diagnosing {run}", completed=done, total=planned)

        sides = load_sides(runs, names=name, allow_mixed=allow_mixed, on_progress=told)
    result = compare(sides, alpha=alpha, sequential=sequential, allow_mixed=allow_mixed)
    if json:
        print_json(result.to_json())
    else:
        print_comparison(result)
    if fail_if_worse and result.first_is_worse:
        raise SystemExit(1)


def _static(
    runs: Sequence[Path],
    static: Sequence[Path],
    name: Sequence[str],
    *,
    alpha: float,
    column: str,
    paper: bool,
    json: bool,
) -> None:
    """Compare runs of `better vlm` with each other, or with the illusion gaps of runs of `better eval`."""
    from betterbench.cli.output.vlm import print_prediction, print_steps
    from betterbench.vlm.scoring import COLUMNS
    from betterbench.vlm.steps import step_table

    if column not in COLUMNS:
        raise UnknownNameError("column", column, COLUMNS)
    if len(static) < len(runs):
        found = _prediction(runs, static, name, alpha=alpha, column=column)
        if json:
            print_json(found.to_json())
        else:
            print_prediction(found)
        return
    audited = _audited() if paper else None
    table = step_table(runs, names=name, column=column, alpha=alpha)
    if json:
        print_json({**table.to_json(), **({} if audited is None else {"paper": audited.to_json()})})
        return
    print_steps(table)
    if audited is not None:
        calibration_module("cli.audit_output", _NO_AUDIT).print_audit(audited)


STATIC_TABLE = "static_bottleneck"
"""Name that the audit uses for the paper's table of static benchmarks."""
_NO_AUDIT = "The audit of the paper's table is part of betterbench-calibration, which is not installed"


def _audited() -> Any:  # noqa: ANN401 - an Audit of betterbench-calibration, which this package does not import
    """Return the audit of the table of static benchmarks in the BeTTER paper."""
    audit = calibration_module("audit", _NO_AUDIT)
    found = audit.audit_source(audit.paper_tables())
    return audit.Audit(found.source, tuple(table for table in found.tables if table.table.name == STATIC_TABLE))


def _prediction(
    runs: Sequence[Path], static: Sequence[Path], name: Sequence[str], *, alpha: float, column: str
) -> PredictionTable:
    """Test whether the static scores of policies predict their illusion gaps.

    A policy's run of `better vlm` and its run of `better eval` are matched by name, or by order if no names are given.
    """
    from betterbench.cli.output.diagnosis import diagnosed
    from betterbench.records import RunFolder
    from betterbench.vlm.prediction import prediction_table
    from betterbench.vlm.stored import read_static_run

    if name and len(name) != len(runs):
        problem = f"got {len(name)} names for {len(runs)} runs"
        raise InvalidInputError("--name", problem, "Pass one --name per run, or leave out --name")
    acted = [path for path in runs if path not in static]
    if any(not path.is_dir() for path in acted):
        other = next(path for path in acted if not path.is_dir())
        raise InvalidInputError(
            str(other), "this is not a run folder", "Pass the folder of a run made with `better eval`"
        )
    names = list(name) or [str(i) for group in (static, acted) for i in range(len(group))]
    paths = list(runs) if name else [*static, *acted]
    sides: dict[str, dict[bool, Path]] = {}
    for path, called in zip(paths, names, strict=True):
        pair = sides.setdefault(called, {})
        if (path in static) in pair:
            kind = "better vlm" if path in static else "better eval"
            problem = f"{pair[path in static]} and {path} are both runs of {kind} named {called!r}"
            raise InvalidInputError(
                "--name", problem, "Pass one run made with `better vlm` and one made with `better eval` per policy"
            )
        pair[path in static] = path
    for pair in sides.values():
        if len(pair) < 2:
            missing = "better eval" if True in pair else "better vlm"
            problem = f"{next(iter(pair.values()))} has no run of {missing}"
            cure = "Pass both runs of each policy, with the same --name or in the same order"
            raise InvalidInputError("better compare", f"{problem} for the same policy", cure)
    found = [
        (called if name else None, read_static_run(pair[True]), diagnosed(RunFolder.open(pair[False])))
        for called, pair in sides.items()
    ]
    return prediction_table(found, column=column, alpha=alpha)


def _across(
    folders: Sequence[RunFolder],
    name: Sequence[str],
    *,
    alpha: float,
    allow_mixed: bool,
    out: Path | None,
    overwrite: bool,
    json: bool,
) -> None:
    """Compare runs of several suites, and print the results in one table."""
    from betterbench.cli.output.across import print_across, write_across
    from betterbench.comparison.across import gaps_of, read_suite_runs, world_table
    from betterbench.jobs.outputs import OutputFolder

    suites = read_suite_runs(folders, names=name)
    table = world_table(suites, alpha=alpha, allow_mixed=allow_mixed)
    gaps = gaps_of(suites, alpha=alpha, allow_mixed=allow_mixed)
    files: tuple[Path, ...] = ()
    if out is not None:
        with OutputFolder(out, "compare", overwrite=overwrite):
            files = write_across(table, gaps, out)
    if json:
        print_json({**table.to_json(), "gaps": [gap.to_json() for gap in gaps], "files": [str(f) for f in files]})
        return
    print_across(table, gaps)
    for file in files:
        OUT.print(str(file), markup=False, soft_wrap=True)
