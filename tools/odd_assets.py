"""Measure the asset certificate on unusual good assets and on faults that ``planted_assets.py`` does not plant.

    .venv/bin/python tools/odd_assets.py --seed 0 --out runs/odd

Twelve unusual shapes (wire basket, ladle, colander, ...) must be kept. The bad assets are common objects with one fault
each (``odd_shapes.py``). The fault is planted in the file, in the physics that a URDF or MJCF file states, or in the
asset after its import. Items, results and rates are those of ``planted_assets.py``.
"""

from __future__ import annotations

import argparse
import functools
import json
import math
import sys
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import trimesh

from betterbench.errors import BetterError
from betterbench.jobs import in_processes, run_items
from betterbench.sim.asset_checks import certify_asset
from betterbench.sim.assets import Asset
from betterbench.sim.assets.authoring.registry import asset_of
from betterbench.sim.assets.importing.importer import Wishes
from betterbench.sim.assets.importing.kinds import kind_of
from made_meshes import SHAPES, Rng, turn_about, write_mesh
from odd_shapes import ODD_ASSET_FAULTS, ODD_SHAPES, sheet_with_hole, with_far_speck, with_spike
from planted_assets import Item, Judged, Results, imported, lies_still, print_table

GRASPED = ("mug", "can", "block", "marker", "soap", "orange", "jar", "candle")
OPEN = ("mug", "bowl", "glass", "lunchbox")
ODD_VICTIMS: dict[str, Sequence[str]] = {
    "bar across the opening": OPEN,
    "handle without collision parts": ("mug",),
    "grasp wider than the gripper": GRASPED,
    "grasp narrower than the object": GRASPED,
    "grams as kilograms": ("mug", "can", "orange", "spoon", "bowl", "soap"),
    "kilograms as grams": ("mug", "can", "orange", "spoon", "bowl", "soap"),
}
"""Objects to which a fault applies; other faults apply to every object of ``made_meshes.py``."""
FILE_FAULTS = (
    "z up in a format with y up",
    "speck far away",
    "sheet with a hole",
    "spike under the base",
    "grams in URDF",
    "negative inertia in MJCF",
)


def make_plan(seed: int, out: Path, *, each: int) -> list[Item]:
    """Write the mesh files and return the items: ``each`` of every good shape and of every fault."""
    rng = np.random.default_rng([seed, 46])
    items = [_good(name, rng, out, k * each + i) for k, name in enumerate(ODD_SHAPES) for i in range(each)]
    for fault in ODD_ASSET_FAULTS:
        for _ in range(each):
            name = str(rng.choice(sorted(ODD_VICTIMS.get(fault, SHAPES))))
            items.append(replace(_item(len(items), name, SHAPES[name](rng), rng, out), fault=fault, stage="asset"))
    for fault in FILE_FAULTS:
        items += [_bad_file(len(items) + i, fault, rng, out) for i in range(each)]
    return [replace(item, id=f"{item.id} ({item.fault or 'good'})") for item in items]


def _item(number: int, name: str, mesh: trimesh.Trimesh, rng: Rng, out: Path) -> Item:
    suffix = str(rng.choice([".glb", ".stl"]))
    path = out / "meshes" / f"{number:03d}-{name.replace(' ', '_')}{suffix}"
    up = write_mesh(mesh, path, rng)
    size = float(np.ptp(mesh.bounds, axis=0).max())
    wishes: dict[str, object] = {"name": name, "license": "CC0-1.0"}
    if suffix == ".stl":
        wishes["up"] = up  # this format does not define the up axis
    if kind_of(name) is None:
        wishes["size_m"] = size  # users must give the size of an object of unknown kind
    seed = int(rng.integers(2**31))
    file = str(path.relative_to(out))
    return Item(f"{number:03d} {name}", "made", name, file, None, "file", size, up, tuple(wishes.items()), seed)


def _good(name: str, rng: Rng, out: Path, number: int) -> Item:
    return replace(_item(number, name, ODD_SHAPES[name](rng), rng, out), origin="odd")


def _bad_file(number: int, fault: str, rng: Rng, out: Path) -> Item:
    name = str(rng.choice({"z up in a format with y up": ("bottle", "jar", "plate", "notebook", "mug", "candle")}.get(
        fault, ("mug", "can", "block", "orange", "bowl", "plate", "candle"))))  # fmt: skip
    if fault in ("grams in URDF", "negative inertia in MJCF"):
        return _described(number, fault, "mug" if fault.startswith("grams") else name, rng, out)
    mesh = SHAPES[name](rng)
    if fault == "sheet with a hole":
        name, mesh = "plate", sheet_with_hole(rng)
    elif fault == "speck far away":
        mesh = with_far_speck(mesh, rng)
    elif fault == "spike under the base":
        mesh = with_spike(mesh, rng)
    path = out / "meshes" / f"{number:03d}-{name}.glb"
    if fault == "z up in a format with y up":
        mesh.apply_transform(turn_about(np.pi / 2, [1, 0, 0]))  # write_mesh turns it back
    write_mesh(mesh, path, rng)
    wishes = (("name", name), ("license", "CC0-1.0"))
    size, seed = float(np.ptp(mesh.bounds, axis=0).max()), int(rng.integers(2**31))
    return Item(
        f"{number:03d} {name}", "made", name, str(path.relative_to(out)), fault, "file", size, None, wishes, seed
    )


