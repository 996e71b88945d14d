"""Films of learned policies, judged blind from strips of frames and compared with the diagnosis.

The first command draws trials by seed from the runs of studies and from single runs, the given number from each run,
with a given number of failures. For every trial it writes a numbered strip of frames (``NNN.png``) and a text
(``NNN.txt``) with the instruction, the objects at the start and the training conditions. Neither shows a label, a
contact or the outcome. The file ``drawn.json``, which a judge must not read, lists the trials. Judges write
a table with the columns ``id``, ``label``, ``kind``, ``sure`` and ``remark``. The second command compares two such
tables with each other and with the diagnosis::

    python tools/judged_films.py draw FILMS STUDY_OR_RUN [...] --per-run 25 --failures 19
    python tools/judged_films.py compare FILMS/drawn.json judge1.csv judge2.csv

The third command writes a contact sheet with a few frames of some films, for the documentation::

    python tools/judged_films.py sheet FILMS docs/pictures/judged-blind.jpg 16 23 26
"""

from __future__ import annotations

import argparse
import csv
import json
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from betterbench.diagnosis import diagnose_run
from betterbench.learning.study.outcomes import read_trials
from betterbench.records import Record, RunFolder
from betterbench.sim.scenes.limited import LimitedView
from betterbench.statistics import AgreementTable, wilson_interval
from betterbench.tasks import Condition, Label, Task, get_task, stream

FRAMES, COLUMNS, SIDE_PX, CLOSE_PX, RENDER_PX = 18, 6, 256, 176, 640
"""Frames per strip and per row; sides of a frame, of a close-up and of the rendered image [pixel]."""
CLOSE_UP_M = 0.12
"""Half side of the region that a close-up shows [m]."""
_GAP, _LINE, _TEXT, _CURVE = 4, 17, 15, 60
_PAPER, _INK, _BLUE, _RED = (253, 252, 250), (28, 30, 33), (40, 122, 200), (200, 60, 20)


@dataclass(frozen=True, slots=True)
class Drawn:
    """A drawn trial, by the folder of its run and its number."""

    number: int
    run: str
    task: str
    condition: str
    seed: int


