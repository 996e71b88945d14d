"""Image file with pictures of assets that a search found."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from betterbench.cli.output.picture_file import picture_file

if TYPE_CHECKING:
    from betterbench.sim.assets.catalogue.search import Hit


def write_sheet(hits: Sequence[tuple[str, Hit]], out: Path, *, overwrite: bool) -> None:
    """Write an image file with a picture of each asset, its search score and its license."""
    with picture_file(out, "assets", overwrite=overwrite) as write:
        if hits:
            from PIL import Image

            from betterbench.cli.output.asset_sheet import asset_sheet

            write(Image.fromarray(asset_sheet(hits)), ())
