"""Plant faults in assets and measure how many the importer and the asset certificate let through.

    .venv/bin/python tools/planted_assets.py --seed 0 --out runs/planted [--meshes FOLDER]            # make the items
    .venv/bin/python tools/planted_assets.py --seed 0 --out runs/planted [--meshes FOLDER] --measure  # and measure

Good assets are meshes made by ``made_meshes.py``, assets from the procedural library and, if given, meshes from a
folder (``*.glb``, and ``NAME/*.obj``). A bad asset is a good asset with one fault (``planted_faults.py``), planted in
the file, in the options of the import, or in the asset after the import. The plan is ``plan.json``; each result is a
line of ``journal.jsonl``, and the same command continues after an interruption.

False accepts are bad assets that the importer accepted and the certificate passed. If the importer repairs a file's
fault, the result is a good asset; the original's known up axis and volume show whether it did. These items are listed
separately. Accepted assets are dropped once more, in a separate simulation, to check that they come to rest.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import hashlib
import json
import math
import sys
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
import trimesh

from betterbench.errors import BetterError
from betterbench.jobs import LineJournal, in_processes, run_items, write_durably
from betterbench.sim.asset_checks import certify_asset
from betterbench.sim.asset_checks.tried_grasps import with_tried_grasps
from betterbench.sim.assets import Asset, build
from betterbench.sim.assets.authoring.registry import asset_of
from betterbench.sim.assets.importing.child import VERSION
from betterbench.sim.assets.importing.importer import Imported, Wishes, import_mesh
from betterbench.sim.assets.importing.kinds import kind_of
from betterbench.sim.assets.importing.measures import corners_of
from betterbench.sim.assets.importing.stored import from_bytes, to_bytes
from betterbench.sim.robots.physics import PHYSICS
from betterbench.sim.scenes import add_asset
from made_meshes import LIBRARY, SHAPES, Rng, joined, turn_about, write_mesh
from planted_faults import ASSET_FAULTS, FILE_FAULTS, ONE_END_UP, OPEN_KINDS, VICTIMS


@dataclass(frozen=True)
class Item:
    """One asset to be judged.

    Attributes:
        id: Number and name of the item.
        origin: "made", "library" or "mesh".
        name: Name that a user would give; it determines the kind.
        file: Mesh file, or category and look of the library.
        fault: Planted fault, None for a good item.
        stage: Stage at which the fault is planted: "file" or "asset".
        size_m: True longest side, None if it is not known.
        up: True up axis of the file, None if it is not known.
        wishes: Options of the import.
        seed: Seed of the fault.
    """

    id: str
    origin: str
    name: str
    file: str
    fault: str | None
    stage: str
    size_m: float | None
    up: str | None
    wishes: tuple[tuple[str, object], ...]
    seed: int


def make_plan(seed: int, out: Path, meshes: Path | None, *, each: int = 4) -> list[Item]:
    """Write the mesh files and return the items.

    There are ``each`` bad items per asset fault, half as many per file fault, and as many good items. Faults
    of assets are planted in good items.
    """
    rng = np.random.default_rng([seed, 45])
    faults = [fault for fault in ASSET_FAULTS for _ in range(each)]
    of_files = [fault for fault in FILE_FAULTS for _ in range(max(1, each // 2))]
    good = _good_items(len(faults) + len(of_files), rng, out, meshes)
    items = list(good)
    for fault in faults:
        able = [item for item in good if _is_victim(item, fault)]
        victim = able[int(rng.integers(len(able)))]
        items.append(
            replace(victim, id=_id(len(items), fault, victim.name), fault=fault, stage="asset", seed=_seed(rng))
        )
    for fault in of_files:
        items.append(_bad_file(len(items), fault, rng, out))
    return items


def _id(number: int, fault: str | None, name: str) -> str:
    return f"{number:03d} {'good' if fault is None else fault} {name or 'asset'}"


def _seed(rng: Rng) -> int:
    return int(rng.integers(2**31))


def _is_victim(item: Item, fault: str) -> bool:
    if fault in VICTIMS:
        return item.origin == "made" and item.name in VICTIMS[fault]
    return fault != "too heavy" or kind_of(item.name) is not None


def _good_items(count: int, rng: Rng, out: Path, meshes: Path | None) -> list[Item]:
    """Return good items: at least two of each generated kind, a fifth from the library, and meshes from the folder."""
    folder = [] if meshes is None else sorted([*meshes.glob("**/*.glb"), *meshes.glob("**/*.obj")])
    from_library = count // 5
    from_folder = min(len(folder), max(0, count - from_library - 2 * len(SHAPES)))
    items: list[Item] = []
    for k in rng.permutation(len(folder))[:from_folder]:
        file = folder[int(k)]
        name = file.parent.name if file.suffix == ".obj" else file.stem
        wishes = (("name", name), ("license", "as its folder states"))
        items.append(
            Item(_id(len(items), None, name), "mesh", name, str(file), None, "file", None, None, wishes, _seed(rng))
        )
    categories = sorted(LIBRARY)
    for k in range(from_library):
        category = categories[k % len(categories)]
        file_and_look = f"{category} {int(rng.integers(8))}"
        items.append(
            Item(
                _id(len(items), None, category),
                "library",
                LIBRARY[category],
                file_and_look,
                None,
                "file",
                None,
                None,
                (),
                _seed(rng),
            )
        )
    kinds = sorted(SHAPES)
    while len(items) < count:
        items.append(_made(len(items), kinds[len(items) % len(kinds)], None, rng, out))
    return items


def _bad_file(number: int, fault: str, rng: Rng, out: Path) -> Item:
    victims = sorted((VICTIMS.get(fault) or frozenset(SHAPES)) & set(SHAPES))
    return _made(number, str(rng.choice(victims)), fault, rng, out)


def _made(number: int, kind: str, fault: str | None, rng: Rng, out: Path) -> Item:
    """Write a generated mesh, with or without a fault in the file or in its import options."""
    mesh = SHAPES[kind](rng)
    size = float(np.ptp(mesh.bounds, axis=0).max())
    suffix = str(rng.choice([".glb", ".stl", ".ply"]))
    wishes: dict[str, object] = {"name": kind, "license": "CC0-1.0"}
    if fault is not None:
        mesh, more = _file_fault(mesh, fault, size, rng)
        wishes |= more
    path = out / "meshes" / f"{number:03d}-{kind}{suffix}"
    up = write_mesh(mesh, path, rng)
    if fault == "wrong axis given":
        wishes["up"] = "-" + up if kind in OPEN_KINDS else "x"
    elif suffix != ".glb" and fault not in ("upside down", "on its side"):
        wishes["up"] = up  # these formats do not define the up axis
    return Item(
        _id(number, fault, kind),
        "made",
        kind,
        str(path.relative_to(out)),
        fault,
        "file",
        size,
        up,
        tuple(wishes.items()),
        _seed(rng),
    )


def _file_fault(mesh: trimesh.Trimesh, fault: str, size: float, rng: Rng) -> tuple[trimesh.Trimesh, dict[str, object]]:
    """Return a mesh with a fault, and the import options that go with it."""
    mesh = mesh.copy()
    if fault == "upside down":
        mesh.apply_transform(turn_about(np.pi, [1, 0, 0]))
    elif fault == "on its side":
        mesh.apply_transform(turn_about(np.pi / 2, [1, 0, 0]))
    elif fault == "inverted faces":
        mesh.invert()
    elif fault == "leaking":
        low = mesh.bounds[0, 2]
        centers = mesh.triangles_center
        floor = (np.abs(mesh.face_normals[:, 2]) > 0.9) & (centers[:, 2] < low + 0.01)
        mesh.update_faces(~floor)
    elif fault == "far parts":
        other = mesh.copy()
        other.apply_translation([1.5 * size, 0.0, 0.0])
        mesh = joined([mesh, other])
    elif fault == "wrong size given":
        return mesh, {"size_m": size * float(rng.choice([10.0, 0.1, 1000.0, 4.0, 0.25]))}
    return mesh, {}


@dataclass(frozen=True)
class Judged:
    """Result of one item.

    Attributes:
        outcome: "refused" by the importer, "rejected" by the certificate, or "accepted".
        failed: Names of the failed checks, or the importer's message.
        mended: Whether the importer made a good asset from a bad file.
        still: Whether an accepted asset comes to rest in this script's separate simulation.
    """

    id: str
    fault: str | None
    stage: str
    origin: str
    outcome: str
    failed: list[str]
    mended: bool
    still: bool | None


def judge(item: Item, *, out: Path) -> Judged:
    """Import and certify one item of a folder."""
    rng = np.random.default_rng(item.seed)
    kind = kind_of(item.name)
    mended = False
    try:
        if item.origin == "library":
            category, look = item.file.split()
            asset = build(category, look=int(look))
        else:
            wishes = Wishes(**dict(item.wishes))  # type: ignore[arg-type]
            asset = asset_of(imported(out / item.file, wishes, out / "imports").draft, "planted", color="gray")
            mended = item.stage == "file" and _is_mended(item, asset)
    except BetterError as error:
        return Judged(item.id, item.fault, item.stage, item.origin, "refused", [str(error)], False, None)
    if item.fault is not None and item.stage == "asset":
        asset = ASSET_FAULTS[item.fault](asset, rng)
    certificate = certify_asset(asset, name=item.id, kind=kind)
    failed = [f"{check.name}: {check.sentence}" for check in certificate.failed]
    outcome = "rejected" if failed else "accepted"
    still = lies_still(asset, rng) if outcome == "accepted" else None
    return Judged(item.id, item.fault, item.stage, item.origin, outcome, failed, mended, still)


def imported(file: Path, wishes: Wishes, kept: Path) -> Imported:
    """Import a file in this process, or use the result of an earlier item."""
    key = hashlib.sha256(f"{VERSION} {file} {wishes}".encode() + file.read_bytes()).hexdigest()[:24]
    stored = kept / f"{key}.npz"
    if not stored.is_file():
        kept.mkdir(parents=True, exist_ok=True)
        write_durably(stored, to_bytes(with_tried_grasps(import_mesh(file, wishes))))
    return from_bytes(stored.read_bytes(), file.name)


def _is_mended(item: Item, asset: Asset) -> bool:
    """Return whether a bad file was imported as a good asset, judged by the original's known properties."""
    if item.fault in ("leaking", "far parts"):
        return False
    if item.fault == "inverted faces":
        part = asset.visual[0]
        return bool(trimesh.Trimesh(part.vertices, part.faces).volume > 0.0)
    if item.fault == "wrong size given":
        return False
    expected = {"upside down": {"y": "-y", "z": "-z"}, "on its side": {"y": "z", "z": "y"}}.get(str(item.fault), {})
    found = str(asset.parameters["up"])
    if item.fault == "on its side":
        if item.name in OPEN_KINDS:
            return found.lstrip("-") == expected.get(str(item.up)) and _opens_upward(asset)
        ends = (found,) if item.name in ONE_END_UP else (found, found.lstrip("-"), f"-{found}")
        return {"y": "z", "z": "-y"}[str(item.up)] in ends
    return found == expected.get(str(item.up))


