"""Pose of a real camera measured from the printed markers, and the motion to the pose of the simulated camera.

OpenCV finds the markers and solves for the pose. The lens is not known in advance, so its focal length and first
distortion coefficient are estimated together with the pose. All markers are in one plane, but the camera looks at the
plane obliquely, so focal length and distance can be distinguished. The standard deviations of the solution state the
uncertainty of these two values.

A camera pose is a position [m] in the arm's base frame (x ahead, y left, z up) and the camera's axes in OpenCV's
convention: x to the right of the image, y downward, z along the view.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.installation import missing_extra
from betterbench.real.sheet.layout import (
    CELLS,
    DICTIONARY,
    MARKER_MM,
    MARKERS_MM,
    RULER_MM,
    TILES,
    Area,
    corners_mm,
    page_of,
)
from betterbench.sim.robots.so101 import SO101
from betterbench.sim.robots.spec import CameraMount

LEAST_MARKERS = 5
"""Minimum number of detected markers. Four markers in one corner are not enough, because the lens is estimated too."""
MOST_ERROR_PX = 1.1
"""Maximum reprojection error in an image that is 640 pixels wide [pixels].

Renderings of a flat sheet have an error of 0.3 to 0.9 (with strong noise). If pages are misplaced by 10 mm, the error
is 1.2.
"""
MOST_LEFT_OUT = 2
"""Maximum number of markers that may be discarded as outliers (over three times the median error), for example because
the arm or its shadow covers an edge. A misplaced page has more outliers.
"""
WIDTH_PX = 640
"""Image width to which the limits in pixels refer."""
MOST_BLUR_PX = 4.0
"""Maximum width of the edge from black to white (10 to 90 %) in an image that is 640 pixels wide [pixels].

The width is 2 in a rendering. At a width of 4, the position error is up to 9 mm instead of 4 mm.
"""
MOST_BLUR_ANYWHERE_PX = 3.2
"""Maximum width of the sharpest edges in an image with too few markers [pixels].

If the edges are wider, the image is reported as blurred. The width is 1.7 in a rendering.
"""
MOST_RULER = 0.01
"""Maximum relative error of the length of the printed ruler. An error of 1 % changes the camera position by 8 mm."""
MOST_MARKER_SCALE = 0.025
"""Maximum relative difference between the marker size and the size expected from the distances between markers.

If pages are fitted to the paper, the markers are 3 to 6 % smaller. In renderings, the difference is up to 1 %.
"""
MOST_OTHER_SCALE = 0.1
"""Minimum relative difference between the marker size and the expected size for misplaced pages.

No printer shrinks a page this much.
"""
MOST_PAGE_OFF_MM = 20.0
"""Maximum distance of a marker from the position expected for a rotated or swapped page [mm].

Up to this distance, the page is reported as rotated or swapped.
"""
SMALL_PX = 400
"""Image width below which markers are reported as too small instead of blurred or covered [pixels]."""
MOST_SPREAD_M = 0.01
"""Maximum standard deviation of the measured camera position [m], equal to the allowed position error of the camera.

In renderings, the standard deviation is up to 4 mm. If only the near row of pages is visible, the standard deviation is
12 to 20 mm, and the position error is 14 to 46 mm.
"""
NEAR_FOV_DEG = 1.5
"""Maximum difference between the fields of view of the real and the simulated camera [degrees].

