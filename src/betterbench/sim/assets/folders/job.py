"""Job that imports many files into an asset folder. An interrupted job can be resumed."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np

from betterbench.errors import BetterError, InvalidInputError, StorageError, one_line
from betterbench.jobs.durable import write_durably
from betterbench.jobs.item_threads import NoResource, in_threads
from betterbench.jobs.job import JobProgress, run_items
from betterbench.jobs.outputs import OutputFolder
from betterbench.json_form import file_digest
from betterbench.sim.assets.asset import VisualPart
from betterbench.sim.assets.authoring.registry import categories
from betterbench.sim.assets.folders.manifest import FolderAsset, is_asset_name, manifest_bytes, manifest_of
from betterbench.sim.assets.importing.child import VERSION, Made, import_bytes
from betterbench.sim.assets.importing.coloring import color_word
from betterbench.sim.assets.importing.importer import Imported, Wishes
from betterbench.sim.assets.importing.stored import from_bytes
from betterbench.sim.assets.licenses import require_license
from betterbench.sim.assets.names import file_words
from betterbench.tasks.user_files import ASSET_MANIFEST

VERB = "assets"
"""Command that writes asset folders."""
LICENSE_OPTIONS = "Use --license to state its license, or add --any-license to import it anyway"


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportRequest:
    """Request to import one file.

    Attributes:
        path: The file.
        wishes: Options of the import.
        name: Name by which tasks refer to the asset. If None, the asset is named after the file.
        color: Color word for the asset. If None, it is the color that covers most of the surface.
        any_license: Whether restricted and unknown licenses are allowed.
    """

    path: Path
    wishes: Wishes = field(default_factory=Wishes)
    name: str | None = None
    color: str | None = None
    any_license: bool = False


@dataclass(slots=True)
class ImportReport:
    """Outcome of an import job.

    Attributes:
        made: Names of the newly imported assets.
        kept: Names of the assets that were already in the folder.
        failed: Files that could not be imported, each with the reason.
    """

    made: list[str] = field(default_factory=list)
    kept: list[str] = field(default_factory=list)
    failed: list[tuple[str, str]] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class _Result:
    request: ImportRequest
    made: Made | None = None
    problem: str = ""


def import_assets(
    requests: Sequence[ImportRequest],
    out: Path,
    *,
    workers: int = 1,
    overwrite: bool = False,
    on_progress: Callable[[JobProgress[object]], None] | None = None,
) -> ImportReport:
    """Import files into an asset folder.

    Assets that are already in the folder are kept. Files that cannot be imported are skipped.

    Args:
        requests: The files to import.
        out: The asset folder. It is created if it does not exist.
        workers: Number of files that are imported in parallel.
        overwrite: Whether to replace files that betterbench did not write.
        on_progress: Called at the start and after each file.

    Returns:
        The names of imported and kept assets, and the files that were skipped.

    Raises:
        InvalidInputError: If two files get the same name, or a name is invalid or already taken.
        RunConflictError: If another process is writing to the folder, or the folder contains files that betterbench did
            not write.
    """
    report = ImportReport()
    with OutputFolder(out, VERB, overwrite=overwrite):
        folder = _Folder(out)
        names = folder.names_for(requests)
        report.kept = [names[request] for request in requests if folder.holds(names[request], request)]

        def keep(result: object) -> None:
            if not isinstance(result, _Result):
                raise TypeError("the result was not produced by this import job")
            if result.made is None:
                report.failed.append((_shown(result.request.path), result.problem))
                return
            folder.add(names[result.request], result.request, result.made)
            report.made.append(names[result.request])

        def work(waiting: list[ImportRequest]) -> Iterator[object]:
            return in_threads(waiting, lambda _, one: _imported(one), workers=workers, open_resource=NoResource)

        run_items(
            requests,
            is_done=lambda request: folder.holds(names[request], request),
            work=work,
            keep=keep,
            on_progress=on_progress,
        )
    return report


def _imported(request: ImportRequest) -> _Result:
    where = _shown(request.path)
    try:
        require_license(where, request.wishes.license, any_license=request.any_license, option=LICENSE_OPTIONS)
        return _Result(request, import_bytes(request.path, request.wishes))
    except StorageError:
        raise  # stop the job, because an error of the cache would affect all other files as well
    except (BetterError, OSError) as error:
        return _Result(request, None, one_line(error, most=400))


def _shown(path: Path) -> str:
    return one_line(path.name, most=120)


class _Folder:
    """Asset folder to which this process writes."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._assets = manifest_of(path).assets

    def names_for(self, requests: Sequence[ImportRequest]) -> dict[ImportRequest, str]:
        """Return a name for each requested asset.

        If the user gave a name, it is used. Otherwise, an asset that is already in the folder keeps its name, and a new
        asset is named after its file.
        """
        taken = set(self._assets) | set(categories())
        before = {self._source(asset): name for name, asset in self._assets.items()}
        found: dict[ImportRequest, str] = {}
        for request in requests:
            name = request.name
            if name is not None:
                self._require_name(name, request, found)
            else:
                known = any(source == request.path.name for source, _ in before)
                name = before.get((request.path.name, _digest(request.path))) if known else None
                if name is None or name in found.values():
                    name = _free_name(request.path, taken)
            taken.add(name)
            found[request] = name
        return found

    def _require_name(self, name: str, request: ImportRequest, found: dict[ImportRequest, str]) -> None:
        if not is_asset_name(name):
            problem = f"{one_line(repr(name), most=80)} is not a valid asset name"
            raise InvalidInputError(
                "--name", problem, "Use lower-case letters, digits and underscores, and begin with a letter"
            )
        if name in found.values():
            raise InvalidInputError(
                "--name",
                f"{name!r} is given for two files",
                "Import the files one after the other, each with its own name",
            )
        there = self._assets.get(name)
        if there is None and name in categories():
            raise InvalidInputError(
                "--name", f"an asset named {name!r} already exists", f"Choose a different name, such as my_{name}"
            )
        if there is not None and next(iter(there.source_files), "") != request.path.name:
            problem = f"{name!r} in {self._path} was made from a different file"
            raise InvalidInputError("--name", problem, "Choose a different name or a different folder")

    @staticmethod
    def _source(asset: FolderAsset) -> tuple[str, str]:
        return next(iter(asset.source_files.items()), ("", ""))

    def holds(self, name: str, request: ImportRequest) -> bool:
        """Return whether the folder already has the requested asset.

        The asset must have been made from the same files, with the same options and the same version of the importer.
        """
        asset = self._assets.get(name)
        if asset is None or asset.importer != VERSION or asset.options != _options(request):
            return False
        try:
            same = all(
                file_digest(request.path.parent / source) == digest for source, digest in asset.source_files.items()
            )
            return same and file_digest(self._path / asset.file) == asset.sha256
        except OSError:
            return False

    def add(self, name: str, request: ImportRequest, made: Made) -> None:
        """Store an imported asset in the folder, and list it in the manifest."""
        imported = from_bytes(made.data, name)
        file = f"{name}.npz"
        write_durably(self._path / file, made.data)
        self._assets = {**self._assets, name: _listed(file, request, made, imported)}
        write_durably(self._path / ASSET_MANIFEST, manifest_bytes(self._assets))


