"""File with the pictures of some assets."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from betterbench.cli.output.picture_file import picture_file

if TYPE_CHECKING:
    from betterbench.sim.assets.catalogue.search import Hit


def write_sheet(hits: Sequence[tuple[str, Hit]], out: Path, *, overwrite: bool) -> None:
    """Write the pictures of some assets with their scores and licenses."""
    with picture_file(out, "assets", overwrite=overwrite) as write:
        if hits:
            from PIL import Image

            from betterbench.cli.output.asset_sheet import asset_sheet

            write(Image.fromarray(asset_sheet(hits)), ())
