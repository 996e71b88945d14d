"""Blind test of whether objects are recognizable: draws crops of scenes without names, and scores the answers.

The first command draws numbered crops as the front camera sees them, on sheets of 25. A person who knows neither the
list of categories nor this file writes the name of each marked object, ``{"1": "red mug", "2": "fork", ...}``. The
second command compares the answers and writes the page of the documentation::

    MUJOCO_GL=egl python tools/legibility_sheet.py draw SHEETS
    MUJOCO_GL=egl python tools/legibility_sheet.py judge ANSWERS.json MORE.json --out docs
"""

from __future__ import annotations

import argparse
import json
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from betterbench.interface.actions import EE_DELTA
from betterbench.sim.scenes import Renderer, Scene
from betterbench.sim.scenes.framing import FramingView
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import Condition, Task, get_task, suite_tasks
from betterbench.tasks.interventions import vary

CROPS = 200
PER_SHEET = 25
SIDE_PX = 64
"""Side length of a crop [pixel in a 256 x 256 image]."""
SHOWN_PX = 224
"""Side at which a crop is shown [pixel]."""
SEEN = 0.6
"""Minimum visible fraction of an object for it to be included."""
REQUIRED = 0.95
"""Required share of correct answers."""

ACCEPTED: dict[str, str] = {
    "apple": "apple",
    "block": "block|cube|brick",
    "bun_bottom": "bun|bread|roll",
    "bun_top": "bun|bread|roll",
    "burger": "burger|hamburger|cheeseburger",
    "can": "can|soda|tin|coke|cola",
    "cereal_bowl": "bowl",
    "cheese_slice": "cheese",
    "coffee_machine": "coffee|coffeemaker|espresso",
    "computer_mouse": "mouse",
    "crumpled_napkin": "napkin|tissue|paper|crumpled",
    "crushed_can": "can|soda|tin|coke|cola",
    "cup": "cup|mug|teacup",
    "dinner_plate": "plate|dish",
    "drawer_cabinet": "cabinet|drawer|drawers|chest|organizer",
    "drink_cup": "drink|soda|cup|beverage",
    "egg_cup": "egg",
    "fork": "fork",
    "fries_box": "fries|chips",
    "jam_jar": "jam|jar|jelly|marmalade|honey",
    "keyboard": "keyboard",
    "laptop": "laptop|notebook|computer",
    "lemon": "lemon",
    "lettuce_leaf": "lettuce|leaf|salad|cabbage",
    "lower_drawer": "drawer|drawers|cabinet|chest|organizer",
    "lunchbox": "lunchbox|lunch|box|container|tray|bin",
    "mug": "mug|cup",
    "orange": "orange|tangerine|mandarin|clementine",
    "patty": "patty|meat|burger|hamburger",
    "pill_bottle": "pill|pills|medicine|bottle|vitamin",
    "place_plate": "plate|dish",
    "plain_paprika_jar": "jar|shaker|spice|salt|pepper|paprika|bottle|can",
    "plain_pepper_jar": "jar|shaker|spice|salt|pepper|paprika|bottle|can",
    "plain_salt_jar": "jar|shaker|spice|salt|pepper|paprika|bottle|can",
    "round_block": "block|blocks|peg|cylinder|disc|disk|puck|log|piece|token|checker|stamp",
    "salt_shaker": "salt|shaker|pepper",
    "serving_plate": "plate|dish|platter",
    "shallow_bowl": "bowl",
    "soap_bar": "soap|bar",
    "speaker": "speaker|loudspeaker",
    "spice_jar": "jar|spice|salt|pepper|paprika|shaker|bottle",
    "spice_rack": "rack|holder|stand|block|tray",
    "sponge": "sponge",
    "spoon": "spoon",
    "stapler": "stapler",
    "stapler_block": "block|brick|bar|plank",
    "takeaway_box": "box|takeaway|container|carton|tray",
    "tape_roll": "tape|roll",
    "tumbler": "tumbler|glass",
    "upper_drawer": "drawer|drawers|cabinet|chest|organizer",
    "waste_bin": "bin|trash|trashcan|dustbin|basket|wastebasket|garbage|bucket",
}
"""Words of which an answer must contain one, by category."""