def moments(record: Record, count: int) -> list[int]:
    """Return the rows to show: the start, the end, the ends of finger motions, and rows in between."""
    last, rate = len(record) - 1, record.metadata.control_rate_hz
    turns = _finger_turns(record, rate)
    if len(turns) > count // 2:
        turns = [turns[i] for i in np.linspace(0, len(turns) - 1, count // 2).round().astype(int)]
    rows = {0, last}
    for row in turns:
        rows.add(min(last, row))
        if len(rows) < count - 4:
            rows.add(min(last, row + round(rate)))
    while len(rows) < min(count, last + 1):
        known = sorted(rows)
        widest = max(range(len(known) - 1), key=lambda i: known[i + 1] - known[i])
        rows.add((known[widest] + known[widest + 1]) // 2)
    return sorted(rows)[:count]


def _finger_turns(record: Record, rate: float) -> list[int]:
    """Return the rows where the fingers have come to rest after a motion of more than 5 mm, or are about to open."""
    width, step = record.finger_width, max(1, round(0.2 * rate))
    speed = np.abs(width[step:] - width[:-step])
    moving = np.concatenate([np.zeros(step, bool), speed > 0.002])
    edges = np.flatnonzero(np.diff(moving.astype(int)))
    rows, start = list[int](), 0
    for row in edges:
        if not moving[row]:
            start = int(row)
        elif abs(width[row] - width[start]) > 0.005:
            rows.append(start if width[row] > width[start] else int(row))
    return sorted(set(rows))


def strip(run: RunFolder, drawn: Drawn, view: LimitedView) -> Image.Image:
    """Return the film strip of a trial: frames of the front camera, and close-ups of the gripper below them."""
    record = run.read_record(drawn.task, drawn.condition, drawn.seed)
    view.open_of(run, record)
    rows = moments(record, FRAMES)
    lines = -(-len(rows) // COLUMNS)
    cell = SIDE_PX + CLOSE_PX + _LINE + 2 * _GAP
    head = textwrap.wrap(f"No. {drawn.number:03d}. Instruction: “{record.metadata.instruction}”", 180)
    top = len(head) * (_LINE + 2) + _CURVE + 3 * _GAP
    sheet = Image.new("RGB", (COLUMNS * (SIDE_PX + _GAP) + _GAP, top + lines * cell), _PAPER)
    draw = ImageDraw.Draw(sheet)
    for i, text in enumerate(head):
        draw.text((_GAP, i * (_LINE + 2)), text, fill=_INK, font=ImageFont.load_default(_TEXT + 2))
    _curve(draw, record, rows, (_GAP, len(head) * (_LINE + 2) + _GAP, sheet.width - _GAP, top - 2 * _GAP))
    for i, row in enumerate(rows):
        left, upper = _GAP + (i % COLUMNS) * (SIDE_PX + _GAP), top + (i // COLUMNS) * cell
        frame = Image.fromarray(view.draw(record.qpos[row], "front", jitter=record.metadata.view_jitter))
        if i == 0:
            _slots(frame, record, view)
        sheet.paste(frame.resize((SIDE_PX, SIDE_PX), Image.Resampling.LANCZOS), (left, upper))
        sheet.paste(_close_up(frame, record, row, view), (left, upper + SIDE_PX))
        wrist = Image.fromarray(view.draw(record.qpos[row], "wrist", jitter=record.metadata.view_jitter))
        side = SIDE_PX - CLOSE_PX - 2
        sheet.paste(wrist.resize((side, side), Image.Resampling.LANCZOS), (left + CLOSE_PX + 2, upper + SIDE_PX))
        mark = (f"{record.time[row]:.2f} s", "fingers", f"{100 * record.finger_width[row]:.1f} cm")
        for k, text in enumerate(mark):
            at = (left + CLOSE_PX + 4, upper + SIDE_PX + side + 8 + k * (_LINE + 2))
            draw.text(
                at, text, fill=_INK if k == 0 else _BLUE, font=ImageFont.load_default(_TEXT + (2 if k == 0 else 0))
            )
    return sheet


def _curve(draw: ImageDraw.ImageDraw, record: Record, rows: Sequence[int], box: tuple[int, int, int, int]) -> None:
    """Draw the distance of the fingers over time, with a line at each frame."""
    left, top, right, bottom = box
    draw.rectangle(box, outline=(200, 200, 200))
    x = left + record.time / record.time[-1] * (right - left)
    y = bottom - record.finger_width / max(0.08, float(record.finger_width.max())) * (bottom - top - 2)
    for row in rows:
        draw.line([(x[row], top), (x[row], bottom)], fill=(225, 215, 200))
    draw.line(list(zip(x.tolist(), y.tolist(), strict=True)), fill=_BLUE, width=2)
    text = f"distance of the fingers, 0 to 8 cm, over {record.time[-1]:.1f} s"
    draw.text((left + 6, bottom - _LINE), text, fill=_INK, font=ImageFont.load_default(_TEXT - 3))


def _slots(frame: Image.Image, record: Record, view: LimitedView) -> None:
    """Mark the slots of the task in the first frame."""
    slots = record.metadata.scene.slots
    pixels = view.project(np.array([slot.position for slot in slots]), "front")
    draw, font = ImageDraw.Draw(frame), ImageFont.load_default(34)
    for slot, (u, v) in zip(slots, pixels.tolist(), strict=True):
        draw.ellipse((u - 5, v - 5, u + 5, v + 5), fill=(250, 220, 60))
        box = draw.textbbox((u + 8, v - 2), slot.name, font=font)
        draw.rectangle(box, fill=_PAPER)
        draw.text((u + 8, v - 2), slot.name, fill=_INK, font=font)


def _close_up(frame: Image.Image, record: Record, row: int, view: LimitedView) -> Image.Image:
    """Return the region around the fingertips, enlarged."""
    at = np.asarray(record.ee_position[row], dtype=np.float64)
    points = view.project(np.array([at, at + np.array([0.0, CLOSE_UP_M, 0.0])]), "front")
    half = max(40.0, float(abs(points[1, 0] - points[0, 0])))
    u, v = (float(np.clip(c, half, RENDER_PX - half)) for c in points[0] + np.array([0.0, half / 4]))
    region = frame.crop((round(u - half), round(v - half), round(u + half), round(v + half)))
    return region.resize((CLOSE_PX, CLOSE_PX), Image.Resampling.LANCZOS)


def text_of(record: Record, drawn: Drawn, task: Task) -> str:
    """Return the text beside a strip: instruction, objects at the start and training conditions."""
    m = record.metadata
    conditions = [*task.training]
    lines = [
        f"film {drawn.number:03d}, task {drawn.task}: {task.title}",
        f"instruction: {m.instruction}",
        f"expected behavior: {m.expected}",
        f"record ends at {record.time[-1]:.2f} s",
        "",
        "slots, x toward the camera and y to the right of the image [m]: "
        + ", ".join(f"{s.name} ({s.position[0]:.2f}, {s.position[1]:.2f})" for s in m.scene.slots),
        "objects at the start:",
        *(f"- {o.name}: {o.kind}, {o.role}, slot {o.slot or 'none (see the first frame)'}" for o in m.scene.objects),
        "",
        "training conditions (instruction; objects by slot; objects already at a target):",
        *(f"- {c.name}: “{c.instruction.text}”; {_layout(c)}" for c in conditions),
    ]
    return "\n".join(lines) + "\n"


def _layout(condition: Condition) -> str:
    placed = [f"{condition.object(n).kind} at {slot}" for n, slot in condition.layout.items()]
    resting = [
        f"{condition.object(n).kind} already at {condition.object(p.target).kind} {p.region}".strip()
        for n, p in condition.preplaced.items()
    ]
    return ", ".join([*placed, *resting])


@dataclass(frozen=True, slots=True)
class Outcome:
    """Outcome of a trial that may be drawn."""

    condition: str
    seed: int
    success: bool


def runs_of(place: Path) -> Iterator[tuple[Path, list[Outcome]]]:
    """Yield the run in a folder, or the runs of the study in it in name order, with their trials."""
    if not (place / "stages").is_dir():
        yield place, [Outcome(t.variation or t.condition, t.seed, t.success) for t in diagnose_run(place).trials]
        return
    for path in sorted((place / "stages").glob("runs-*.json")):
        trials = read_trials(json.loads(path.read_text(encoding="utf-8"))["output"]["trials"], str(path))
        name = path.stem.removeprefix("runs-")
        yield place / "runs" / name, [Outcome(t.variation or t.condition, t.seed, t.success) for t in trials]


def choose(trials: Sequence[Outcome], count: int, failures: int, name: str, seed: int) -> list[Outcome]:
    """Return trials drawn by seed: at least so many failures, if the run has them, in shuffled order."""
    random = stream("judged films", seed, name)
    order = [trials[int(i)] for i in random.permutation(len(trials))]
    failed = [t for t in order if not t.success][: max(0, min(count, failures))]
    solved = [t for t in order if t.success][: count - len(failed)]
    rest = [t for t in order if t not in failed and t not in solved][: count - len(failed) - len(solved)]
    chosen = [*failed, *solved, *rest]
    return [chosen[int(i)] for i in random.permutation(len(chosen))]


def draw_films(out: Path, places: Sequence[Path], per_run: int, failures: int, seed: int) -> None:
    """Draw trials, write their strips and texts, and list them in ``drawn.json``; films that exist are kept."""
    out.mkdir(parents=True, exist_ok=True)
    listing = out / "drawn.json"
    known = [Drawn(**form) for form in json.loads(listing.read_text(encoding="utf-8"))] if listing.exists() else []
    with LimitedView(quality="fast", size=RENDER_PX) as view:
        for folder, trials in (found for place in places for found in runs_of(place)):
            run, name = RunFolder.open(folder), folder.name
            have = {(d.condition, d.seed) for d in known if d.run == str(folder)}
            left = [t for t in trials if (t.condition, t.seed) not in have]
            wanted = failures - sum(not t.success for t in trials if t not in left)
            known += [
                Drawn(len(known) + 1 + i, str(folder), name.partition("-")[0], t.condition, t.seed)
                for i, t in enumerate(choose(left, per_run - len(have), wanted, name, seed))
            ]
            for drawn in known:
                path = out / f"{drawn.number:03d}.png"
                if drawn.run != str(folder) or path.exists():
                    continue
                record = run.read_record(drawn.task, drawn.condition, drawn.seed)
                text = text_of(record, drawn, get_task(drawn.task))
                path.with_suffix(".txt").write_text(text, encoding="utf-8")
                strip(run, drawn, view).save(path)
    listing.write_text(json.dumps([asdict(d) for d in known], indent=1) + "\n", encoding="utf-8")


@dataclass(frozen=True, slots=True)
class Judgment:
    """One judge's answer for a film."""

    label: str
    kind: str
    sure: bool
    remark: str


def judgments_in(path: Path) -> dict[int, Judgment]:
    """Return the rows of a judge's table by film number."""
    with path.open(encoding="utf-8", newline="") as file:
        return {
            int(row["id"]): Judgment(row["label"], kind_of(row["label"]), row["sure"] == "sure", row["remark"] or "")
            for row in csv.DictReader(file)
        }


def kind_of(label: str) -> str:
    """Return the kind of a label ("none" for a right behavior). Raises ValueError if there is no such label."""
    return Label(label).kind.value


def diagnosed(drawn: Sequence[Drawn]) -> dict[int, tuple[str, str]]:
    """Return label and evidence of the current diagnosis, by film number."""
    found = dict[int, tuple[str, str]]()
    for folder in dict.fromkeys(d.run for d in drawn):
        trials = {(t.variation or t.condition, t.seed): t for t in diagnose_run(Path(folder)).trials}
        for d in drawn:
            if d.run == folder:
                trial = trials[d.condition, d.seed]
                found[d.number] = trial.label.value, trial.evidence.text
    return found


def compare(listing: Path, tables: tuple[Path, Path], out: Path | None) -> None:
    """Print the agreement of two judges and of the diagnosis with them, and every film on which they differ."""
    drawn = [Drawn(**form) for form in json.loads(listing.read_text(encoding="utf-8"))]
    first, second = (judgments_in(path) for path in tables)
    found = diagnosed(drawn)
    both = [d.number for d in drawn if d.number in first and d.number in second]
    for part in ("label", "kind"):
        pairs = [(getattr(first[n], part), getattr(second[n], part)) for n in both]
        kappa = AgreementTable.of_pairs(pairs, sorted({name for pair in pairs for name in pair})).kappa or 0.0
        agreed = [n for n, (a, b) in zip(both, pairs, strict=True) if a == b]
        ours = {n: found[n][0] if part == "label" else kind_of(found[n][0]) for n in both}
        same = sum(ours[n] == getattr(first[n], part) for n in agreed)
        print(f"{part}: judges agree in {_share(len(agreed), len(both))}, kappa {kappa:.2f}")
        print(f"{part}: where they agree, the diagnosis agrees in {_share(same, len(agreed))}")
        for k, judge in enumerate((first, second), 1):
            same = sum(ours[n] == getattr(judge[n], part) for n in both)
            print(f"{part}: the diagnosis agrees with judge {k} in {_share(same, len(both))}")
    for d in drawn:
        if d.number not in both:
            continue
        a, b, (label, evidence) = first[d.number], second[d.number], found[d.number]
        if not a.label == b.label == label:
            print(f"{d.number:03d} {d.task}/{d.condition}/{d.seed}: diagnosed {label} ({evidence})")
            for answer in (a, b):
                print(f"      {answer.label}{'' if answer.sure else ' (unsure)'}: {answer.remark}")
    if out is not None:
        forms = [_form(d, (first[d.number], second[d.number]), found[d.number][0]) for d in drawn if d.number in both]
        out.write_text(json.dumps(forms, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def _form(drawn: Drawn, judges: tuple[Judgment, Judgment], label: str) -> Mapping[str, object]:
    run = Path(drawn.run).name
    return {**asdict(drawn), "run": run, "judgments": [asdict(judge) for judge in judges], "diagnosed": label}


def contact_sheet(films: Path, numbers: Sequence[int], out: Path, *, frames: int = 6, side: int = 112) -> None:
    """Write a contact sheet: a row per film with its number, its instruction, and frames from its strip."""
    rows: list[tuple[str, list[Image.Image]]] = []
    for number in numbers:
        image = Image.open(films / f"{number:03d}.png")
        text = (films / f"{number:03d}.txt").read_text(encoding="utf-8").splitlines()[1]
        lines = round((image.height - _CURVE) / (SIDE_PX + CLOSE_PX + _LINE + 2 * _GAP))
        cell = SIDE_PX + CLOSE_PX + _LINE + 2 * _GAP
        top = image.height - lines * cell
        cells = [
            (_GAP + column * (SIDE_PX + _GAP), top + line * cell) for line in range(lines) for column in range(COLUMNS)
        ]
        shown = [cells[i] for i in np.linspace(0, len(cells) - 1, frames).round().astype(int)]
        views = [image.crop((x, y, x + SIDE_PX, y + SIDE_PX)).resize((side, side)) for x, y in shown]
        rows.append((f"{number}. {text.removeprefix('instruction: ')}", views))
    sheet = Image.new("RGB", (frames * (side + _GAP), len(rows) * (side + _LINE + _GAP)), _PAPER)
    draw = ImageDraw.Draw(sheet)
    for k, (head, views) in enumerate(rows):
        y = k * (side + _LINE + _GAP)
        draw.text((2, y), head[:105], fill=_INK, font=ImageFont.load_default(_TEXT - 2))
        for i, view in enumerate(views):
            sheet.paste(view, (i * (side + _GAP), y + _LINE))
    sheet.save(out, quality=74, optimize=True)


def _share(count: int, total: int) -> str:
    interval = wilson_interval(count, total)
    return f"{count}/{total} = {100 * count / total:.0f} % ({100 * interval.low:.0f} to {100 * interval.high:.0f})"


def main() -> None:
    """Draw films, compare judgments, or write a contact sheet."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    verbs = parser.add_subparsers(dest="verb", required=True)
    drawing = verbs.add_parser("draw")
    drawing.add_argument("out", type=Path)
    drawing.add_argument("places", type=Path, nargs="+", help="folders of studies or runs")
    drawing.add_argument("--per-run", type=int, default=25)
    drawing.add_argument("--failures", type=int, default=19)
    drawing.add_argument("--seed", type=int, default=0)
    comparing = verbs.add_parser("compare")
    comparing.add_argument("drawn", type=Path)
    comparing.add_argument("tables", type=Path, nargs=2)
    comparing.add_argument("--out", type=Path, help="JSON file with all judgments")
    showing = verbs.add_parser("sheet")
    showing.add_argument("films", type=Path)
    showing.add_argument("out", type=Path)
    showing.add_argument("numbers", type=int, nargs="+")
    given = parser.parse_args()
    if given.verb == "sheet":
        contact_sheet(given.films, given.numbers, given.out)
    elif given.verb == "draw":
        draw_films(given.out, given.places, given.per_run, given.failures, given.seed)
    else:
        compare(given.drawn, tuple(given.tables), given.out)


if __name__ == "__main__":
    main()
