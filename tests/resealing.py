"""Documents that are changed by hand and sealed again, so that a test meets what is behind the seal."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from betterbench.json_form import sealed_form

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


def rewrite(file: Path, change: Callable[[dict[str, Any]], object]) -> None:
    """Changes a sealed JSON document in place; ``change`` gets its form."""
    form = json.loads(file.read_bytes())
    change(form)
    file.write_text(json.dumps(sealed_form(form)), encoding="utf-8")
