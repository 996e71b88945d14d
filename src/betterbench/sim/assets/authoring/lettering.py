"""Stroke font for letters and digits printed on objects.

It contains only the characters that the procedural library needs.
"""

from betterbench.sim.assets.authoring.paint import Canvas, Rgb

Stroke = tuple[tuple[float, float], ...]

# Each stroke is a sequence of points on a field that is 0.6 wide and 1 high, with the origin at the lower left.
_BOWL: Stroke = ((0.0, 0.0), (0.0, 1.0), (0.42, 1.0), (0.6, 0.88), (0.6, 0.62), (0.42, 0.48), (0.0, 0.48))
_SIGNS: dict[str, tuple[Stroke, ...]] = {
    "1": (((0.08, 0.78), (0.32, 1.0), (0.32, 0.0)), ((0.08, 0.0), (0.56, 0.0))),
    "2": (((0.0, 0.80), (0.14, 0.97), (0.42, 1.0), (0.6, 0.82), (0.56, 0.60), (0.0, 0.0), (0.6, 0.0)),),
    "3": (
        ((0.0, 0.94), (0.40, 1.0), (0.58, 0.82), (0.50, 0.60), (0.22, 0.53)),
        ((0.22, 0.53), (0.52, 0.46), (0.6, 0.22), (0.42, 0.02), (0.0, 0.06)),
    ),
    "A": (((0.0, 0.0), (0.3, 1.0), (0.6, 0.0)), ((0.12, 0.36), (0.48, 0.36))),
    "E": (((0.6, 1.0), (0.0, 1.0), (0.0, 0.0), (0.6, 0.0)), ((0.0, 0.52), (0.48, 0.52))),
    "I": (((0.3, 0.0), (0.3, 1.0)),),
    "K": (((0.0, 0.0), (0.0, 1.0)), ((0.6, 1.0), (0.0, 0.42)), ((0.2, 0.6), (0.6, 0.0))),
    "L": (((0.0, 1.0), (0.0, 0.0), (0.58, 0.0)),),
    "P": (_BOWL,),
    "R": (_BOWL, ((0.28, 0.48), (0.6, 0.0))),
    "S": (
        ((0.58, 0.88), (0.40, 1.0), (0.14, 0.98), (0.0, 0.80), (0.08, 0.60), (0.50, 0.42), (0.6, 0.20)),
        ((0.6, 0.20), (0.44, 0.02), (0.16, 0.0), (0.0, 0.12)),
    ),
    "T": (((0.0, 1.0), (0.6, 1.0)), ((0.3, 1.0), (0.3, 0.0))),
}
_ADVANCE = 0.86


def write_word(
    canvas: Canvas, text: str, center: tuple[float, float], *, height: float, ink: Rgb, weight: float = 0.16
) -> None:
    """Write a word of upper-case characters on a texture, centered at ``center``.

    The letter height is given in units of the canvas, and the stroke width as a fraction of the letter height.
    """
    left = center[0] - 0.5 * height * (_ADVANCE * (len(text) - 1) + 0.6)
    low = center[1] - 0.5 * height
    for index, sign in enumerate(text):
        start = left + index * _ADVANCE * height
        for stroke in _SIGNS[sign]:
            points = [(start + height * x, low + height * y) for x, y in stroke]
            canvas.line(points, weight * height, ink)
