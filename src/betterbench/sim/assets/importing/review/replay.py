"""Apply the accepted changes in a review file to imported objects.

The changed objects are stored in the import cache.
"""

from __future__ import annotations

import hashlib
from dataclasses import asdict
from pathlib import Path

from betterbench.errors import InvalidInputError
from betterbench.jobs.durable import write_durably
from betterbench.json_form import dump_json, read_bounded
from betterbench.sim.assets.importing import child
from betterbench.sim.assets.importing.importer import Imported
from betterbench.sim.assets.importing.review.content import content_hash
from betterbench.sim.assets.importing.review.journal import accepted, asset_name, history_of
from betterbench.sim.assets.importing.stored import from_bytes, to_bytes

VERSION = 1
"""Version of the replay. It is incremented whenever the same changes to the same import would give a different object
than before."""

_MOST_STORED_BYTES = 64 << 20


def reviewed(imported: Imported, mesh: Path, reviews: Path) -> Imported:
    """Apply the accepted changes of a review file to an imported object.

    Args:
        imported: The object as it was imported.
        mesh: Mesh file of the object.
        reviews: The review file.

    Raises:
        InvalidInputError: If the object was rejected, has no verdict, or was reviewed with a different content or size.
        RecordError: If the review file cannot be read.
    """
    content, asset = content_hash(mesh), asset_name(mesh)
    history = history_of(reviews, content, asset)
    decisions = [asdict(review) for _, review in history.reviews]
    key = hashlib.sha256(
        f"review {VERSION} of import {child.VERSION}|".encode() + to_bytes(imported) + dump_json(decisions)
    ).hexdigest()[:32]
    file = child.cache_folder() / "reviewed" / f"{key}.npz"
    if file.is_file():
        try:
            return from_bytes(read_bounded(file, max_bytes=_MOST_STORED_BYTES, cure="Delete it"), asset)
        except InvalidInputError:
            pass  # the cached file is damaged and will be written again
    made = to_bytes(accepted(imported, history, asset=asset, content=content))
    file.parent.mkdir(parents=True, exist_ok=True)
    write_durably(file, made)
    return from_bytes(made, asset)
