"""Synthetic data in every published form of the benchmarks, and a chat endpoint that answers by script."""

from __future__ import annotations

import base64
import io
import json
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import av
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from PIL import Image

WIDTH, HEIGHT = 64, 48
RELATIONS = ("left", "right", "above", "under", "close", "far")
DOMAINS = ("Daily life", "Hobbies", "Recreation", "Work")


def picture(number, size=(WIDTH, HEIGHT)):
    """Returns a PNG of one color."""
    buffer = io.BytesIO()
    Image.new("RGB", size, (number * 37 % 256, number * 11 % 256, 90)).save(buffer, "PNG")
    return buffer.getvalue()


def large_picture():
    """Returns a PNG of 81 million pixels, black and white because colors would take seconds to compress."""
    buffer = io.BytesIO()
    Image.new("1", (9000, 9000)).save(buffer, "PNG")
    return buffer.getvalue()


def noise(size=(WIDTH, HEIGHT)):
    """Returns a PNG of random colors, which does not compress."""
    buffer = io.BytesIO()
    pixels = np.random.default_rng(0).integers(0, 256, (size[1], size[0], 3), dtype=np.uint8)
    Image.fromarray(pixels).save(buffer, "PNG")
    return buffer.getvalue()


def mask(left, top, right, bottom):
    """Returns a PNG with a white rectangle."""
    pixels = np.zeros((HEIGHT, WIDTH), dtype=np.uint8)
    pixels[top:bottom, left:right] = 255
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "PNG")
    return buffer.getvalue()


def table(path, rows):
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(pa.Table.from_pylist(rows), path, row_group_size=3)


# ------------------------------------------------------------------------------------------------------- EmbSpatial
def embspatial_rows(count=8):
    return [
        {
            "data_source": ("mp3d", "ai2thor", "scannet")[i % 3],
            "scene_id": f"scene{i // 2}",
            "question_id": f"q{i}",
            "question": "Which object is nearest to the camera?",
            "relation": RELATIONS[i % 6],
            "answer_options": ["mug", "lamp", "chair", "sofa"],
            "answer": i % 4,
            "objects": [{"name": "mug", "bbox": [1, 2, 3, 4]}],
        }
        for i in range(count)
    ]


def embspatial_json(folder):
    rows = [row | {"image": base64.b64encode(picture(i)).decode()} for i, row in enumerate(embspatial_rows())]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "embspatial_bench.json").write_text(json.dumps(rows))
    (folder / "embspatial_sft.json").write_text("[]")
    return folder


def embspatial_parquet(folder):
    rows = [
        row | {"image": {"bytes": picture(i), "path": f"{i}.png"}, "objects": None}
        for i, row in enumerate(embspatial_rows())
    ]
    table(folder / "data" / "test-00000-of-00001.parquet", rows)
    return folder


def embspatial_mirror(folder):
    rows = [
        {k: v for k, v in row.items() if k != "objects"}
        | {"image_base64": base64.b64encode(picture(i)).decode(), "answer": "ABCD"[row["answer"]]}
        for i, row in enumerate(embspatial_rows())
    ]
    table(folder / "test.parquet", rows)
    return folder


