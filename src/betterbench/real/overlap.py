"""Agreement, for each object, between the live image of the front camera and the rendered image of the simulated twin.

For each visible object of the twin, the live image is searched for the rendered object and its surroundings. The
similarity is the normalized cross-correlation over the object and a border around it. The mean of each color channel is
removed, and each channel is scaled, so that the result does not depend on the brightness or tint. The shift with the
highest similarity gives the position of the object, which is converted to centimeters on the table by the camera
geometry.

The correlation compares shapes and color contrasts. It cannot detect additional objects. The colors of the two
tablecloths are compared by their ratio of green to blue next to the objects.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.real.twin import TwinView

FOUND = 0.6
"""Minimum correlation at the best shift for an object to be considered found."""
MOST_OFF_M = 0.015
"""Maximum distance of an object from its planned position [m].

Slots have a jitter of 10 mm, and people align objects with the overlay by eye.
"""
SEARCH_M = 0.07
"""Half width of the area around the planned position in which an object is searched for [m]."""
BORDER_PX = 5
"""Width of the border around an object that is included in the comparison [pixels]."""
COARSE_PX = 3
"""Step size of the coarse search [pixels]."""
SAMPLES = 400
"""Maximum number of pixels that are compared per object."""
CLOTH_RATIO = 0.45
"""Maximum difference in log(green / blue) between the tablecloths of the live and the rendered image.

