"""Import an object and test its grasps in simulation. Both steps run in the child process of the import."""

from __future__ import annotations

from dataclasses import replace

from betterbench.sim.asset_checks import limits
from betterbench.sim.asset_checks.lift import LiftTrial, try_grasp
from betterbench.sim.asset_checks.rest import settled
from betterbench.sim.assets import Grasp
from betterbench.sim.assets.authoring.registry import asset_of
from betterbench.sim.assets.importing.child import answer_imports
from betterbench.sim.assets.importing.importer import Imported

_ENOUGH = 4
"""Number of successful grasps after which testing stops. Experts try the next grasp after a failure."""
_SLIP_STEP_MM, _SWING_STEP_DEGREES = 3.0, 10.0
"""Step sizes for slip and swing, which are rounded down to whole steps when grasps are sorted. Grasps with equal values
keep the order in which they were proposed."""


def import_for_parent() -> None:
    """Import the requested objects and test their grasps. The child process of an import runs this function."""
    answer_imports(with_tried_grasps)


def with_tried_grasps(imported: Imported) -> Imported:
    """Keep only the grasps that lift and carry the object in simulation, sorted from most to least stable.

    A note about the test is added. If the object is heavier than the payload of the robot, no grasp is tested and all
    grasps are kept.
    """
    draft = imported.draft
    if not draft.grasps or draft.mass_kg > limits.PAYLOAD_KG:
        return imported
    asset = asset_of(draft, "imported", color="gray")
    rest = settled(asset).pose
    tried, lifted = 0, list[tuple[int, int, Grasp]]()
    for grasp in sorted(asset.grasps, key=lambda grasp: grasp.preference):
        trial = try_grasp(asset, grasp, rest)
        tried += 1
        if trial.succeeded:
            lifted.append((_looseness(trial), grasp.preference, grasp))
        if len(lifted) == _ENOUGH:
            break
    lifted.sort(key=lambda found: found[:2])
    grasps = tuple(
        replace(grasp, name="body" if k == 0 else f"body{k + 1}", preference=k)
        for k, (_, _, grasp) in enumerate(lifted)
    )
    note = f"{len(grasps)} of {tried} grasps lift and carry it in simulation"
    return replace(imported, draft=replace(draft, grasps=grasps), notes=(*imported.notes, note))


def _looseness(trial: LiftTrial) -> int:
    return int(trial.slip_mm / _SLIP_STEP_MM) + int(trial.swing_degrees / _SWING_STEP_DEGREES)
