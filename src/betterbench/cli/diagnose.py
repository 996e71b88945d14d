"""``better diagnose``: why each trial ended as it did."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from betterbench.cli.console import OUT, print_json, say


def diagnose_command(run: Annotated[Path, tyro.conf.Positional], *, keep: bool = False, json: bool = False) -> None:
    """Diagnose every trial of a run from its records alone.

    The result is stored as RUN/diagnosis.json. If the run holds an earlier one, the differences are printed. A run
    that is still going can be diagnosed too: trials that it has not reached are not counted, and nothing is stored.

    Example: better diagnose runs/expert

    Args:
        run: Folder of the run.
        keep: Leave the stored diagnosis as it is.
        json: Print one JSON document instead of tables.
    """
    from betterbench.cli.output.diagnosis import print_changes, print_diagnosis
    from betterbench.cli.output.standing import print_standing
    from betterbench.diagnosis import diagnose_run, stored
    from betterbench.diagnosis.changes import find_changes
    from betterbench.diagnosis.standing import standing_of
    from betterbench.recording import RunFolder
    from betterbench.report.headline import verdict_line

    folder = RunFolder.open(run)
    before = stored.read_stored(folder)
    result = diagnose_run(folder)
    changes = None if before is None or result.pending else find_changes(before, stored.StoredDiagnosis.of(result))
    if result.pending:
        say(f"The run is still going: {len(result.trials)} of {result.planned} trials are done. Nothing is stored.")
    elif not keep:
        try:
            stored.store_diagnosis(folder, result)
        except OSError as error:
            say(f"not stored: {stored.stored_path(folder)} cannot be written ({error.strerror})")
    if json:
        standing = standing_of(result).to_json()
        print_json({**result.to_json(), "power": standing, "changes": None if changes is None else changes.to_json()})
        return
    print_diagnosis(result)
    print_standing(result.policy, standing_of(result))
    if changes is not None and changes.any:
        print_changes(changes)
    OUT.print(f"\n{verdict_line(result)}", markup=False, style="bold", soft_wrap=True)
