"""InternVL's division of an image into square tiles, and the resulting number of tokens.

The rule is the same as in InternVL's ``dynamic_preprocess`` and in the image processor of transformers (GOT-OCR 2).
Among all grids with at most ``most`` tiles, it chooses the one with the aspect ratio nearest to that of the image. If
two grids have the same aspect ratio, it chooses the larger one if the image has more than half as many pixels as this
grid. The image is resized to the grid and cut into tiles. If there is more than one tile, a thumbnail of the whole
image is added.
"""

from __future__ import annotations

from dataclasses import dataclass

from betterbench.errors import require_between

MOST_TILES = 12
"""Default maximum number of tiles for an image (``max_patches`` of InternVL-3.5's image processor)."""
TILES_ALLOWED = 64
"""Largest value that is accepted as the maximum number of tiles."""


@dataclass(frozen=True, slots=True)
class Grid:
    """Grid of tiles into which an image is divided. If the grid has more than one tile, a thumbnail is added."""

    columns: int
    rows: int

    @property
    def tiles(self) -> int:
        """Number of tiles in the grid, including the thumbnail."""
        cut = self.columns * self.rows
        return cut + (cut > 1)

    def tokens(self, side: int, *, patch: int = 14, shuffle: float = 0.5) -> int:
        """Return the number of language model tokens for all tiles.

        Args:
            side: Side of a tile [pixel].
            patch: Side of a patch of the vision transformer [pixel].
            shuffle: Factor by which pixel shuffling reduces each side of the grid of patches.
        """
        return self.tiles * int(side // patch * shuffle) ** 2


def grid_of(width: int, height: int, *, most: int = MOST_TILES, side: int = 448) -> Grid:
    """Return the grid of tiles for an image of the given size.

    Args:
        width: Width of the image [pixel].
        height: Height of the image [pixel].
        most: Maximum number of tiles, not counting the thumbnail.
        side: Side of a tile [pixel].

    Raises:
        InvalidInputError: If ``most`` is out of range.
    """
    require_between("max-tiles", most, 1, TILES_ALLOWED)
    shapes = sorted(
        ((i, j) for i in range(1, most + 1) for j in range(1, most + 1) if i * j <= most), key=lambda s: s[0] * s[1]
    )
    ratio, best, nearest = width / height, (1, 1), float("inf")
    for columns, rows in shapes:
        distance = abs(ratio - columns / rows)
        fills = width * height > 0.5 * side * side * columns * rows
        if distance < nearest or (distance == nearest and fills):
            best, nearest = (columns, rows), distance
    return Grid(*best)
