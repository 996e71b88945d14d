"""Draw random questions of a set over their images, for inspection by a person.

Example:
    python tools/vqa_sheet.py sets/expert sheet.png --count 20
"""

from __future__ import annotations

import argparse
import textwrap
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from betterbench.vqa.dataset import read_set
from betterbench.vqa.question import Form, Question

WIDTH, TEXT, COLUMNS = 300, 150, 5
INK, SOFT, RIGHT = (24, 26, 30), (110, 112, 118), (20, 120, 60)


def panel(folder: Path, question: Question) -> Image.Image:
    """Return the image of a question with its box or point drawn, and question and answer below."""
    image = Image.open(folder / question.image).convert("RGB").resize((WIDTH, WIDTH))
    draw, scale = ImageDraw.Draw(image), WIDTH / question.width
    if question.box is not None:
        draw.rectangle([v * scale for v in question.box], outline=(255, 64, 160), width=2)
    if question.form is Form.POINT:
        x, y = (float(v) * scale for v in question.answer.strip("[]").split(","))
        draw.ellipse((x - 4, y - 4, x + 4, y + 4), fill=(255, 230, 0), outline=(0, 0, 0))
    sheet = Image.new("RGB", (WIDTH, WIDTH + TEXT), "white")
    sheet.paste(image, (0, 0))
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(12)
    lines = [line for part in question.prompt.splitlines() for line in textwrap.wrap(part, 46)]
    y = WIDTH + 4
    told = f"{question.source.task}/{question.source.condition} {question.source.camera} · {question.difficulty.value}"
    answer = [(f"= {line}", RIGHT) for line in textwrap.wrap(question.reply, 44)]
    for text, color in [(told, SOFT), *((line, INK) for line in lines[:8]), *answer]:
        draw.text((4, y), text, fill=color, font=font)
        y += 14
    return sheet


def main() -> None:
    """Draw a sheet."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("set", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    questions = read_set(given.set).questions
    chosen = np.random.default_rng(given.seed).permutation(len(questions))[: given.count]
    panels = [panel(given.set, questions[i]) for i in chosen]
    rows = -(-len(panels) // COLUMNS)
    sheet = Image.new("RGB", (COLUMNS * (WIDTH + 8), rows * (WIDTH + TEXT + 8)), (225, 225, 228))
    for n, drawn in enumerate(panels):
        sheet.paste(drawn, (n % COLUMNS * (WIDTH + 8), n // COLUMNS * (WIDTH + TEXT + 8)))
    sheet.save(given.out)


if __name__ == "__main__":
    main()
