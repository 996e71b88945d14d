"""Failed trials of learned policies, judged by eye before anybody has seen their labels.

The first command draws failed trials by seed from a study's runs and writes numbered strips of frames, without labels.
A person watches them and writes, for each number, the label that it shows and what was seen: ``{"1": {"label":
"lexical_kinematic_shortcut", "seen": "takes the blue mug"}, ...}``. The second command compares the answers with the
labels of the diagnosis and prints the agreement with every disagreement::

    python tools/judged_films.py draw STUDY SHEETS --count 100
    python tools/judged_films.py judge STUDY SHEETS/drawn.json ANSWERS.json
"""

from __future__ import annotations

import argparse
import io
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from betterbench.evaluation.figures.films import Shot, render_shots
from betterbench.learning.study.outcomes import TrialOutcome, read_trials
from betterbench.records import Record, RunFolder
from betterbench.statistics import wilson_interval
from betterbench.tasks import stream

FRAMES, SIDE_PX, PER_SHEET = 8, 236, 5
_HEAD_PX, _MARGIN_PX = 46, 6


@dataclass(frozen=True, slots=True)
class Drawn:
    """A drawn trial, by the folder of its run."""

    run: str
    task: str
    condition: str
    seed: int


def failed_trials(study: Path) -> Iterator[tuple[Drawn, TrialOutcome]]:
    """Yield the failed trials of all learners in a study, in name order."""
    for path in sorted((study / "stages").glob("runs-*.json")):
        run = path.stem.removeprefix("runs-")
        task = run.partition("-")[0]
        trials = read_trials(json.loads(path.read_text(encoding="utf-8"))["output"]["trials"], str(path))
        for trial in trials:
            if not trial.success:
                yield Drawn(run, task, trial.variation or trial.condition, trial.seed), trial


def moments(record: Record, count: int) -> list[int]:
    """Return the rows to be shown: the start, gripper commands to close or open, the end, and rows between."""
    last = len(record) - 1
    turns = np.flatnonzero(np.diff(np.sign(record.gripper_command)) != 0) + 1
    rows = {0, last, *(min(last, int(row) + 8) for row in turns[: count - 2])}
    while len(rows) < min(count, last + 1):
        known = sorted(rows)
        widest = max(range(len(known) - 1), key=lambda i: known[i + 1] - known[i])
        rows.add((known[widest] + known[widest + 1]) // 2)
    return sorted(rows)[:count]


def strip(run: RunFolder, drawn: Drawn, number: int) -> Image.Image:
    """Return the frames of a trial side by side, with the trial's number, instruction and times."""
    record = run.read_record(drawn.task, drawn.condition, drawn.seed)
    shots = [Shot(drawn.task, drawn.condition, drawn.seed, float(record.time[row])) for row in moments(record, FRAMES)]
    images = render_shots(run, shots, size=SIDE_PX, quality="fast")
    sheet = Image.new("RGB", (FRAMES * (SIDE_PX + _MARGIN_PX), SIDE_PX + _HEAD_PX + _MARGIN_PX), (253, 252, 250))
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(20)
    head = f"{number}.  “{record.metadata.instruction}”   (ended after {record.time[-1]:.1f} s)"
    draw.text((4, 2), head, fill=(28, 30, 33), font=font)
    for i, shot in enumerate(shots):
        at = i * (SIDE_PX + _MARGIN_PX)
        sheet.paste(Image.open(io.BytesIO(images[shot])), (at, _HEAD_PX))
        closed = record.gripper_command[int(np.searchsorted(record.time, shot.time_s - 1e-9))] > 0
        mark = f"{shot.time_s:.1f} s {'closed' if closed else 'open'}"
        draw.text((at + 2, _HEAD_PX - 18), mark, fill=(200, 80, 20) if closed else (40, 122, 200))
    return sheet


def draw(study: Path, out: Path, count: int, seed: int) -> None:
    """Draw trials and write their strips, and which trials they are."""
    found = [drawn for drawn, _ in failed_trials(study)]
    order = stream("judged films", seed, "draw").permutation(len(found))[:count]
    chosen = [found[int(i)] for i in order]
    out.mkdir(parents=True, exist_ok=True)
    (out / "drawn.json").write_text(json.dumps([asdict(d) for d in chosen], indent=1) + "\n", encoding="utf-8")
    strips: list[Image.Image] = []
    for number, drawn in enumerate(chosen, 1):
        strips.append(strip(RunFolder.open(study / "runs" / drawn.run), drawn, number))
        if len(strips) == PER_SHEET or number == len(chosen):
            _stacked(strips).save(out / f"sheet-{(number - 1) // PER_SHEET + 1:02d}.png")
            strips = []


def _stacked(strips: Sequence[Image.Image]) -> Image.Image:
    sheet = Image.new("RGB", (strips[0].width, sum(s.height for s in strips)), (253, 252, 250))
    top = 0
    for one in strips:
        sheet.paste(one, (0, top))
        top += one.height
    return sheet


def judge(study: Path, drawn_file: Path, answers_file: Path) -> None:
    """Print how many answers agree with the diagnosis, and every one that does not."""
    labels = {drawn: trial.label for drawn, trial in failed_trials(study)}
    drawn = [Drawn(**form) for form in json.loads(drawn_file.read_text(encoding="utf-8"))]
    answers = json.loads(answers_file.read_text(encoding="utf-8"))
    agreed = 0
    for number, trial in enumerate(drawn, 1):
        answer = answers[str(number)]
        accepted = [answer["label"], *answer.get("also", ())]
        if labels[trial] in accepted:
            agreed += 1
        else:
            where = f"{trial.run} {trial.condition}/{trial.seed}"
            print(f"| {number} | {where} | {' or '.join(accepted)} | {labels[trial]} | {answer['seen']} |")
    interval = wilson_interval(agreed, len(drawn))
    print(f"{agreed} of {len(drawn)} agree ({100 * interval.low:.0f} to {100 * interval.high:.0f} %)")


def main() -> None:
    """Draw or judge."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    verbs = parser.add_subparsers(dest="verb", required=True)
    drawing = verbs.add_parser("draw")
    drawing.add_argument("study", type=Path)
    drawing.add_argument("out", type=Path)
    drawing.add_argument("--count", type=int, default=100)
    drawing.add_argument("--seed", type=int, default=0)
    judging = verbs.add_parser("judge")
    for name in ("study", "drawn", "answers"):
        judging.add_argument(name, type=Path)
    given = parser.parse_args()
    if given.verb == "draw":
        draw(given.study, given.out, given.count, given.seed)
    else:
        judge(given.study, given.drawn, given.answers)


if __name__ == "__main__":
    main()
