"""Generate documentation: the pages about tasks and templates with pictures, and the page about the asset library."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from PIL import Image

import calibration_page
import framing_page
import library_sheet
import real_setup_tables
import scene_pictures
import schema_page
import task_pages
import threshold_page
from betterbench.evaluation import show_comparison
from betterbench.sim.assets import categories, colors, looks, unseen_looks
from betterbench.tasks import Task, all_tasks, suite_tasks
from betterbench.tasks.interventions import vary

HERO = (("morning_coffee", "O1"), ("fast_food", "T1"))
SHEET_BYTES = 900_000
"""Largest size of the two sheets that show everything."""


def main() -> None:
    """Write all pages and pictures below the folder given by ``--out``."""
    parser = argparse.ArgumentParser(description="Make the generated part of the documentation.")
    parser.add_argument("--out", type=Path, default=Path("docs"), help="folder of the documentation")
    parser.add_argument("--seed", type=int, default=0, help="seed of the pictures")
    parser.add_argument("--tasks", nargs="*", default=None, help="write the pages of these tasks only")
    arguments = parser.parse_args()
    tasks = in_order(all_tasks())
    for task in tasks:
        if arguments.tasks is None or task.id in arguments.tasks:
            write_task(task, arguments.out, seed=arguments.seed)
    if arguments.tasks is None:
        write_overviews(tasks, arguments.out, seed=arguments.seed)
        calibration_page.write(arguments.out)
        threshold_page.write(arguments.out)
        schema_page.write(arguments.out)
        real_setup_tables.write(arguments.out)
    sys.stdout.write(f"wrote the pages of {len(arguments.tasks or tasks)} tasks below {arguments.out}\n")


def in_order(tasks: tuple[Task, ...]) -> list[Task]:
    """Return tasks in the order of the suite's table, followed by all other registered tasks."""
    order = list(suite_tasks("better60"))
    return sorted(tasks, key=lambda t: (order.index(t.id) if t.id in order else len(order), t.id))


def write_task(task: Task, out: Path, *, seed: int) -> None:
    """Write the page of a task and its pictures."""
    pictures = out / "pictures"
    pictures.mkdir(parents=True, exist_ok=True)
    (out / "tasks").mkdir(exist_ok=True)
    (out / "tasks" / f"{task.id}.md").write_text(task_pages.task_page(task), encoding="utf-8")
    views = [scene_pictures.front_view(task.id, c.name, seed, 256) for c in task_pages.settings_of(task).values()]
    small = len(views) > 2
    shown = [view.resize((172, 172), Image.Resampling.LANCZOS) for view in views] if small else views
    scene_pictures.save_small(
        scene_pictures.row(shown, columns=3 if small else None), pictures / f"{task.id}_training.jpg"
    )
    for variation in task.variations:
        both = scene_pictures.pair(task, variation, seed=seed, size=256)
        scene_pictures.save_small(both, pictures / f"{task.id}_{variation.name}.jpg")


def write_overviews(tasks: list[Task], out: Path, *, seed: int) -> None:
    """Write the pages and pictures about all tasks and all assets."""
    pictures = out / "pictures"
    (out / "tasks.md").write_text(task_pages.index_page(tasks), encoding="utf-8")
    (out / "templates.md").write_text(task_pages.templates_page(tasks), encoding="utf-8")
    (out / "assets.md").write_text(library_page(tasks), encoding="utf-8")
    hero = [show_comparison(t, v, seed=seed, size=360) for t, v in HERO]
    scene_pictures.save_small(scene_pictures.row(hero, columns=1), pictures / "hero.jpg", limit=100_000)
    home = show_comparison(*HERO[0], seed=seed, size=300)
    scene_pictures.save_small(home, pictures / "home.jpg", limit=50_000)
    suite = [t for t in tasks if t.id in suite_tasks("better60")]
    sheet = scene_pictures.contact_sheet(suite, seed=seed)
    scene_pictures.save_small(sheet, pictures / "contact_sheet.jpg", limit=SHEET_BYTES)
    framing_page.write(suite, out)
    library = library_sheet.sheet(categories())
    scene_pictures.save_small(library, pictures / "library.jpg", limit=SHEET_BYTES)


def library_page(tasks: list[Task]) -> str:
    """Return the asset library page, which lists the tasks that use each asset."""
    used: dict[str, list[str]] = {}
    for task in tasks:
        conditions = [*task.training, *(vary(task, v)[0] for v in task.variations)]
        for category in sorted({o.category for c in conditions for o in c.objects}):
            used.setdefault(category, []).append(f"[{task.id}](tasks/{task.id}.md)")
    rows = []
    for name in categories():
        counts = f"{len(looks(name))} + {len(unseen_looks(name))}"
        rows.append(f"| `{name}` | {counts} | {', '.join(colors(name))} | {', '.join(used.get(name, ['–']))} |")
    return "\n".join(
        [
            "# Asset library",
            "",
            (
                "Every object is made by a parametric generator. A category is one function, and each look is the "
                "function's result for a different seed. The seed of the trial determines the look, and the condition "
                "determines the color. The number after the plus sign is the number of looks that are held out for "
                f"`--looks unseen`. There are {len(rows)} categories. The picture shows three looks of each category "
                "in its default color. If a category has several colors, it also shows one look in another color."
            ),
            "",
            "![every asset and some of its looks](pictures/library.jpg)",
            "",
            "| asset | looks | colors | used by |",
            "|---|---|---|---|",
            *rows,
            "",
        ]
    )


if __name__ == "__main__":
    main()