def _listed(file: str, request: ImportRequest, made: Made, imported: Imported) -> FolderAsset:
    draft = imported.draft
    points = np.concatenate([part.vertices for part in draft.parts if isinstance(part, VisualPart)])
    x, y, z = (round(float(side), 5) for side in np.ptp(points.astype(np.float64), axis=0))
    return FolderAsset(
        file=file,
        sha256=hashlib.sha256(made.data).hexdigest(),
        color=request.color or color_word(draft.parts),
        kind="" if imported.kind is None else imported.kind.name,
        size_m=(x, y, z),
        mass_kg=draft.mass_kg,
        license=request.wishes.license,
        author=request.wishes.author or "",
        source=request.wishes.source or request.path.name,
        source_files={request.path.name: _digest(request.path), **made.files},
        options=_options(request),
        notes=tuple(one_line(note, most=400) for note in imported.notes),
        importer=VERSION,
    )


def _options(request: ImportRequest) -> dict[str, str | float | bool]:
    """Return the import options that differ from their defaults. They are stored in the manifest."""
    said = {**asdict(replace(request.wishes)), "color": request.color}
    return {key: value for key, value in said.items() if value not in (None, False)}


def _digest(path: Path) -> str:
    try:
        return file_digest(path)
    except OSError:
        return ""


def _free_name(path: Path, taken: set[str]) -> str:
    """Return an unused name made of the words in a file name: "mug", or "my_mug" or "my_mug_2" if "mug" is taken."""
    whole = path.absolute()
    plain = "_".join(word for word in file_words(whole, Path(whole.anchor)) if word.isascii())[:40]
    name = plain if is_asset_name(plain) else "object"
    if name not in taken:
        return name
    number = 1
    while (found := f"my_{name}" if number == 1 else f"my_{name}_{number}") in taken:
        number += 1
    return found
