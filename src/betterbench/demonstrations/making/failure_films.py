"""Videos of failed attempts. The first attempt with each kind of failure is simulated again from its seed."""

from __future__ import annotations

from betterbench.demonstrations.making.acceptance import FOLDER, Acceptance
from betterbench.demonstrations.making.production import attempt_at, method_of, scene_of
from betterbench.errors import BetterError, StorageError
from betterbench.evaluation.figures.films import film_record
from betterbench.jobs import OnCount
from betterbench.records import RunFolder
from betterbench.sim.scenes.limited import LimitedView

SIZE = 256
"""Side length of the videos [pixel]."""
EVERY = 2
"""Number of record rows per video frame, so that videos have ten frames per second."""


def film_failures(
    run: RunFolder, found: Acceptance, *, on_progress: OnCount | None = None
) -> dict[tuple[str, str], str]:
    """Render a video of the first failed attempt of each kind and task, unless the video already exists.

    Args:
        run: Folder of the run.
        found: Outcomes of the run's attempts.
        on_progress: Called with the number of finished videos and the total number.

    Returns:
        For each task and kind of failure, the path of the video relative to the report folder, or the reason why there
        is none.
    """
    wanted = [(t.task, kind, trial, number) for t in found.tasks for kind, (trial, number, _) in t.examples.items()]
    films: dict[tuple[str, str], str] = {}
    method = method_of(run)
    for done, (task, kind, trial, number) in enumerate(wanted, start=1):
        name = f"films/{task}-{kind.replace(' ', '-')}-{trial.condition}-{trial.seed}-{number}.mp4"
        path = run.inside(FOLDER, name)
        try:
            if not path.exists():
                scene = scene_of(trial, method.quality, method.robot)
                record = attempt_at(scene, number, method).record
                with LimitedView(quality="fast", size=SIZE) as view:
                    view.open(scene.files())
                    film_record(view, record, path, every=EVERY)
            films[task, kind] = name
        except StorageError:
            raise
        except BetterError as problem:
            films[task, kind] = f"none: {problem}"
        if on_progress is not None:
            on_progress(done, len(wanted))
    return films
