"""File with the pictures of some assets."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from betterbench.cli.console import say
from betterbench.errors import InvalidInputError

if TYPE_CHECKING:
    from betterbench.sim.assets.catalogue.search import Hit


def write_sheet(hits: Sequence[tuple[str, Hit]], out: Path, *, overwrite: bool) -> None:
    """Write the pictures of some assets with their scores and licenses."""
    from PIL import Image

    from betterbench.cli.output.asset_sheet import asset_sheet
    from betterbench.evaluation.figures.show import image_file
    from betterbench.jobs import write_durably
    from betterbench.jobs.outputs import OutputFile, mark_of

    if out.suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise InvalidInputError(
            "--out", f"{out} ends with {out.suffix!r}", "Choose a file name that ends with .png or .jpg"
        )
    if not hits:
        return
    with OutputFile(out, "assets", overwrite=overwrite):
        sheet = Image.fromarray(asset_sheet(hits))
        write_durably(out, image_file(sheet, out.suffix, remark=mark_of("assets")))
    say(f"wrote {out}", whole=True)