def embspatial_folder(folder):
    (folder / "images").mkdir(parents=True)
    rows = []
    for i, row in enumerate(embspatial_rows()):
        (folder / "images" / f"{i}.png").write_bytes(picture(i))
        rows.append(row | {"image": f"images/{i}.png"})
    (folder / "questions.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    return folder


# ------------------------------------------------------------------------------------------------------- RefSpatial
def refspatial_rows(split, count=3):
    return [
        {
            "id": i,
            "object": f"the {split.lower()} mug number {i}",
            "prompt": f"Please point out the {split.lower()} mug number {i}.",
            "suffix": "Your answer should be formatted as a list of tuples, i.e. [(x1, y1)].",
            "step": 1 + i % 3,
        }
        for i in range(count)
    ]


def refspatial_parquet(folder):
    for split in ("location", "placement", "unseen"):
        rows = [
            row | {"image": {"bytes": picture(i)}, "mask": {"bytes": mask(32, 12, 48, 24)}}
            for i, row in enumerate(refspatial_rows(split))
        ]
        table(folder / "data" / f"{split}-00000-of-00001.parquet", rows)
    return folder


def refspatial_raw(folder):
    for split in ("Location", "Placement", "Unseen"):
        for name in ("image", "mask"):
            (folder / split / name).mkdir(parents=True)
        rows = []
        for i, row in enumerate(refspatial_rows(split)):
            (folder / split / "image" / f"{i}.png").write_bytes(picture(i))
            (folder / split / "mask" / f"{i}.png").write_bytes(mask(32, 12, 48, 24))
            rows.append(row | {"rgb_path": f"image/{i}.png", "mask_path": f"mask/{i}.png", "category": split.lower()})
        (folder / split / "question.json").write_text(json.dumps(rows))
    return folder


# --------------------------------------------------------------------------------------------------------- EgoPlan2
def egoplan2_rows(count=8):
    return [
        {
            "sample_id": f"0a1b-2c3d-{i // 2}_{i}",
            "domain": DOMAINS[i % 4],
            "scenario": "cooking",
            "task_goal": f"make tea number {i}",
            "choice_a": "fill the kettle",
            "choice_b": "open the drawer",
            "choice_c": "wash the cup",
            "choice_d": "close the door",
            "golden_choice_idx": "ABCD"[i % 4],
            "answer": "fill the kettle",
            "task_start_frame": 0,
            "current_observation_frame": 14,
            "task_progress_metadata": [],
        }
        for i in range(count)
    ]


def egoplan2_frames(folder):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "EgoPlan-Bench2.json").write_text(json.dumps(egoplan2_rows()))
    for row in egoplan2_rows():
        frames = folder / "keyframes" / row["sample_id"]
        frames.mkdir(parents=True)
        for i in range(8):
            (frames / f"frame-{i}_frameID-{100 - 2 * i}.png").write_bytes(picture(i))
    return folder


def egoplan2_parquet(folder):
    rows = [
        {k: v for k, v in row.items() if k not in ("golden_choice_idx", "scenario", "task_progress_metadata")}
        | {
            "ground_truth": row["golden_choice_idx"],
            "formatted_question": "unused",
            "keyframes": [{"bytes": picture(i), "path": None} for i in range(8)],
        }
        for row in egoplan2_rows()
    ]
    table(folder / "data" / "test-00000-of-00001.parquet", rows)
    return folder


def egoplan2_video(folder):
    (folder / "videos").mkdir(parents=True)
    (folder / "EgoPlan-Bench2.json").write_text(json.dumps(egoplan2_rows()))
    for name in {row["sample_id"].split("_")[0] for row in egoplan2_rows()}:
        with av.open(str(folder / "videos" / f"{name}.mp4"), "w") as container:
            stream = container.add_stream("mpeg4", rate=10)
            stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
            for i in range(16):
                pixels = np.full((HEIGHT, WIDTH, 3), 10 * i, dtype=np.uint8)
                container.mux(stream.encode(av.VideoFrame.from_ndarray(pixels, format="rgb24")))
            container.mux(stream.encode())
    return folder


FORMS = {
    "embspatial": (embspatial_json, embspatial_parquet, embspatial_mirror, embspatial_folder),
    "refspatial": (refspatial_parquet, refspatial_raw),
    "egoplan2": (egoplan2_frames, egoplan2_parquet, egoplan2_video),
}


class Server:
    """A chat endpoint whose answer is a function of the request's JSON; it counts what it was asked."""

    def __init__(self, answer):
        self.asked = []
        outer = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self):
                body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
                outer.asked.append(body)
                reply = json.dumps({"choices": [{"message": {"content": answer(body)}}]}).encode()
                self.send_response(200)
                self.send_header("Content-Length", str(len(reply)))
                self.end_headers()
                self.wfile.write(reply)

            def log_message(self, *_):
                pass

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.server.server_port}/v1"
        threading.Thread(target=self.server.serve_forever, args=(0.05,), daemon=True).start()

    def close(self):
        self.server.shutdown()
        self.server.server_close()


def texts_of(body):
    """Returns the texts of a request, joined."""
    return "\n".join(part["text"] for part in body["messages"][0]["content"] if part["type"] == "text")


def pictures_of(body):
    """Returns the pictures of a request."""
    parts = [part["image_url"]["url"] for part in body["messages"][0]["content"] if part["type"] == "image_url"]
    return [base64.b64decode(url.partition(",")[2]) for url in parts]
