"""``better assets``: the asset catalogue over several sources, its search, and the import of files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from betterbench.cli.console import OUT, print_json, print_listing, print_table, progress_bar, say
from betterbench.errors import InvalidInputError, MissingDependencyError

if TYPE_CHECKING:
    from betterbench.sim.assets.catalogue.encoders import TextEncoder
    from betterbench.sim.assets.catalogue.entry import CatalogueEntry
    from betterbench.sim.assets.catalogue.indexing import IndexReport
    from betterbench.sim.assets.catalogue.search import Catalogue, Filters, Hit
    from betterbench.sim.assets.catalogue.sources import SourceOptions

What = Literal["index", "search", "show", "licenses", "import", "check"]


def assets_command(
    what: Annotated[What, tyro.conf.Positional, tyro.conf.arg(metavar="WHAT")],
    given: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="TEXT")] = (),
    *,
    catalogue: Path | None = None,
    name: str | None = None,
    kind: str | None = None,
    color: str | None = None,
    size_m: float | None = None,
    mass_kg: float | None = None,
    up: Literal["auto", "x", "y", "z", "-x", "-y", "-z"] = "auto",
    freeze: bool = False,
    license: str | None = None,  # noqa: A002 - the name of the option
    any_license: bool = False,
    author: str | None = None,
    encoder: str = "minilm",
    limit: int = 10,
    num: int | None = None,
    seed: int = 0,
    source: str | None = None,
    max_faces: int | None = None,
    max_size: float | None = None,
    min_size: float | None = None,
    picture: Path | None = None,
    workers: int = 1,
    out: Path | None = None,
    overwrite: bool = False,
    json: bool = False,
) -> None:
    """Index sources of assets, search them by words and meaning, show one, list licenses, import or check assets.

    index reads sources into the catalogue: procedural (built-in generators, the default), a folder of meshes,
        objaverse.
    search takes a description; show takes an asset's id. Assets whose license forbids commercial use or changes, or is
    unknown, are left out unless --license any is given. import makes assets from GLB, glTF, OBJ, STL, PLY, URDF and
    MJCF files, or from catalogue ids, in the folder --out, which other verbs load with --asset-dir. check certifies
    files, folders and registered assets, and exits with status 1 if one fails.

    Example: better assets search "a shiny red apple" --out sheet.png

    Args:
        what: index, search, show, licenses, import or check.
        given: Sources to index, the description to search, the id to show, the files and ids to import, or the files,
            folders and assets to check.
        catalogue: Catalogue folder; by default in the user's cache.
        name: With index: name of the source in the catalogue. With import: name of the asset in tasks, for a single
            file.
        kind: With import and check: name or description that determines the kind, such as "coffee mug"; default: the
            file name.
        color: With import and check: color word; default: the color that covers most of the surface.
        size_m: With import and check: longest side in meters; by default from the format and the kind.
        mass_kg: With import and check: mass in kilograms; by default from the file or the kind.
        up: With import and check: the file's up axis, such as --up=-z; auto chooses it from format and kind.
        freeze: With import and check: fix the movable joints of a URDF or MJCF file, which are an error otherwise.
        license: With index, import and check: license of files without one. With search: free (the default) or any.
        any_license: With import: also import files with a restricted or unknown license.
        author: With index and import: author of files without one.
        encoder: With index: encoder of meaning: minilm, sentence-transformers:MODEL, or none for words only.
        limit: Largest number of assets to list.
        num: Number of assets to choose for one description, which differ in shape and color.
        seed: Seed for the choice of --num assets.
        source: Search only this source.
        max_faces: Maximum number of triangles in an asset.
        max_size: Largest extent of an asset in meters.
        min_size: Least extent of the largest side in meters.
        picture: With check: PNG or JPEG file for pictures of visible parts, collision parts and pose at rest.
        workers: With import: number of files imported at once.
        out: PNG or JPEG file for a sheet of pictures with scores and licenses. With import: folder of the assets. With
            check: folder that keeps the certificates; the same command resumes with the remaining assets.
        overwrite: Replace files that better assets did not write.
        json: Print one JSON document instead of a table.
    """
    folder = catalogue or _usual_folder()
    if what == "index":
        from betterbench.sim.assets.catalogue.sources import SourceOptions

        source_options = SourceOptions(name=name or "", license=license or "", author=author or "")
        _index(folder, given, source_options, encoder=encoder, json=json)
        return
    if what == "import":
        from betterbench.cli.verbs.asset_import import ImportOptions, import_command

        options = ImportOptions(
            name=name,
            kind=kind,
            color=color,
            size_m=size_m,
            mass_kg=mass_kg,
            up=None if up == "auto" else up,
            freeze=freeze,
            license=license,
            any_license=any_license,
            author=author,
        )
        import_command(folder, given, options, out=out, workers=workers, overwrite=overwrite, json=json)
        return
    from betterbench.sim.assets.catalogue.encoders import open_encoder
    from betterbench.sim.assets.catalogue.search import Catalogue, Filters

    if what == "check":
        from betterbench.cli.verbs.asset_check import check_assets
        from betterbench.sim.assets.importing.importer import Wishes

        axis = None if up == "auto" else up
        wishes = Wishes(kind, size_m, mass_kg, axis, license or "unknown", freeze=freeze)
        check_assets(given, wishes, color=color, out=out, picture=picture, overwrite=overwrite, json=json)
        return
    if license not in (None, "free", "any"):
        raise InvalidInputError(
            "--license", f"{license!r} is not a choice of --license", "Add --license any to include all licenses"
        )
    filters = Filters(
        license="any" if license == "any" else "free",
        source=source or "",
        max_faces=max_faces,
        max_size_m=max_size,
        min_size_m=min_size,
    )
    with Catalogue(folder, encoder=open_encoder) as opened:
        if what == "licenses":
            _licenses(opened, given, json=json)
        elif what == "show":
            _show(opened, given, out, overwrite=overwrite, json=json)
        else:
            query = " ".join(given)
            hits = _found(opened, query, limit=limit, num=num, seed=seed, filters=filters)
            if out is not None:
                _write_sheet(hits, out, overwrite=overwrite)
            _print_hits(opened, query, hits, json=json)


def _usual_folder() -> Path:
    from betterbench.sim.assets.catalogue.places import usual_folder

    return usual_folder()


# -------------------------------------------------------------------------------------------------------------- index


def _index(folder: Path, given: Sequence[str], options: SourceOptions, *, encoder: str, json: bool) -> None:
    from betterbench.sim.assets.catalogue.indexing import index_sources
    from betterbench.sim.assets.catalogue.sources import open_source

    if options.name and len(given) != 1:
        raise InvalidInputError("--name", f"{len(given)} sources are given", "Index one source at a time with --name")
    sources = [open_source(address, options) for address in given or ("procedural",)]
    loaded, missing = _encoder(encoder)
    with progress_bar("catalogue of assets", 0) as (bar, task):

        def on_progress(stage: str, done: int, total: int) -> None:
            bar.update(task, description=stage, completed=done, total=total or None)

        report = index_sources(folder, sources, encoder=loaded, on_progress=on_progress)
    for asset, reason in report.named:
        say(f"skipped {asset}: {reason}")
    if missing:
        say(f"The catalogue can be searched by words only. {missing}")
    if json:
        print_json(_index_document(folder, report, loaded))
    else:
        OUT.print(
            f"{report.total} assets: {report.added} new, {report.updated} changed, {report.kept} kept, "
            f"{report.removed} removed, {report.skipped} skipped"
        )
        OUT.print(str(folder), soft_wrap=True)


def _encoder(name: str) -> tuple[TextEncoder | None, str]:
    """Return an encoder by name, and a message if the default encoder is not available."""
    from betterbench.sim.assets.catalogue.encoders import DEFAULT, open_encoder

    if name == "none":
        return None, ""
    try:
        return open_encoder(name), ""
    except MissingDependencyError as error:
        if name != DEFAULT:
            raise
        return None, f"{error}, then better assets index again"


def _index_document(folder: Path, report: IndexReport, encoder: TextEncoder | None) -> dict[str, object]:
    counts = ("total", "added", "updated", "kept", "removed", "encoded", "skipped")
    return {
        "catalogue": str(folder),
        **{count: getattr(report, count) for count in counts},
        "skipped_first": [{"asset": asset, "reason": reason} for asset, reason in report.named],
        "encoder": None if encoder is None else encoder.name,
    }


# ------------------------------------------------------------------------------------------------------------- search


def _found(
    opened: Catalogue, query: str, *, limit: int, num: int | None, seed: int, filters: Filters
) -> list[tuple[str, Hit]]:
    """Return ids and hits for a query, or the selection for ``--num``."""
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
    """Return the message about a catalogue without vectors, with the command that adds vectors."""
    from betterbench.installation import EXTRAS, extra_command

    install = "" if EXTRAS["assets"].is_installed else f"{extra_command('assets')}, then "
    return f"Searched by words only. To search by meaning too, run: {install}better assets index"


def _said(entry: CatalogueEntry) -> str:
    size = "" if entry.size_m is None else " x ".join(f"{side:.3g}" for side in entry.size_m) + " m"
    faces = "" if entry.faces is None else f"{entry.faces} triangles"
    by = f"by {entry.author}" if entry.author else ""
    said = entry.description or entry.name
    return ", ".join(part for part in (said.rstrip("."), size, faces, by) if part)


def _show(opened: Catalogue, given: Sequence[str], out: Path | None, *, overwrite: bool, json: bool) -> None:
    """Print one asset, and write its picture."""
    if len(given) != 1:
        raise InvalidInputError(
            "assets show", f"{len(given)} ids are given", "Give one id, as listed by better assets search"
        )
    entry = opened.entry(given[0])
    if out is not None:
        from betterbench.sim.assets.catalogue.search import Hit

        _write_sheet([(given[0], Hit(entry, 1.0, None, None, None))], out, overwrite=overwrite)
    form = entry.to_json()
    if json:
        print_json(form)
        return
    width = max(map(len, form))
    for key, value in form.items():
        shown = ", ".join(map(str, value)) if isinstance(value, list) else "–" if value in (None, "") else str(value)
        OUT.print(f"{key.replace('_', ' '):<{width}}  {shown}", soft_wrap=True)


def _licenses(opened: Catalogue, given: Sequence[str], *, json: bool) -> None:
    """Print how many assets of each source have which license."""
    from betterbench.sim.assets.licenses import license_kind

    if given:
        raise InvalidInputError("assets licenses", f"{given[0]!r} is not expected here", "Leave it out")
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
        OUT.print(f"\n{left_out} assets are searched only with --license any.")


def _write_sheet(hits: Sequence[tuple[str, Hit]], out: Path, *, overwrite: bool) -> None:
    """Write the pictures of some assets with their scores and licenses."""
    from PIL import Image

    from betterbench.cli.output.asset_sheet import asset_sheet
    from betterbench.evaluation.figures.show import image_file
    from betterbench.jobs import write_durably
    from betterbench.jobs.outputs import OutputFile, mark_of

    if out.suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise InvalidInputError("--out", f"{out} ends with {out.suffix!r}", "Name a file that ends with .png or .jpg")
    if not hits:
        return
    with OutputFile(out, "assets", overwrite=overwrite):
        sheet = Image.fromarray(asset_sheet(hits))
        write_durably(out, image_file(sheet, out.suffix, remark=mark_of("assets")))
    say(f"wrote {out}", whole=True)
