"""Header of a modality file: its trial, its view and its modalities."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field, TypeAdapter

from betterbench.errors import InvalidInputError
from betterbench.geometry import Vector
from betterbench.json_form import Digest, strict_form
from betterbench.records.modalities.labels import FIRST_OBJECT, STAGE, semantics_of_instances
from betterbench.records.modalities.spec import MODALITIES, Modality, ViewSpec

FORMAT_VERSION: Literal[2] = 2
"""Version of the columns and the header.

Increase it when older versions of betterbench would misinterpret a new file. Files of version 1 have no checksum, and
`better materialize` creates them again.
"""

_Count = Annotated[int, Field(ge=0)]


@strict_form
@dataclass(frozen=True, slots=True)
class BoxedObject:
    """Object of the scene whose boxes are stored in the file.

    Objects have the same order as in the record's ``scene.objects``.

    Attributes:
        name: Name of the object in the scene.
        category: Category of the object.
        instance: Instance id of the object in the column ``instances``.
        semantic: Semantic id of the object's category in the column ``semantics``.
        half_size_m: Half extents of the object's 3-D box in the object frame [m].
    """

    name: str
    category: str
    instance: _Count
    semantic: _Count
    half_size_m: Vector


@strict_form
@dataclass(frozen=True, slots=True, kw_only=True)
class ViewHeader:
    """Header of a modality file: the trial, the view, the modalities, and the meaning of the instance ids.

    Attributes:
        record_sha256: SHA-256 of the record file.
        quality: Render preset of the color images.
        modalities: Modalities in the file, in the order of their columns.
        focal_px: Focal length [pixel]. Pixels are square, and the optical axis goes through the center of the image: K
            = [[f, 0, (width - 1) / 2], [0, f, (height - 1) / 2], [0, 0, 1]].
        objects: Objects of the scene.
        stage: Instance ids of the robot and the stage.
        renderer: Properties of OpenGL and the version of the simulator, because the pixels depend on both.
    """

    task: str
    condition: str
    seed: _Count
    policy: str
    record_sha256: Digest
    scene_hash: str
    view: ViewSpec
    quality: str
    modalities: tuple[Modality, ...]
    control_rate_hz: Annotated[float, Field(gt=0.0)]
    focal_px: Annotated[float, Field(gt=0.0)]
    objects: tuple[BoxedObject, ...]
    renderer: Mapping[str, str]
    stage: Mapping[str, int]
    format_version: Literal[2] = FORMAT_VERSION

    def __post_init__(self) -> None:
        """Raise InvalidInputError if a modality is listed twice or the modalities are out of order."""
        if list(self.modalities) != [name for name in MODALITIES if name in self.modalities] or not self.modalities:
            raise InvalidInputError(
                "modalities", "expected each modality at most once and in column order", "Materialize the trial again"
            )

    @property
    def semantics(self) -> list[int]:
        """Semantic id of each instance, indexed by instance id."""
        return semantics_of_instances([o.category for o in self.objects])


HEADER = TypeAdapter(ViewHeader)


def stage_ids() -> dict[str, int]:
    """Return the instance id of each part of the stage and the robot, by name."""
    return {name: 1 + i for i, name in enumerate(STAGE)}


def instance_of_object(index: int) -> int:
    """Return the instance id of the object with the given index in the record's ``scene.objects``."""
    return FIRST_OBJECT + index
