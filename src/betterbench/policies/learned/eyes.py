"""Image inputs of a learner of the ``pixels`` family, cut and scaled from the images of a scene's cameras."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from PIL import Image

from betterbench.errors import InvalidInputError
from betterbench.interface import observation_spec
from betterbench.policies.learned.recipe import Eyes


def looked_at(eyes: Eyes, pictures: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the views of a learner, (views, size, size, 3) uint8, from upright pictures by camera.

    Each is the mean over the part of the camera's picture that a pixel covers; one to one it is that picture's pixels.

    Raises InvalidInputError if a camera is missing, or its picture has another size than the recipe's observation.
    """
    known = {camera.name: camera for camera in observation_spec(eyes.observation).cameras}
    found = np.empty((len(eyes.windows), eyes.size, eyes.size, 3), np.uint8)
    for place, view in enumerate(eyes.windows):
        spec, picture = known[view.camera], pictures.get(view.camera)
        if picture is None or picture.shape != (spec.height, spec.width, 3):
            shown = "no picture" if picture is None else f"one of {picture.shape[1]} x {picture.shape[0]}"
            raise InvalidInputError(
                f"camera {view.camera}",
                f"the learner is shown {shown} and learned from {spec.width} x {spec.height}",
                f"Give --observation {eyes.observation}",
            )
        left, top, right, bottom = view.window
        box = (left * spec.width, top * spec.height, right * spec.width, bottom * spec.height)
        image = Image.fromarray(np.ascontiguousarray(picture))
        found[place] = np.asarray(image.resize((eyes.size, eyes.size), Image.Resampling.BOX, box=box))
    return found