def _opens_upward(asset: Asset) -> bool:
    return any(region.name == "opening" for region in asset.regions)


def lies_still(asset: Asset, rng: Rng) -> bool:
    """Drop an asset by 3 mm at a random yaw, and return whether it moves less than 2 mm and 2 degrees from 2 to 5 s."""
    spec = mujoco.MjSpec()
    PHYSICS.set_scene(spec)
    spec.option.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 0.1])
    add_asset(spec, "asset", asset)
    model = spec.compile()
    data = mujoco.MjData(model)
    yaw = rng.uniform(-np.pi, np.pi)
    low = min(float(corners_of(part)[:, 2].min()) for part in asset.collision)
    data.qpos[:7] = (0, 0, 0.003 - low, math.cos(yaw / 2), 0, 0, math.sin(yaw / 2))
    mujoco.mj_step(model, data, nstep=1000)
    before = data.qpos[:7].copy()
    most, turned = 0.0, 0.0
    for _ in range(30):
        mujoco.mj_step(model, data, nstep=50)
        most = max(most, float(np.linalg.norm(data.qpos[:3] - before[:3])))
        turned = max(turned, 2 * math.acos(min(1.0, abs(float(data.qpos[3:7] @ before[3:7])))))
    return most < 0.002 and turned < math.radians(2.0)


