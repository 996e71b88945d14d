"""Draw a contact sheet of an episode in an exported data set (LeRobot v3.0), which shows a policy's training data.

Example:
    python tools/export_sheet.py sets/demos --episode 0 --out docs/pictures/export.jpg
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.compute as pc
import pyarrow.parquet as pq
from PIL import Image, ImageDraw, ImageFont

from betterbench.demonstrations.export.video import read_pictures

SIDE, GAP, HEADING, COLUMNS = 160, 6, 34, 6
"""Side of an image, space between images and height of the text [pixel], and number of images per row."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the sheet; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--episode", type=int, default=0)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args(arguments)
    sheet(options.dataset, options.episode).save(options.out, quality=88)
    print(options.out)
    return 0


def sheet(folder: Path, episode: int) -> Image.Image:
    """Return the sheet of an episode: a row per camera, a column per moment, the subgoal above and the action below."""
    info: dict[str, Any] = json.loads((folder / "meta/info.json").read_text(encoding="utf-8"))
    row = pq.read_table(folder / "meta/episodes/chunk-000/file-000.parquet").slice(episode, 1).to_pylist()[0]
    place = {"chunk_index": row["data/chunk_index"], "file_index": row["data/file_index"]}
    table = pq.read_table(
        folder / info["data_path"].format(**place), columns=["episode_index", "subtask_index", "action"]
    )
    table = table.filter(pc.equal(table["episode_index"], episode))
    subgoals = pq.read_table(folder / "meta/subtasks.parquet")["subtask"].to_pylist()
    moments = np.linspace(0, len(table) - 1, COLUMNS).round().astype(int).tolist()
    cameras = [name for name, feature in info["features"].items() if feature["dtype"] == "video"]
    width, height = COLUMNS * (SIDE + GAP) + GAP, 2 * HEADING + len(cameras) * (SIDE + GAP) + HEADING
    canvas = Image.new("RGB", (width, height), "white")
    draw, font = ImageDraw.Draw(canvas), ImageFont.load_default(13)
    draw.text((GAP, 8), f"{row['better/task']} {row['better/condition']}: {row['tasks'][0]}", "black", font)
    for column, moment in enumerate(moments):
        left = GAP + column * (SIDE + GAP)
        said = f"{moment / info['fps']:.1f} s  {subgoals[table['subtask_index'][moment].as_py()]}"
        draw.text((left, HEADING + 8), said, "black", font)
        action = ", ".join(f"{value:+.1f}" for value in table["action"][moment].as_py())
        draw.text((left, height - HEADING + 8), f"[{action}]", "dimgray", ImageFont.load_default(9))
        for line, camera in enumerate(cameras):
            picture = _picture(folder, info, row, camera, moment)
            canvas.paste(picture.resize((SIDE, SIDE)), (left, 2 * HEADING + line * (SIDE + GAP)))
    return canvas


def _picture(folder: Path, info: dict[str, Any], row: dict[str, Any], camera: str, moment: int) -> Image.Image:
    place = {f"{what}_index": row[f"videos/{camera}/{what}_index"] for what in ("chunk", "file")}
    video = folder / info["video_path"].format(video_key=camera, **place)
    first = round(row[f"videos/{camera}/from_timestamp"] * info["fps"]) + moment
    return Image.fromarray(next(read_pictures(str(video), first=first))[1])


if __name__ == "__main__":
    sys.exit(main())
