"""Measure ``better vlm`` on many items with a server that answers immediately."""

from __future__ import annotations

import base64
import io
import json
import multiprocessing
import os
import resource
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from http.client import HTTPConnection
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
from PIL import Image

from betterbench.vlm import RunSettings, evaluate_model, find_benchmark
from betterbench.vlm.prompts import find_prompt
from betterbench.vqa.llm import ChatModel, ReplyCache, endpoint_at, user_message
from figures import Figure
from instant_chat import instant_chat_server

ITEMS, FEW = 10_000, 1_000
AT_ONCE = 4
"""Simultaneous requests, the default of ``better vlm``."""
_DISTINCT = 50
"""Number of different photographs; each item has one of them."""


def static_row(*, quick: bool) -> Iterator[Figure]:
    """Measure a run on data in the form of EmbSpatial-Bench (JSON with embedded JPEG files of 640 x 480 pixels).

    Each run is a separate process that reads the data, sends the requests, stores the answers and the cache, and
    computes the scores. The server is another process that reads each request and answers with a letter and token
    counts.
    """
    many, few = (ITEMS // 10, FEW // 10) if quick else (ITEMS, FEW)
    with tempfile.TemporaryDirectory() as scratch, instant_chat_server() as port:
        place = Path(scratch)
        photos = _photos()
        for count in (few, many):
            _write_data(place / str(count), count, photos)
        small, large = (_measured(place / str(count), port) for count in (few, many))
        bare_s = _bare_client_s(photos, port, few) / few
    cpu_s = large.cpu_s / many
    rate = many / large.wall_s
    note = f"{many:,} items, {large.wall_s:.1f} s by the clock, {AT_ONCE} requests at once, {os.cpu_count()} cores"
    yield Figure("static", "items per second, server included", (rate,), "1/s", ">=", 200.0, note)
    yield Figure("static", "processor time of 1,000 items", (1e3 * cpu_s,), "s", "<=", 10.0)
    text = "processor time of an item / a bare HTTP request with the same body"
    yield Figure("static", text, (cpu_s / bare_s,), "x", note=f"{1e3 * cpu_s:.2f} / {1e3 * bare_s:.2f} ms")
    growth = (large.memory_mb - small.memory_mb) / (many - few) * 1e3
    note = f"{large.memory_mb:.0f} MB with {many:,} items, {small.memory_mb:.0f} MB with {few:,}"
    yield Figure("static", "memory for each further 1,000 items", (growth,), "MB", "<=", 20.0, note)


@dataclass(frozen=True, slots=True)
class _Measured:
    """Time by the clock [s], processor time [s] and peak memory of a run [MB]."""

    wall_s: float
    cpu_s: float
    memory_mb: float


def _measured(folder: Path, port: int) -> _Measured:
    ours, theirs = multiprocessing.Pipe()
    process = multiprocessing.get_context("spawn").Process(target=_run, args=(folder, port, theirs))
    process.start()
    found = ours.recv()
    process.join()
    return _Measured(*found)


def _run(folder: Path, port: int, answer: Connection) -> None:
    benchmark = find_benchmark("embspatial")
    began, worked = time.perf_counter(), time.process_time()
    items = benchmark.load(folder)
    endpoint = endpoint_at(f"http://127.0.0.1:{port}/v1#instant", cache=ReplyCache(folder / "cache"))
    settings = RunSettings(find_prompt("embspatial", None), at_once=AT_ONCE)
    run = evaluate_model(benchmark, items, ChatModel(endpoint), folder / "run", settings)
    if run.score.all.answered != len(items.items) or run.requests.cached:
        raise ValueError(f"{run.score.all.answered} of {len(items.items)} items were answered")
    memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    answer.send((time.perf_counter() - began, time.process_time() - worked, memory_mb))


def _photos() -> list[bytes]:
    """Return JPEG files of smooth noise with the size of a photograph (about 65 kB)."""
    draw, files = np.random.default_rng(0), []
    for _ in range(_DISTINCT):
        image = Image.fromarray(draw.integers(0, 256, (30, 40, 3), dtype=np.uint8)).resize((640, 480))
        file = io.BytesIO()
        image.save(file, "JPEG", quality=90)
        files.append(file.getvalue())
    return files


def _write_data(folder: Path, count: int, photos: Sequence[bytes]) -> None:
    texts = [base64.b64encode(photo).decode() for photo in photos]
    folder.mkdir()
    with (folder / "embspatial_bench.json").open("w", encoding="utf-8") as file:
        for i in range(count):
            row = {
                "data_source": "mp3d",
                "scene_id": f"scene {i // 3}",
                "question_id": f"q{i}",
                "question": f"Which of these objects is nearest to the camera in image {i}?",
                "relation": ("left", "right", "above", "under", "close", "far")[i % 6],
                "answer_options": ["mug", "lamp", "chair", "sofa"],
                "answer": i % 4,
                "image": texts[i % len(texts)],
            }
            file.write(("," if i else "[") + json.dumps(row))
        file.write("]")


def _bare_client_s(photos: Sequence[bytes], port: int, count: int) -> float:
    """Return the processor time of sending requests with the same images over one connection [s]."""
    connection = HTTPConnection("127.0.0.1", port)
    began = time.process_time()
    for i in range(count):
        messages = [
            user_message(f"Which of these objects is nearest to the camera in image {i}?", photos[i % _DISTINCT])
        ]
        body = json.dumps({"model": "instant", "messages": messages, "temperature": 0, "max_tokens": 256}).encode()
        connection.request("POST", "/v1/chat/completions", body, {"Content-Type": "application/json"})
        json.loads(connection.getresponse().read())
    spent = time.process_time() - began
    connection.close()
    return spent
