"""Image inputs for a learner of the ``pixels`` family: camera images that are cropped and scaled."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from PIL import Image

from betterbench.errors import InvalidInputError
from betterbench.interface import observation_spec
from betterbench.policies.learned.recipe import Eyes


def looked_at(eyes: Eyes, pictures: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the input images of a learner, (views, size, size, 3) uint8, given upright camera images by camera name.

    Each pixel is the mean of the area that it covers in the camera image. If no scaling is needed, pixels are copied.
    Raises InvalidInputError if the image of a camera is missing or does not have the size that the observation preset
    in the recipe prescribes.
    """
    known = {camera.name: camera for camera in observation_spec(eyes.observation).cameras}
    found = np.empty((len(eyes.windows), eyes.size, eyes.size, 3), np.uint8)
    for place, view in enumerate(eyes.windows):
        spec, picture = known[view.camera], pictures.get(view.camera)
        if picture is None or picture.shape != (spec.height, spec.width, 3):
            shown = "missing" if picture is None else f"{picture.shape[1]} x {picture.shape[0]}"
            raise InvalidInputError(
                f"camera {view.camera}",
                f"the images are {shown}, but the learner was trained with {spec.width} x {spec.height}",
                f"Use --observation {eyes.observation}",
            )
        left, top, right, bottom = view.window
        box = (left * spec.width, top * spec.height, right * spec.width, bottom * spec.height)
        image = Image.fromarray(np.ascontiguousarray(picture))
        found[place] = np.asarray(image.resize((eyes.size, eyes.size), Image.Resampling.BOX, box=box))
    return found
