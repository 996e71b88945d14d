"""Imported objects with the accepted changes of a file of reviews, kept in the cache of imports."""

from __future__ import annotations

import hashlib
from dataclasses import asdict
from pathlib import Path

from betterbench.json_form import dump_json
from betterbench.sim.assets.importing.child import VERSION, cached
from betterbench.sim.assets.importing.importer import Imported
from betterbench.sim.assets.importing.review.content import content_hash
from betterbench.sim.assets.importing.review.journal import accepted, asset_name, history_of
from betterbench.sim.assets.importing.stored import to_bytes


def reviewed(imported: Imported, mesh: Path, reviews: Path) -> Imported:
    """Return an imported object with its accepted changes.

    Args:
        imported: The object as it was imported.
        mesh: Its mesh file.
        reviews: File of the review.

    Raises:
        InvalidInputError: If the object was rejected, has no verdict, or was reviewed with another content or size.
        RecordError: If the file of the review cannot be read.
    """
    content, asset = content_hash(mesh), asset_name(mesh)
    history = history_of(reviews, content, asset)
    decisions = [asdict(review) for _, review in history.reviews]
    key = hashlib.sha256(f"review {VERSION}|".encode() + to_bytes(imported) + dump_json(decisions)).hexdigest()[:32]
    return cached(key, lambda: to_bytes(accepted(imported, history, asset=asset, content=content)), asset)
