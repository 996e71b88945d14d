"""Measure materializing of all modalities of two views against MuJoCo's own rendering of the same passes."""

from __future__ import annotations

import itertools
import os
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from betterbench.jobs.ahead import ahead
from betterbench.records.modalities.columns import MAX_CHUNK_ROWS
from betterbench.records.modalities.spec import MODALITIES, ViewSpec
from betterbench.sim.modalities.trial_files import TrialFiles
from betterbench.sim.scenes.cameras import ViewPlacement
from betterbench.sim.scenes.limited import LimitedView
from betterbench.sim.scenes.stage import Quality
from pacing import RawViews, Rehearsal, rehearse

VIEWS = (ViewSpec("front"), ViewSpec("wrist"))


class RawPasses(RawViews):
    """The render passes for colors, depth and segmentation of the same views, drawn by MuJoCo's own functions."""

    def __init__(self, rehearsal: Rehearsal, quality: Quality) -> None:
        super().__init__(rehearsal.scene.model, quality, [view.camera for view in VIEWS])
        self._rehearsal, self._data = rehearsal, mujoco.MjData(rehearsal.scene.model)
        self._placement = ViewPlacement(rehearsal.scene.model, rehearsal.record.metadata.view_jitter)
        self._colors = self._scene.flags.copy()
        self._ids = self._colors.copy()
        self._ids[:] = 0
        flag = mujoco.mjtRndFlag
        self._ids[[int(flag.mjRND_CULL_FACE), int(flag.mjRND_SEGMENT), int(flag.mjRND_IDCOLOR)]] = 1
        side = self.pixels[0].shape[0]
        self.segments = np.empty((side, side, 3), np.uint8)
        self.depth = np.empty((side, side), np.float32)

    def draw_rows(self, first: int, last: int) -> float:
        """Draw rows ``first`` to ``last - 1`` of the record, with two passes per view, and return the seconds."""
        model, data, qpos = self._model, self._data, self._rehearsal.record.qpos
        every = int(mujoco.mjtCatBit.mjCAT_ALL)
        began = time.perf_counter()
        for row in range(first, last):
            data.qpos[:] = qpos[row]
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            self._placement.apply(data)
            mujoco.mjr_setBuffer(int(mujoco.mjtFramebuffer.mjFB_OFFSCREEN), self._context)
            for camera, pixels in zip(self._cameras, self.pixels, strict=True):
                mujoco.mjv_updateScene(model, data, self._option, None, camera, every, self._scene)
                self._scene.flags[:] = self._colors
                mujoco.mjr_render(self._view, self._scene, self._context)
                mujoco.mjr_readPixels(pixels, None, self._view, self._context)
                self._scene.flags[:] = self._ids
                mujoco.mjr_render(self._view, self._scene, self._context)
                mujoco.mjr_readPixels(self.segments, self.depth, self._view, self._context)
        return time.perf_counter() - began


@dataclass(frozen=True, slots=True)
class Block:
    """The time that a block took, as wall time and as processor time [s].

    Attributes:
        raw_s: Wall time of MuJoCo's own passes.
        own_s: Wall time of materializing.
        raw_cpu_s: Processor time of MuJoCo's own passes.
        drawing_cpu_s: Processor time of the limited process, which draws.
        writing_cpu_s: Processor time of this process, which compresses and writes at the same time.
    """

    raw_s: float
    own_s: float
    raw_cpu_s: float
    drawing_cpu_s: float
    writing_cpu_s: float


def _processor_s(process: int) -> float:
    """Return the processor time that another process has used [s], in steps of 10 ms."""
    fields = Path(f"/proc/{process}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def blocks_of(task: str, quality: Quality, *, quick: bool) -> Iterator[Block]:
    """Yield the times of MuJoCo's own passes and of materializing, which alternate block by block.

    A block is a row group. The measured time includes drawing in the limited process, the transfer through the pipe,
    boxes, flow, compression and writing. Starting the process and uploading the model are not included on either side.
    """
    rehearsal = rehearse(task, quality)
    record, scene = rehearsal.record, rehearsal.scene
    raw = RawPasses(rehearsal, quality)
    with tempfile.TemporaryDirectory() as folder, LimitedView(quality=quality.name) as limited:
        limited.open(scene.files())
        facts, _ = limited.prepare(VIEWS, MODALITIES)
        with TrialFiles(Path(folder), VIEWS, MODALITIES, facts=facts, objects=scene.info.objects) as files:
            blocks = range(0, len(record) - MAX_CHUNK_ROWS, MAX_CHUNK_ROWS)
            for first in itertools.islice(blocks, 2 if quick else 8):
                last = first + MAX_CHUNK_ROWS
                cpu = time.process_time()
                theirs = raw.draw_rows(first, last)
                raw_cpu = time.process_time() - cpu
                began, cpu, drawn = time.perf_counter(), time.process_time(), _processor_s(limited.process_id)
                rows = limited.sights(record.qpos[first:last], jitter=record.metadata.view_jitter)
                with ahead(rows, MAX_CHUNK_ROWS) as taken:
                    for row, sights in enumerate(taken, first):
                        files.add(sights, float(record.time[row]))
                own = time.perf_counter() - began
                drawing = _processor_s(limited.process_id) - drawn
                yield Block(theirs, own, raw_cpu, drawing, time.process_time() - cpu)
    raw.close()
