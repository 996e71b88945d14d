"""Logs of a training run: tables as CSV, and curves as SVG.

If a run is interrupted and resumed, the final CSV files are the same as without the interruption.
"""

from __future__ import annotations

import csv
import hashlib
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass, field, fields
from pathlib import Path
from typing import Any, TypeVar

from betterbench.errors import RecordError
from betterbench.jobs.durable import on_disk, write_durably
from betterbench.learning.training.questions import AnswerRate
from betterbench.learning.training.validation import PhaseError, Rollout
from betterbench.ordinary_file import read_ordinary
from betterbench.quoting import markup_text


@dataclass(frozen=True, slots=True)
class LossRow:
    """Mean loss and mean gradient norm over the steps since the previous row."""

    step: int
    loss: float
    learning_rate: float
    gradient_norm: float


Row = TypeVar("Row", LossRow, PhaseError, Rollout, AnswerRate)

ANSWERS_NAME = "answers.csv"
"""Name of the co-training table, which counts the correct answers to questions about held-out demonstrations."""

_WIDTH, _HEIGHT, _LEFT, _BOTTOM, _TOP = 720, 300, 60, 40, 30
_COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")


@dataclass(slots=True)
class Log:
    """Tables that log a training run. Their rows are in the order of the training steps."""

    losses: list[LossRow] = field(default_factory=list)
    errors: list[PhaseError] = field(default_factory=list)
    rollouts: list[Rollout] = field(default_factory=list)
    answers: list[AnswerRate] = field(default_factory=list)

    @classmethod
    def read(cls, out: Path, until: int) -> Log:
        """Read the tables in a training folder up to a step.

        Rows after that step are dropped, since an interrupted training run may have logged steps after its last saved
        state.
        """
        return cls(
            _read(out / "loss.csv", LossRow, until),
            _read(out / "validation.csv", PhaseError, until),
            _read(out / "rollouts.csv", Rollout, until),
            _read(out / ANSWERS_NAME, AnswerRate, until) if (out / ANSWERS_NAME).exists() else [],
        )

    def write(self, out: Path) -> None:
        """Write the tables and the curves into a folder. Raises StorageError if the disk is full."""
        with on_disk(out):
            write_durably(out / "loss.csv", _table(LossRow, self.losses))
            write_durably(out / "validation.csv", _table(PhaseError, self.errors))
            write_durably(out / "rollouts.csv", _table(Rollout, self.rollouts))
            if self.answers:
                write_durably(out / ANSWERS_NAME, _table(AnswerRate, self.answers))
            write_durably(out / "curves.svg", self.svg().encode())

    def digest(self) -> str:
        """Return the SHA-256 of all tables."""
        whole = hashlib.sha256(_table(LossRow, self.losses))
        whole.update(_table(PhaseError, self.errors))
        whole.update(_table(Rollout, self.rollouts))
        whole.update(_table(AnswerRate, self.answers))
        return whole.hexdigest()

    def svg(self) -> str:
        """Return two charts as SVG: the training loss, and below it the errors on held-out demonstrations by phase."""
        loss = {"loss": [(row.step, row.loss) for row in self.losses]}
        phases = dict.fromkeys(row.phase for row in self.errors)
        errors = {p: [(row.step, row.translation_mm) for row in self.errors if row.phase == p] for p in phases}
        height = 2 * _HEIGHT
        head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {height}" font-family="sans-serif"'
        return "\n".join(
            [
                f'{head} font-size="12">',
                f'<rect width="{_WIDTH}" height="{height}" fill="white"/>',
                *_chart("training loss", loss, 0),
                *_chart("error of the next actions on held-out demonstrations [mm per control step]", errors, _HEIGHT),
                "</svg>\n",
            ]
        )


def _chart(title: str, series: dict[str, list[tuple[int, float]]], down: int) -> list[str]:
    """Return the SVG elements of a chart that begins ``down`` pixels below the top of the drawing."""
    points = [point for found in series.values() for point in found]
    last = max((x for x, _ in points), default=1) or 1
    most = max((y for _, y in points), default=1.0) * 1.05 or 1.0
    bottom, right = down + _HEIGHT - _BOTTOM, _WIDTH - 90

    def place(x: float, y: float) -> str:
        across = _LEFT + (right - _LEFT) * x / last
        return f"{across:.1f},{bottom - (bottom - down - _TOP) * y / most:.1f}"

    parts = [f'<text x="{_LEFT}" y="{down + 18}" font-weight="bold">{markup_text(title)}</text>']
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        y = bottom - (bottom - down - _TOP) * share
        x = _LEFT + (right - _LEFT) * share
        parts.append(f'<line x1="{_LEFT}" x2="{right}" y1="{y:.1f}" y2="{y:.1f}" stroke="#ddd"/>')
        parts.append(f'<text x="{_LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{most * share:.3g}</text>')
        parts.append(f'<text x="{x:.1f}" y="{bottom + 18}" text-anchor="middle">{round(last * share):,}</text>')
    parts.append(f'<text x="{(_LEFT + right) / 2}" y="{bottom + 34}" text-anchor="middle">step</text>')
    for number, (name, found) in enumerate(series.items()):
        color = _COLORS[number % len(_COLORS)]
        line = " ".join(place(x, y) for x, y in found)
        parts.append(f'<polyline points="{line}" fill="none" stroke="{color}" stroke-width="1.5"/>')
        parts += [f'<circle cx="{p.split(",")[0]}" cy="{p.split(",")[1]}" r="2" fill="{color}"/>' for p in line.split()]
        y = down + _TOP + 16 * number + 10
        parts.append(f'<text x="{right + 8}" y="{y}" fill="{color}">{markup_text(name)}</text>')
    return parts


def _table(kind: type[Row], rows: Sequence[Row]) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([f.name for f in fields(kind)])
    writer.writerows(astuple(row) for row in rows)
    return text.getvalue().encode()


_READERS: Mapping[str, Callable[[str], Any]] = {
    "int": int,
    "float": float,
    "str": str,
    "bool": {"True": True, "False": False}.__getitem__,
}


def _read(path: Path, kind: type[Row], until: int) -> list[Row]:
    """Read the rows of a table up to a step. Raises RecordError if the table cannot be read."""
    try:
        readers = [_READERS[str(f.type)] for f in fields(kind)]
        cells = csv.reader(io.StringIO(read_ordinary(path).decode()))
        next(cells, None)  # the header
        rows = [kind(*(read(cell) for read, cell in zip(readers, row, strict=True))) for row in cells]
    except (OSError, ValueError, KeyError, csv.Error) as error:
        raise RecordError(
            f"{path}: the table cannot be read ({error}). Restore it from an intact copy, or train in another folder. "
            f"The weights in this folder are kept."
        ) from error
    return [row for row in rows if row.step <= until]
