"""Checks of the visual shape: triangles, their orientation, textures, and gaps between parts."""

from __future__ import annotations

import numpy as np

from betterbench.sim.asset_checks import limits
from betterbench.sim.asset_checks.check import Finding, at_most, check
from betterbench.sim.asset_checks.subject import Subject
from betterbench.sim.assets import Texture, VisualPart
from betterbench.sim.assets.importing.measures import degenerate_share, largest_gap, share_from_behind

_SAME_UV = 1e-6


@check
def triangles(subject: Subject) -> Finding:
    """Check that hardly any triangles have zero area, and that all vertices are finite."""
    share = degenerate_share(*subject.surface)
    return at_most(
        share,
        limits.DEGENERATE_SHARE,
        "share",
        f"{100 * share:.2g} % of its triangles have no area",
        "Merge close vertices and remove degenerate triangles in a mesh editor",
    )


@check
def faces_outward(subject: Subject) -> Finding:
    """Check that the triangles face outward. A surface that faces inward would be invisible from outside."""
    share = share_from_behind(*subject.surface)
    return at_most(
        share,
        limits.BEHIND_SHARE,
        "share",
        f"back faces cover {100 * share:.2g} % of its image",
        "Recalculate the normals to the outside in a mesh editor, or give thin sheets a thickness",
    )


@check
def textures(subject: Subject) -> Finding:
    """Check that every part is visible, and that no texture is missing, entirely black or a placeholder."""
    for part in subject.asset.visual:
        problem = _problem(part)
        if problem:
            return Finding(None, None, "", True, f"part {part.name!r} {problem}", "Export the object with its textures")
    count = sum(part.texture is not None for part in subject.asset.visual)
    return Finding(None, None, "", False, f"{count} textures and {len(subject.asset.visual) - count} plain colors")


def _problem(part: VisualPart) -> str:
    if part.rgba[3] < limits.LEAST_ALPHA:
        return f"has an opacity of {part.rgba[3]:.2g} and cannot be seen"
    if part.texture is None:
        return ""
    colors = _shown(part, part.texture)
    if colors is None:
        return "has texture coordinates that are missing or not finite"
    dark = float((colors.max(axis=1) < limits.DARK).mean())
    if dark > limits.DARK_SHARE:
        return f"is black on {100 * dark:.0f} % of its surface"
    magenta = float(((colors[:, 0] > 240) & (colors[:, 1] < 15) & (colors[:, 2] > 240)).mean())
    if magenta > limits.PLACEHOLDER_SHARE:
        return f"shows the magenta of a missing texture on {100 * magenta:.0f} % of its surface"
    if np.ptp(part.texture.uv, axis=0).max() < _SAME_UV and len(part.faces) > 1:
        return "has the same texture coordinates everywhere, so it shows a single point of its texture"
    return ""


def _shown(part: VisualPart, texture: Texture) -> np.ndarray | None:
    """Return the texture color at the center of each triangle, (k, 3). None if the texture coordinates are unusable."""
    corners = part.faces if texture.corners is None else texture.corners
    if len(corners) != len(part.faces) or corners.max(initial=0) >= len(texture.uv):
        return None
    at = texture.uv[corners].mean(axis=1)
    if not np.isfinite(at).all():
        return None
    height, width = texture.pixels.shape[:2]
    column = np.clip((np.mod(at[:, 0], 1.0) * width).astype(int), 0, width - 1)
    row = np.clip(((1.0 - np.mod(at[:, 1], 1.0)) * height).astype(int), 0, height - 1)
    return np.asarray(texture.pixels[row, column])


@check
def connected(subject: Subject) -> Finding:
    """Check that the visible parts touch each other."""
    size = subject.longest_m
    gap = 1000.0 * largest_gap(*subject.surface, spacing=size / 60.0)
    return at_most(
        gap,
        max(limits.GAP_MM, 1000.0 * limits.GAP_SHARE * size),
        "mm",
        f"largest gap between its parts {gap:.2g} mm",
        "Import each object alone, or move the parts together",
    )
