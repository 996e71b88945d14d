"""``better real sheet``: write the marker sheet that is laid on the table of the real scene."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from betterbench.cli.console import OUT, say


def sheet_command(*, out: Path, paper: Literal["a4", "letter", "whole"] = "a4", overwrite: bool = False) -> None:
    """Write the marker sheet as PDF and SVG: markers, object slots, position of the arm's base, and rulers.

    Lay the sheet on the table around the arm to measure the pose of the front camera (`better real check-cameras`) and
    to mark the positions of objects. The sheet has six pages of A4 or Letter and an overview with instructions, or one
    page of 795 x 410 mm for a print shop (whole).

    Example: better real sheet --out sheet --paper a4

    Args:
        out: Folder for the files.
        paper: Size of the paper: a4, letter or whole.
        overwrite: Write even to a folder that `better real sheet` did not make, and replace files with the same names
            there.
    """
    from betterbench.jobs.outputs import OutputFolder
    from betterbench.real.sheet.pages import write_sheet

    with OutputFolder(out, "real sheet", overwrite=overwrite):
        paths = write_sheet(out, paper)
    say(f"wrote {len(paths)} files; print the PDF at 100 %, without scaling it to the page", whole=True)
    OUT.print(str(paths[0]), markup=False, soft_wrap=True)
