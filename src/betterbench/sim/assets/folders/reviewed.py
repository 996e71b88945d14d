"""Write a new asset folder that contains the reviewed assets with the changes made in the review."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.jobs.durable import write_durably
from betterbench.json_form import read_bounded
from betterbench.sim.assets.asset import VisualPart
from betterbench.sim.assets.folders.manifest import CURE, FolderAsset, manifest_bytes, manifest_of
from betterbench.sim.assets.folders.registration import MAX_FILE_BYTES
from betterbench.sim.assets.importing.importer import Imported
from betterbench.sim.assets.importing.review.applying import apply
from betterbench.sim.assets.importing.review.changes import Change
from betterbench.sim.assets.importing.stored import from_bytes, to_bytes
from betterbench.tasks.user_files import ASSET_MANIFEST


def stored_asset(folder: Path, name: str) -> Imported:
    """Read an asset from a folder, in its state after the import.

    Raises:
        InvalidInputError: If the folder has no such asset, or the asset's file is not the one that the manifest lists.
    """
    assets = manifest_of(folder).assets
    if name not in assets:
        raise InvalidInputError(
            str(folder), f"it has no asset {name!r}", f"Known assets: {', '.join(assets) or 'none'}"
        )
    path = folder / assets[name].file
    data = read_bounded(path, max_bytes=MAX_FILE_BYTES, cure=CURE)
    if hashlib.sha256(data).hexdigest() != assets[name].sha256:
        raise InvalidInputError(str(path), "it is not the file that the manifest lists", CURE)
    return from_bytes(data, str(path))


def write_reviewed_folder(
    folder: Path, out: Path, changes: Mapping[str, Sequence[Change]], rejected: Collection[str] = ()
) -> list[str]:
    """Copy the assets of a folder to a new folder, with the changes made in a review and without rejected assets.

    The same folder and changes always give the same bytes.

    Args:
        folder: Folder of imported assets.
        out: The new folder. It must not be the reviewed folder.
        changes: Changes to each asset, in order, keyed by the name of the asset.
        rejected: Names of assets that are left out.

    Returns:
        The names of the written assets.

    Raises:
        InvalidInputError: If a change does not fit an asset, or ``out`` is the reviewed folder itself.
    """
    if out.resolve() == folder.resolve():
        raise InvalidInputError("--out", f"{out} is the reviewed folder itself", "Use a different folder")
    listed: dict[str, FolderAsset] = {}
    for name, asset in manifest_of(folder).assets.items():
        if name in rejected:
            continue
        imported = stored_asset(folder, name)
        made = changes.get(name, ())
        data = to_bytes(apply(imported, made, where=name))
        write_durably(out / asset.file, data)
        listed[name] = _listed(asset, from_bytes(data, name), data) if made else asset
    write_durably(out / ASSET_MANIFEST, manifest_bytes(listed))
    return list(listed)


def _listed(asset: FolderAsset, imported: Imported, data: bytes) -> FolderAsset:
    """Return the manifest entry of an asset after a review has changed it."""
    draft = imported.draft
    points = np.concatenate([part.vertices for part in draft.parts if isinstance(part, VisualPart)])
    x, y, z = (round(float(side), 5) for side in np.ptp(points.astype(np.float64), axis=0))
    kind = "" if imported.kind is None else imported.kind.name
    digest = hashlib.sha256(data).hexdigest()
    return replace(asset, sha256=digest, size_m=(x, y, z), mass_kg=draft.mass_kg, kind=kind, notes=imported.notes)
