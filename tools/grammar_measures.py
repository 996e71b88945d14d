"""Measure the assets of the grammar and write their masses and sizes to ``generation/grammar/data/measures.json``.

    .venv/bin/python tools/grammar_measures.py

Run it after a change of an asset that the grammar uses; a slow test compares the file with the assets.
"""

from __future__ import annotations

import json
from pathlib import Path

from betterbench.generation.grammar.nouns import measure, measured_categories

OUT = Path(__file__).resolve().parents[1] / "src/betterbench/generation/grammar/data/measures.json"


def main() -> None:
    """Write the file."""
    lines = []
    for category in measured_categories():
        mass_kg, size_m = measure(category)
        lines.append(f"  {json.dumps(category)}: {json.dumps({'kg': list(mass_kg), 'm': list(size_m)})}")
    OUT.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
