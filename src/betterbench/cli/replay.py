"""``better replay``: simulate a record again, or turn it into a video."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from betterbench.cli.console import OUT, print_json, say
from betterbench.errors import BetterError, RecordError
from betterbench.evaluation import check_record, write_video
from betterbench.recording import RunFolder, read_record


def replay(
    record: Annotated[Path, tyro.conf.Positional],
    *,
    check: bool = False,
    out: Path | None = None,
    camera: str = "front",
    size: int = 512,
    json: bool = False,
) -> None:
    """Simulate a record's actions again and compare every state, or write its video.

    Example: better replay runs/expert/records/fast_food/T1/0.parquet --check

    Args:
        record: The record.
        check: Simulate again and compare bit for bit.
        out: Video file to write without --check; a place in the run's folder if not given.
        camera: Camera of the video.
        size: Side of the video in pixels.
        json: Print one JSON document.
    """
    if not check:
        path = _video(record, out, camera=camera, size=size)
        say(f"wrote {path}")
        return
    result = check_record(record)
    if json:
        print_json(
            {
                "record": str(record),
                "identical": result.identical,
                "rows": result.rows,
                "first_difference": result.first_difference,
                "largest_difference": result.largest_difference,
                "verdict_agrees": result.verdict_agrees,
                "notes": list(result.notes),
            }
        )
    elif result.identical:
        OUT.print(f"identical: {result.rows} states and every verdict", markup=False)
    if not result.identical:
        where = "no state" if result.first_difference is None else f"row {result.first_difference} on"
        raise BetterError(
            f"{record}: the replay differs ({where}, by {result.largest_difference:.3g} at most; verdicts "
            f"{'agree' if result.verdict_agrees else 'differ'}). {'; '.join(result.notes) or 'Versions are the same.'}"
        )


def _video(record: Path, out: Path | None, *, camera: str, size: int) -> Path:
    meta = read_record(record).metadata
    folder = record.resolve().parents[3] if len(record.resolve().parents) > 3 else record.parent
    run = RunFolder.open(folder)
    if run.record_path(meta.task, meta.condition, meta.seed).resolve() != record.resolve():
        raise RecordError(f"{record}: it is not in its run's folder, where its scene is stored. Put it back.")
    return write_video(run, meta.task, meta.condition, meta.seed, camera=camera, size=size, out=out)
