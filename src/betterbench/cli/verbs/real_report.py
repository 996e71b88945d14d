"""``better real report``: report the labels, matrices and agreement of a protocol on a real robot arm."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import tyro

from betterbench.cli.console import OUT, print_json, print_table, say


def report_command(
    folder: Annotated[Path, tyro.conf.Positional],
    *,
    sim: tyro.conf.UseAppendAction[tuple[Path, ...]] = (),
    out: Path | None = None,
    overwrite: bool = False,
    json: bool = False,
) -> None:
    """Write the report on a protocol: diagnostic matrices of each policy, labels with evidence, and agreement.

    Labels are based on joint states and on the judgments of videos. A trial is unscored if neither of them determines a
    label, or if the files of the trial have changed. Judgments that contradict the joint states are listed. With --sim,
    each cell is compared with a run of the same policy on the simulated twin. The report shows conditions and policies:
    do not show it to judges before they have finished.

    Example: better real report bench --sim runs/ours_on_the_twin

    Args:
        folder: Folder of the protocol.
        sim: Run of one of the policies on the simulated twin; may be given several times.
        out: HTML file; FOLDER/report/index.html if not given.
        overwrite: Replace a file that `better real report` did not write.
        json: Print one JSON document instead of writing a page.
    """
    from betterbench.jobs.outputs import OutputFile
    from betterbench.real.report_page import write_real_page
    from betterbench.real.results import results_of

    results = results_of(folder, sim)
    if json:
        print_json(results.to_json())
        return
    path = out or folder / "report" / "index.html"
    path.parent.mkdir(parents=True, exist_ok=True)
    with OutputFile(path, "real report", overwrite=overwrite):
        write_real_page(results, path)
    rows = [[p.policy.name, *map(str, list(asdict(p.counts).values())[:5])] for p in results.policies]
    done = len(results.run.trials) + len(results.run.damaged)
    title = f"{done} of {len(results.run.plan.trials)} trials are done"
    print_table(["policy", "right", "failed", "ambiguous", "unscored", "not done"], rows, title=title)
    for damaged in results.run.damaged:
        say(f"{damaged.code} is unscored because its files are damaged: {damaged.problem}", whole=True)
    for trial in results.trials:
        if trial.label.contradiction:
            say(f"{trial.trial.code}: {trial.label.contradiction}", whole=True)
    for agreement in results.agreements:
        say(agreement.sentence, whole=True)
    for sentence in results.order.sentences:
        say(sentence, whole=True)
    for twin in results.twins:
        say(f"{twin.policy}: {twin.sentence}", whole=True)
    OUT.print(str(path), markup=False, soft_wrap=True)
