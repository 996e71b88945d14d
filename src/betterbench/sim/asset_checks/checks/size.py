"""Checks that the size and the mass of an asset are plausible for its kind."""

from __future__ import annotations

from betterbench.sim.asset_checks import limits
from betterbench.sim.asset_checks.check import Finding, check
from betterbench.sim.asset_checks.subject import Subject


@check
def size(subject: Subject) -> Finding:
    """Check that the longest side is within the usual range of the asset's kind."""
    kind, longest = subject.kind, subject.longest_m
    if kind is None:
        low, high, of = limits.LEAST_M, limits.MOST_M, "an object on a table"
    else:
        low, high = kind.low_m / limits.SIZE_FACTOR, kind.high_m * limits.SIZE_FACTOR
        of = f"a {kind.name}"
    nearest = high if longest > high else low
    # use enough digits to show that a size is outside the limits
    digits = next((n for n in range(3, 9) if f"{100 * longest:.{n}g}" != f"{100 * nearest:.{n}g}"), 9)
    shown = (f"{100 * length:.{digits}g}" for length in (longest, low, high))
    said = "longest side {} cm, usual for {of}: {} to {} cm".format(*shown, of=of)
    return Finding(
        100 * longest, 100 * nearest, "cm", not low <= longest <= high, said, "Give its longest side with --size-m"
    )


@check
def mass(subject: Subject) -> Finding:
    """Check that the mass is usual for the asset's kind, and that the density of the visible solid is plausible."""
    asset, kind = subject.asset, subject.kind
    if kind is not None:
        usual = kind.mass_at(subject.longest_m)
        ratio = max(asset.mass_kg / usual, usual / asset.mass_kg) if asset.mass_kg > 0.0 else float("inf")
        if not ratio <= limits.MASS_FACTOR:
            said = (
                f"mass {1000 * asset.mass_kg:.3g} g, a factor of {ratio:.3g} from the {1000 * usual:.3g} g usual for "
                "its kind"
            )
            return Finding(ratio, limits.MASS_FACTOR, "ratio", True, said, "Give its mass with --mass-kg")
    solid = subject.solid
    volume = (float(solid.cells.sum()) - 0.5 * float(solid.surface.sum())) * solid.pitch_m**3
    density = asset.mass_kg / volume
    fails = not limits.LEAST_DENSITY <= density <= limits.MOST_DENSITY
    nearest = limits.MOST_DENSITY if density > limits.MOST_DENSITY else limits.LEAST_DENSITY
    said = f"mass {1000 * asset.mass_kg:.3g} g, {density:.3g} kg/m^3 of its visible solid"
    return Finding(density, nearest, "kg/m^3", fails, said, "Give its mass with --mass-kg")
