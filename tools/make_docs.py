"""Make the generated part of the documentation: task cards with pictures, and the sheet of the asset library."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from PIL import Image

import library_sheet
from betterbench.assets import categories, colours, looks
from betterbench.evaluation import show_comparison, show_training
from betterbench.tasks import Task, Variation, all_tasks, regime_of

HERO = (("morning_coffee", "O1"), ("fast_food", "T1"))
QUALITY = 85


def main() -> None:
    """Write everything below the folder that the command line names."""
    parser = argparse.ArgumentParser(description="Make the generated part of the documentation.")
    parser.add_argument("--out", type=Path, default=Path("docs"), help="folder of the documentation")
    parser.add_argument("--seed", type=int, default=1, help="seed of the pictures")
    arguments = parser.parse_args()
    pictures = arguments.out / "pictures"
    pictures.mkdir(parents=True, exist_ok=True)
    cards = [card for task in all_tasks() for card in (_task_card(task, pictures, arguments.seed),)]
    (arguments.out / "tasks.md").write_text("\n".join(["# Tasks and variations", "", *cards]), encoding="utf-8")
    _stack([show_comparison(t, v, seed=arguments.seed, size=360) for t, v in HERO]).save(
        pictures / "hero.jpg", quality=QUALITY
    )
    pairs = [show_comparison(t.id, v.name, seed=arguments.seed, size=256) for t in all_tasks() for v in t.variations]
    _stack(pairs, columns=2).save(pictures / "contact_sheet.jpg", quality=QUALITY)
    library_sheet.sheet(categories()).convert("RGB").save(pictures / "library.jpg", quality=QUALITY)
    (arguments.out / "assets.md").write_text(_library_page(), encoding="utf-8")
    sys.stdout.write(f"wrote {arguments.out}/tasks.md, {arguments.out}/assets.md and {pictures}\n")


def _task_card(task: Task, pictures: Path, seed: int) -> str:
    training = pictures / f"{task.id}_training.jpg"
    show_training(task.id, seed=seed, size=320).save(training, quality=QUALITY)
    regime = regime_of(task)
    lines = [
        f"## {task.title}",
        "",
        f"`{task.id}`, version {task.version}, template {task.template.title}. {task.description}",
        "",
        f"![training regime](pictures/{training.name})",
        "",
        "What training teaches besides the task: "
        + "; ".join(f"“{word}” is picked at {' or '.join(slots)}" for word, slots in regime.word_slots.items())
        + ".",
        "",
    ]
    for variation in task.variations:
        lines += _variation_card(task, variation, pictures, seed)
    return "\n".join(lines)


def _variation_card(task: Task, variation: Variation, pictures: Path, seed: int) -> list[str]:
    path = pictures / f"{task.id}_{variation.name}.jpg"
    show_comparison(task.id, variation.name, seed=seed, size=360).save(path, quality=QUALITY)
    return [
        f"### {variation.name}: {variation.title}",
        "",
        f"![training scene beside test scene](pictures/{path.name})",
        "",
        f"- axis: {variation.axis.value.replace('_', ' ')}; derived from `{variation.base}` by "
        + ", ".join(f"`{i}`" for i in variation.interventions),
        f"- hypothesis: {variation.hypothesis}",
        f"- expected: {variation.expected.value.replace('_', ' ')}; support: {variation.support.value}",
        f"- can expose: {', '.join(f'`{label}`' for label in variation.exposes)}",
        "",
    ]


def _library_page() -> str:
    rows = [f"| `{name}` | {len(looks(name))} | {', '.join(colours(name))} |" for name in categories()]
    return "\n".join(
        [
            "# Asset library",
            "",
            "Every object is made by a parametric generator of our own; one description gives many looks.",
            "",
            "![every asset and its looks](pictures/library.jpg)",
            "",
            "| asset | looks | colours |",
            "|---|---|---|",
            *rows,
            "",
        ]
    )


def _stack(images: list[Image.Image], *, columns: int = 1) -> Image.Image:
    width = max(image.width for image in images)
    height = max(image.height for image in images)
    rows = -(-len(images) // columns)
    page = Image.new("RGB", (width * columns, height * rows), (250, 250, 248))
    for i, image in enumerate(images):
        page.paste(image, ((i % columns) * width, (i // columns) * height))
    return page


if __name__ == "__main__":
    main()
