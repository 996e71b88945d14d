"""``better assets import``: import files and catalogue rows into an asset folder."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from betterbench.cli.console import OUT, print_json, print_listing, progress_bar, say
from betterbench.errors import InvalidInputError

if TYPE_CHECKING:
    from betterbench.jobs import JobProgress
    from betterbench.sim.assets.catalogue.entry import CatalogueEntry
    from betterbench.sim.assets.folders.job import ImportReport, ImportRequest
    from betterbench.sim.assets.folders.manifest import FolderAsset


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportOptions:
    """Options for the imported objects. Options that were not given are None."""

    name: str | None
    kind: str | None
    color: str | None
    size_m: float | None
    mass_kg: float | None
    up: Literal["x", "y", "z", "-x", "-y", "-z"] | None
    freeze: bool
    license: str | None
    any_license: bool
    author: str | None


def import_command(
    files: Annotated[tuple[str, ...], tyro.conf.Positional] = (),
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
    workers: int = 1,
    out: Path | None = None,
    overwrite: bool = False,
    json: bool = False,
) -> None:
    """Import GLB, glTF, OBJ, STL, PLY, URDF or MJCF files, or meshes listed in the catalogue, as assets.

    The assets are written to the folder --out, which other subcommands load with --asset-dir. Running the command again
    resumes an interrupted import.

    Example: better assets import mug.glb --kind "coffee mug" --out my_assets

    Args:
        files: Files and catalogue ids to import.
        catalogue: Catalogue folder; by default in the user's cache.
        name: Name of the asset in tasks; only for a single file.
        kind: Name or description that determines the kind, such as "coffee mug"; default: the file name.
        color: Color word; default: the color that covers most of the surface.
        size_m: Longest side in meters; by default inferred from the format and the kind.
        mass_kg: Mass in kilograms; by default inferred from the file or the kind.
        up: Axis of the file that points up, such as --up=-z; auto chooses the axis from the format and the kind.
        freeze: Fix the movable joints of URDF and MJCF files. Without this option, files with movable joints are
            rejected.
        license: License to assume for files that do not state one.
        any_license: Also import files with a restricted or unknown license.
        author: Author to record for files that do not state one.
        workers: Number of files to import in parallel.
        out: Folder for the imported assets.
        overwrite: Replace files that `better assets` did not write.
        json: Print one JSON document instead of a table.
    """
    from betterbench.sim.assets.catalogue.places import usual_folder

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
    _import(catalogue or usual_folder(), files, options, out=out, workers=workers, overwrite=overwrite, json=json)


def _import(
    catalogue: Path,
    given: Sequence[str],
    options: ImportOptions,
    *,
    out: Path | None,
    workers: int,
    overwrite: bool,
    json: bool,
) -> None:
    from betterbench.sim.assets.folders.job import import_assets
    from betterbench.sim.assets.folders.manifest import manifest_of

    if out is None:
        raise InvalidInputError(
            "--out", "no folder for the imported assets is given", "Pass a folder, for example --out my_assets"
        )
    if not given:
        raise InvalidInputError("assets import", "no file was given", "Name the mesh, URDF or MJCF files to import")
    one_only = {
        "--name": options.name,
        "--size-m": options.size_m,
        "--mass-kg": options.mass_kg,
        "--kind": options.kind,
    }
    for option, value in one_only.items():
        if value is not None and len(given) > 1:
            raise InvalidInputError(
                option, f"{len(given)} files were given", "Import one file at a time with this option"
            )
    for option, number in (("--size-m", options.size_m), ("--mass-kg", options.mass_kg)):
        if number is not None and not 0.0 < number < 100.0:
            raise InvalidInputError(
                option,
                f"expected a number above 0 and below 100, got {number:g}",
                "Use a size in meters or a mass in kilograms",
            )
    requests = _requests(catalogue, given, options)
    with progress_bar("import", len(requests)) as (bar, task):

        def on_progress(progress: JobProgress[object]) -> None:
            bar.update(task, completed=progress.done, total=progress.planned)

        report = import_assets(requests, out, workers=workers, overwrite=overwrite, on_progress=on_progress)
    assets = manifest_of(out).assets
    for file, problem in report.failed:
        say(f"skipped {problem}" if problem.startswith(file) else f"skipped {file}: {problem}")
    if json:
        print_json(_document(out, report, assets))
    else:
        _print(out, report, assets)
    if report.failed and not (report.made or report.kept):
        raise InvalidInputError(
            "assets import", "no file could be imported", "Read the reasons printed above, and correct the files"
        )


def _requests(catalogue: Path, given: Sequence[str], options: ImportOptions) -> list[ImportRequest]:
    from betterbench.sim.assets.importing.object_file import FORMATS

    # The id of a row contains a slash ("kitchen/mug.glb"), so a name without a slash is a file.
    ids = [text for text in given if not Path(text).exists() and ("/" in text or Path(text).suffix not in FORMATS)]
    rows = _rows(catalogue, ids)
    return [_of_row(rows[text], options) if text in rows else _of_file(Path(text), options) for text in given]


def _rows(catalogue: Path, ids: Sequence[str]) -> dict[str, CatalogueEntry]:
    """Return the catalogue rows with the given ids.

    If there is no catalogue and the first id looks like a file name, raise an InvalidInputError that reports a missing
    file.
    """
    from betterbench.sim.assets.catalogue.search import Catalogue

    if not ids:
        return {}
    try:
        with Catalogue(catalogue) as opened:
            return {one: opened.entry(one) for one in ids}
    except InvalidInputError as error:
        if Path(ids[0]).suffix:
            raise InvalidInputError(
                ids[0], "the file does not exist", "Pass an existing file, or the id of an asset in the catalogue"
            ) from error
        raise


def _of_file(path: Path, options: ImportOptions) -> ImportRequest:
    from betterbench.sim.assets.folders.job import ImportRequest
    from betterbench.sim.assets.importing.importer import Wishes
    from betterbench.sim.assets.licenses import license_name

    wishes = Wishes(
        name=options.kind,
        size_m=options.size_m,
        mass_kg=options.mass_kg,
        up=options.up,
        license=license_name(options.license or "unknown"),
        author=options.author,
        freeze=options.freeze,
    )
    return ImportRequest(
        path=path, wishes=wishes, name=options.name, color=options.color, any_license=options.any_license
    )


def _of_row(entry: CatalogueEntry, options: ImportOptions) -> ImportRequest:
    """Return the import request for a catalogue row.

    Options that were given override the row's name, license and author.
    """
    from betterbench.sim.assets.folders.rows import request_of_row

    return request_of_row(entry, _of_file(Path(entry.path), options))


def _document(out: Path, report: ImportReport, assets: dict[str, FolderAsset]) -> dict[str, object]:
    listed = [
        {
            "name": name,
            "kept": name in report.kept,
            "color": assets[name].color,
            "kind": assets[name].kind,
            "size_m": list(assets[name].size_m),
            "mass_kg": assets[name].mass_kg,
            "license": assets[name].license,
            "notes": list(assets[name].notes),
        }
        for name in (*report.kept, *report.made)
    ]
    return {
        "folder": str(out),
        "assets": listed,
        "failed": [{"file": file, "reason": reason} for file, reason in report.failed],
    }


def _print(out: Path, report: ImportReport, assets: dict[str, FolderAsset]) -> None:
    rows = []
    for name in (*report.kept, *report.made):
        asset = assets[name]
        size = " x ".join(f"{100 * side:.3g}" for side in asset.size_m)
        rows.append(
            [name, asset.color, asset.license, f"{size} cm, {1000 * asset.mass_kg:.3g} g; {'; '.join(asset.notes)}"]
        )
    if rows:
        print_listing(["asset", "color", "license", ""], rows)
    OUT.print(f"{len(report.made)} imported, {len(report.kept)} kept, {len(report.failed)} skipped")
    if rows:
        OUT.print(f"Load them with --asset-dir {shlex.quote(str(out))}", soft_wrap=True)
