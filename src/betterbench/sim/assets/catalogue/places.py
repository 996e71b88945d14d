"""Default location of the catalogue."""

from pathlib import Path

import platformdirs


def usual_folder() -> Path:
    """Return the default folder of the catalogue."""
    return platformdirs.user_cache_path("betterbench") / "assets"
