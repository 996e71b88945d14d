"""Procedural textures for visual parts, drawn with NumPy: bands, discs, lines and noise."""

import functools
import itertools
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar

import numpy as np

Rgb = tuple[float, float, float]
"""Red, green and blue, from 0 to 1."""

# Each texture is drawn at this multiple of its size and averaged down for antialiasing.
_OVERSAMPLING = 2

_unpainted: ContextVar[bool] = ContextVar("unpainted", default=False)


@contextmanager
def unpainted() -> Iterator[None]:
    """Context manager that turns off the painting of textures, so that assets are built faster.

    A canvas then has only one pixel. All random numbers are still drawn, so the shapes of assets stay the same.
    """
    token = _unpainted.set(True)
    try:
        yield
    finally:
        _unpainted.reset(token)


class Canvas:
    """Texture on which generators paint.

    Its coordinates are in meters or another unit, with the origin at the lower left.

    Attributes:
        x: (1, width) horizontal coordinate of each column of samples.
        y: (height, 1) vertical coordinate of each row of samples, upward. Expressions of ``x`` and ``y`` broadcast to
            the size of the texture. Masks and factors that only depend on rows, or only on columns, therefore take
            almost no time.
    """

    def __init__(self, width: float, height: float, pixels: tuple[int, int], color: Rgb) -> None:
        """Create a canvas of one color.

        The finished texture has ``pixels`` = (width, height) pixels, at most 256 on each side.
        """
        columns, rows = (_OVERSAMPLING * side for side in ((1, 1) if _unpainted.get() else pixels))
        self.x = ((np.arange(columns) + 0.5) / columns * width)[None, :]
        self.y = ((rows - 0.5 - np.arange(rows)) / rows * height)[:, None]
        self.width, self.height = width, height
        # The channel is the first axis, because operations on an array with the channel as its last axis take five
        # times as long.
        self._planes = np.empty((3, rows, columns))
        self._planes[:] = _by_plane(color)

    @functools.cached_property
    def radius(self) -> np.ndarray:
        """Distance of each sample from the center of the canvas, as a (height, width) array."""
        away: np.ndarray = np.hypot(self.x - 0.5 * self.width, self.y - 0.5 * self.height)
        return away

    @functools.cached_property
    def angle(self) -> np.ndarray:
        """Direction of each sample as seen from the center, as a (height, width) array [rad]. 0 is to the right."""
        turn: np.ndarray = np.arctan2(self.y - 0.5 * self.height, self.x - 0.5 * self.width)
        return turn

    def between(self, low: float, high: float) -> np.ndarray:
        """Return a (height, 1) mask of the rows above ``low`` and below ``high``."""
        return (self.y > low) & (self.y < high)

    def near(self, x: float, y: float, reach_x: float, reach_y: float) -> np.ndarray:
        """Return a mask of the rectangle around (x, y) with the half extents ``reach_x`` and ``reach_y``."""
        return (np.abs(self.y - y) < reach_y) & (np.abs(self.x - x) < reach_x)

    def paint(self, mask: np.ndarray, color: Rgb, *, strength: float = 1.0) -> None:
        """Blend a color into the texture where the mask is set.

        The mask is boolean, or has weights in [0, 1], and must broadcast to the size of the texture.
        """
        wanted: np.ndarray = mask.astype(bool, copy=False)
        rows, columns = _run(np.any(wanted, axis=1)), _run(np.any(wanted, axis=0))
        mask = mask[rows, columns]
        if not mask.size:
            return
        # a side of length 1 stands for all rows or columns
        window = (rows if wanted.shape[0] > 1 else slice(None), columns if wanted.shape[1] > 1 else slice(None))
        if mask.dtype == np.bool_:
            self._fill(window, mask, color, strength)
        else:
            self._blend(window, mask * strength, color)

    def _fill(self, window: tuple[slice, slice], inside: np.ndarray, color: Rgb, strength: float = 1.0) -> None:
        """Blend a color into a window of the texture, using the same weight for all pixels in the window's mask."""
        planes, new = self._planes[:, *window], _by_plane(color)
        np.copyto(planes, new if strength == 1.0 else planes * (1.0 - strength) + new * strength, where=inside)

    def paint_rectangle(self, rows: np.ndarray, columns: np.ndarray, weight: np.ndarray, color: Rgb) -> None:
        """Blend a color into the texture where the row mask (height,) and the column mask (width,) are both set.

        ``weight`` is a (width,) array in [0, 1]. This method paints hundreds of small marks quickly, because it does
        not need a mask of the whole canvas for each mark.
        """
        window = (_run(rows), _run(columns))
        inside = rows[window[0], None] & columns[None, window[1]]
        self._blend(window, inside * weight[window[1]], color)

    def _blend(self, window: tuple[slice, slice], weight: np.ndarray, color: Rgb) -> None:
        planes = self._planes[:, *window]
        planes *= 1.0 - weight
        for channel, value in enumerate(color):
            planes[channel] += value * weight

    def _window(self, center: tuple[float, float], reach_x: float, reach_y: float) -> tuple[slice, slice]:
        """Return the slices of rows and columns that contain all samples near a point.

        Small marks are painted faster if only this part of the texture is changed.
        """
        return _run(np.abs(self.y[:, 0] - center[1]) <= reach_y), _run(np.abs(self.x[0] - center[0]) <= reach_x)

    def shade(self, factor: np.ndarray) -> None:
        """Multiply all channels by ``factor``, an array that broadcasts to (height, width)."""
        self._planes *= factor

    def brighten(self, dark: float, top: float) -> None:
        """Multiply the colors by a factor that rises from ``dark`` at the lower edge to 1 at row ``top``."""
        self.shade(dark + (1.0 - dark) * np.clip(self.y / top, 0.0, 1.0))

    def shadow(self, start: float, end: float, light: float, loss: float) -> None:
        """Darken the texture above row ``start``.

        The brightness is ``light`` at row ``start`` and decreases by ``loss`` between rows ``start`` and ``end``.
        """
        down = np.clip((self.y - start) / (end - start), 0.0, 1.0)
        self.shade(np.where(self.y > start, light - loss * down, 1.0))

    def band(self, low: float, high: float, color: Rgb) -> None:
        """Paint a horizontal band that extends from row ``low`` to row ``high``."""
        self.paint((self.y >= low) & (self.y < high), color)

    def ellipse(self, center: tuple[float, float], radii: tuple[float, float], color: Rgb, turn: float = 0) -> None:
        """Paint a filled ellipse that is rotated by ``turn`` [rad]."""
        window = self._window(center, max(radii), max(radii))
        self._fill(window, self._in_ellipse(window, center, radii, turn), color)

    def inside_ellipse(self, center: tuple[float, float], radii: tuple[float, float], turn: float = 0.0) -> np.ndarray:
        """Return a mask of the samples inside an ellipse that is rotated by ``turn`` [rad]."""
        return self._in_ellipse((slice(None), slice(None)), center, radii, turn)

    def _in_ellipse(
        self, window: tuple[slice, slice], center: tuple[float, float], radii: tuple[float, float], turn: float
    ) -> np.ndarray:
        """Return a mask of the samples in a window that are inside an ellipse."""
        c, s = math.cos(turn), math.sin(turn)
        dx, dy = self.x[:, window[1]] - center[0], self.y[window[0]] - center[1]
        inside: np.ndarray = ((c * dx + s * dy) / radii[0]) ** 2 + ((c * dy - s * dx) / radii[1]) ** 2 <= 1.0
        return inside

    def line(self, points: Sequence[tuple[float, float]], width: float, color: Rgb, strength: float = 1) -> None:
        """Paint a polyline of the given width."""
        mask = np.zeros(self._planes.shape[1:], dtype=bool)
        for (ax, ay), (bx, by) in itertools.pairwise(points):
            length = (bx - ax) ** 2 + (by - ay) ** 2
            reach_x, reach_y = 0.5 * abs(bx - ax) + width, 0.5 * abs(by - ay) + width
            window = self._window((0.5 * (ax + bx), 0.5 * (ay + by)), reach_x, reach_y)
            x, y = self.x[:, window[1]], self.y[window[0]]
            t = np.clip(((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / max(length, 1e-12), 0.0, 1.0)
            mask[window] |= np.hypot(x - ax - t * (bx - ax), y - ay - t * (by - ay)) <= 0.5 * width
        self.paint(mask, color, strength=strength)

    def grain(self, rng: np.random.Generator, *, cells: tuple[int, int], amount: float) -> None:
        """Multiply the colors by smooth noise with mean 1 and standard deviation ``amount``.

        ``cells`` is the number of noise cells in the horizontal and in the vertical direction.
        """
        columns, rows = cells
        grid = rng.standard_normal((rows + 1, columns + 1))
        u = np.linspace(0.0, columns, self.x.size, endpoint=False)
        v = np.linspace(0.0, rows, self.y.size, endpoint=False)
        i, j = np.floor(v).astype(int), np.floor(u).astype(int)
        fv, fu = (v - i)[:, None], (u - j)[None, :]
        fv, fu = fv * fv * (3.0 - 2.0 * fv), fu * fu * (3.0 - 2.0 * fu)
        across = grid[:, j] * (1.0 - fu) + grid[:, j + 1] * fu
        noise, above = across[i], across[i + 1]
        noise *= 1.0 - fv
        above *= fv
        noise += above
        noise *= amount
        noise += 1.0
        self.shade(noise)

    def spots(
        self,
        rng: np.random.Generator,
        count: int,
        color: Rgb,
        *,
        radius: tuple[float, float],
        rows: tuple[float, float],
        stretch: float = 1.0,
    ) -> None:
        """Paint spots with random centers between two pixel rows. The width of a spot is ``stretch`` times its height.

        ``radius`` gives the smallest and the largest radius of a spot.
        """
        for u, v, size in rng.uniform(0.0, 1.0, (count, 3)).tolist():
            r = radius[0] + (radius[1] - radius[0]) * size
            self.ellipse((u * self.width, rows[0] + v * (rows[1] - rows[0])), (stretch * r, r), color)

    def pixels(self) -> np.ndarray:
        """Return the finished texture as a (height, width, 3) uint8 array, in which the first row is the top row."""
        height, width = (side // _OVERSAMPLING for side in self._planes.shape[1:])
        pixels = np.empty((height, width, 3), dtype=np.uint8)
        for channel, plane in enumerate(self._planes):
            total = np.zeros((height, width))
            for i, j in itertools.product(range(_OVERSAMPLING), repeat=2):
                total += plane[i::_OVERSAMPLING, j::_OVERSAMPLING]
            total.clip(0.0, _OVERSAMPLING**2, out=total)
            total *= 255.0 / _OVERSAMPLING**2
            pixels[..., channel] = np.rint(total, out=total)
        return pixels


def _by_plane(color: Rgb) -> np.ndarray:
    """Reshape a color to (3, 1, 1), so that it broadcasts over the pixels of a texture."""
    return np.array(color, dtype=float).reshape(3, 1, 1)


def _run(wanted: np.ndarray) -> slice:
    """Return the shortest slice that contains all True elements. The slice is empty if there are none."""
    at = wanted.nonzero()[0]
    return slice(at[0], at[-1] + 1) if at.size else slice(0, 0)


def uniforms(rng: np.random.Generator, *ranges: tuple[float, float]) -> list[float]:
    """Draw one random number from each range (low, high), in order."""
    return [rng.uniform(low, high) for low, high in ranges]


def scattered(
    rng: np.random.Generator, *, tries: int, gap: float, reach: float, count: int | None = None
) -> Iterator[tuple[float, float]]:
    """Yield up to ``count`` random points that are at least ``gap`` apart, in a disc around (1, 1).

    While iterating, the caller may draw other random numbers from ``rng``. If ``count`` is None, the number of points
    is limited only by the number of tries.
    """
    placed: list[tuple[float, float]] = []
    for _ in range(tries):
        if len(placed) == count:
            return
        angle, distance = rng.uniform(0.0, 2.0 * math.pi), reach * math.sqrt(rng.random())
        x, y = 1.0 + distance * math.cos(angle), 1.0 + distance * math.sin(angle)
        if all(math.hypot(x - px, y - py) >= gap for px, py in placed):
            placed.append((x, y))
            yield x, y


# # Colors of common color words. They are chosen to be distinguishable under the lighting of the scenes.
PALETTE: dict[str, Rgb] = {
    "red": (0.78, 0.07, 0.07),
    "blue": (0.08, 0.22, 0.68),
    "white": (0.90, 0.89, 0.86),
    "green": (0.10, 0.48, 0.18),
    "yellow": (0.92, 0.74, 0.08),
    "orange": (0.90, 0.42, 0.05),
    "black": (0.09, 0.09, 0.10),
    "gray": (0.45, 0.46, 0.48),
    "silver": (0.70, 0.71, 0.73),
    "cream": (0.86, 0.80, 0.66),
    "brown": (0.72, 0.42, 0.15),
    "purple": (0.42, 0.14, 0.52),
    "pink": (0.90, 0.48, 0.58),
}
"""RGB color of each color word in instructions."""


STEEL: Rgb = (0.74, 0.75, 0.77)
BUN: Rgb = (0.76, 0.45, 0.15)  # brown of a baked bun and of objects that look like one
CHROME: Rgb = (0.80, 0.81, 0.83)


def shaded(color: Rgb, factor: float) -> Rgb:
    """Return a darker color (if factor < 1) or a lighter color (if factor > 1, toward white)."""
    if factor <= 1.0:
        return (color[0] * factor, color[1] * factor, color[2] * factor)
    lift = 1.0 - 1.0 / factor
    return (color[0] + (1 - color[0]) * lift, color[1] + (1 - color[1]) * lift, color[2] + (1 - color[2]) * lift)


def mixed(a: Rgb, b: Rgb, fraction: float) -> Rgb:
    """Mix two colors. The result is ``a`` at fraction 0 and ``b`` at fraction 1."""
    return (a[0] + (b[0] - a[0]) * fraction, a[1] + (b[1] - a[1]) * fraction, a[2] + (b[2] - a[2]) * fraction)


def jittered(color: Rgb, rng: np.random.Generator, *, amount: float = 0.08) -> Rgb:
    """Return a randomly lighter or darker shade of a color."""
    return shaded(color, 1.0 + float(rng.uniform(-amount, amount)))