_NOT_A_JAR = "jam|pill|pills|medicine|medication|pharmacy|vitamin|soda|coke|cola|tin"
REFUSED: dict[str, str] = {
    "bun_bottom": "biscuit|cookie|top|upper|lid|patty",
    "bun_top": "biscuit|cookie|bottom|lower|base|patty",
    "burger": "patty|bun",
    "can": "crushed|crumpled|dented|trash|garbage|waste",
    "crumpled_napkin": "can|tin|soda",
    "cup": "glass|tumbler",
    "dinner_plate": "bowl",
    "drink_cup": "can|tin",
    "jam_jar": "salt|pepper|paprika|chili|spice",
    "laptop": "mouse|keyboard",
    "lower_drawer": "upper|top",
    "lunchbox": "trash|waste|garbage|recycling",
    "mug": "glass|tumbler|machine",
    "patty": "cookie|biscuit|cheeseburger",
    "pill_bottle": "salt|pepper|paprika|spice",
    "plain_pepper_jar": "salt|paprika|chili|" + _NOT_A_JAR,
    "plain_paprika_jar": "salt|black|" + _NOT_A_JAR,
    "plain_salt_jar": "pepper|paprika|chili|" + _NOT_A_JAR,
    "round_block": "burger|bun|bread|cookie|cookies|biscuit|food|box",
    "salt_shaker": "pepper|paprika|chili|" + _NOT_A_JAR,
    "serving_plate": "bowl",
    "shallow_bowl": "plate",
    "spice_jar black": "salt|paprika|chili|" + _NOT_A_JAR,
    "spice_jar red": "salt|black|" + _NOT_A_JAR,
    "spice_jar white": "pepper|paprika|chili|" + _NOT_A_JAR,
    "stapler": "block",
    "stapler_block": "stapler",
    "tumbler": "mug|teacup|cup|coffee|tea",
    "upper_drawer": "lower|bottom",
    "waste_bin": "plant|flower|pot|planter|soda|coke|crushed",
}
"""Words that an answer must not contain, by category or by category and color: names of similar objects.
"""

REQUIRED_TOO: dict[str, str] = {
    "coffee_machine": "machine|maker|coffeemaker|espresso",
    "crushed_can": "crushed|crumpled|dented|squashed|bent|flattened|smashed",
    "round_block": "wood|wooden|toy|block|blocks",
    "stapler_block": "wood|wooden|toy|block|brick",
}
"""Words of which an answer must also contain one, if instructions depend on the distinction."""

COLORS = (
    "red|blue|green|yellow|white|black|gray|grey|silver|orange|brown|tan|beige|purple|pink|navy|teal|golden|cyan|maroon"
)
SAME_COLOR: dict[str, str] = {
    "blue": "blue|navy",
    "red": "red|maroon",
    "silver": "silver|gray|grey",
    "gray": "gray|grey|silver",
    "brown": "brown|tan|beige",
}
"""Words that name the same color, where there are several."""

PART_COLORS: dict[str, str] = {
    "egg_cup": r"^(brown|tan|beige|orange) (?=egg in )",
}
"""Colors of a part that people mention before the object itself, by category: the color of the egg in its cup."""


@dataclass(frozen=True, slots=True)
class Crop:
    """One numbered crop and what it shows."""

    number: int
    task: str
    condition: str
    seed: int
    object: str
    category: str
    color: str
    image: Image.Image


def crops(number: int = CROPS) -> list[Crop]:
    """Return crops of all categories in turn, in an order that reveals nothing."""
    rng = np.random.default_rng(20261122)
    places = _places()
    found: list[Crop] = []
    categories = sorted(places)
    while len(found) < number:
        category = categories[len(found) % len(categories)]
        task, condition, name = places[category][int(rng.integers(len(places[category])))]
        crop = _crop(task, condition, name, int(rng.integers(10_000)))
        if crop is not None:
            found.append(crop)
    order = rng.permutation(len(found))
    return [_numbered(found[int(i)], n) for n, i in enumerate(order, start=1)]


