"""Import and certify every mesh of a folder, and print the share that passes without a person.

    .venv/bin/python tools/real_meshes.py MESHES --out runs/meshes [--workers 2]

Each file (``*.glb``, and ``NAME/*.obj`` with NAME as the name of the object) is imported with its name and a license as
its only options. The seconds are CPU seconds of the import, without the certificate. Each result is a line of
``journal.jsonl``, and the same command continues after an interruption. ``--pictures`` also writes a picture of each
object with its visible parts, its collision parts and its pose at rest.
"""

from __future__ import annotations

import argparse
import functools
import json
import statistics
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from betterbench.errors import BetterError
from betterbench.jobs import LineJournal, in_processes, run_items
from betterbench.sim.asset_checks import certify_asset
from betterbench.sim.asset_checks.picture import asset_pictures
from betterbench.sim.asset_checks.tried_grasps import with_tried_grasps
from betterbench.sim.assets.authoring.registry import asset_of
from betterbench.sim.assets.importing.importer import Wishes, import_mesh
from betterbench.sim.assets.importing.kinds import kind_of
from planted_assets import lies_still

PIXELS = 200


@dataclass(frozen=True)
class Tried:
    """Result of one file.

    Attributes:
        name: Name of the object, from its file or its folder.
        kind: Name of its kind, None if unknown.
        failed: Sentences of the failed checks, or the message of the importer.
        imported: Whether the importer made an asset.
        still: Whether an asset that passed lies still in a separate simulation.
        seconds: CPU time of the import.
        hulls: Number of collision parts.
    """

    name: str
    kind: str | None
    failed: list[str]
    imported: bool
    still: bool | None
    seconds: float
    hulls: int


def named_files(folder: Path) -> dict[str, Path]:
    """Return the mesh files of a folder by the names of their objects."""
    found = sorted([*folder.glob("**/*.glb"), *folder.glob("**/*.obj")])
    return {file.parent.name if file.suffix == ".obj" else file.stem: file for file in found}


def try_file(item: tuple[str, Path], *, pictures: Path | None = None) -> Tried:
    """Import and certify one file."""
    name, file = item
    kind = kind_of(name)
    known = None if kind is None else kind.name
    began = time.process_time()
    try:
        draft = with_tried_grasps(import_mesh(file, Wishes(name=name, license="as its folder states"))).draft
    except BetterError as error:
        return Tried(name, known, [str(error)], False, None, time.process_time() - began, 0)
    seconds = time.process_time() - began
    asset = asset_of(draft, "tried", color="gray")
    certificate = certify_asset(asset, name=name, kind=kind)
    failed = [f"{check.name}: {check.sentence}" for check in certificate.failed]
    still = None if failed else lies_still(asset, np.random.default_rng(0))
    if pictures is not None:
        row = np.concatenate(asset_pictures(asset, pixels=PIXELS), axis=1)
        Image.fromarray(row).save(pictures / f"{name}.png")
    return Tried(name, known, failed, True, still, seconds, len(asset.collision))


class _Results(LineJournal):
    """The results of the files that were tried."""

    def _take_in(self, lines: list[bytes]) -> None:
        self.found = {form["name"]: Tried(**form) for form in map(json.loads, lines)}

    def keep(self, result: Tried) -> None:
        """Store a result."""
        self._append_line(asdict(result))
        self.found[result.name] = result


def measure(files: dict[str, Path], out: Path, *, workers: int, pictures: bool = False) -> list[Tried]:
    """Try all files that an earlier command has not tried."""
    drawn = out / "pictures" if pictures else None
    (drawn or out).mkdir(parents=True, exist_ok=True)
    with _Results(out / "journal.jsonl") as journal:
        run_items(
            list(files.items()),
            is_done=lambda item: item[0] in journal.found,
            work=lambda waiting: in_processes(waiting, functools.partial(try_file, pictures=drawn), workers=workers),
            keep=journal.keep,
            on_progress=lambda p: print(f"\r{p.done}/{p.planned}", end="", file=sys.stderr, flush=True),
        )
        return [journal.found[name] for name in files]


def print_summary(results: list[Tried]) -> dict[str, float]:
    """Print each object that failed and the rates, and return the rates."""
    print()
    for result in results:
        if result.failed:
            print(f"{result.name} ({result.kind}): {'; '.join(result.failed)}")
    passed = [result for result in results if not result.failed]
    rates = {
        "imported": sum(result.imported for result in results) / len(results),
        "passed": len(passed) / len(results),
        "still": sum(bool(result.still) for result in passed) / max(len(passed), 1),
        "median_s": statistics.median(result.seconds for result in results),
        "longest_s": max(result.seconds for result in results),
    }
    print(f"imported: {100 * rates['imported']:.1f} % of {len(results)}")
    print(f"passed their certificate: {100 * rates['passed']:.1f} % ({len(passed)})")
    print(f"of these lie still: {100 * rates['still']:.1f} %")
    print(f"CPU time of an import: median {rates['median_s']:.1f} s, at most {rates['longest_s']:.1f} s")
    return rates


def main(arguments: list[str] | None = None) -> None:
    """Try the meshes of a folder."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("meshes", type=Path, help="folder of mesh files")
    parser.add_argument("--out", type=Path, required=True, help="folder of the results")
    parser.add_argument("--pictures", action="store_true", help="write a picture per object")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    given = parser.parse_args(arguments)
    files = named_files(given.meshes.absolute())
    print_summary(measure(files, given.out.absolute(), workers=given.workers, pictures=given.pictures))


if __name__ == "__main__":
    main()
