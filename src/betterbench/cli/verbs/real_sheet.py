"""``better real sheet``: write the marker sheet of the real scene, to print."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from betterbench.cli.console import OUT, say


def sheet_command(*, out: Path, paper: Literal["a4", "letter", "whole"] = "a4", overwrite: bool = False) -> None:
    """Write the marker sheet as PDF and SVG, true to scale: markers, slots, the place of the arm's base, and rulers.

    The sheet lies on the table around the arm while better real check-cameras measures the front camera, and while the
    places of objects are marked. It has six pages on A4 or Letter, and an overview with instructions; whole is one page
    of 795 x 410 mm for a print shop.

    Example: better real sheet --out sheet --paper a4

    Args:
        out: Folder for the files.
        paper: Size of the paper: a4, letter or whole.
        overwrite: Write to a folder that better real sheet did not make, and replace files with the same names there.
    """
    from betterbench.jobs.outputs import OutputFolder
    from betterbench.real.sheet.pages import write_sheet

    with OutputFolder(out, "real sheet", overwrite=overwrite):
        paths = write_sheet(out, paper)
    say(f"wrote {len(paths)} files; print the PDF at 100 %, without fitting it to the page", whole=True)
    OUT.print(str(paths[0]), markup=False, soft_wrap=True)
