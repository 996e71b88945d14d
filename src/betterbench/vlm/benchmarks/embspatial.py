"""EmbSpatial-Bench (ACL 2024): spatial relations between objects as seen by the camera, with four options."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import partial
from pathlib import Path

from betterbench.json_form import file_digest
from betterbench.vlm.benchmarks.benchmark import Benchmark, DataFile, DataSource, Headline, missing
from betterbench.vlm.items import Gold, Item, ItemSet
from betterbench.vlm.pictures import embedded, file_in, picture_file
from betterbench.vlm.rows import Row, distinct, find_files, read_rows
from betterbench.vqa.question import Form

_LAYOUT = (
    "embspatial_bench.json with base64 images (the hub's file)",
    "Parquet files with a column image or image_base64 (mirrors)",
    "a JSON file whose image column contains paths of image files next to it",
)
_KINDS = {
    "left": "direction", "right": "direction", "above": "direction", "under": "direction", "below": "direction",
    "close": "distance", "far": "distance",
}  # fmt: skip


def _read(folder: Path) -> ItemSet:
    files = find_files(folder, (".parquet",)) or [
        f for f in find_files(folder, (".json", ".jsonl")) if "sft" not in f.name.lower()
    ]
    if not files:
        raise missing("embspatial", folder, _LAYOUT)
    items: list[Item] = []
    pictures: dict[str, Callable[[], bytes]] = {}
    taken = set[str]()
    for file in files:
        for row in read_rows(file, large=("image", "image_base64")):
            item = _item(row, distinct(row.text("question_id", "id"), taken))
            items.append(item)
            pictures[item.pictures[0]] = partial(_picture, row)
    return ItemSet("embspatial", tuple(items), lambda name: pictures[name](), {f.name: file_digest(f) for f in files})


def _item(row: Row, identifier: str) -> Item:
    options = row.texts("answer_options", "options")
    relation = row.text("relation").strip().lower()
    source = row.text_or("unknown", "data_source", "source")
    scene = row.text_or("", "scene_id") or hashlib.sha256(_picture(row)).hexdigest()
    return Item(
        id=identifier,
        form=Form.CHOICE,
        question=row.text("question"),
        gold=Gold(row.letter(len(options), "answer", "answer_index")),
        pictures=(identifier,),
        cluster=f"{source}/{scene}",
        options=options,
        groups={"source": source, "relation": relation, "kind": _KINDS.get(relation, relation)},
    )


def _picture(row: Row) -> bytes:
    name = row.named("image", "image_base64", "image_path")
    value = row.large(name)
    where = row.where(name)
    if isinstance(value, str) and len(value) < 1000 and value.lower().endswith((".png", ".jpg", ".jpeg", ".webp")):
        return picture_file(file_in(row.file.parent, value, where=where))
    return embedded(value, where)


EMBSPATIAL = Benchmark(
    name="embspatial",
    title="EmbSpatial-Bench",
    read=_read,
    source=DataSource(
        repository="Phineas476/EmbSpatial-Bench",
        files=(DataFile("embspatial_bench.json", 254.0),),
        license="CC-BY-4.0",
        terms="The images come from Matterport3D, ScanNet and AI2-THOR, which have their own terms.",
        layout=_LAYOUT,
    ),
    headline=Headline(),
    groups=("source", "relation", "kind"),
    published=3640,
)
"""3,640 questions about six spatial relations, with images from three sources."""