At this difference, an object at the edge of the image moves by 3 %.
"""
NEAR_M, NEAR_DEG = 0.01, 1.0
"""Maximum distance [m] and angle [degrees] from the simulated camera at which the camera is correctly placed."""


@dataclass(frozen=True, slots=True, eq=False)
class CameraPose:
    """Pose and field of view of a camera.

    Attributes:
        position_m: (3,) position in the arm's base frame [m].
        axes: (3, 3) directions of the camera's x, y and z axes in the base frame, as columns.
        fovy_deg: Vertical field of view [degrees].
    """

    position_m: np.ndarray
    axes: np.ndarray
    fovy_deg: float


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredCamera:
    """Camera pose measured from the markers.

    Attributes:
        pose: Pose and field of view of the camera.
        corners_px: (4, 2) image corners of each detected marker that the solution uses, by marker number.
        error_px: Root mean square reprojection error [pixels].
        spread_m: Standard deviation of the camera position, estimated from the residuals [m].
        distortion: First radial distortion coefficient.
        blur_px: Median width of the marker edges [pixels].
    """

    pose: CameraPose
    corners_px: dict[int, np.ndarray]
    error_px: float
    spread_m: float
    distortion: float
    blur_px: float


@dataclass(frozen=True, slots=True, eq=False)
class CameraCorrection:
    """Motion that moves a real camera to the pose of the simulated camera.

    Attributes:
        move_m: (3,) translation along x (away from the arm), y (to the arm's left) and z (up) [m].
        turn_deg: (3,) rotation about the camera's axes [degrees]: tilt up, pan right, roll clockwise seen from behind.
        fovy_deg: Vertical fields of view of the real camera and of the simulated camera [degrees].
    """

    move_m: np.ndarray
    turn_deg: np.ndarray
    fovy_deg: tuple[float, float]

    @property
    def distance_m(self) -> float:
        """Distance between the two cameras [m]."""
        return float(np.linalg.norm(self.move_m))

    @property
    def angle_deg(self) -> float:
        """Angle between the two cameras [degrees]."""
        return float(np.linalg.norm(self.turn_deg))

    @property
    def is_near(self) -> bool:
        """Whether the camera is close enough to the pose of the simulated camera."""
        return self.distance_m <= NEAR_M and self.angle_deg <= NEAR_DEG

    @property
    def lens_sentence(self) -> str:
        """Advice to use another lens; empty if the field of view is close enough to the simulated camera's."""
        real, twin = self.fovy_deg
        if abs(real - twin) <= NEAR_FOV_DEG:
            return ""
        kind = "wider" if real > twin else "narrower"
        return (
            f"The lens is {kind} than the twin's. Objects therefore appear elsewhere in the image, although the camera "
            f"is in the right position. Use another lens, or use a wider lens and crop and scale its image."
        )

    @property
    def sentences(self) -> tuple[str, ...]:
        """Instructions for moving and rotating the camera, one sentence each. Tiny motions are left out."""
        found = []
        moves = _parts(
            100.0 * self.move_m,
            0.1,
            "cm",
            (("away from the arm", "toward the arm"), ("to the arm's left", "to the arm's right"), ("up", "down")),
        )
        if moves:
            found.append(f"Move the camera {moves}.")
        roll = ("roll it clockwise (seen from behind it)", "roll it counterclockwise (seen from behind it)")
        ways = (("tilt it up", "tilt it down"), ("turn it to its right", "turn it to its left"), roll)
        turns = _parts(self.turn_deg, 0.1, "degrees", ways)
        if turns:
            found.append(f"Then {turns}.")
        return tuple(found)


def _parts(values: np.ndarray, least: float, unit: str, ways: Sequence[tuple[str, str]]) -> str:
    """Describe the components of a motion in words, the largest component first. Small components are left out."""
    order = sorted(range(len(values)), key=lambda k: -abs(values[k]))
    told = []
    for k in order:
        if abs(values[k]) >= least:
            way = ways[k][int(values[k] < 0.0)]
            told.append(
                f"{abs(values[k]):.1f} {unit} {way}" if unit == "cm" else f"{way} by {abs(values[k]):.1f} {unit}"
            )
    return ", ".join(told)


def twin_camera() -> CameraPose:
    """Return the pose of the front camera in the simulated twin."""
    if SO101.front_camera is None:
        raise AssertionError("the description of the SO-101 must contain a front camera")
    return mounted(SO101.front_camera)


def mounted(mount: CameraMount) -> CameraPose:
    """Return the pose of a camera, given its position, the point at which it looks, and its upward direction."""
    position, target, up = (np.array(v) for v in (mount.position, mount.target, mount.up))
    forward = (target - position) / np.linalg.norm(target - position)
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    return CameraPose(position, np.stack([right, np.cross(forward, right), forward], axis=1), mount.fovy_deg)


def correction_of(camera: CameraPose, twin: CameraPose) -> CameraCorrection:
    """Return the motion that brings a real camera to the pose of the simulated camera.

    The translation is applied before the rotation.
    """
    turn, _ = opencv().Rodrigues(camera.axes.T @ twin.axes)
    return CameraCorrection(
        twin.position_m - camera.position_m, np.degrees(np.ravel(turn)), (camera.fovy_deg, twin.fovy_deg)
    )


def measure_camera(image: np.ndarray, *, ruler_mm: float = RULER_MM, fovy_deg: float | None = None) -> MeasuredCamera:
    """Measure the pose of the camera that took an image, (height, width, 3) uint8 RGB.

    Args:
        image: Image that shows the sheet on the table.
        ruler_mm: Measured length of the printed ruler [mm].
        fovy_deg: Vertical field of view [degrees]. If it is None, it is estimated.

    Raises:
        InvalidInputError: If the ruler, the image or the solution cannot be trusted. The message says what to do.
        MissingDependencyError: If OpenCV is not installed.
    """
    _require_ruler(ruler_mm)
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8 or min(image.shape[:2]) < 120:
        problem = f"has shape {image.shape} of {image.dtype}"
        raise InvalidInputError("image", problem, "Use a color image of at least 120 pixels on each side")
    gray = opencv().cvtColor(np.ascontiguousarray(image), opencv().COLOR_RGB2GRAY)
    found = _markers(gray)
    if len(found) < LEAST_MARKERS:
        raise _too_few(gray, len(found))
    unit = image.shape[1] / WIDTH_PX
    blur = float(np.median([_edge_width(gray, corners) for corners in found.values()]))
    if blur > MOST_BLUR_PX * unit:
        problem = f"the edges of the markers are {blur:.1f} pixels wide"
        raise InvalidInputError("image", problem, "Focus the camera, hold it still, and add light")
    _require_pages(found)
    shape, scale = (image.shape[0], image.shape[1]), ruler_mm / RULER_MM
    try:
        return _trusted(found, shape, scale, fovy_deg, blur)
    except InvalidInputError as problem:
        if fovy_deg is None:
            raise
        try:
            seen = _trusted(found, shape, scale, None, blur).pose.fovy_deg
        except InvalidInputError:
            raise problem from None
        told = f"{fovy_deg:g} degrees do not match the image, which shows {seen:.1f}"
        cure = "Leave out the option, or set it to the vertical field of view for this image size"
        raise InvalidInputError("--fovy-deg", told, cure) from problem


def _trusted(
    found: dict[int, np.ndarray], shape: tuple[int, int], scale: float, fovy_deg: float | None, blur: float
) -> MeasuredCamera:
    """Compute the camera pose from the markers. Raise InvalidInputError if the result is not reliable."""
    found = dict(found)
    camera, residuals = _solved(found, shape, scale, fovy_deg, blur)
    for _ in range(MOST_LEFT_OUT):
        worst = max(residuals, key=lambda marker: residuals[marker])
        if len(found) <= LEAST_MARKERS or residuals[worst] < 3.0 * float(np.median(list(residuals.values()))):
            break
        found.pop(worst)
        camera, residuals = _solved(found, shape, scale, fovy_deg, blur)
    off = _marker_scale(found, shape, camera) / scale
    if abs(off - 1.0) > MOST_OTHER_SCALE:
        problem = "the markers are not arranged as on the overview page"
        raise InvalidInputError(
            "sheet", problem, "Place the pages edge to edge, as shown on the overview, with the printed side up"
        )
    if abs(off - 1.0) > MOST_MARKER_SCALE:
        problem = f"the markers have {100.0 * off:.1f} % of the size that their distances imply"
        cure = "Print all pages at 100 %, and lay them edge to edge along their frames"
        raise InvalidInputError("sheet", problem, cure)
    if camera.error_px > MOST_ERROR_PX * shape[1] / WIDTH_PX:
        worst = max(residuals, key=lambda marker: residuals[marker])
        problem = f"the markers deviate by {camera.error_px:.1f} pixels, marker {worst} the most"
        cure = (
            "Lay the pages flat and edge to edge, as shown on the overview, check both rulers of each page, and use "
            "the camera's whole image"
        )
        raise InvalidInputError("sheet", problem, cure)
    if camera.spread_m > MOST_SPREAD_M:
        problem = f"the position of the camera is uncertain by {100.0 * camera.spread_m:.1f} cm"
        raise InvalidInputError(
            "image", problem, "Move the camera so that it sees more markers, spread over more of the image"
        )
    return camera


def _require_ruler(ruler_mm: float) -> None:
    """Raise InvalidInputError if the measured length of the printed ruler is not plausible.

    A length is not plausible if it is not a positive number, seems to be in a different unit, or shows that the printer
    scaled the sheet.
    """
    if abs(ruler_mm / RULER_MM - 1.0) <= MOST_RULER:
        return
    if not (math.isfinite(ruler_mm) and ruler_mm > 0.0):
        cure = "Measure the printed ruler with a real one, and pass its length in millimeters"
        raise InvalidInputError("--ruler-mm", f"expected a positive length in millimeters, got {ruler_mm:g}", cure)
    for unit, factor in (("centimeters", 10.0), ("inches", 25.4), ("meters", 1000.0)):
        if abs(factor * ruler_mm / RULER_MM - 1.0) <= 0.1:
            cure = f"Pass the length in millimeters: {factor * ruler_mm:.1f}"
            raise InvalidInputError("--ruler-mm", f"{ruler_mm:g} seems to be in {unit}", cure)
    problem = f"the printed ruler is {ruler_mm:g} mm long instead of {RULER_MM:.0f}"
    raise InvalidInputError("--ruler-mm", problem, "Print the sheet again at 100 %, without fitting it to the page")


# -------------------------------------------------------------------------------------------------------------- pages


def _require_pages(found: dict[int, np.ndarray]) -> None:
    """Raise InvalidInputError if a page of the sheet is rotated or swapped with another page.

    The view of the table is determined by the majority of the markers. In this view, the markers of a misplaced page
    appear at the position of another page or rotated by 180 degrees. Without this check, one or two such markers would
    be discarded as if they were covered, and the slots on their page would be at wrong positions.
    """
    table = np.concatenate([corners_mm(marker) for marker in found]).astype(np.float32)
    pixels = np.concatenate(list(found.values())).astype(np.float32)
    view, _ = opencv().findHomography(pixels, table, opencv().RANSAC, MOST_PAGE_OFF_MM)
    if view is None:
        return
    told = []
    for page, tile in enumerate(TILES, start=1):
        seen = {m: _through(view, corners) for m, corners in found.items() if page_of(MARKERS_MM[m]) == page}
        if not seen or _misses(seen, tile, tile, turned=False) <= 2.0 * MOST_PAGE_OFF_MM:
            continue
        places = [(n, place, turned) for n, place in enumerate(TILES, start=1) for turned in (False, True)]
        other, place, turned = min(places, key=lambda each: _misses(seen, tile, each[1], turned=each[2]))
        if _misses(seen, tile, place, turned=turned) <= MOST_PAGE_OFF_MM:
            where = "" if other == page else f"is at the position of page {other}"
            told.append(f"page {page} {' and '.join(filter(None, (where, 'is turned around' if turned else '')))}")
    if told:
        cure = "Arrange the pages as shown on the overview, seen from behind the arm"
        raise InvalidInputError("sheet", "; ".join(told), cure)


def _through(view: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return the (4, 2) positions on the table [mm] that correspond to the image corners of a marker."""
    return np.asarray(opencv().perspectiveTransform(corners.reshape(1, -1, 2), view)[0])


def _misses(seen: dict[int, np.ndarray], tile: Area, place: Area, *, turned: bool) -> float:
    """Return the deviation of a page's markers from the markers expected at the position of a given page [mm].

    The deviation is the largest distance of a marker corner from its expected position.
    """
    center, there = (np.array([0.5 * (a.x_low + a.x_high), 0.5 * (a.y_low + a.y_high)]) for a in (tile, place))
    way = -1.0 if turned else 1.0
    return max(
        float(np.linalg.norm(there + way * (corners_mm(m) - center) - corners, axis=1).max())
        for m, corners in seen.items()
    )


# ------------------------------------------------------------------------------------------------------------ markers


def opencv() -> Any:  # noqa: ANN401 - a module without types
    """Import OpenCV and return the module. Raise MissingDependencyError if it is not installed."""
    try:
        return importlib.import_module("cv2")
    except ImportError as problem:
        raise missing_extra(
            "Finding the markers in an image requires OpenCV, which is not installed", "real"
        ) from problem


def _markers(gray: np.ndarray) -> dict[int, np.ndarray]:
    """Find the markers of the sheet in an image, and return the (4, 2) corners [pixels] of each, by marker number.

    Raises:
        InvalidInputError: If a marker occurs twice in the image.
    """
    aruco = opencv().aruco
    options = aruco.DetectorParameters()
    options.cornerRefinementMethod = aruco.CORNER_REFINE_SUBPIX
    options.cornerRefinementWinSize = max(3, round(5 * gray.shape[1] / WIDTH_PX))
    options.minMarkerPerimeterRate = 0.02
    detector = aruco.ArucoDetector(aruco.getPredefinedDictionary(getattr(aruco, DICTIONARY)), options)
    corners, numbers, _ = detector.detectMarkers(gray)
    found: dict[int, np.ndarray] = {}
    for marker, points in zip(() if numbers is None else np.ravel(numbers).tolist(), corners, strict=True):
        if marker >= len(CELLS):
            continue
        if marker in found:
            problem = f"marker {marker} occurs twice in the image"
            raise InvalidInputError(
                "image", problem, "Leave only one sheet on the table, and remove mirrors from the view"
            )
        found[marker] = np.asarray(points, dtype=float).reshape(4, 2)
    return dict(sorted(found.items()))


def _too_few(gray: np.ndarray, count: int) -> InvalidInputError:
    """Create the error for an image in which too few markers were found. The error states the likely reason."""
    says = f"{count} of the sheet's {len(CELLS)} markers found, {LEAST_MARKERS} needed"
    if len(_markers(np.ascontiguousarray(gray[:, ::-1]))) >= max(LEAST_MARKERS, count + 1):
        return InvalidInputError(
            "image",
            "it is mirrored: the markers are found in its mirror image",
            "Switch off mirroring in the camera or the printer",
        )
    if gray.shape[1] < SMALL_PX:
        problem = f"{says}; with {gray.shape[1]} x {gray.shape[0]} pixels, it is too small for them"
        return InvalidInputError("image", problem, "Use the image size of `better real run`, such as 640 x 480")
    sharpest = _sharpest_edge(gray)
    if math.isinf(sharpest):
        cure = "Take the cap off the lens, and check light and exposure"
        return InvalidInputError("image", f"{says}; its brightness is nearly uniform", cure)
    if sharpest > MOST_BLUR_ANYWHERE_PX * gray.shape[1] / WIDTH_PX:
        problem = f"{says}; its sharpest edges are {sharpest:.0f} pixels wide, so it is blurred"
        return InvalidInputError("image", problem, "Focus the camera, hold it still, and add light")
    cure = "Point the camera at the sheet, remove objects and shadows from it, and fold the arm"
    return InvalidInputError("image", says, cure)


def _edge_width(gray: np.ndarray, corners: np.ndarray) -> float:
    """Return the median width of the outer edges of a marker [pixels], measured from 10 to 90 % brightness."""
    center, widths = corners.mean(axis=0), []
    cell = 0.5 / 6.0  # half a cell, as a fraction of the marker's side
    for k in range(4):
        first, second = corners[k], corners[(k + 1) % 4]
        for share in (0.3, 0.5, 0.7):
            point = first + share * (second - first)
            inward = (center - point) * 2.0 * cell  # from the edge to the middle of the black border
            length = float(np.linalg.norm(inward))
            profile = _profile(gray, point - inward, point + inward)
            low, high = profile.min(), profile.max()
            if high - low < 25.0 or length < 1.0:
                continue
            share_of = (profile - low) / (high - low)
            inside = np.count_nonzero((share_of > 0.1) & (share_of < 0.9))
            widths.append(2.0 * length * inside / len(profile))
    return float(np.median(widths)) if widths else math.inf


def _profile(gray: np.ndarray, start: np.ndarray, end: np.ndarray, count: int = 41) -> np.ndarray:
    """Return the linearly interpolated brightness along a line between two points."""
    points = start + np.linspace(0.0, 1.0, count)[:, None] * (end - start)
    height, width = gray.shape
    u, v = np.clip(points[:, 0], 0, width - 1.001), np.clip(points[:, 1], 0, height - 1.001)
    i, j = u.astype(int), v.astype(int)
    a, b = u - i, v - j
    top = gray[j, i] * (1 - a) + gray[j, i + 1] * a
    return np.asarray(top * (1 - b) + (gray[j + 1, i] * (1 - a) + gray[j + 1, i + 1] * a) * b)


def _sharpest_edge(gray: np.ndarray) -> float:
    """Return the width of the sharpest edges in an image [pixels].

    The width is the contrast of the image divided by its steepest brightness gradient.
    """
    smooth = opencv().GaussianBlur(gray, (0, 0), 0.7).astype(float)
    low, high = np.percentile(smooth, (1.0, 99.0))
    slopes = np.hypot(np.diff(smooth, axis=1)[:-1], np.diff(smooth, axis=0)[:, :-1])
    steepest = float(np.percentile(slopes, 99.9))
    return 0.8 * float(high - low) / max(steepest, 1e-6) if high - low >= 25.0 else math.inf


# --------------------------------------------------------------------------------------------------------------- pose


def _points(markers: Sequence[int], scale: float) -> np.ndarray:
    """Return the (n, 3) positions of the corners of markers in the base frame [m]."""
    flat = np.concatenate([corners_mm(marker) for marker in markers]) * 0.001 * scale
    return np.column_stack([flat, np.zeros(len(flat))]).astype(np.float32)


def _solved(
    found: dict[int, np.ndarray], shape: tuple[int, int], scale: float, fovy_deg: float | None, blur: float
) -> tuple[MeasuredCamera, dict[int, float]]:
    """Compute the camera pose from the markers, and return it with the reprojection error of each marker [pixels]."""
    cv2 = opencv()
    height, width = shape
    points, pixels = _points(list(found), scale), np.concatenate(list(found.values())).astype(np.float32)
    guess = 0.5 * height / math.tan(0.5 * math.radians(fovy_deg or twin_camera().fovy_deg))
    K = np.array([[guess, 0.0, 0.5 * (width - 1)], [0.0, guess, 0.5 * (height - 1)], [0.0, 0.0, 1.0]])
    flags = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_PRINCIPAL_POINT | cv2.CALIB_FIX_ASPECT_RATIO
    flags |= cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3
    if fovy_deg is not None:
        flags |= cv2.CALIB_FIX_FOCAL_LENGTH
    solution = cv2.calibrateCameraExtended([points], [pixels], (width, height), K, np.zeros(5), flags=flags)
    error, K, distortion, rotations, translations, _, spreads, _ = solution
    R, _ = cv2.Rodrigues(rotations[0])
    t = np.ravel(translations[0])
    position = -R.T @ t
    if position[2] <= 0.0 or not np.isfinite(position).all():
        cure = "Check that the sheet lies on the table with its print up"
        raise InvalidInputError("image", "the markers imply a camera position below the table", cure)
    again, _ = cv2.projectPoints(points, rotations[0], t, K, distortion)
    off = np.linalg.norm(again.reshape(-1, 2) - pixels, axis=1).reshape(-1, 4)
    residuals = {marker: float(row.max()) for marker, row in zip(found, off, strict=True)}
    fovy = math.degrees(2.0 * math.atan(0.5 * height / K[1, 1]))
    spread = float(np.linalg.norm(np.ravel(spreads)[3:6]))
    pose = CameraPose(position, R.T, fovy)
    return MeasuredCamera(pose, dict(found), float(error), spread, float(np.ravel(distortion)[0]), blur), residuals


def _marker_scale(found: dict[int, np.ndarray], shape: tuple[int, int], camera: MeasuredCamera) -> float:
    """Return the measured size of the markers on the table, relative to their size on the sheet.

    The pose is determined mainly by the distances between markers, because they are longer than the markers themselves.
    Markers on pages that were printed too small but placed at the right distances therefore appear too small.
    """
    cv2 = opencv()
    height, width = shape
    focal = 0.5 * height / math.tan(0.5 * math.radians(camera.pose.fovy_deg))
    K = np.array([[focal, 0.0, 0.5 * (width - 1)], [0.0, focal, 0.5 * (height - 1)], [0.0, 0.0, 1.0]])
    sizes = []
    for corners in found.values():
        flat = cv2.undistortPoints(corners.reshape(-1, 1, 2), K, np.array([camera.distortion, 0, 0, 0])).reshape(4, 2)
        rays = np.column_stack([flat, np.ones(4)]) @ camera.pose.axes.T
        on_table = camera.pose.position_m - rays * (camera.pose.position_m[2] / rays[:, 2:])
        sizes.append(1000.0 * math.sqrt(_area(on_table[:, :2])) / MARKER_MM)
    return float(np.median(sizes))


def _area(corners: np.ndarray) -> float:
    """Return the area of a quadrilateral."""
    x, y = corners.T
    return 0.5 * abs(float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))))
