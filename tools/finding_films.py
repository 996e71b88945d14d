"""Draw film strips that show the paper's findings: the same trial played by learners from two arms of a study.

The arguments are the study, the output picture and the trials::

    python tools/finding_films.py STUDY PICTURE morning_coffee/L3/0 fruit_lunch/R1/0

``--suite FOLDER`` loads the tasks of a study on a suite in a folder.
"""

from __future__ import annotations

import argparse
import io
import json
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

from betterbench.evaluation.figures.films import Shot, render_shots
from betterbench.learning.study.outcomes import TrialOutcome, read_trials
from betterbench.records import RunFolder
from betterbench.tasks import TrialId, suite_tasks
from judged_films import moments

FRAMES, SIDE_PX, MARGIN_PX = 6, 220, 6
HEAD_PX, ROW_HEAD_PX = 34, 24
PAPER, INK, RIGHT, WRONG = (253, 252, 250), (28, 30, 33), (30, 120, 70), (190, 60, 30)


def film(study: Path, trial: TrialId, arms: tuple[str, str], training_seed: int) -> Image.Image:
    """Return one trial as played by two learners: the instruction, then a row of frames for each learner."""
    width = FRAMES * (SIDE_PX + MARGIN_PX)
    row_px = ROW_HEAD_PX + SIDE_PX + MARGIN_PX
    sheet = Image.new("RGB", (width, HEAD_PX + len(arms) * row_px + MARGIN_PX), PAPER)
    draw = ImageDraw.Draw(sheet)
    for i, arm in enumerate(arms):
        name = f"{trial.task}-{arm}-seed{training_seed}"
        run = RunFolder.open(study / "runs" / name)
        record = run.read_record(trial.task, trial.condition, trial.seed)
        if i == 0:
            head = f"{trial.task} {trial.condition}: “{record.metadata.instruction}”"
            draw.text((4, 4), head, fill=INK, font=ImageFont.load_default(20))
        found = outcome(study, name, trial)
        top = HEAD_PX + i * row_px
        text = f"{arm} learner: {'solved' if found.success else found.label.replace('_', ' ')}"
        draw.text((4, top), text, fill=RIGHT if found.success else WRONG, font=ImageFont.load_default(17))
        rows = moments(record, FRAMES)
        shots = [Shot(trial.task, trial.condition, trial.seed, float(record.time[row])) for row in rows]
        images = render_shots(run, shots, size=SIDE_PX, quality="standard")
        for k, shot in enumerate(shots):
            at = (k * (SIDE_PX + MARGIN_PX), top + ROW_HEAD_PX)
            sheet.paste(Image.open(io.BytesIO(images[shot])), at)
            draw.text((at[0] + 5, at[1] + 4), f"{shot.time_s:.1f} s", fill=INK, font=ImageFont.load_default(14))
    return sheet


def outcome(study: Path, name: str, trial: TrialId) -> TrialOutcome:
    """Return a study stage's result for a learner's trial."""
    stage = study / "stages" / f"runs-{name}.json"
    trials = read_trials(json.loads(stage.read_text(encoding="utf-8"))["output"]["trials"], str(stage))
    return next(t for t in trials if (t.variation or t.condition, t.seed) == (trial.condition, trial.seed))


def main() -> None:
    """Draw the films of all trials into one picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("study", type=Path)
    parser.add_argument("picture", type=Path)
    parser.add_argument("trials", nargs="+", metavar="TASK/VARIATION/SEED")
    parser.add_argument("--arms", nargs=2, default=("confounded", "balanced"))
    parser.add_argument("--training-seed", type=int, default=0)
    parser.add_argument("--suite", type=Path, help="folder of the suite, if its tasks are not packaged")
    given = parser.parse_args()
    if given.suite is not None:
        suite_tasks(str(given.suite))
    films = []
    for text in given.trials:
        task, condition, seed = text.split("/")
        films.append(film(given.study, TrialId(task, condition, int(seed)), tuple(given.arms), given.training_seed))
    sheet = Image.new("RGB", (films[0].width, sum(f.height for f in films)), PAPER)
    top = 0
    for one in films:
        sheet.paste(one, (0, top))
        top += one.height
    sheet.save(given.picture, quality=88)


if __name__ == "__main__":
    main()
