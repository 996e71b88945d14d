"""``better replay``: simulate a record again, or turn it into a video."""

from __future__ import annotations

import os
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import tyro

from betterbench.cli.console import OUT, print_json, say
from betterbench.errors import BetterError, RecordError

MOST_FIELDS = 5
"""Fields that are named in the error of a record that does not follow from its actions."""


def replay_command(
    record: Annotated[Path, tyro.conf.Positional],
    *,
    check: bool = False,
    out: Path | None = None,
    camera: str = "front",
    size: int = 512,
    json: bool = False,
) -> None:
    """Simulate the actions of a record again and compare every state, or write a video of it.

    Example: better replay runs/expert/records/fast_food/T1/0.parquet --check

    Args:
        record: File of the record, in the folder of its run.
        check: Simulate again and compare all that follows from trial and actions, instead of writing a video.
        out: Video file to write; a file in the folder of the run if not given.
        camera: Camera of the video.
        size: Side of the video in pixels.
        json: Print the result of --check as one JSON document.
    """
    from betterbench.evaluation import check_record

    if not check:
        path = _video(record, out, camera=camera, size=size)
        say(f"wrote {path}")
        return
    result = check_record(record)
    if json:
        print_json({"record": str(record), "identical": result.identical, **asdict(result)})
    elif result.identical:
        OUT.print(f"identical: {result.rows} states, every verdict and all {result.fields} fields", markup=False)
    if not result.identical:
        where = "no state" if result.first_difference is None else f"row {result.first_difference} on"
        more = len(result.differing) - MOST_FIELDS
        listed = "; ".join(result.differing[:MOST_FIELDS]) + (f"; and {more} more" if more > 0 else "")
        raise BetterError(
            f"{record}: the replay differs ({where}, by {result.largest_difference:.3g} at most; verdicts "
            f"{'agree' if result.verdict_agrees else 'differ'}). What does not follow: {listed}. "
            f"{'; '.join(result.notes) or 'Versions are the same'}."
        )


def _video(record: Path, out: Path | None, *, camera: str, size: int) -> Path:
    from betterbench.evaluation import write_video
    from betterbench.recording import RunFolder, read_record

    meta = read_record(record).metadata
    place = Path(os.path.realpath(record))
    run = RunFolder.open(place.parents[3] if len(place.parents) > 3 else record.parent)
    if Path(os.path.realpath(run.record_path(meta.task, meta.condition, meta.seed))) != place:
        raise RecordError(
            f"{record}: the record is not in the folder of its run, where its scene is stored. Put it back."
        )
    return write_video(run, meta.task, meta.condition, meta.seed, camera=camera, size=size, out=out)
