"""Export of a recorded trial as a Rerun file: images, masks, boxes, depth, contacts and subgoals on one timeline."""

from __future__ import annotations

import contextlib
import importlib
import io
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from PIL import Image

from betterbench.installation import missing_extra
from betterbench.jobs import OnCount
from betterbench.jobs.durable import DurableFile
from betterbench.ordinary_file import open_ordinary
from betterbench.quoting import markdown_text
from betterbench.records import Record, RunFolder
from betterbench.records.modalities.header import instance_of_object, stage_ids
from betterbench.records.modalities.spec import ViewSpec
from betterbench.sim.modalities.pictures import LEAST_SEEN, own_colors
from betterbench.sim.modalities.viewing import Lane, ShownRow, lanes_of, shown_rows

_TIME, _ROW = "time", "row"
_JPEG_QUALITY = 90
_PNG_LEVEL = 4
_DEPTH_PER_M = 1000.0
"""Number of depth units per meter in the file.

Depths are stored with 16 bits, because 32-bit depths would take up nine tenths of a file.
"""

_APPLICATION = "betterbench"
_HEAD_BYTES = 4096


def write_rerun(
    run: RunFolder,
    record: Record,
    views: tuple[ViewSpec, ...],
    path: Path,
    *,
    quality: str,
    on_progress: OnCount | None = None,
) -> Path:
    """Write a trial to an ``.rrd`` file and return its path.

    ``on_progress`` is called with the number of finished rows and the total number of rows.

    Raises:
        MissingDependencyError: If Rerun is not installed, or off-screen OpenGL does not work on this machine.
        RecordError: If the scene cannot be opened.
        StorageError: If the disk is full.
    """
    rerun, blueprint = _rerun()
    meta = record.metadata
    stream = rerun.RecordingStream(_APPLICATION, recording_id=f"{meta.policy} {meta.task}/{meta.condition}/{meta.seed}")
    lanes = lanes_of(record)
    with DurableFile(path) as durable, _disconnected(stream):
        # Rerun only collects the data in memory. If it wrote the file itself, a full disk would truncate the file
        # silently.
        kept = stream.memory_recording()
        stream.send_blueprint(_layout(blueprint, views), make_active=False, make_default=True)
        for shown in shown_rows(run, record, views, quality=quality):
            if shown.row == 0:
                _log_cameras(rerun, stream, views, shown.focal_px)
                _log_names(
                    rerun,
                    stream,
                    record,
                    own_colors(shown.views[0]["rgb"], shown.views[0]["instances"], len(meta.scene.objects)),
                )
            stream.set_time(_TIME, duration=shown.time_s)
            stream.set_time(_ROW, sequence=shown.row)
            _log_row(rerun, stream, record, views, shown)
            _log_lanes(rerun, stream, lanes, shown.row)
            if on_progress is not None:
                on_progress(shown.row + 1, len(record))
        stream.flush()
        durable.file.write(kept.drain_as_bytes())
        durable.finish()
    return path


@contextlib.contextmanager
def _disconnected(stream: Any) -> Iterator[None]:  # noqa: ANN401 - Rerun's
    """Disconnect a stream on exit, even after an error, so that its buffer is freed."""
    try:
        yield
    finally:
        stream.disconnect()


def is_rerun_file(path: Path) -> bool:
    """Return whether the file was written by :func:`write_rerun`.

    Such files are Rerun files that contain the name "betterbench" near the beginning.
    """
    with open_ordinary(path) as file:
        head = file.read(_HEAD_BYTES)
    return head.startswith(b"RRF") and _APPLICATION.encode() in head


def _rerun() -> tuple[Any, Any]:
    """Import Rerun and its blueprint module. They are imported late, because Rerun is an optional dependency."""
    try:
        modules: tuple[ModuleType, ...] = tuple(map(importlib.import_module, ("rerun", "rerun.blueprint")))
    except ImportError as error:
        raise missing_extra("Rerun is not installed", "view", otherwise="or write a page with --out x.html.") from error
    return modules[0], modules[1]


def _layout(blueprint: Any, views: tuple[ViewSpec, ...]) -> Any:  # noqa: ANN401 - Rerun is an extra
    images = [blueprint.Spatial2DView(origin=f"world/{view.camera}", name=view.name) for view in views]
    return blueprint.Blueprint(
        blueprint.Vertical(
            blueprint.Horizontal(*images, blueprint.Spatial3DView(origin="world", name="3-D")),
            blueprint.Horizontal(
                blueprint.StateTimelineView(origin="happens", name="subgoals and contacts"),
                blueprint.TextDocumentView(origin="trial", name="trial"),
                column_shares=[3, 1],
            ),
            row_shares=[3, 2],
        ),
        collapse_panels=True,
    )


