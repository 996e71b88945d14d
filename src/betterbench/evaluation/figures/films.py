"""Images and videos rendered from the records of a run."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import av
import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.jobs import OnCount
from betterbench.jobs.durable import DurableFile
from betterbench.jobs.outputs import mark_of
from betterbench.records import Record, RunFolder
from betterbench.sim.scenes.image_files import jpeg_bytes
from betterbench.sim.scenes.limited import LimitedView, LimitedViews
from betterbench.sim.worlds import Photo, world_named


@dataclass(frozen=True, slots=True)
class Shot:
    """State of a trial at a given simulated time [s], to be rendered as an image."""

    task: str
    condition: str
    seed: int
    time_s: float


def render_shots(
    run: RunFolder,
    shots: Sequence[Shot],
    *,
    camera: str = "front",
    size: int = 320,
    quality: str = "standard",
    views: LimitedViews | None = None,
    on_progress: OnCount | None = None,
) -> dict[Shot, bytes]:
    """Render one JPEG of ``size`` x ``size`` pixels per shot.

    If the run belongs to another benchmark, the simulator of that benchmark renders the images. For LIBERO, LIBERO's
    front camera is used. ``views`` provides the rendering processes. By default, a new process is started.
    ``on_progress`` is called with the number of finished images and the number of all images.

    Raises:
        RecordError: If a record or a scene is missing or unreadable.
        MissingDependencyError: If off-screen OpenGL does not work on this machine, or the benchmark of the run cannot
            render images.
        WorldError: If the simulator of the other benchmark fails.
    """
    trials = dict.fromkeys((s.task, s.condition, s.seed) for s in shots)
    records = {key: run.read_record(*key) for key in trials}
    if not run.world.measured:
        return _world_shots(run, records, shots, size, on_progress)
    images: dict[Shot, bytes] = {}
    if not records:
        return images
    with ExitStack() as stack:
        (view,) = (views or stack.enter_context(LimitedViews())).take(1, quality=quality, size=size)
        for scene_hash in dict.fromkeys(r.metadata.scene_hash for r in records.values()):
            for shot in shots:
                record = records[shot.task, shot.condition, shot.seed]
                if record.metadata.scene_hash != scene_hash:
                    continue
                view.open_of(run, record)
                images[shot] = jpeg_bytes(_image(view, record, camera, shot.time_s), quality=82)
                if on_progress is not None:
                    on_progress(len(images), len(shots))
    return images


def _world_shots(
    run: RunFolder,
    records: Mapping[tuple[str, str, int], Record],
    shots: Sequence[Shot],
    size: int,
    on_progress: OnCount | None,
) -> dict[Shot, bytes]:
    """Render one JPEG per shot of a run in a benchmark that renders its own images, such as LIBERO."""
    ordered = sorted(shots, key=lambda shot: (shot.task, shot.condition))
    rows = [records[s.task, s.condition, s.seed] for s in ordered]
    wanted = [
        Photo(f"{s.task}/{s.condition}", record, _row(record, s.time_s))
        for s, record in zip(ordered, rows, strict=True)
    ]
    images: dict[Shot, bytes] = {}
    world = world_named(run.world.name)
    for image in world.photos(run.plan["world"], wanted, size=size, where=str(run.path / "run.json")):
        images[ordered[len(images)]] = jpeg_bytes(image, quality=82)
        if on_progress is not None:
            on_progress(len(images), len(shots))
    return images


def write_video(
    run: RunFolder,
    task: str,
    condition: str,
    seed: int,
    *,
    camera: str = "front",
    size: int = 512,
    out: Path | None = None,
    on_progress: OnCount | None = None,
) -> Path:
    """Write the video of a recorded trial (H.264 in MP4) and return its path.

    By default, the video is written to the folder of the run. ``on_progress`` is called with the number of finished
    frames and the number of all frames.

    Raises:
        InvalidInputError: If the side length of the images [pixel] is odd.
    """
    if size % 2:
        raise InvalidInputError("--size", f"{size} is odd", "Use an even number of pixels")
    record = run.read_record(task, condition, seed)
    path = out or run.video_path(task, condition, seed, camera=camera)
    with LimitedView(quality="standard", size=size) as view:
        view.open_of(run, record)
        film_record(view, record, path, camera=camera, on_progress=on_progress)
    return path


def film_record(
    view: LimitedView,
    record: Record,
    path: Path,
    *,
    camera: str = "front",
    every: int = 1,
    on_progress: OnCount | None = None,
) -> None:
    """Write the video of a record (H.264 in MP4), with one frame for every ``every`` control steps.

    The renderer ``view`` must already have opened the scene of the record. ``on_progress`` is called with the number of
    finished frames and the number of all frames.
    """
    rows = range(0, len(record), every)
    with DurableFile(path) as durable, av.open(durable.file, "w", format="mp4") as container:
        container.metadata["comment"] = mark_of("replay")
        stream = container.add_stream("libx264", rate=round(record.metadata.control_rate_hz / every))
        stream.width = stream.height = view.size
        stream.pix_fmt = "yuv420p"
        for done, row in enumerate(rows, start=1):
            rgb = view.draw(record.qpos[row], camera, jitter=record.metadata.view_jitter)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(rgb, format="rgb24")))
            if on_progress is not None:
                on_progress(done, len(rows))
        container.mux(stream.encode(None))
        container.close()
        durable.finish()


def probe_encoder() -> str:
    """Encode a small video in memory, and return a description of the video format.

    Raises an error if the encoder is not available.
    """
    buffer = io.BytesIO()
    with av.open(buffer, "w", format="mp4") as container:
        stream = container.add_stream("libx264", rate=20)
        stream.width = stream.height = 64
        stream.pix_fmt = "yuv420p"
        container.mux(stream.encode(av.VideoFrame.from_ndarray(np.zeros((64, 64, 3), np.uint8), format="rgb24")))
        container.mux(stream.encode(None))
    return f"H.264 ({len(buffer.getvalue())} bytes written)"


def _row(record: Record, time_s: float) -> int:
    return int(np.clip(round(time_s * record.metadata.control_rate_hz), 0, len(record) - 1))


def _image(view: LimitedView, record: Record, camera: str, time_s: float) -> np.ndarray:
    return view.draw(record.qpos[_row(record, time_s)], camera, jitter=record.metadata.view_jitter)