The blue and the green cloth differ by 0.94, and a warm lamp (green 0.9, blue 0.75) changes the value by 0.18.
"""
LEAST_PX = 25
"""Minimum visible area for an object to be compared [pixels]."""


@dataclass(frozen=True, slots=True)
class ObjectAgreement:
    """Agreement between the live and the rendered image for one object.

    Attributes:
        name: Name of the object.
        score: Correlation at the planned position, from 0 to 1.
        best: Correlation at the position where it is highest.
        off_m: Offset of the position with the highest correlation from the planned position, along x (away from the
            arm) and y (to the arm's left) [m].
    """

    name: str
    score: float
    best: float
    off_m: tuple[float, float]

    @property
    def is_found(self) -> bool:
        """Whether the object was found near its planned position."""
        return self.best >= FOUND

    @property
    def distance_m(self) -> float:
        """Distance of the object from its planned position [m]."""
        return float(np.hypot(*self.off_m))

    @property
    def accepted(self) -> bool:
        """Whether the object was found close enough to its planned position."""
        return self.is_found and self.distance_m <= MOST_OFF_M

    @property
    def sentence(self) -> str:
        """Sentence that tells the operator how the object is misplaced; empty if the object is accepted."""
        title = self.name.replace("_", " ")
        if self.accepted:
            return ""
        if not self.is_found:
            return f"The {title} was not found at its planned position or within {100 * SEARCH_M:.0f} cm of it."
        x, y = self.off_m
        parts = []
        if abs(x) >= 0.005:
            parts.append(f"{100 * abs(x):.1f} cm too {'far from' if x > 0 else 'close to'} the arm")
        if abs(y) >= 0.005:
            parts.append(f"{100 * abs(y):.1f} cm too far to the arm's {'left' if y > 0 else 'right'}")
        return f"The {title} lies {' and '.join(parts)}."


@dataclass(frozen=True, slots=True)
class Agreement:
    """Agreement between a real scene and its simulated twin.

    Attributes:
        objects: Compared objects, with the worst agreement first.
        left_out: Names of objects that are not visible enough for a comparison.
        cloth: Color of the planned tablecloth if a different tablecloth is on the table; empty if it is the planned
            one.
    """

    objects: tuple[ObjectAgreement, ...]
    left_out: tuple[str, ...]
    cloth: str = ""

    @property
    def score(self) -> float:
        """Lowest score among the compared objects, from 0 to 1; 1 if no object was compared."""
        return min((o.score for o in self.objects), default=1.0)

    @property
    def accepted(self) -> bool:
        """Whether the tablecloth has the right color and every compared object is at its planned position."""
        return not self.cloth and all(o.accepted for o in self.objects)

    @property
    def sentences(self) -> tuple[str, ...]:
        """Sentences about the problems: one if the tablecloth is wrong, and one for each misplaced object."""
        cloth = (f"The tablecloth is not {self.cloth}.",) if self.cloth else ()
        return (*cloth, *(o.sentence for o in self.objects if not o.accepted))


def measure_agreement(live: np.ndarray, twin: TwinView) -> Agreement:
    """Compare a live image, (height, width, 3) uint8, with the image of the simulated twin.

    The live image is first scaled to the size of the twin's image.

    Raises:
        InvalidInputError: If the aspect ratios of the two images differ by more than 2 %.
    """
    height, width = twin.image.shape[:2]
    live = _scaled(live, width, height)
    found, left_out = [], []
    for name, mask in twin.masks.items():
        if int(mask.sum()) < LEAST_PX:
            left_out.append(name)
        else:
            found.append(_object(name, live, twin, mask))
    found.sort(key=lambda o: (o.accepted, o.score))
    return Agreement(tuple(found), tuple(left_out), _wrong_cloth(live, twin))


def _wrong_cloth(live: np.ndarray, twin: TwinView) -> str:
    """Return the color of the twin's tablecloth if the live image shows a different tablecloth, or "".

    The colors are compared next to the objects.
    """
    if not twin.cloth:
        return ""
    objects = np.logical_or.reduce(list(twin.masks.values()))
    around = _grown(_grown(objects)) & ~_grown(objects)
    ratios = []
    for image in (live, twin.image):
        _, green, blue = np.median(image[around], axis=0) + 1.0
        ratios.append(float(np.log(green / blue)))
    return twin.cloth if abs(ratios[0] - ratios[1]) > CLOTH_RATIO else ""


def _scaled(image: np.ndarray, width: int, height: int) -> np.ndarray:
    """Scale an image by area averaging. Raise InvalidInputError if the aspect ratio would change."""
    if image.ndim != 3 or image.shape[2] != 3 or abs(image.shape[1] * height / (image.shape[0] * width) - 1.0) > 0.02:
        problem = f"its images have shape {image.shape}, but those of the twin have {(height, width, 3)}"
        raise InvalidInputError("front camera", problem, "Use a camera size with the same ratio of width to height")
    if image.shape[:2] == (height, width):
        return image
    from PIL import Image  # noqa: PLC0415 - only for cameras of another size

    return np.asarray(Image.fromarray(image).resize((width, height), Image.Resampling.BOX))


def _object(name: str, live: np.ndarray, twin: TwinView, mask: np.ndarray) -> ObjectAgreement:
    """Return the agreement for one object. A coarse search for the image shift is followed by a fine search."""
    motion = twin.pixels_per_m[name]
    reach = np.ceil(np.abs(motion).sum(axis=1) * SEARCH_M).astype(int)
    rows, columns = np.nonzero(_grown(mask))
    chosen = np.linspace(0, len(rows) - 1, min(len(rows), SAMPLES)).astype(int)
    points = np.stack([columns[chosen], rows[chosen]], axis=1)
    template = twin.image[points[:, 1], points[:, 0]].astype(np.float32)

    def best_of(center: np.ndarray, half: np.ndarray, step: int) -> tuple[np.ndarray, float]:
        around = [np.arange(-n // step * step, n + 1, step) + c for n, c in zip(half, center, strict=True)]
        shifts = np.stack(np.meshgrid(*around, indexing="ij"), axis=-1).reshape(-1, 2)
        scores = _correlations(template, live, points, shifts)
        k = int(np.argmax(scores))
        return shifts[k], float(scores[k])

    start = np.zeros(2, dtype=int)
    coarse, _ = best_of(start, reach, COARSE_PX)
    shift, best = best_of(coarse, np.full(2, COARSE_PX), 1)
    at_place = float(_correlations(template, live, points, start[None, :])[0])
    if at_place >= best:
        shift, best = start, at_place
    off = np.linalg.solve(motion, shift.astype(float))
    return ObjectAgreement(name, float(np.clip(at_place, 0.0, 1.0)), best, (float(off[0]), float(off[1])))


def _correlations(template: np.ndarray, live: np.ndarray, points: np.ndarray, shifts: np.ndarray) -> np.ndarray:
    """Return the correlation (m,) of a template with the live image for each of m shifts.

    Each channel is scaled by its best-fitting factor, so that a tint does not change the result. A point outside the
    image has the color of the nearest pixel.

    Args:
        template: (n, 3) colors of the template.
        live: Live image.
        points: (n, 2) pixels (u, v) of the template.
        shifts: (m, 2) shifts (u, v) in pixels.
    """
    height, width = live.shape[:2]
    at = shifts[:, None, :] + points[None, :, :]
    u, v = np.clip(at[..., 0], 0, width - 1), np.clip(at[..., 1], 0, height - 1)
    seen = live[v, u].astype(np.float32)
    seen -= seen.mean(axis=1, keepdims=True)
    centered = template - template.mean(axis=0)
    dots = np.einsum("nc,mnc->mc", centered, seen)
    squares = np.einsum("mnc,mnc->mc", seen, seen)
    # The least-squares gain of a channel is dot / square; with this gain, the channel adds dot**2 / square.
    parts = np.where((squares > 1e-3) & (dots > 0.0), dots * dots / np.maximum(squares, 1e-3), 0.0)
    return np.asarray(np.sqrt(parts.sum(axis=1) / max(float((centered * centered).sum()), 1e-3)))


def _grown(mask: np.ndarray) -> np.ndarray:
    """Return a mask enlarged by the width of the border. NumPy suffices for this, so SciPy is not imported."""
    grown = mask.copy()
    for _ in range(BORDER_PX):
        padded = np.pad(grown, 1)
        grown = padded[1:-1, 1:-1] | padded[:-2, 1:-1] | padded[2:, 1:-1] | padded[1:-1, :-2] | padded[1:-1, 2:]
    return grown
