"""Write the documentation page about camera views, with measurements for each task and a picture of the rooms."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from PIL import Image, ImageDraw

import scene_pictures
from betterbench.interface.actions import EE_DELTA
from betterbench.sim.scenes import Renderer, Scene
from betterbench.sim.scenes.appearance import room_of
from betterbench.sim.scenes.framing import (
    BACKGROUND,
    GRIPPER_PX,
    MARGIN_M,
    SIDE_PX,
    VISIBLE,
    FramingView,
    extreme_jitters,
    least_margin_m,
)
from betterbench.sim.scenes.rooms import ROOMS, UNSEEN_ROOMS
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import Looks, Task
from betterbench.tasks.interventions import vary

SEEDS = range(40)
PICTURE_TASK_SIZE = 192
PICTURE_BYTES = 90_000
FIRST_EDITION = "first_edition.jpg"
"""Pictures of the ten tasks in the suite's first edition, in suite order, rendered at commit 00038ed with seed 0."""
EDITIONS_BYTES = 200_000
HEADINGS = (
    "task",
    "gripper at the start [px]",
    "gripper over a slot [px]",
    "least margin [mm]",
    "smallest named object [px]",
    "least visible share",
    "most background",
)


def write(tasks: Sequence[Task], out: Path) -> None:
    """Write the page and its picture into the documentation folder."""
    (out / "framing.md").write_text(page(tasks), encoding="utf-8")
    scene_pictures.save_small(rooms_picture(tasks), out / "pictures" / "rooms.jpg", limit=PICTURE_BYTES)
    editions = editions_picture(tasks, Image.open(out / "pictures" / FIRST_EDITION))
    scene_pictures.save_small(editions, out / "pictures" / "editions.jpg", limit=EDITIONS_BYTES)


def page(tasks: Sequence[Task]) -> str:
    """Return the page, with the worst value of each figure over all conditions of a task and several seeds."""
    rows = [f"| {' | '.join((f'`{task.id}`', *_worst(task)))} |" for task in tasks]
    seen, unseen = (", ".join(room.name for room in rooms) for rooms in (ROOMS, UNSEEN_ROOMS))
    return "\n".join(
        [
            "# Camera framing",
            "",
            (
                "The front camera is at (1.45, 0, 0.95) m and shows the gripper, the table and all objects on it. "
                "The wrist camera is fixed to the gripper and shows both fingertips and the area below them. In an "
                "image of 256 x 256 pixels, at the start of every trial:"
            ),
            "",
            f"- the gripper covers at least {GRIPPER_PX:g} pixels, also at 12 cm above every slot;",
            (
                f"- slots and target regions stay {1e3 * MARGIN_M:g} mm inside the image, for all jitters of slots and "
                "camera;"
            ),
            (
                f"- every named object is at least {SIDE_PX:g} pixels long, and at least "
                f"{100 * VISIBLE:g} % of it is visible, within the image and unoccluded;"
            ),
            f"- at most {100 * BACKGROUND:g} % of the image is background (not table, robot or object).",
            "",
            (
                f"The table gives the worst value over all training conditions and variations and the seeds {SEEDS[0]} "
                f"to {SEEDS[-1]}. `tests/sim/scenes/test_framing.py` checks the limits. For every registered task, "
                "`tests/sim/scenes/test_named_in_view.py` checks that each object and target of an instruction covers "
                "at least 150 pixels at seed 0."
            ),
            "",
            f"| {' | '.join(HEADINGS)} |",
            f"|---|{'---:|' * (len(HEADINGS) - 1)}",
            *rows,
            "",
            "## Before and after",
            "",
            (
                "The pictures show the first training condition of every task at seed 0, in the first edition of the "
                "suite (above) and in the current edition (below)."
            ),
            "",
            "![the ten tasks of the first edition above the ten current tasks](pictures/editions.jpg)",
            "",
            "## Rooms, looks and jitter",
            "",
            (
                "A trial's seed determines its room (table, wall, floor and light), the look of every object kind, the "
                "camera poses (± 1 cm and ± 1° per axis), the key light direction (± 4° per axis) and the arm's "
                "initial pose (± 2 cm per axis, ± 5° about the tool). A trial and its twin share all these "
                "values, and training and test draw from the same distribution."
            ),
            "",
            f"- rooms of training and test: {seen};",
            f"- held-out rooms: {unseen}.",
            "",
            "![one task in every room; the last three are held out](pictures/rooms.jpg)",
            "",
            (
                "`better eval --looks unseen` uses held-out looks of objects and rooms, which do not occur in "
                "demonstrations. The packaged certificate covers the seen looks. `better certify --looks unseen` "
                "makes a certificate for the unseen looks. Runs with different looks cannot be compared."
            ),
            "",
        ]
    )