def _numbered(crop: Crop, number: int) -> Crop:
    return Crop(number, crop.task, crop.condition, crop.seed, crop.object, crop.category, crop.color, crop.image)


def _places() -> dict[str, list[tuple[Task, Condition, str]]]:
    """Return the occurrences of each category in better60: task, condition and name of the object."""
    places: dict[str, list[tuple[Task, Condition, str]]] = {}
    for task in map(get_task, suite_tasks("better60")):
        for condition in (*task.training, *(vary(task, v)[0] for v in task.variations)):
            for o in condition.objects:
                places.setdefault(o.category, []).append((task, condition, o.name))
    return places


def _crop(task: Task, condition: Condition, name: str, seed: int) -> Crop | None:
    """Return the crop of one object, or None if too little of it is visible."""
    scene = Scene(task, condition, seed=seed, action_space=EE_DELTA, quality=quality_preset("standard"))
    with Renderer(scene.model, width=256, height=256, quality=scene.quality) as renderer:
        view = renderer.render(scene.data, "front", masks=True)
        body = int(scene.compiled.bodies[scene.info.index(name)])
        if view.rgb is None or view.masks is None:
            raise AssertionError("colors and masks were requested")
    framing = FramingView(scene)
    seen = framing.of(name)
    framing.close()
    if seen.visible < SEEN:
        return None
    mask = view.masks == body
    rows, columns = np.nonzero(mask)
    v, u = (rows.min() + rows.max()) / 2.0, (columns.min() + columns.max()) / 2.0
    side = max(SIDE_PX, int(1.25 * max(np.ptp(rows), np.ptp(columns))))
    left, top = (int(np.clip(round(c - side / 2), 0, 256 - side)) for c in (u, v))
    scale = SHOWN_PX / side
    image = Image.fromarray(view.rgb).crop((left, top, left + side, top + side))
    image = image.resize((SHOWN_PX, SHOWN_PX), Image.Resampling.LANCZOS)
    box = [
        scale * (e - o)
        for e, o in zip(
            (columns.min() - 1, rows.min() - 1, columns.max() + 2, rows.max() + 2), (left, top, left, top), strict=True
        )
    ]
    ImageDraw.Draw(image).rectangle([max(0, round(b)) for b in box], outline=(255, 64, 160), width=1)
    o = scene.info.object(name)
    return Crop(0, task.id, condition.name, seed, name, o.category, o.color, image)


