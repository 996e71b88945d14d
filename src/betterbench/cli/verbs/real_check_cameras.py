"""``better real check-cameras``: measure the pose of the real front camera from the marker sheet."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from betterbench.cli.console import OUT, print_json
from betterbench.errors import InvalidInputError, require_between

if TYPE_CHECKING:
    from betterbench.real.sheet.camera_pose import CameraPose


def check_cameras_command(
    images: Annotated[tuple[Path, ...], tyro.conf.Positional] = (),
    *,
    ruler_mm: float,
    camera: str = "",
    camera_size: tuple[int, int] = (640, 480),
    fovy_deg: float | None = None,
    out: Path | None = None,
    overwrite: bool = False,
    json: bool = False,
) -> None:
    """Measure the pose of the real front camera from the marker sheet, and print the required correction.

    Print the sheet that `better real sheet` writes, and lay it on the table. The pose and the field of view of the
    camera are computed from the markers on the sheet, and compared with the front camera in the simulated twin of the
    scene. The exit status is 1 if the pose differs by more than 1 cm or 1 degree.

    Pass an image file, or use --camera for the live camera. The image must have the size that `better real run` uses,
    because the field of view of a camera can depend on the image size.

    Example: better real check-cameras --camera 0 --ruler-mm 100

    Args:
        images: Image of the front camera, PNG or JPEG.
        ruler_mm: Measured length of the printed 100 mm ruler in millimeters.
        camera: Index or path of the live camera, as in `better real run`.
        camera_size: Width and height of the images in pixels.
        fovy_deg: Vertical field of view of the camera in degrees; by default it is measured as well.
        out: PNG or JPEG file to write: the image with the detected markers, and with the positions at which the
            simulated camera would see them.
        overwrite: Replace a file that `better real check-cameras` did not write.
        json: Print one JSON document.
    """
    from betterbench.cli.output.picture_file import picture_file
    from betterbench.real.sheet.annotated import annotated
    from betterbench.real.sheet.camera_pose import correction_of, measure_camera, twin_camera
    from betterbench.real.sheet.images import image_of, live_image

    for pixels in camera_size:
        require_between("--camera-size", pixels, 120, 4096)
    if len(images) + bool(camera) != 1:
        problem = f"{len(images)} images and {'a' if camera else 'no'} camera are given"
        raise InvalidInputError("check-cameras", problem, "Pass either one image file or --camera 0")
    image = live_image(camera, camera_size) if camera else image_of(images[0])
    found = measure_camera(image, ruler_mm=ruler_mm, fovy_deg=fovy_deg)
    twin = twin_camera()
    if out is not None:
        with picture_file(out, "real check-cameras", overwrite=overwrite) as write:
            write(annotated(image, found, twin), ())
    correction = correction_of(found.pose, twin)
    notes = [note for note in (correction.lens_sentence, *_notes(image.shape[1], image.shape[0], found.pose)) if note]
    if json:
        form: dict[str, Any] = {
            "markers": list(found.corners_px),
            "reprojection_error_px": found.error_px,
            "position_m": found.pose.position_m.tolist(),
            "position_spread_m": found.spread_m,
            "fovy_deg": found.pose.fovy_deg,
            "twin_position_m": twin.position_m.tolist(),
            "twin_fovy_deg": twin.fovy_deg,
            "distance_m": correction.distance_m,
            "angle_deg": correction.angle_deg,
            "move_m": correction.move_m.tolist(),
            "turn_deg": correction.turn_deg.tolist(),
            "placed": correction.is_near,
            "notes": notes,
        }
        print_json(form)
    else:
        x, y, z = (float(v) for v in 100.0 * found.pose.position_m)
        side = "left" if y >= 0.0 else "right"
        ahead = "ahead of" if x >= 0.0 else "behind"
        where = f"{abs(x):.1f} cm {ahead} the arm, {abs(y):.1f} cm to its {side}, {z:.1f} cm high"
        lines = [
            f"markers       {len(found.corners_px)} found, reprojection error {found.error_px:.2f} px",
            f"camera        {where} (standard deviation {100.0 * found.spread_m:.1f} cm)",
            f"lens          {found.pose.fovy_deg:.1f} degrees vertically; the twin's has {twin.fovy_deg:.1f}",
            f"offset        {100.0 * correction.distance_m:.1f} cm and {correction.angle_deg:.1f} degrees",
            "correction    "
            + (" ".join(correction.sentences) if not correction.is_near else "none, the pose is correct"),
        ]
        lines += [f"note          {note}" for note in notes]
        for line in lines:
            OUT.print(line, markup=False, soft_wrap=True)
    if not correction.is_near:
        raise SystemExit(1)


def _notes(width: int, height: int, pose: CameraPose) -> Iterator[str]:
    """Yield a warning if the image has a wrong aspect ratio, and a warning if the sheet seems to be rotated."""
    if abs(3 * width - 4 * height) > 0.02 * 3 * width:
        yield (
            f"The image has {width} x {height} pixels, expected an aspect ratio of 4:3. Give it in the size that "
            f"better real run records, because a distorted image gives a wrong pose."
        )
    if pose.axes[0, 2] > 0.0:
        yield (
            "According to the sheet, the camera points away from the arm. If this is wrong, rotate the sheet by 180 "
            "degrees."
        )
