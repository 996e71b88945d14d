"""``better assets licenses``: count the licenses in the catalogue."""

from __future__ import annotations

from pathlib import Path

from betterbench.cli.console import OUT, print_json, print_table


def licenses_command(*, catalogue: Path | None = None, json: bool = False) -> None:
    """Print the number of assets per source and license.

    Example: better assets licenses

    Args:
        catalogue: Catalogue folder; by default in the user's cache.
        json: Print one JSON document instead of a table.
    """
    from betterbench.sim.assets.catalogue.places import usual_folder
    from betterbench.sim.assets.catalogue.search import Catalogue
    from betterbench.sim.assets.licenses import license_kind

    with Catalogue(catalogue or usual_folder()) as opened:
        rows = [(source, name, license_kind(name), total) for source, name, total in opened.licenses()]
    if json:
        keys = ("source", "license", "kind", "assets")
        print_json([dict(zip(keys, row, strict=True)) for row in rows])
        return
    print_table(
        ["source", "license", "kind", "assets"],
        [[source, name or "–", kind, str(total)] for source, name, kind, total in rows],
    )
    left_out = sum(total for _, _, kind, total in rows if kind != "free")
    if left_out:
        OUT.print(f"\n{left_out} assets are found only with --license any.")