def sheets(found: list[Crop]) -> list[Image.Image]:
    """Return the crops on numbered sheets."""
    font = ImageFont.load_default(18)
    pages = []
    for first in range(0, len(found), PER_SHEET):
        page = Image.new("RGB", (5 * (SHOWN_PX + 8) + 8, 5 * (SHOWN_PX + 34) + 8), (250, 250, 248))
        draw = ImageDraw.Draw(page)
        for i, crop in enumerate(found[first : first + PER_SHEET]):
            x, y = 8 + (i % 5) * (SHOWN_PX + 8), 8 + (i // 5) * (SHOWN_PX + 34)
            draw.text((x, y), str(crop.number), fill=(28, 28, 30), font=font)
            page.paste(crop.image, (x, y + 24))
        pages.append(page)
    return pages


def is_right(answer: str, category: str, color: str) -> bool:
    """Return whether a free-form answer is right: it has an accepted word, no rejected word, and no wrong color.

    If several colors are given ("blue and white"), one must be the object's own color. Words after a comma, "with",
    "on" or "in" are about a part ("jam jar, white lid") and are not judged, unless they are only a color ("mug, blue").
    """
    said = re.sub(PART_COLORS[category], "", answer.lower()) if category in PART_COLORS else answer.lower()
    texts = re.split(r",| with | on | in ", said, maxsplit=1)
    whole, *part = (set(re.findall(r"[a-z]+", text)) for text in texts)
    words, colors = whole.union(*part), _set(COLORS)
    if not words & _set(ACCEPTED[category]) or (category in REQUIRED_TOO and not words & _set(REQUIRED_TOO[category])):
        return False
    if any(whole & _set(REFUSED.get(key, "")) for key in (category, f"{category} {color}")):
        return False
    named = whole & colors or {word for of_part in part if of_part <= colors for word in of_part}
    return not named or bool(named & _set(SAME_COLOR.get(color, color)))


def _set(pattern: str) -> set[str]:
    return set(pattern.split("|"))


def page(found: list[Crop], readings: list[dict[str, str]]) -> str:
    """Return the documentation page with every answer from one or more readers."""
    shares, rows = [], []
    for answers in readings:
        count = sum(is_right(answers.get(str(c.number), ""), c.category, c.color) for c in found)
        shares.append(f"{count} of {len(found)} ({100 * count / len(found):.1f} %)")
    for c in found:
        cells = [answers.get(str(c.number), "–") for answers in readings]
        told = [text if is_right(text, c.category, c.color) else f"**no:** {text}" for text in cells]
        rows.append(f"| {c.number} | {c.category} ({c.color}) | {' | '.join(told)} |")
    pages = -(-len(found) // PER_SHEET)
    columns = [f"reader {i + 1}" for i in range(len(readings))]
    return "\n".join(
        [
            "# Recognizable objects",
            "",
            (
                f"This page shows {len(found)} crops of images of the front camera (256 x 256 pixels), in random order "
                "and without names. Readers without the list of categories named each outlined object. "
                f"**Correct answers, one number per reader: {' and '.join(shares)}. The requirement is "
                f"{100 * REQUIRED:.0f} %.** An answer is correct if it "
                "names the object by an everyday word, does not name an object that it must not be confused with, and "
                "does not give a wrong color (colors of parts, as in 'jam jar, white lid', are not judged). "
                "`tools/legibility_sheet.py` draws the sheets and judges the answers."
            ),
            "",
            *(
                f"![crops {PER_SHEET * i + 1} to {PER_SHEET * (i + 1)}](pictures/legibility_{i + 1}.jpg)"
                for i in range(pages)
            ),
            "",
            f"| crop | object | {' | '.join(columns)} |",
            f"|---|---|{'---|' * len(columns)}",
            *rows,
            "",
        ]
    )


def main() -> None:
    """Draw the sheets, or judge answers."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("what", choices=("draw", "judge"))
    parser.add_argument("path", type=Path, nargs="+", help="folder of the sheets, or answer files, one per reader")
    parser.add_argument("--out", type=Path, default=Path("docs"), help="folder of the documentation")
    options = parser.parse_args()
    found = crops()
    if options.what == "draw":
        folder = options.path[0]
        folder.mkdir(parents=True, exist_ok=True)
        for i, sheet in enumerate(sheets(found), start=1):
            sheet.save(folder / f"sheet_{i}.png", optimize=True)
        print(f"wrote {-(-len(found) // PER_SHEET)} sheets to {folder}")
        return
    readings = [json.loads(path.read_text(encoding="utf-8")) for path in options.path]
    for path, answers in zip(options.path, readings, strict=True):
        wrong = [c for c in found if not is_right(answers.get(str(c.number), ""), c.category, c.color)]
        for c in wrong:
            print(f"{c.number}: {c.category} ({c.color}) was named {answers.get(str(c.number), 'nothing')!r}")
        print(f"{path}: {len(found) - len(wrong)} of {len(found)} right")
    pictures = options.out / "pictures"
    pictures.mkdir(parents=True, exist_ok=True)
    for i, sheet in enumerate(sheets(found), start=1):
        sheet.save(pictures / f"legibility_{i}.jpg", quality=72, optimize=True)
    (options.out / "legibility.md").write_text(page(found, readings), encoding="utf-8")


if __name__ == "__main__":
    main()
