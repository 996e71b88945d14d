"""Where the extra `vlm` is not installed, the tests of models in the process are left out."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

collect_ignore = [] if all(map(importlib.util.find_spec, ("torch", "transformers"))) else ["test_intern_vl.py"]
