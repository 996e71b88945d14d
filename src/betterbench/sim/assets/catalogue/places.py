"""Place of the catalogue of this user."""

from pathlib import Path

import platformdirs


def usual_folder() -> Path:
    """Return the folder of the catalogue that is used unless another one is named."""
    return platformdirs.user_cache_path("betterbench") / "assets"
