"""Queue of the objects to review.

The objects are assets in asset folders, or mesh files, which are imported when they are first shown.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from betterbench.errors import BetterError, InvalidInputError
from betterbench.sim.assets.folders.manifest import manifest_of
from betterbench.sim.assets.folders.reviewed import stored_asset, write_reviewed_folder
from betterbench.sim.assets.importing.child import import_safely
from betterbench.sim.assets.importing.importer import Wishes
from betterbench.sim.assets.importing.mesh_file import FORMATS
from betterbench.sim.assets.importing.registration import MeshImport
from betterbench.sim.assets.importing.review import Change, History, ReviewState, changed, content_hash, history_of
from betterbench.sim.assets.importing.review.journal import asset_name

MOST_FILES = 10_000


@dataclass(slots=True)
class QueuedObject:
    """Object in the queue of a review.

    Attributes:
        path: Mesh file of the object.
        content: Hash of the mesh file and of all files that it refers to.
        states: The object as it was imported, followed by its state after each change. Empty before the import.
        problem: Reason why the import failed. Empty if it succeeded or has not started.
        wishes: Options for importing the mesh file.
        stored: Whether the object is an asset in an asset folder, which was imported earlier.
    """

    path: Path
    content: str
    states: list[ReviewState]
    problem: str = ""
    wishes: Wishes = field(default_factory=Wishes)
    stored: bool = False

    @property
    def name(self) -> str:
        """Name of the object on the page."""
        return self.path.stem if self.stored else asset_name(self.path)

    @property
    def state(self) -> ReviewState | None:
        """The object with all its changes, or None if it is not imported yet."""
        return self.states[-1] if self.states else None

    def load(self, history: History) -> None:
        """Import the object and apply its changes. If this fails, store the reason in ``problem``."""
        if self.states or self.problem:
            return
        try:
            if self.stored:
                self.states = [ReviewState(stored_asset(self.path.parent, self.path.stem))]
            else:
                self.states = [ReviewState(import_safely(self.path, self.wishes))]
            for change in history.changes:
                self.states.append(changed(self.states[-1], change, where=self.name))
        except BetterError as error:
            self.problem = str(error)


def mesh_files(given: Sequence[Path]) -> list[Path]:
    """Return the mesh files among the given files and in the given folders, without duplicates.

    The files in a folder are sorted by name.

    Raises:
        InvalidInputError: If there are no mesh files or too many, or if a given file is missing or has an unknown
            format.
    """
    found: dict[Path, None] = {}
    for path in given:
        if path.is_dir():
            inside = sorted(p for p in path.rglob("*") if p.suffix.lower() in FORMATS and p.is_file())
            found.update(dict.fromkeys(inside))
        elif not path.exists():
            raise InvalidInputError(
                str(path), "it does not exist", "Pass mesh files, or folders that contain mesh files"
            )
        elif path.suffix.lower() not in FORMATS:
            raise InvalidInputError(
                str(path), "its format is not known", f"Pass files in one of these formats: {', '.join(FORMATS)}"
            )
        else:
            found[path] = None
    if not found:
        raise InvalidInputError(
            "DIR_OR_FILES", "no mesh file was found", f"Pass files in one of these formats: {', '.join(FORMATS)}"
        )
    if len(found) > MOST_FILES:
        raise InvalidInputError(
            "DIR_OR_FILES", f"{len(found):,} mesh files are too many", f"Review at most {MOST_FILES:,} at once"
        )
    return list(found)


def queue_of(given: Sequence[Path], registered: Sequence[MeshImport] = ()) -> list[QueuedObject]:
    """Return the review queue for files and folders. Files with the same content are treated as one object.

    Args:
        given: Files and folders. If there are none, the registered files are reviewed.
        registered: Mesh files that task files import, each with its import options.

    Raises:
        InvalidInputError: If a file is missing or not a mesh file (see :func:`mesh_files`).
    """
    wishes = {found.path.resolve(): found.wishes for found in registered}
    queue: dict[str, QueuedObject] = {}
    for path in mesh_files(given or [found.path for found in registered]):
        content = content_hash(path)
        queue.setdefault(content, QueuedObject(path, content, [], wishes=wishes.get(path.resolve(), Wishes())))
    return list(queue.values())


def folder_queue(folders: Sequence[Path]) -> list[QueuedObject]:
    """Return the review queue for all assets in the given asset folders.

    Raises:
        InvalidInputError: If a manifest cannot be read, or the folders contain no assets.
    """
    queue: dict[str, QueuedObject] = {}
    for folder in folders:
        for asset in manifest_of(folder).assets.values():
            queue.setdefault(asset.sha256, QueuedObject(folder / asset.file, asset.sha256, [], stored=True))
    if not queue:
        raise InvalidInputError(
            "review assets", "the folders contain no assets", "Import assets with `better assets import`"
        )
    return list(queue.values())


def apply_to_folder(reviews: Path, folder: Path, out: Path) -> tuple[list[str], dict[str, str]]:
    """Copy the accepted assets of a folder to a new folder, and apply the changes made in a review to the copies.

    Returns:
        The names of the written assets, and the reason why each rejected asset was rejected, keyed by asset name.

    Raises:
        RecordError: If the review file cannot be read.
        InvalidInputError: If an asset has no verdict.
    """
    changes: dict[str, Sequence[Change]] = {}
    rejected: dict[str, str] = {}
    for name, asset in manifest_of(folder).assets.items():
        history = history_of(reviews, asset.sha256, name)
        verdict = history.verdict
        if verdict is None:
            problem = f"it has {len(history.changes)} changes and no verdict"
            raise InvalidInputError(
                name, problem, "Run `better review assets --asset-dir`, and accept or reject the asset"
            )
        if verdict.verdict == "reject":
            rejected[name] = verdict.reason
        changes[name] = history.changes
    return write_reviewed_folder(folder, out, changes, rejected), rejected