class Results(LineJournal):
    """The results of the items that were judged."""

    def _take_in(self, lines: list[bytes]) -> None:
        self.found = {form["id"]: Judged(**form) for form in map(json.loads, lines)}

    def keep(self, result: Judged) -> None:
        """Store a result."""
        self._append_line(asdict(result))
        self.found[result.id] = result


def measure(items: list[Item], out: Path, *, workers: int) -> list[Judged]:
    """Judge all items that an earlier command has not judged."""
    with Results(out / "journal.jsonl") as journal:
        run_items(
            items,
            is_done=lambda item: item.id in journal.found,
            work=lambda waiting: in_processes(waiting, functools.partial(judge, out=out), workers=workers),
            keep=journal.keep,
            on_progress=lambda p: print(f"\r{p.done}/{p.planned}", end="", file=sys.stderr, flush=True),
        )
        return [journal.found[item.id] for item in items]


def print_table(results: list[Judged]) -> dict[str, float]:
    """Print accepted and rejected per fault as a table for the documentation, and return the rates."""
    print("\n| fault | planted in | items | refused | rejected | mended | false accepts |")
    print("|---|---|---|---|---|---|---|")
    bad = [r for r in results if r.fault is not None]
    for fault, stage in dict.fromkeys((r.fault, r.stage) for r in bad):
        rows = [r for r in bad if (r.fault, r.stage) == (fault, stage)]
        mended = sum(r.mended and r.outcome == "accepted" for r in rows)
        false = [r for r in rows if r.outcome == "accepted" and not r.mended]
        counts = [sum(r.outcome == o for r in rows) for o in ("refused", "rejected")]
        print(f"| {fault} | {stage} | {len(rows)} | {counts[0]} | {counts[1]} | {mended} | {len(false)} |")
    good = [r for r in results if r.fault is None]
    for origin in dict.fromkeys(r.origin for r in good):
        rows = [r for r in good if r.origin == origin]
        print(f"good ({origin}): {sum(r.outcome == 'accepted' for r in rows)} of {len(rows)} kept")
    false = [r for r in bad if r.outcome == "accepted" and not r.mended]
    judged = [r for r in bad if not (r.mended and r.outcome == "accepted")]
    accepted = [r for r in results if r.outcome == "accepted"]
    rates = {
        "false_accepts": len(false) / max(len(judged), 1),
        "good_kept": sum(r.outcome == "accepted" for r in good) / max(len(good), 1),
        "still": sum(bool(r.still) for r in accepted) / max(len(accepted), 1),
    }
    print(f"false accepts: {len(false)} of {len(judged)} ({100 * rates['false_accepts']:.1f} %)")
    print(f"good kept: {100 * rates['good_kept']:.1f} % of {len(good)}")
    print(f"of the accepted lie still: {100 * rates['still']:.1f} % of {len(accepted)}")
    for r in false:
        print("  false accept", r.id)
    for r in good:
        if r.outcome != "accepted":
            print("  lost", r.id, "; ".join(r.failed)[:300])
    for r in accepted:
        if not r.still:
            print("  not still", r.id)
    return rates


def main(arguments: list[str] | None = None) -> None:
    """Make the items and, with ``--measure``, judge them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--seed", type=int, required=True, help="seed of shapes, faulty objects and faults")
    parser.add_argument("--out", type=Path, required=True, help="folder of the items and their results")
    parser.add_argument("--meshes", type=Path, help="folder of good meshes, in addition to generated meshes")
    parser.add_argument("--each", type=int, default=4, help="bad assets per fault")
    parser.add_argument("--measure", action="store_true", help="import and certify all items")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    given = parser.parse_args(arguments)
    out = given.out.absolute()
    items = make_plan(given.seed, out, None if given.meshes is None else given.meshes.absolute(), each=given.each)
    bad = sum(item.fault is not None for item in items)
    (out / "plan.json").write_text(json.dumps([dataclasses.asdict(item) for item in items], indent=1), encoding="utf-8")
    print(f"{bad} bad and {len(items) - bad} good items in {out}")
    if given.measure:
        print_table(measure(items, out, workers=given.workers))


if __name__ == "__main__":
    main()