def _worst(task: Task) -> tuple[str, ...]:
    over: list[int] = []
    gripper, margins, sides, shares, background = [], [], [], [], []
    for condition in (*task.training, *(vary(task, v)[0] for v in task.variations)):
        for seed in SEEDS:
            scene = Scene(task, condition, seed=seed, action_space=EE_DELTA, quality=quality_preset("fast"))
            view = FramingView(scene)
            if not over:
                jitters = tuple(extreme_jitters())[::21]
                over = [view.gripper_over(slot.name, jitter) for slot in task.slots for jitter in jitters]
            framing = view.start()
            view.close()
            gripper.append(framing.gripper_px)
            background.append(framing.background)
            sides += [asked.side_px for asked in framing.asked]
            shares += [asked.visible for asked in framing.asked]
            margins.append(least_margin_m(scene))
    return (
        str(min(gripper)),
        str(min(over)),
        f"{1e3 * min(margins):.0f}",
        f"{min(sides):.0f}",
        f"{100 * min(shares):.0f} %",
        f"{100 * max(background):.0f} %",
    )


def editions_picture(tasks: Sequence[Task], before: Image.Image) -> Image.Image:
    """Return square pictures of the tasks in the first edition, with the current view below each, five per row."""
    side = before.height
    then = [before.crop((side * i, 0, side * (i + 1), side)) for i in range(before.width // side)]
    now = [
        scene_pictures.front_view(task.id, task.training[0].name, 0, 256).resize((side, side), Image.Resampling.LANCZOS)
        for task in tasks
    ]
    columns = len(tasks) // 2
    halves = [images[a : a + columns] for a in (0, columns) for images in (then, now)]
    return scene_pictures.row([image for half in halves for image in half], columns=columns)


def rooms_picture(tasks: Sequence[Task]) -> Image.Image:
    """Return the front view of tasks in every room, starting with the room that a seed of a task draws."""
    shown: tuple[tuple[Looks, tuple[str, ...]], ...] = (
        ("seen", tuple(room.name for room in ROOMS)),
        ("unseen", tuple(room.name for room in UNSEEN_ROOMS)),
    )
    wanted = [(looks, name) for looks, names in shown for name in names]
    views = []
    for number, (looks, name) in enumerate(wanted):
        task = tasks[number % len(tasks)]
        seed = next(s for s in range(1000) if room_of(task.id, s, shown=looks).name == name)
        views.append(_view(task, seed, looks, name))
    return scene_pictures.row(views, columns=4)


def _view(task: Task, seed: int, looks: Looks, name: str) -> Image.Image:
    scene = Scene(
        task, task.training[0], seed=seed, action_space=EE_DELTA, quality=quality_preset("standard"), looks=looks
    )
    with Renderer(scene.model, width=256, height=256, quality=scene.quality) as renderer:
        rgb = renderer.render(scene.data, "front").rgb
    if rgb is None:
        raise AssertionError("colors were requested")
    image = Image.fromarray(rgb).resize((PICTURE_TASK_SIZE, PICTURE_TASK_SIZE), Image.Resampling.LANCZOS)
    ImageDraw.Draw(image).text((4, 3), name, fill=(255, 255, 255), stroke_width=1, stroke_fill=(0, 0, 0))
    return image
