"""Videos that show a recorded trial next to its training twin (the training trial with the same seed).

The videos also show the instructions, the time, the labels and the path of the gripper.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import av
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from betterbench.errors import InvalidInputError
from betterbench.evaluation.figures.show import wrap_text
from betterbench.jobs import OnCount
from betterbench.jobs.durable import DurableFile
from betterbench.jobs.outputs import mark_of
from betterbench.records import Record, RunFolder
from betterbench.sim.scenes.limited import LimitedView, LimitedViews

OPEN, CLOSED = (40, 122, 200), (226, 88, 20)
"""RGB colors of those parts of the path where the gripper was commanded to open and to close."""

_PAPER, _INK, _SOFT, _HALO = (253, 252, 250), (28, 30, 33), (92, 96, 102), (255, 255, 255)
_CONTROLS = 0.14
"""Height of the space below the images, as a fraction of the image size.

Video players show their controls in this space while the video is paused.
"""

_HOLD_S = 1.0
"""Duration of the first image (with the complete path) and of the last image in the video [s]."""


@dataclass(frozen=True, slots=True)
class Panel:
    """One of the two trials in a video, with its heading and its outcome.

    Attributes:
        heading: Title above the trial ("this trial, fast_food/T1/3").
        ended: Outcome of the trial ("Semantic feature collapse").
        right: Whether the outcome is a success. A success is shown in blue, a failure in orange.
    """

    task: str
    condition: str
    seed: int
    heading: str
    ended: str
    right: bool = False

    @property
    def trial(self) -> tuple[str, str, int]:
        """Task, condition and seed of the trial."""
        return self.task, self.condition, self.seed


@dataclass(frozen=True, slots=True)
class FilmLook:
    """Camera, size, speed and rendering quality of a video.

    Attributes:
        size: Side length of each image [px]. It must be even.
        rate_hz: Frames per second of the video.
        longest_s: Maximum duration of the motion in the video [s]. Longer trials are sped up to this duration. If None,
            every trial is shown in real time.
    """

    camera: str = "front"
    size: int = 240
    rate_hz: int = 6
    longest_s: float | None = 8.0
    quality: str = "fast"

    def __post_init__(self) -> None:
        if self.size % 2 or self.size < 64:
            raise InvalidInputError(
                "--size", f"{self.size} pixels are odd or too few", "Use an even number of at least 64 pixels"
            )


@dataclass(frozen=True, slots=True)
class TwinFilm:
    """Video (H.264 in MP4) of a trial and its training twin, with a cover image (JPEG).

    The cover image shows the initial states of both trials with their complete gripper paths.
    """

    clip: bytes
    still: bytes


def render_paths(
    run: RunFolder,
    trials: Sequence[tuple[str, str, int]],
    *,
    look: FilmLook = FilmLook(),
    views: LimitedViews | None = None,
    on_progress: OnCount | None = None,
) -> dict[tuple[str, str, int], bytes]:
    """Render one JPEG per trial (task, condition, seed): its initial state with the path of the end effector.

    ``views`` provides the rendering processes. By default, a new process is started.

    Raises:
        RecordError: If a record or a scene is missing or unreadable.
        MissingDependencyError: If off-screen OpenGL does not work on this machine.
    """
    images: dict[tuple[str, str, int], bytes] = {}
    with _views(look, 1 if trials else 0, views) as sides:
        for trial in dict.fromkeys(trials):
            images[trial] = _jpeg(_Side(sides[0], run, trial, look).start)
            if on_progress is not None:
                on_progress(len(images), len(trials))
    return images


def render_strips(
    run: RunFolder,
    trials: Sequence[tuple[str, str, int]],
    *,
    frames: int = 6,
    look: FilmLook = FilmLook(size=160),
    on_progress: OnCount | None = None,
) -> dict[tuple[str, str, int], bytes]:
    """Render one strip of images per trial as a JPEG. The first image shows the initial state with the complete path.

    Each of the other images shows a later state with the path up to that time. Raises the same errors as
    :func:`render_paths`.
    """
    images: dict[tuple[str, str, int], bytes] = {}
    with _views(look, 1 if trials else 0) as views:
        for trial in dict.fromkeys(trials):
            side = _Side(views[0], run, trial, look)
            times = np.linspace(0.0, side.duration_s, frames)[1:]
            strip = Image.new("RGB", (frames * look.size, look.size), _PAPER)
            for i, image in enumerate([side.start, *(side.at(time_s) for time_s in times)]):
                strip.paste(image, (i * look.size, 0))
            images[trial] = _jpeg(strip)
            if on_progress is not None:
                on_progress(len(images), len(trials))
    return images


def render_twin_films(
    run: RunFolder,
    films: Sequence[Sequence[Panel]],
    *,
    look: FilmLook = FilmLook(),
    views: LimitedViews | None = None,
    on_progress: OnCount | None = None,
) -> list[TwinFilm]:
    """Return one video per entry of ``films``, showing either one trial or a trial next to its training twin.

    ``views`` provides the rendering processes, as in :func:`render_paths`. Raises the same errors as
    :func:`render_paths`.
    """
    made: list[TwinFilm] = []
    with _views(look, max(map(len, films), default=0), views) as sides:
        for panels in films:
            target = io.BytesIO()
            still = _film(sides, run, panels, target, look=look)
            made.append(TwinFilm(target.getvalue(), _jpeg(still)))
            if on_progress is not None:
                on_progress(len(made), len(films))
    return made


def write_twin_film(
    run: RunFolder,
    panels: Sequence[Panel],
    path: Path,
    *,
    look: FilmLook,
    on_progress: OnCount | None = None,
) -> Path:
    """Write a video of a trial and its training twin to a file. See :func:`render_twin_films`.

    ``on_progress`` is called with the number of finished frames and the number of all frames.
    """
    with DurableFile(path) as durable, _views(look, len(panels)) as views:
        _film(views, run, panels, durable.file, look=look, on_progress=on_progress)
        durable.finish()
    return path


@contextmanager
def _views(look: FilmLook, count: int, given: LimitedViews | None = None) -> Iterator[list[LimitedView]]:
    """Context manager that provides ``count`` rendering processes, one for each trial in a video.

    When it exits, it ends the processes that it has started. Processes passed in by the caller keep running.
    """
    with ExitStack() as stack:
        views = given or stack.enter_context(LimitedViews())
        yield views.take(count, quality=look.quality, size=look.size)


def _film(
    views: Sequence[LimitedView],
    run: RunFolder,
    panels: Sequence[Panel],
    target: BinaryIO,
    *,
    look: FilmLook,
    on_progress: OnCount | None = None,
) -> Image.Image:
    """Write a video to ``target``. Return the first image of the video."""
    sides = [_Side(view, run, panel.trial, look) for view, panel in zip(views, panels, strict=False)]
    layout = _Layout([(p, s.record.metadata.instruction) for p, s in zip(panels, sides, strict=True)], look.size)
    lasting_s = max(side.duration_s for side in sides)
    speed = max(1.0, lasting_s / look.longest_s) if look.longest_s else 1.0
    times = np.append(np.arange(0.0, lasting_s, speed / look.rate_hz), lasting_s)
    hold = round(_HOLD_S * look.rate_hz)
    still = layout.sheet([side.start for side in sides], "initial state, complete path")
    with av.open(target, "w", format="mp4") as container:
        container.metadata["comment"] = mark_of("replay")
        stream = container.add_stream("libx264", rate=look.rate_hz, options={"crf": "27", "preset": "veryfast"})
        stream.width, stream.height = still.size
        stream.pix_fmt = "yuv420p"
        for number, sheet in enumerate(_sheets(still, sides, layout, times, hold), 1):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.asarray(sheet), format="rgb24")))
            if on_progress is not None:
                on_progress(number, len(times) + 2 * hold)
        container.mux(stream.encode(None))
    return still


def _sheets(
    still: Image.Image, sides: Sequence[_Side], layout: _Layout, times: np.ndarray, hold: int
) -> Iterator[Image.Image]:
    yield from [still] * hold
    sheet = still
    for time_s in times:
        sheet = layout.sheet([side.at(time_s) for side in sides], f"{time_s:.1f} s")
        yield sheet
    yield from [sheet] * hold


class _Side:
    """Images of one recorded trial, with the path of the end effector drawn on them."""

    def __init__(self, view: LimitedView, run: RunFolder, trial: tuple[str, str, int], look: FilmLook) -> None:
        self.record: Record = run.read_record(*trial)
        self._view, self._look, self._jitter = view, look, self.record.metadata.view_jitter
        view.open_of(run, self.record)
        self._last: tuple[int, Image.Image] | None = None
        first = self._draw(0)
        self._pixels = self._view.project(self.record.ee_position, look.camera)
        self.start = self._with_path(first, len(self.record))

    @property
    def duration_s(self) -> float:
        """Duration of the trial [s]."""
        return (len(self.record) - 1) / self.record.metadata.control_rate_hz

    def at(self, time_s: float) -> Image.Image:
        """Return the image at a given time [s], with the path up to that time.

        For times after the end of the trial, the image shows the last state.
        """
        row = min(round(time_s * self.record.metadata.control_rate_hz), len(self.record) - 1)
        if self._last is None or self._last[0] != row:
            self._last = row, self._with_path(self._draw(row), row + 1)
        return self._last[1]

    def _draw(self, row: int) -> Image.Image:
        return Image.fromarray(self._view.draw(self.record.qpos[row], self._look.camera, jitter=self._jitter))

    def _with_path(self, image: Image.Image, rows: int) -> Image.Image:
        """Draw the path of the end effector in the first ``rows`` rows of the record on an image.

        The path is blue where the gripper was commanded to open, and orange where it was commanded to close.
        """
        drawn, scale = image.copy(), 2
        large = drawn.resize((scale * drawn.width, scale * drawn.height), Image.Resampling.BICUBIC)
        pen, thick = ImageDraw.Draw(large), max(2, round(drawn.width / 90)) * scale // 2
        pixels = scale * self._pixels[:rows]
        closed = self.record.gripper_command[:rows] > 0.0
        pieces = [
            (i, tuple(map(tuple, pixels[i : i + 2]))) for i in range(rows - 1) if np.isfinite(pixels[i : i + 2]).all()
        ]
        for _, line in pieces:
            pen.line(line, fill=_HALO, width=thick + scale + 1)
        for i, line in pieces:
            pen.line(line, fill=CLOSED if closed[i + 1] else OPEN, width=thick)
        for row, round_mark in ((0, True), (rows - 1, False)):
            if np.isfinite(pixels[row]).all():
                x, y = pixels[row]
                box = (x - 1.6 * thick, y - 1.6 * thick, x + 1.6 * thick, y + 1.6 * thick)
                color = CLOSED if closed[row] else OPEN
                (pen.ellipse if round_mark else pen.rectangle)(box, fill=_HALO if round_mark else color, outline=color)
        return large.resize(drawn.size, Image.Resampling.LANCZOS)


class _Layout:
    """Layout of a video frame: images side by side, each with its heading, instruction and outcome, and the time."""

    def __init__(self, panels: Sequence[tuple[Panel, str]], size: int) -> None:
        self._size, self._pad = size, max(8, size // 30)
        self._panels = panels
        self._font, self._small = ImageFont.load_default(max(11, size / 22)), ImageFont.load_default(max(10, size / 26))
        self._row = round(1.3 * max(11, size / 22))
        self._texts = [wrap_text(said, self._font, size) for _, said in panels]
        self._ends = self._pad + self._row * (1 + max(map(len, self._texts)))
        self._top = self._ends + self._row + self._pad // 2
        height = self._top + size + round(_CONTROLS * size)
        width = self._pad + (size + self._pad) * len(panels)
        self._extent = width + width % 2, height + height % 2

    def sheet(self, images: Sequence[Image.Image], clock: str) -> Image.Image:
        """Compose one frame of the video."""
        sheet = Image.new("RGB", self._extent, _PAPER)
        pen = ImageDraw.Draw(sheet)
        for i, ((panel, _), lines, image) in enumerate(zip(self._panels, self._texts, images, strict=True)):
            x = self._pad + i * (self._size + self._pad)
            pen.text((x, self._pad), panel.heading, fill=_SOFT, font=self._small)
            for j, line in enumerate(lines, 1):
                pen.text((x, self._pad + j * self._row), line, fill=_INK, font=self._font)
            sheet.paste(image, (x, self._top))
            pen.text((x, self._ends), panel.ended, fill=OPEN if panel.right else CLOSED, font=self._font)
            wide = self._small.getlength(clock)
            pen.rectangle((x, self._top, x + wide + self._pad, self._top + self._row), fill=_PAPER)
            pen.text((x + self._pad // 2, self._top + 1), clock, fill=_INK, font=self._small)
        return sheet


def _jpeg(image: Image.Image) -> bytes:
    buffer = io.BytesIO()
    image.save(buffer, "JPEG", quality=80, optimize=True)
    return buffer.getvalue()
