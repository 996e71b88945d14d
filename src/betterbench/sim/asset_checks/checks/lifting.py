"""Checks that an asset fits into the gripper, and that it can be lifted, held and carried with one of its grasps."""

from __future__ import annotations

from betterbench.sim.asset_checks import limits
from betterbench.sim.asset_checks.check import Finding, check, not_applicable
from betterbench.sim.asset_checks.lift import LiftTrial, try_grasp
from betterbench.sim.asset_checks.opening import gripper_opening_m, needed_opening_m
from betterbench.sim.asset_checks.subject import Subject

_CURE = "Move a grasp to a part with two parallel sides, or check mass and friction"


@check
def grasp_width(subject: Subject) -> Finding:
    """Check that at least one of the preferred grasps fits into the gripper and declares the correct width."""
    grasps = sorted(subject.asset.grasps, key=lambda grasp: grasp.preference)[: limits.GRASPS_TRIED]
    if not grasps:
        return not_applicable("it has no grasp for a parallel jaw")
    jaw = 1000.0 * gripper_opening_m()
    problems = []
    for grasp in grasps:
        needed_m = needed_opening_m(subject.solid, grasp)
        needed, stated = 1000.0 * (needed_m or 0.0), 1000.0 * grasp.width_m
        open_to = stated + 2000.0 * grasp.clearance_m + limits.GRASP_TOLERANCE_MM
        if needed_m is None:
            problems.append(f"{grasp.name}: there is nothing between the pads")
        elif max(needed, stated) > jaw:
            problems.append(f"{grasp.name}: {max(needed, stated):.3g} mm, and the gripper opens {jaw:.3g} mm")
        elif needed > open_to:
            problems.append(f"{grasp.name}: its stated width is {stated:.2g} mm, but the part needs {needed:.3g} mm")
        else:
            said = f"grasp {grasp.name!r} needs an opening of {needed:.2g} mm, the gripper opens {jaw:.3g} mm"
            return Finding(needed, jaw, "mm", False, said)
    said = f"none of its first {len(grasps)} grasps fits the gripper ({'; '.join(problems)})"
    return Finding(0.0, 1.0, "grasps", True, said, "Correct the width of the grasps, or move them to a narrower part")


@check
def lift(subject: Subject) -> Finding:
    """Check that one of the asset's preferred grasps can lift the asset by 15 cm, hold it and carry it sideways."""
    asset, kind = subject.asset, subject.kind
    must = kind is not None and kind.name in limits.ALWAYS_LIFTED_KINDS
    if asset.mass_kg > limits.PAYLOAD_KG and not must:
        return not_applicable(f"{asset.mass_kg:.3g} kg are more than the payload of {limits.PAYLOAD_KG:g} kg")
    thick = float(subject.size_m[2])
    if thick < limits.LEAST_THICK_M:
        return not_applicable(f"it is {1000 * thick:.2g} mm thick, too flat to be grasped from a table")
    if not asset.grasps:
        if must:
            said = "it has no grasp, although every usual object of its kind fits into the gripper"
            return Finding(0.0, 1.0, "grasps", True, said, _CURE)
        return not_applicable("it has no grasp for a parallel jaw")
    grasps = sorted(asset.grasps, key=lambda grasp: grasp.preference)[: limits.GRASPS_TRIED]
    reasons = []
    for grasp in grasps:
        trial: LiftTrial = try_grasp(asset, grasp, subject.rest.pose)
        if trial.succeeded:
            moved = f"slips {trial.slip_mm:.2g} mm, swings {trial.swing_degrees:.2g} degrees"
            said = f"grasp {grasp.name!r} lifts and carries it: {moved}"
            return Finding(trial.slip_mm, limits.SLIP_MM, "mm", False, said)
        reasons.append(f"{grasp.name}: {trial.reason}")
    said = f"none of its first {len(grasps)} grasps lifts and carries it ({'; '.join(reasons)})"
    return Finding(0.0, 1.0, "grasps", True, said, _CURE)
