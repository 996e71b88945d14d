"""Several EGL devices on a machine with one: the software renderer, loaded a second time under another name."""

import ctypes.util
import json
import os
import shutil
from pathlib import Path

import pytest

VENDORS = Path("/usr/share/glvnd/egl_vendor.d")


def second_renderer(folder: Path) -> dict[str, str]:
    """Return the variable that makes EGL list Mesa's software renderer twice; skip where there is no Mesa."""
    own = next(VENDORS.glob("*mesa*.json"), None)
    library = ctypes.util.find_library("EGL_mesa")
    places = [Path(place) / (library or "") for place in ("/usr/lib/x86_64-linux-gnu", "/usr/lib/aarch64-linux-gnu")]
    found = next((place for place in places if library and place.exists()), None)
    if own is None or found is None:
        pytest.skip("Mesa's EGL is not installed")
    copy = folder / "libEGL_second.so.0"
    shutil.copy(os.path.realpath(found), copy)
    form = {"file_format_version": "1.0.0", "ICD": {"library_path": str(copy)}}
    (folder / "second.json").write_text(json.dumps(form))
    return {"__EGL_VENDOR_LIBRARY_FILENAMES": f"{own}:{folder / 'second.json'}"}


@pytest.fixture(scope="session")
def two_renderers(tmp_path_factory) -> dict[str, str]:
    return second_renderer(tmp_path_factory.mktemp("vendors"))
