"""``better assets search``: find assets by description."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from betterbench.cli.console import print_json, print_listing, say
from betterbench.cli.output.asset_file import write_sheet
from betterbench.errors import InvalidInputError

if TYPE_CHECKING:
    from betterbench.sim.assets.catalogue.entry import CatalogueEntry
    from betterbench.sim.assets.catalogue.search import Catalogue, Filters, Hit


def search_command(
    text: Annotated[tuple[str, ...], tyro.conf.Positional] = (),
    *,
    catalogue: Path | None = None,
    license: str | None = None,  # noqa: A002 - the name of the option
    limit: int = 10,
    num: int | None = None,
    seed: int = 0,
    source: str | None = None,
    max_faces: int | None = None,
    max_size: float | None = None,
    min_size: float | None = None,
    out: Path | None = None,
    overwrite: bool = False,
    json: bool = False,
) -> None:
    """Search for assets by words and meaning.

    Assets whose license forbids commercial use or changes, or is unknown, are omitted unless --license any is given.

    Example: better assets search "a shiny red apple" --out sheet.png

    Args:
        text: Description of the asset.
        catalogue: Catalogue folder; by default in the user's cache.
        license: Licenses to include: free (the default) or any.
        limit: Maximum number of assets to list.
        num: Instead of the best matches, choose this number of matching assets that differ in shape and color.
        seed: Seed for the choice of --num assets.
        source: Search only this source.
        max_faces: Maximum number of triangles in an asset.
        max_size: Maximum length of an asset's longest side in meters.
        min_size: Minimum length of an asset's longest side in meters.
        out: PNG or JPEG file to write, with a picture, score and license of each asset.
        overwrite: Replace a file that `better assets` did not write.
        json: Print one JSON document instead of a table.
    """
    from betterbench.sim.assets.catalogue.encoders import open_encoder
    from betterbench.sim.assets.catalogue.places import usual_folder
    from betterbench.sim.assets.catalogue.search import Catalogue, Filters

    if license not in (None, "free", "any"):
        raise InvalidInputError(
            "--license",
            f"expected 'free' or 'any', got {license!r}",
            "Use --license any to include assets with any license",
        )
    filters = Filters(
        license="any" if license == "any" else "free",
        source=source or "",
        max_faces=max_faces,
        max_size_m=max_size,
        min_size_m=min_size,
    )
    with Catalogue(catalogue or usual_folder(), encoder=open_encoder) as opened:
        query = " ".join(text)
        hits = _found(opened, query, limit=limit, num=num, seed=seed, filters=filters)
        if out is not None:
            write_sheet(hits, out, overwrite=overwrite)
        _print_hits(opened, query, hits, json=json)


def _found(
    opened: Catalogue, query: str, *, limit: int, num: int | None, seed: int, filters: Filters
) -> list[tuple[str, Hit]]:
    """Return the assets that match a query, as pairs of asset id and search hit.

    If ``num`` is given, return this number of matching assets that differ in shape and color.
    """
    from betterbench.sim.assets.catalogue.variety import choose_different

    if num is not None:
        return [(one.id, one.hit) for one in choose_different(opened, query, num, seed=seed, filters=filters)]
    return [(hit.entry.id, hit) for hit in opened.search(query, limit=limit, filters=filters)]


def _print_hits(opened: Catalogue, query: str, hits: Sequence[tuple[str, Hit]], *, json: bool) -> None:
    if json:
        encoder = opened.encoder_name if opened.has_vectors else None
        found = [{**hit.to_json(), "id": asset, "row": hit.entry.id} for asset, hit in hits]
        print_json({"query": query, "encoder": encoder, "assets": found})
    elif hits:
        rows = [[asset, f"{hit.score:.2f}", hit.entry.license or "unknown", _said(hit.entry)] for asset, hit in hits]
        print_listing(["asset", "score", "license", ""], rows)
    else:
        say("Nothing was found. Try other words, --license any, or index more sources.")
    if not opened.has_vectors:
        say(_without_meaning())


def _without_meaning() -> str:
    """Return a message saying that the search compared only words, not meanings.

    The message includes the command that adds text embeddings to the catalogue.
    """
    from betterbench.installation import EXTRAS, extra_command

    install = "" if EXTRAS["assets"].is_installed else f"{extra_command('assets')}, then "
    return f"Searched by words only. To search by meaning too, run: {install}better assets index"


def _said(entry: CatalogueEntry) -> str:
    size = "" if entry.size_m is None else " x ".join(f"{side:.3g}" for side in entry.size_m) + " m"
    faces = "" if entry.faces is None else f"{entry.faces} triangles"
    by = f"by {entry.author}" if entry.author else ""
    said = entry.description or entry.name
    return ", ".join(part for part in (said.rstrip("."), size, faces, by) if part)