def _described(number: int, fault: str, name: str, rng: Rng, out: Path) -> Item:
    """Write a mesh with a URDF or MJCF file that contains wrong physical properties."""
    mesh = SHAPES[name](rng)
    folder = out / "meshes" / f"{number:03d}-{name}"
    folder.mkdir(parents=True, exist_ok=True)
    mesh.export(folder / "mesh.obj")
    if fault == "grams in URDF":
        path = folder / f"{name}.urdf"
        kind = kind_of(name)
        grams = 1000.0 * (0.3 if kind is None else kind.mass_kg)
        path.write_text(
            f'<robot name="{name}"><link name="body"><inertial><mass value="{0.05 * grams:.1f}"/>'
            '<origin xyz="0 0 0.04"/>'
            '<inertia ixx="0.4" iyy="0.4" izz="0.4" ixy="0" ixz="0" iyz="0"/></inertial>'
            '<visual><geometry><mesh filename="mesh.obj"/></geometry></visual></link></robot>',
            encoding="utf-8",
        )
    else:
        path = folder / f"{name}.xml"
        path.write_text(
            f'<mujoco model="{name}"><asset><mesh name="m" file="mesh.obj"/></asset><worldbody><body name="b">'
            '<freejoint/><inertial pos="0 0 0.03" mass="0.2" diaginertia="0.0002 -0.0002 0.0002"/>'
            '<geom type="mesh" mesh="m"/></body></worldbody></mujoco>',
            encoding="utf-8",
        )
    wishes = (("name", name), ("license", "CC0-1.0"))
    size, seed = float(np.ptp(mesh.bounds, axis=0).max()), int(rng.integers(2**31))
    return Item(
        f"{number:03d} {name}", "made", name, str(path.relative_to(out)), fault, "file", size, "z", wishes, seed
    )


def judge(item: Item, *, out: Path) -> Judged:
    """Import and certify one item of a folder."""
    rng = np.random.default_rng(item.seed)
    kind = kind_of(item.name)
    try:
        made = imported(out / item.file, Wishes(**dict(item.wishes)), out / "imports")  # type: ignore[arg-type]
        asset = asset_of(made.draft, "planted", color="gray")
    except BetterError as error:
        return Judged(item.id, item.fault, item.stage, item.origin, "refused", [str(error)], False, None)
    mended = item.stage == "file" and _is_mended(item, asset)
    if item.fault is not None and item.stage == "asset":
        asset = ODD_ASSET_FAULTS[item.fault](asset, rng)
    certificate = certify_asset(asset, name=item.id, kind=kind)
    failed = [f"{check.name}: {check.sentence}" for check in certificate.failed]
    outcome = "rejected" if failed else "accepted"
    still = lies_still(asset, rng) if outcome == "accepted" else None
    return Judged(item.id, item.fault, item.stage, item.origin, outcome, failed, mended, still)


def _is_mended(item: Item, asset: Asset) -> bool:
    """Return whether a bad file was imported as a good asset, judged by the original's known properties."""
    if item.fault == "z up in a format with y up":
        return str(asset.parameters["up"]) == "z" or (
            item.name == "notebook" and str(asset.parameters["up"]).lstrip("-") == "z"
        )
    if item.fault == "grams in URDF":
        kind = kind_of(item.name)
        return kind is not None and max(r := asset.mass_kg / kind.mass_at(max(asset.size_m)), 1.0 / r) < 4.0
    if item.fault == "negative inertia in MJCF":
        ixx, iyy, izz, *_ = asset.inertia
        return min(ixx, iyy, izz) > 0.0 and math.isfinite(ixx + iyy + izz)
    return False


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


def main(arguments: list[str] | None = None) -> None:
    """Make and judge the items."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--seed", type=int, required=True, help="seed of shapes, faulty objects and faults")
    parser.add_argument("--out", type=Path, required=True, help="folder of the items and their results")
    parser.add_argument("--each", type=int, default=3, help="items of each good shape and of each fault")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    given = parser.parse_args(arguments)
    out = given.out.absolute()
    items = make_plan(given.seed, out, each=given.each)
    (out / "plan.json").write_text(json.dumps([asdict(item) for item in items], indent=1), encoding="utf-8")
    print_table(measure(items, out, workers=given.workers))


if __name__ == "__main__":
    main()
