"""``better view``: show a recorded trial with its video, masks, boxes, contacts and subgoals on one timeline."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated

import tyro

from betterbench.cli.console import progress_bar, say
from betterbench.errors import InvalidInputError

if TYPE_CHECKING:
    from betterbench.jobs import OnCount
    from betterbench.records import Record, RunFolder
    from betterbench.records.modalities.spec import ViewSpec


def view_command(
    record: Annotated[Path, tyro.conf.Positional],
    *,
    out: Path | None = None,
    camera: tyro.conf.UseAppendAction[tuple[str, ...]] = (),
    quality: str | None = None,
    overwrite: bool = False,
) -> None:
    """Show a recorded trial on one timeline: video, masks, boxes, contacts and subgoals.

    A file name ending in .html gives a page for any browser. A file name ending in .rrd gives a file for the Rerun
    viewer (extra view), which also shows depth and 3-D boxes.

    Example: better view runs/expert/records/fast_food/T1/0.parquet --out t1.html

    Args:
        record: Record file in the folder of its run.
        out: File to write, .rrd or .html; TASK_CONDITION_SEED.html if not given.
        camera: View to render, in the syntax of `better materialize`; may be given several times. Default: the views of
            the run's policy.
        quality: Render preset; default: the preset used for the policy.
        overwrite: Replace a file that `better view` did not write.
    """
    from betterbench.cli.verbs.replay import run_of
    from betterbench.jobs.outputs import OutputFile
    from betterbench.records.modalities.spec import ViewSpec
    from betterbench.report.figures.player import is_player
    from betterbench.sim.modalities.folder import Wanted
    from betterbench.sim.modalities.rerun_file import is_rerun_file
    from betterbench.sim.modalities.run import default_views, seen_quality

    named = tuple(ViewSpec.parse(text) for text in camera)
    Wanted(named or (ViewSpec("front"),), quality=quality)  # reject unknown names before reading the record
    run, meta = run_of(record)
    path = out or Path(f"{meta.task}_{meta.condition}_{meta.seed}.html")
    if path.suffix not in (".rrd", ".html"):
        raise InvalidInputError(
            "--out", f"{path} ends with {path.suffix!r}", "Choose a file name that ends with .rrd or .html"
        )
    views = Wanted(named or default_views(run), quality=quality).views
    whole = run.read_record(meta.task, meta.condition, meta.seed)
    is_ours = is_rerun_file if path.suffix == ".rrd" else is_player
    with (
        OutputFile(path, "view", overwrite=overwrite, is_ours=is_ours),
        terminated_as_interrupted(),
        progress_bar("rows", len(whole)) as (bar, task),
    ):

        def told(done: int, planned: int) -> None:
            bar.update(task, completed=done, total=planned)

        write = _write_rerun if path.suffix == ".rrd" else _write_page
        write(run, whole, views, path, quality=quality or seen_quality(run, whole), on_progress=told)
    say(f"wrote {path}")


@contextmanager
def terminated_as_interrupted() -> Iterator[None]:
    """Handle SIGTERM in the same way as Ctrl-C, so that partially written files are removed."""

    def interrupt(number: int, frame: FrameType | None) -> None:
        del number, frame
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _write_rerun(
    run: RunFolder, record: Record, views: tuple[ViewSpec, ...], path: Path, *, quality: str, on_progress: OnCount
) -> None:
    from betterbench.sim.modalities.rerun_file import write_rerun

    write_rerun(run, record, views, path, quality=quality, on_progress=on_progress)


def _write_page(
    run: RunFolder, record: Record, views: tuple[ViewSpec, ...], path: Path, *, quality: str, on_progress: OnCount
) -> None:
    import numpy as np

    from betterbench.report.figures.player import PlayedLane, PlayedTrial, PlayedView, write_player
    from betterbench.sim.modalities.pictures import LEAST_SEEN, mask_png, object_colors, own_colors
    from betterbench.sim.modalities.viewing import lanes_of, shown_rows
    from betterbench.sim.scenes.image_files import jpeg_bytes

    meta, outcome = record.metadata, record.outcome
    names = [o.name for o in meta.scene.objects]
    colors = object_colors(len(names))
    pictures: list[list[bytes]] = [[] for _ in views]
    masks: list[list[bytes]] = [[] for _ in views]
    boxes: list[list[list[tuple[int, int, int, int, int, float]]]] = [[] for _ in views]
    for shown in shown_rows(run, record, views, quality=quality):
        if shown.row == 0:
            colors = own_colors(shown.views[0]["rgb"], shown.views[0]["instances"], len(names))
        for number, values in enumerate(shown.views):
            fractions = np.nan_to_num(values["visible_fraction"])
            pictures[number].append(jpeg_bytes(values["rgb"], quality=88))
            masks[number].append(mask_png(values["instances"], colors))
            seen = np.flatnonzero(fractions >= LEAST_SEEN).tolist()
            boxes[number].append([(i, *values["visible_box"][i].tolist(), float(fractions[i])) for i in seen])
        on_progress(shown.row + 1, len(record))
    played = [
        PlayedView(view.name, view.width, view.height, pictures[i], masks[i], boxes[i]) for i, view in enumerate(views)
    ]
    trial = PlayedTrial(
        heading=f"{meta.task}/{meta.condition}/{meta.seed}",
        policy=meta.policy,
        instruction=meta.instruction,
        ended="success" if outcome.success else outcome.termination.replace("_", " "),
        times_s=record.time.tolist(),
        objects=list(zip(names, colors, strict=True)),
        views=played,
        lanes=[PlayedLane(lane.kind, lane.name, lane.spans) for lane in lanes_of(record)],
    )
    write_player(trial, path)
