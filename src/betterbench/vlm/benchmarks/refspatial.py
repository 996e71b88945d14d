"""RefSpatial-Bench (RoboRefer, NeurIPS 2025): give points on an object or in a free area that a prompt describes.

The score of an item is the fraction of its points that are in the target region. The headline number of the benchmark
is the mean of the splits Location and Placement. The split Unseen is reported separately.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import partial
from pathlib import Path

from betterbench.errors import InvalidInputError
from betterbench.json_form import file_digest
from betterbench.vlm.benchmarks.benchmark import Benchmark, DataFile, DataSource, Headline, missing
from betterbench.vlm.items import Gold, Item, ItemSet
from betterbench.vlm.pictures import embedded, file_in, mask_of, picture_file, size_of
from betterbench.vlm.rows import Row, distinct, find_files, read_rows
from betterbench.vqa.question import Form

SPLITS = ("location", "placement", "unseen")
_SCORED = ("location", "placement")
_MOST_STRETCH = 0.02
"""Maximum relative difference between the aspect ratios of a mask and of its image."""
_LAYOUT = (
    "Parquet files location-*, placement-* and unseen-* (the hub's data/ folder)",
    "folders Location, Placement and Unseen with question.json, image/ and mask/",
)


def _read(folder: Path) -> ItemSet:
    items: list[Item] = []
    pictures: dict[str, Callable[[], bytes]] = {}
    digests, taken = dict[str, str](), set[str]()
    for split in SPLITS:
        for file in _files(folder, split):
            digests[f"{split}/{file.name}"] = file_digest(file)
            for row in read_rows(file, large=("image", "mask")):
                items.append(_item(row, split, distinct(f"{split}/{row.text('id')}", taken), pictures))
    if not items:
        raise missing("refspatial", folder, _LAYOUT)
    there = {item.groups["split"] for item in items}
    lacking = [split for split in _SCORED if split not in there]
    if lacking:
        problem = f"has no items of the split {' and '.join(lacking)}, but the score is the mean over both"
        raise InvalidInputError(str(folder), problem, f"Add the missing files. Expected {'; or '.join(_LAYOUT)}")
    return ItemSet("refspatial", tuple(items), lambda name: pictures[name](), digests)


def _files(folder: Path, split: str) -> list[Path]:
    tables = find_files(folder, (".parquet",), prefix=split)
    raw = [folder / name / "question.json" for name in (split.capitalize(), split)]
    return tables or [path for path in raw if path.is_file()][:1]


def _item(row: Row, split: str, identifier: str, pictures: dict[str, Callable[[], bytes]]) -> Item:
    image, mask = f"{identifier}/image", f"{identifier}/mask"
    pictures[image] = partial(_picture, row, ("image", "rgb_path"))
    pictures[mask] = partial(_picture, row, ("mask", "mask_path"))
    shown = pictures[image]()
    where = row.where(row.named("image", "rgb_path"))
    width, height = size_of(shown, where)
    _require_region(pictures[mask](), width / height, row.where(row.named("mask", "mask_path")))
    words = {name: row.text_or("", name) for name in ("object", "prompt", "suffix")}
    return Item(
        id=identifier,
        form=Form.POINTS,
        question=row.text("prompt"),
        gold=Gold(mask=mask),
        pictures=(image,),
        cluster=hashlib.sha256(shown).hexdigest()[:16],
        groups={"split": split, "step": row.text_or("unknown", "step")},
        width=width,
        height=height,
        words=words,
    )


def _require_region(mask: bytes, ratio: float, where: str) -> None:
    """Raise InvalidInputError if a mask is empty or does not have the aspect ratio of its image."""
    region = mask_of(mask, where)
    rows, columns = region.shape
    if not region.any():
        raise InvalidInputError(where, "it is empty, so every answer would be wrong", "Download the data again")
    if abs(columns / rows / ratio - 1.0) > _MOST_STRETCH:
        problem = f"has {columns} × {rows} pixels, so its aspect ratio differs from that of its image"
        raise InvalidInputError(where, problem, "Download the data again")


def _picture(row: Row, names: tuple[str, str]) -> bytes:
    name = row.named(*names)
    if name.endswith("_path"):
        return picture_file(file_in(row.file.parent, row.text(name), where=row.where(name)))
    return embedded(row.large(name), row.where(name))


REFSPATIAL = Benchmark(
    name="refspatial",
    title="RefSpatial-Bench",
    read=_read,
    source=DataSource(
        repository="BAAI/RefSpatial-Bench",
        files=tuple(DataFile(f"data/{split}-00000-of-00001.parquet") for split in SPLITS),
        license="see the card of the data set (the evaluation code is Apache-2.0)",
        terms="About 43 MB in total, with 100 location items, 100 placement items and 77 unseen items.",
        layout=_LAYOUT,
    ),
    headline=Headline("macro", "split", _SCORED),
    groups=("split", "step"),
    coordinates="fractions",
    published=277,
    published_groups=("split", {"location": 100, "placement": 100, "unseen": 77}),
    columns="split",
)
"""277 pointing tasks in three splits."""
