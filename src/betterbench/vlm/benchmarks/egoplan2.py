"""EgoPlan-Bench2: choose the next action in an egocentric video, given eight key frames and four options."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.json_form import file_digest
from betterbench.vlm.benchmarks.benchmark import Benchmark, DataFile, DataSource, Headline, missing
from betterbench.vlm.items import Gold, Item, ItemSet
from betterbench.vlm.pictures import embedded, picture_file
from betterbench.vlm.rows import Row, distinct, find_files, read_rows
from betterbench.vlm.videos import frames_of
from betterbench.vqa.question import Form

FRAMES = 8
"""Number of key frames. They are evenly spaced from the start of the task to the current observation."""
_LAYOUT = (
    "Parquet files with a column keyframes (mirrors)",
    "EgoPlan-Bench2.json with keyframes/SAMPLE_ID/frame-0_frameID-*.png to frame-7_frameID-*.png",
    "EgoPlan-Bench2.json with videos/VIDEO.mp4 (Ego4D v1_288p)",
)
_FOLDERS = ("keyframes", "keyframes_dir", "frames")
_VIDEOS = ("videos", "v1_288p", "")
_QUESTION = (
    "Considering the progress shown in the video and my current observation in the last frame, what action should I "
    "take next in order to {goal}?"
)


def _read(folder: Path) -> ItemSet:
    files = find_files(folder, (".parquet",)) or find_files(folder, (".json", ".jsonl"))
    if not files:
        raise missing("egoplan2", folder, _LAYOUT)
    items: list[Item] = []
    pictures: dict[str, Callable[[], bytes]] = {}
    taken = set[str]()
    for file in files:
        for row in read_rows(file, large=("keyframes",)):
            found = _pictures_of(row)
            item = _item(row, distinct(row.text("sample_id"), taken), len(found))
            items.append(item)
            pictures.update(zip(item.pictures, found, strict=True))
    return ItemSet("egoplan2", tuple(items), lambda name: pictures[name](), {f.name: file_digest(f) for f in files})


def _item(row: Row, identifier: str, count: int) -> Item:
    goal = row.text("task_goal")
    options = tuple(row.text(f"choice_{letter}") for letter in "abcd")
    return Item(
        id=identifier,
        form=Form.CHOICE,
        question=_QUESTION.format(goal=goal),
        gold=Gold(row.letter(4, "golden_choice_idx", "ground_truth")),
        pictures=tuple(f"{identifier}/{i}" for i in range(count)),
        # The identifier begins with the name of the video, as the upstream program assumes, too.
        cluster=identifier.split("_", maxsplit=1)[0],
        options=options,
        groups={"domain": row.text("domain"), "scenario": row.text_or("unknown", "scenario")},
        words={"goal": goal},
    )


def _pictures_of(row: Row) -> list[Callable[[], bytes]]:
    """Return a list of functions. Each function reads the image of one key frame.

    The images come from the row, from a folder of frames, or from the video.
    """
    if "keyframes" in row.columns:
        return [partial(_embedded, row, i) for i in range(_count(row))]
    identifier, folder = row.text("sample_id"), row.file.parent
    if not identifier.replace("-", "").replace("_", "").isalnum():
        raise row.error("sample_id", f"{identifier!r} is not a video name followed by a number")
    for name in _FOLDERS:
        frames = folder / name / identifier
        if frames.is_dir():
            return [partial(picture_file, path) for path in _in_folder(frames, row)]
    first, last = row.integer("task_start_frame"), row.integer("current_observation_frame")
    for name in _VIDEOS:
        video = folder / name / f"{identifier.split('_')[0]}.mp4"
        if video.is_file():
            numbers = tuple(map(int, np.linspace(first, last, FRAMES, endpoint=True, dtype=int)))
            return [partial(_of_video, video, numbers, i) for i in range(FRAMES)]
    problem = f"{identifier} has no images"
    cure = f"Put its images into {folder / 'keyframes' / identifier}, or its video into {folder / 'videos'}"
    raise InvalidInputError(row.where("sample_id"), problem, cure)


def _count(row: Row) -> int:
    cells = row.large("keyframes")
    if not isinstance(cells, list) or not cells:
        raise row.error("keyframes", "expected a list of images")
    return len(cells)


def _embedded(row: Row, number: int) -> bytes:
    return embedded(row.large("keyframes")[number], f"{row.where('keyframes')}, frame {number}")


def _in_folder(folder: Path, row: Row) -> list[Path]:
    """Return the image files of the frames in a folder, in order.

    Files with the names that the benchmark's authors use (frame-0_frameID-*.png) are sorted by frame number. Other
    files are sorted by name.
    """
    files = sorted(f for f in folder.iterdir() if f.suffix.lower() in (".png", ".jpg", ".jpeg"))
    numbered = {_number(f.name): f for f in files}
    ordered = files if None in numbered else [numbered[n] for n in sorted(n for n in numbered if n is not None)]
    if not ordered:
        raise row.error("sample_id", f"{folder} has no images", f"Put {FRAMES} PNG or JPEG files into it")
    return ordered


def _number(name: str) -> int | None:
    digits = name.removeprefix("frame-").partition("_")[0].partition(".")[0]
    return int(digits) if name.startswith("frame-") and digits.isdigit() else None


def _of_video(video: Path, numbers: tuple[int, ...], number: int) -> bytes:
    return frames_of(video, numbers)[number]


EGOPLAN2 = Benchmark(
    name="egoplan2",
    title="EgoPlan-Bench2",
    read=_read,
    source=DataSource(
        repository="qiulu66/EgoPlan-Bench2",
        files=(DataFile("EgoPlan-Bench2.json", 1.95),),
        license="none stated",
        terms=(
            "The videos are Ego4D v1_288p. Ego4D has its own license agreement, which each user signs at "
            "ego4d-data.org. Videos and frames must not be passed on, so they are not downloaded here."
        ),
        layout=_LAYOUT,
    ),
    headline=Headline(),
    groups=("domain", "scenario"),
    published=1321,
    published_groups=("domain", {"daily": 439, "hobbies": 295, "recreation": 183, "work": 404}),
    columns="domain",
)
"""1,321 questions in four domains. The number that the paper calls "All" is the micro mean."""