def _log_names(rerun: Any, stream: Any, record: Record, colors: Sequence[tuple[int, int, int]]) -> None:  # noqa: ANN401
    """Log everything that is constant: names and colors of instances, and a description of the trial."""
    meta = record.metadata
    names: list[tuple[Any, ...]] = [(0, "nothing"), *((number, name) for name, number in stage_ids().items())]
    names += [(instance_of_object(i), o.name, colors[i]) for i, o in enumerate(meta.scene.objects)]
    stream.log("world", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    stream.log("world", rerun.AnnotationContext(names), static=True)
    end = f"{record.outcome.termination}{', success' if record.outcome.success else ''}"
    title, said, by = map(markdown_text, (f"{meta.task}/{meta.condition}/{meta.seed}", meta.instruction, meta.policy))
    text = f"# {title}\n\n“{said}”\n\n{by}: {end}"
    stream.log("trial", rerun.TextDocument(text, media_type="text/markdown"), static=True)


def _log_cameras(rerun: Any, stream: Any, views: tuple[ViewSpec, ...], focal_px: tuple[float, ...]) -> None:  # noqa: ANN401
    for view, focal in zip(views, focal_px, strict=True):
        pinhole = rerun.Pinhole(
            focal_length=focal,
            # Rerun measures from the corner of the first pixel, not from its center.
            principal_point=(0.5 * view.width, 0.5 * view.height),
            resolution=(view.width, view.height),
            camera_xyz=rerun.ViewCoordinates.RDF,
            image_plane_distance=0.2,
        )
        stream.log(f"world/{view.camera}", pinhole, static=True)


def _log_row(rerun: Any, stream: Any, record: Record, views: tuple[ViewSpec, ...], shown: ShownRow) -> None:  # noqa: ANN401
    objects = record.metadata.scene.objects
    classes = [instance_of_object(i) for i in range(len(objects))]
    for number, (view, values) in enumerate(zip(views, shown.views, strict=True)):
        place = f"world/{view.camera}"
        turn = rerun.Quaternion(xyzw=np.roll(values["camera_quaternion"], -1))
        stream.log(place, rerun.Transform3D(translation=values["camera_position"], quaternion=turn))
        stream.log(f"{place}/rgb", rerun.Image(values["rgb"]).compress(jpeg_quality=_JPEG_QUALITY))
        depth = rerun.EncodedDepthImage(
            _depth_png(values["depth"]), media_type="image/png", meter=_DEPTH_PER_M, draw_order=-20.0
        )
        stream.log(f"{place}/depth", depth)
        stream.log(f"{place}/masks", rerun.SegmentationImage(values["instances"], opacity=0.35))
        seen = np.flatnonzero(np.nan_to_num(values["visible_fraction"]) >= LEAST_SEEN)
        labels = [f"{objects[i].name} {100 * values['visible_fraction'][i]:.0f} %" for i in seen]
        boxes = rerun.Boxes2D(
            array=values["visible_box"][seen].astype(np.float32),
            array_format=rerun.Box2DFormat.XYXY,
            labels=labels,
            class_ids=[classes[i] for i in seen],
        )
        stream.log(f"{place}/boxes", boxes)
        if number == 0:
            stream.log("world/objects", _boxes(rerun, record, shown, classes))
    stream.log("world/gripper", rerun.Points3D([record.ee_position[shown.row]], radii=0.01, labels=["tool"]))


def _depth_png(depth: np.ndarray) -> bytes:
    """Return depths (height, width) [m] as a 16-bit PNG [mm]. Pixels without a hit or out of range are 0."""
    millimeters = np.nan_to_num(depth * _DEPTH_PER_M, nan=0.0, posinf=0.0, neginf=0.0)
    whole = np.where(millimeters <= np.iinfo(np.uint16).max, np.rint(millimeters), 0.0).astype(np.uint16)
    packed = io.BytesIO()
    Image.fromarray(whole).save(packed, format="PNG", compress_level=_PNG_LEVEL)
    return packed.getvalue()


def _boxes(rerun: Any, record: Record, shown: ShownRow, classes: list[int]) -> Any:  # noqa: ANN401
    values = shown.views[0]
    return rerun.Boxes3D(
        centers=values["box_center_world"],
        half_sizes=shown.half_sizes_m,
        quaternions=[rerun.Quaternion(xyzw=np.roll(q, -1)) for q in values["box_quaternion_world"]],
        labels=[o.name for o in record.metadata.scene.objects],
        class_ids=classes,
        show_labels=False,
    )


def _log_lanes(rerun: Any, stream: Any, lanes: list[Lane], row: int) -> None:  # noqa: ANN401
    """Log the spans that begin or end at this row, in all lanes of the timeline."""
    for lane in lanes:
        said = next((text for first, last, text in lane.spans if first <= row <= last), "")
        before = next((text for first, last, text in lane.spans if first <= row - 1 <= last), "")
        if row == 0 or said != before:
            place = ["happens", lane.kind, lane.name.replace("/", "_")]
            stream.log(place, rerun.StateChange(state=said))
