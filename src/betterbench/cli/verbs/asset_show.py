"""``better assets show``: print one asset of the catalogue."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from betterbench.cli.console import OUT, print_json
from betterbench.cli.output.asset_file import write_sheet
from betterbench.errors import InvalidInputError


def show_asset_command(
    ids: Annotated[tuple[str, ...], tyro.conf.Positional] = (),
    *,
    catalogue: Path | None = None,
    out: Path | None = None,
    overwrite: bool = False,
    json: bool = False,
) -> None:
    """Print one asset of the catalogue, and write its picture.

    Example: better assets show procedural/mug-red --out mug.png

    Args:
        ids: Id of the asset, as listed by `better assets search`.
        catalogue: Catalogue folder; by default in the user's cache.
        out: PNG or JPEG file for the picture.
        overwrite: Replace a file that `better assets` did not write.
        json: Print one JSON document instead of a table.
    """
    from betterbench.sim.assets.catalogue.places import usual_folder
    from betterbench.sim.assets.catalogue.search import Catalogue, Hit

    if len(ids) != 1:
        raise InvalidInputError(
            "assets show", f"{len(ids)} ids are given", "Pass one id, as listed by `better assets search`"
        )
    with Catalogue(catalogue or usual_folder()) as opened:
        entry = opened.entry(ids[0])
    if out is not None:
        write_sheet([(ids[0], Hit(entry, 1.0, None, None, None))], out, overwrite=overwrite)
    form = entry.to_json()
    if json:
        print_json(form)
        return
    width = max(map(len, form))
    for key, value in form.items():
        shown = ", ".join(map(str, value)) if isinstance(value, list) else "–" if value in (None, "") else str(value)
        OUT.print(f"{key.replace('_', ' '):<{width}}  {shown}", soft_wrap=True)
