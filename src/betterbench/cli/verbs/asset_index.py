"""``better assets index``: add asset sources to the catalogue."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from betterbench.cli.console import OUT, print_json, progress_bar, say
from betterbench.errors import InvalidInputError, MissingDependencyError

if TYPE_CHECKING:
    from betterbench.sim.assets.catalogue.encoders import TextEncoder
    from betterbench.sim.assets.catalogue.indexing import IndexReport


def index_command(
    sources: Annotated[tuple[str, ...], tyro.conf.Positional] = (),
    *,
    catalogue: Path | None = None,
    name: str | None = None,
    license: str | None = None,  # noqa: A002 - the name of the option
    author: str | None = None,
    encoder: str = "minilm",
    json: bool = False,
) -> None:
    """Add asset sources to the catalogue: built-in generators, folders of meshes, or Objaverse.

    Running the command again reads only changed files, and resumes after an interruption.

    Example: better assets index meshes/kitchen --license cc0

    Args:
        sources: Sources to index: procedural (built-in generators, the default), folders of meshes, objaverse.
        catalogue: Catalogue folder; by default in the user's cache.
        name: Name of the source in the catalogue; only for a single source.
        license: License to assume for files that do not state one.
        author: Author to record for files that do not state one.
        encoder: Text encoder for the search by meaning: minilm or sentence-transformers:MODEL. Use none to search by
            words only.
        json: Print one JSON document instead of a table.
    """
    from betterbench.sim.assets.catalogue.indexing import index_sources
    from betterbench.sim.assets.catalogue.places import usual_folder
    from betterbench.sim.assets.catalogue.sources import SourceOptions, open_source

    if name and len(sources) != 1:
        raise InvalidInputError("--name", f"{len(sources)} sources are given", "Index one source at a time with --name")
    options = SourceOptions(name=name or "", license=license or "", author=author or "")
    folder = catalogue or usual_folder()
    opened = [open_source(address, options) for address in sources or ("procedural",)]
    loaded, missing = _encoder(encoder)
    with progress_bar("asset catalogue", 0) as (bar, task):

        def on_progress(stage: str, done: int, total: int) -> None:
            bar.update(task, description=stage, completed=done, total=total or None)

        report = index_sources(folder, opened, encoder=loaded, on_progress=on_progress)
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
    """Return the text encoder with the given name, and an empty message.

    If this is the default encoder and it is not installed, return None and a message with the command that installs it.
    """
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
