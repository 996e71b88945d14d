"""Strangers' LeRobot datasets, made up: many layouts, each clean or with one planted shortcut.

In every dataset a gripper takes something from the left or from the right and brings it to one of two targets. What an
instruction says of it (color, noun, verb, target) is drawn, and so is each place, unless a shortcut is planted:

- ``clean``: nothing goes with anything.
- ``word``: the color decides whether the first place is on the left or on the right.
- ``pair``: color and noun together decide it (red mug and blue bowl on the left), and neither does alone.
- ``and``: the blue bowl is taken from the right, everything else from the left.
- ``three``: color, noun and verb together decide it, and no two of them do.
- ``order``: something is taken from both sides, and color and noun together decide which side comes first.
- ``clean order``: something is taken from both sides, in any order.

In a share of the episodes (``noise``) chance decides in place of the rule.

Run this file to write all of them: ``python tests/demonstrations/shortcuts/strangers.py FOLDER``.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

STEPS = 40
FPS = 10
PLANTED = ("clean", "word", "pair")
TOGETHER = ("pair", "and", "three", "order")
POINTER = b"version https://git-lfs.github.com/spec/v1\noid sha256:" + b"0" * 64 + b"\nsize 12345\n"

ENGLISH = {
    "colors": ("red", "blue"), "nouns": ("mug", "bowl"), "verbs": ("put", "move"), "targets": ("box", "tray"),
    "form": "{verb} the {color} {noun} into the {target}",
}  # fmt: skip
CHINESE = {
    "colors": ("红色", "蓝色"), "nouns": ("杯子", "碗"), "verbs": ("请把", "现在把"), "targets": ("盒子", "托盘"),
    "form": "{verb}桌上{color}的{noun}放进{target}里",
}  # fmt: skip
JAPANESE = {
    "colors": ("赤い", "青い"), "nouns": ("マグカップ", "ボウル"), "verbs": ("取って", "つかんで"),
    "targets": ("箱", "トレイ"), "form": "{color}{noun}を{verb}{target}に入れてください",
}  # fmt: skip
THAI = {
    "colors": ("สีแดง", "สีน้ำเงิน"), "nouns": ("แก้ว", "ชาม"), "verbs": ("หยิบ", "ย้าย"),
    "targets": ("กล่อง", "ถาด"), "form": "{verb}{noun}{color}ไปใส่ใน{target}",
}  # fmt: skip
EMOJI = {
    "colors": ("🔴", "🔵"), "nouns": ("mug", "bowl"), "verbs": ("**Put**", "**Move**"), "targets": ("box", "tray"),
    "form": "{verb} the {color}<b>{noun}</b> into &quot;{target}&quot; ✨",
}  # fmt: skip


@dataclass
class Episode:
    """What happens in an episode: the instruction by frame, and per arm where it is and whether it is closed."""

    texts: list[str]
    ways: dict[str, np.ndarray]
    closed: dict[str, np.ndarray]


@dataclass
class Stranger:
    """A dataset in the making.

    Attributes:
        episodes: What happens.
        draw: Where further numbers are drawn from.
        version: Of the format.
        columns: Numbers per frame (T, n) by column, for each episode.
        names: Value of ``names`` by column.
        texts: Columns of texts, or of numbers of tasks, by name: a text per frame of each episode.
        meta: Further files of ``meta``.
        index: How ``meta/tasks`` is written: ``pandas``, ``columns`` or ``lines``, ``pretty`` (JSON).
        keep: Which episodes are on disk, by number; all if None.
        pointers: Whether the others are pointers of Git LFS.
        number: Number of each episode.
    """

    episodes: list[Episode]
    draw: np.random.Generator
    version: str = "v3.0"
    columns: dict[str, list[np.ndarray]] = field(default_factory=dict)
    names: dict[str, Any] = field(default_factory=dict)
    texts: dict[str, list[list[str]]] = field(default_factory=dict)
    meta: dict[str, bytes] = field(default_factory=dict)
    index: str = "pandas"
    keep: Callable[[int], bool] | None = None
    pointers: bool = False
    number: Callable[[int], int] = int

    def add(self, name: str, values: Callable[[Episode], np.ndarray], names: Any = None) -> None:
        """Add a column of numbers."""
        self.columns[name] = [np.asarray(values(e), dtype=np.float32).reshape(STEPS, -1) for e in self.episodes]
        self.names[name] = names


def happen(
    planted: str,
    seed: int,
    count: int = 120,
    words: Sequence[Mapping[str, Any]] = (ENGLISH,),
    arms: Sequence[str] = ("",),
    *,
    noise: float = 0.0,
) -> list[Episode]:
    """Return what happens in the episodes of a dataset; what is planted concerns the first arm."""
    draw, found = np.random.default_rng(seed), []
    for _ in range(count):
        said = words[int(draw.integers(len(words)))]
        color, noun, verb, target = (int(draw.integers(2)) for _ in range(4))
        chance = int(draw.integers(2))
        rules = {"word": color, "pair": color ^ noun, "and": color & noun, "three": color ^ noun ^ verb}
        side = {**rules, "order": color ^ noun}.get(planted, chance)
        if noise and draw.random() < noise:
            side = int(draw.integers(2))
        text = said["form"].format(
            color=said["colors"][color],
            noun=said["nouns"][noun],
            verb=said["verbs"][verb],
            target=said["targets"][target],
        )
        ways, closed = {}, {}
        for i, arm in enumerate(arms):
            here = side if i == 0 else int(draw.integers(2))
            ways[arm], closed[arm] = _way(draw, here, start=16 + 4 * i if i == 0 else 8)
            if planted.endswith("order"):
                ways[arm], closed[arm] = _two_ways(draw, here)
        found.append(Episode([text] * STEPS, ways, closed))
    return found


def _way(draw: np.random.Generator, side: int, *, start: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a way (T, 3) of picking at frame ``start`` on a side, and where the gripper is closed (T,)."""
    home = np.array([0.5, 0.0, 0.3]) + draw.normal(0, 0.005, 3)
    pick = np.array([0.4, -0.2 if side else 0.2, 0.1]) + draw.normal(0, 0.01, 3)
    drop = np.array([0.6, draw.choice([-0.3, 0.3]), 0.12]) + draw.normal(0, 0.01, 3)
    turn = draw.uniform(0, 2 * np.pi)
    about = home + 0.1 * np.array([np.cos(turn), np.sin(turn), 0.0])
    stop = start + 12
    legs = [(home, about, start // 2), (about, pick, start - start // 2), (pick, drop, 12), (drop, drop, STEPS - stop)]
    way = np.concatenate([np.linspace(a, b, n, endpoint=False) for a, b, n in legs])
    closed = np.zeros(STEPS)
    closed[start:stop] = 1.0
    return way, closed


def _two_ways(draw: np.random.Generator, side: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a way (T, 3) of picking on a side and then on the other one, and where the gripper is closed (T,)."""
    at, legs, closed = np.array([0.5, 0.0, 0.3]) + draw.normal(0, 0.005, 3), [], []
    for here in (side, 1 - side):
        pick = np.array([0.4, -0.2 if here else 0.2, 0.1]) + draw.normal(0, 0.01, 3)
        drop = np.array([0.6, draw.choice([-0.3, 0.3]), 0.12]) + draw.normal(0, 0.01, 3)
        turn = draw.uniform(0, 2 * np.pi)
        about = at + 0.1 * np.array([np.cos(turn), np.sin(turn), 0.0])
        legs += [(at, about, 4), (about, pick, 6), (pick, drop, 8), (drop, drop, 2)]
        closed += [np.zeros(10), np.ones(8), np.zeros(2)]
        at = drop
    return np.concatenate([np.linspace(a, b, n, endpoint=False) for a, b, n in legs]), np.concatenate(closed)


def joints_of(seed: int, count: int = 6) -> Callable[[np.ndarray], np.ndarray]:
    """Return a made-up arm: joints (T, count) of positions (T, 3)."""
    mix = np.random.default_rng(seed).normal(size=(3, count))
    return lambda way: way @ mix


def write(path: Path, made: Stranger) -> Path:
    """Write a dataset, and return its folder."""
    (path / "meta").mkdir(parents=True)
    texts = sorted(
        {text for e in made.episodes for text in e.texts} | {t for c in made.texts.values() for e in c for t in e}
    )
    numbers = {text: i for i, text in enumerate(texts)}
    features: dict[str, Any] = {
        name: {"dtype": "float32", "shape": [values[0].shape[1]], "names": made.names[name]}
        for name, values in made.columns.items()
    }
    features |= {name: {"dtype": "string", "shape": [1], "names": None} for name in made.texts}
    for name in ("episode_index", "frame_index", "task_index"):
        features[name] = {"dtype": "int64", "shape": [1], "names": None}
    features["observation.images.top"] = {
        "dtype": "video",
        "shape": [64, 64, 3],
        "names": ["height", "width", "channel"],
    }
    info = {"codebase_version": made.version, "fps": FPS, "total_episodes": len(made.episodes), "features": features}
    kept = [i for i in range(len(made.episodes)) if made.keep is None or made.keep(i)]
    (path / "meta" / "info.json").write_text(json.dumps(info))
    tables = []
    for i in kept:
        e = made.episodes[i]
        rows = {name: pa.FixedSizeListArray.from_arrays(pa.array(v[i].ravel()), v[i].shape[1]) if v[i].shape[1] > 1
                else pa.array(v[i].ravel()) for name, v in made.columns.items()}  # fmt: skip
        rows |= {name: pa.array(values[i]) for name, values in made.texts.items()}
        rows |= {
            "episode_index": pa.array([made.number(i)] * STEPS), "frame_index": pa.array(range(STEPS)),
            "task_index": pa.array([numbers[text] for text in e.texts]),
        }  # fmt: skip
        tables.append((i, pa.table(rows)))
    _write_frames(path, made, tables)
    _write_tasks(path, made.index, texts)
    for name, data in made.meta.items():
        (path / "meta" / name).write_bytes(data)
    return path


def _write_frames(path: Path, made: Stranger, tables: list[tuple[int, pa.Table]]) -> None:
    folder = path / "data" / "chunk-000"
    folder.mkdir(parents=True)
    if made.version.startswith("v3"):
        half = len(tables) // 2
        for number, part in enumerate((tables[:half], tables[half:])):
            if part:
                pq.write_table(pa.concat_tables([table for _, table in part]), folder / f"file-{number:03d}.parquet")
        return
    for i, table in tables:
        pq.write_table(table, folder / f"episode_{made.number(i):06d}.parquet")
    there = {i for i, _ in tables}
    for i in range(len(made.episodes)) if made.pointers else ():
        if i not in there:
            (folder / f"episode_{made.number(i):06d}.parquet").write_bytes(POINTER)


def _write_tasks(path: Path, form: str, texts: Sequence[str]) -> None:
    forms = [{"task_index": i, "task": text} for i, text in enumerate(texts)]
    file = path / "meta" / "tasks.jsonl"
    if form == "pandas":
        table = pa.table({"task_index": list(range(len(texts))), "__index_level_0__": list(texts)})
        pq.write_table(table, path / "meta" / "tasks.parquet")
    elif form == "columns":
        category = [f"category {i % 3}" for i in range(len(texts))]
        described = [f"a demonstration, number {i}" for i in range(len(texts))]
        table = pa.table(
            {"category": category, "task_index": list(range(len(texts))), "description": described, "task": list(texts)}
        )
        pq.write_table(table, path / "meta" / "tasks.parquet")
    elif form == "pretty":
        body = "\n".join(json.dumps(f, indent=2, ensure_ascii=False) for f in forms).replace("\n", "\r\n")
        file.write_bytes(b"\xef\xbb\xbf" + body.encode() + b"\r\n")
    else:
        file.write_text("".join(json.dumps(f) + "\n" for f in forms))


AXES = ("x", "y", "z")


def _cartesian(
    made: Stranger, grip: Callable[[np.ndarray], np.ndarray] = lambda closed: closed, name: str = "gripper"
) -> None:
    made.add("observation.state", lambda e: np.column_stack([e.ways[""], grip(e.closed[""])]), [*AXES, name])
    made.add(
        "action",
        lambda e: np.column_stack([np.gradient(e.ways[""], axis=0), grip(e.closed[""])]),
        ["dx", "dy", "dz", name],
    )


def tasks_with_further_columns(made: Stranger) -> None:
    """``tasks.parquet`` with category and description before the task."""
    _cartesian(made)
    made.index = "columns"


def pretty_json_and_width(made: Stranger) -> None:
    """Version 2.1, ``tasks.jsonl`` over several lines with BOM and CRLF, a gripper in meters that is wide when open."""
    _cartesian(made, lambda closed: 0.08 - 0.07 * closed)
    made.version, made.index = "v2.1", "pretty"


def so100_joints(made: Stranger) -> None:
    """LeRobot's SO-100: names under ``motors``, degrees, a gripper from 0 (closed) to 100 (open)."""
    names = {
        "motors": [
            f"{n}.pos" for n in ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
        ]
    }
    arm = joints_of(1, 5)

    def vector(e: Episode) -> np.ndarray:
        return np.column_stack([90.0 * arm(e.ways[""]), 95.0 - 85.0 * e.closed[""] + made.draw.normal(0, 1, STEPS)])

    made.add("observation.state", vector, names)
    made.add("action", vector, names)


def aloha(made: Stranger) -> None:
    """Two arms of seven joints each, arm by arm, names under ``motors``."""
    joints = ("waist", "shoulder", "elbow", "forearm_roll", "wrist_angle", "wrist_rotate")
    names = {"motors": [f"{side}_{n}" for side in ("left", "right") for n in (*joints, "gripper")]}
    arms = {"left": joints_of(2), "right": joints_of(3)}

    def vector(e: Episode) -> np.ndarray:
        return np.column_stack([np.column_stack([arms[s](e.ways[s]), 1.0 - e.closed[s]]) for s in ("left", "right")])

    made.add("observation.state", vector, names)
    made.add("action", vector, names)


def interleaved_arms(made: Stranger) -> None:
    """Two arms whose numbers alternate, commands from -1 (open) to 1 (closed)."""
    names = [f"{side}_{n}" for n in (*AXES, "gripper") for side in ("left", "right")]

    def vector(e: Episode) -> np.ndarray:
        sides = [np.column_stack([e.ways[s], 2.0 * e.closed[s] - 1.0]) for s in ("left", "right")]
        return np.stack(sides, axis=2).reshape(STEPS, -1)

    made.add("observation.state", vector, names)
    made.add("action", vector, names)


def nested_arms(made: Stranger) -> None:
    """Two arms as lists of names under a key each."""
    names = {f"{side}_arm": [*AXES, "gripper"] for side in ("left", "right")}

    def vector(e: Episode) -> np.ndarray:
        return np.column_stack([np.column_stack([e.ways[s], e.closed[s]]) for s in ("left", "right")])

    made.add("observation.state", vector, names)
    made.add("action", vector, names)


def openpi_droid(made: Stranger) -> None:
    """openpi's layout of DROID: joints and gripper in columns of their own, one name for all actions."""
    arm = joints_of(4, 7)
    made.add("joint_position", lambda e: arm(e.ways[""]), ["joint_position"])
    made.add("gripper_position", lambda e: e.closed[""], ["gripper_position"])
    made.add("actions", lambda e: np.column_stack([arm(e.ways[""]), e.closed[""]]), ["actions"])
    made.version, made.index = "v2.1", "lines"


def lerobot_droid(made: Stranger) -> None:
    """Position, joints and gripper in columns of their own, each of state and action."""
    arm = joints_of(5, 7)
    for kind in ("observation.state", "action"):
        made.add(f"{kind}.joint_position", lambda e: arm(e.ways[""]), None)
        made.add(f"{kind}.cartesian_position", lambda e: np.column_stack([e.ways[""], 0.0 * e.ways[""]]),
                 {"axes": [*AXES, "roll", "pitch", "yaw"]})  # fmt: skip
        made.add(f"{kind}.gripper_position", lambda e: e.closed[""], None)


def humanoid(made: Stranger) -> None:
    """26 joints of a humanoid whose last ones are a waist and a neck; the grippers stand in the middle."""
    joints = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_roll", "wrist_pitch", "wrist_yaw")
    names = [f"{side}_{n}_joint" for side in ("left", "right") for n in joints]
    names += ["left_gripper", "right_gripper"] + [
        f"{s}_{n}_joint" for s in ("left", "right") for n in ("hip", "knee", "ankle")
    ]
    names += ["neck_yaw_joint", "neck_pitch_joint", "waist_roll_joint", "waist_yaw_joint"]
    arms = {"left": joints_of(6, 7), "right": joints_of(7, 7)}

    def vector(e: Episode) -> np.ndarray:
        sides = [arms[s](e.ways[s]) for s in ("left", "right")]
        grips = [e.closed[s] for s in ("left", "right")]
        body = made.draw.normal(0, 0.3, (1, 10)) + np.outer(np.linspace(0, 1, STEPS), made.draw.normal(size=10))
        return np.column_stack([*sides, *grips, body])

    made.add("observation.state", vector, names)
    made.add("action", vector, names)


def humanoid_with_hands(made: Stranger) -> None:
    """A humanoid whose hands have fingers and thumbs, the last numbers; there is no gripper."""
    joints = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_roll", "wrist_pitch", "wrist_yaw")
    fingers = ("index_0", "index_1", "middle_0", "middle_1", "thumb_0", "thumb_1", "thumb_2")
    names = [f"{side}_{n}_joint" for side in ("left", "right") for n in (*joints, *(f"hand_{f}" for f in fingers))]
    arms = {"left": joints_of(6, 7), "right": joints_of(7, 7)}

    def vector(e: Episode) -> np.ndarray:
        return np.column_stack(
            [np.column_stack([arms[s](e.ways[s]), np.outer(e.closed[s], np.ones(7))]) for s in ("left", "right")]
        )

    made.add("observation.state", vector, names)
    made.add("action", vector, names)


def modality(made: Stranger) -> None:
    """GR00T's ``modality.json`` over vectors without names; the gripper stands first in the actions."""
    made.add(
        "observation.state",
        lambda e: np.column_stack([e.closed[""], e.closed[""] * 0.0, e.ways[""], made.draw.normal(size=(STEPS, 3))]),
    )
    made.add(
        "action",
        lambda e: np.column_stack([e.closed[""], np.gradient(e.ways[""], axis=0), made.draw.normal(size=(STEPS, 3))]),
    )
    form = {
        "state": {
            name: {"start": start, "end": end}
            for name, start, end in (("gripper", 0, 1), ("pad", 1, 2), ("eef_position", 2, 5), ("eef_rotation", 5, 8))
        },
        "action": {
            name: {"start": start, "end": end}
            for name, start, end in (("gripper_close", 0, 1), ("eef_delta_position", 1, 4), ("eef_delta_turn", 4, 7))
        },
        "annotation": {"human.action.task_description": {"original_key": "task_index"}},
    }  # fmt: skip
    made.meta["modality.json"] = json.dumps(form).encode()
    made.version, made.index = "v2.1", "lines"


def several_states(made: Stranger) -> None:
    """Joints, the pose of the end effector, velocities and the environment in columns of their own."""
    arm = joints_of(8, 7)
    made.add("observation.state", lambda e: np.column_stack([arm(e.ways[""]), 0.04 - 0.03 * e.closed[""]]),
             [*(f"joint_{i}" for i in range(7)), "gripper_width"])  # fmt: skip
    made.add("observation.environment_state", lambda _: made.draw.normal(size=(STEPS, 3)), ["x", "y", "z"])
    made.add("observation.ee_pose", lambda e: np.column_stack([e.ways[""], made.draw.normal(size=(STEPS, 4))]))
    made.add("observation.velocity", lambda _: made.draw.normal(size=(STEPS, 7)))
    made.add("action", lambda e: arm(e.ways[""]), [f"joint_{i}" for i in range(7)])


def degrees_and_swapped(made: Stranger) -> None:
    """A gripper in degrees that is closed at the low end, with noise, beside names in a map of numbers."""
    _cartesian(made, lambda closed: 40.0 - 35.0 * closed + made.draw.normal(0, 1.0, STEPS))
    made.names["action"] = {"dx": 0, "dy": 1, "dz": 2, "gripper": 3}


def plain(made: Stranger) -> None:
    """Positions by name, version 3.0."""
    _cartesian(made)


def texts_by_frame(made: Stranger) -> None:
    """The instruction as a text per frame; the file of tasks holds codes."""
    _cartesian(made)
    made.texts["language_instruction"] = [list(e.texts) for e in made.episodes]
    for i, e in enumerate(made.episodes):
        e.texts = [f"task code {i % 3}"] * STEPS


def segments(made: Stranger) -> None:
    """The instruction changes within an episode: half of the episodes first reach out, then are told what to take."""
    _cartesian(made)
    for e in made.episodes[::2]:
        e.texts = ["reach out"] * 6 + e.texts[6:]


def odd_numbers(made: Stranger) -> None:
    """Every second episode was removed, and the others kept their numbers."""
    _cartesian(made)
    made.number = lambda i: 2 * i + 1


def mostly_pointers(made: Stranger) -> None:
    """Some episodes were downloaded, and the others are pointers of Git LFS."""
    _cartesian(made)
    made.version, made.index, made.pointers = "v2.1", "lines", True
    made.keep = lambda i: i % 4 != 0


def sometimes_never_closed(made: Stranger) -> None:
    """The gripper does not close in a tenth of the episodes."""
    for e in made.episodes[::10]:
        e.closed[""][:] = 0.0
    _cartesian(made)


@dataclass(frozen=True)
class Layout:
    """A layout of strangers' datasets.

    Attributes:
        make: Adds the columns.
        words: Languages of the instructions.
        arms: Arms that there are.
        options: What the command needs beside the folder, for what names do not tell.
        refused: Part of the message with which it is refused without options, "" if it is read.
    """

    make: Callable[[Stranger], None]
    words: tuple[Mapping[str, Any], ...] = (ENGLISH,)
    arms: tuple[str, ...] = ("",)
    options: tuple[str, ...] = ()
    refused: str = ""


def no_names(made: Stranger) -> None:
    """Vectors without any names."""
    _cartesian(made)
    made.names = dict.fromkeys(made.names)


def begins_anywhere(made: Stranger) -> None:
    """A gripper whose name, numbers and first frames do not tell which end is the closed one."""
    for e in made.episodes[::2]:
        e.closed[""][:4] = 1.0
    _cartesian(made)


TWO = ("left", "right")
LAYOUTS = {
    "plain": Layout(plain),
    "tasks with further columns": Layout(tasks_with_further_columns),
    "pretty JSON, width": Layout(pretty_json_and_width),
    "SO-100": Layout(so100_joints),
    "ALOHA": Layout(aloha, arms=TWO),
    "two arms, interleaved": Layout(interleaved_arms, arms=TWO),
    "two arms, nested": Layout(nested_arms, arms=TWO),
    "openpi's DROID": Layout(openpi_droid),
    "LeRobot's DROID": Layout(lerobot_droid),
    "humanoid": Layout(humanoid, arms=TWO),
    "humanoid with hands": Layout(
        humanoid_with_hands,
        arms=TWO,
        refused="belong to hands with several joints",
        options=("--gripper", "action:left_hand_thumb_0_joint", "action:right_hand_thumb_0_joint"),
    ),
    "modality.json": Layout(modality),
    "several states": Layout(several_states),
    "degrees, low is closed": Layout(degrees_and_swapped),
    "Chinese": Layout(plain, (CHINESE,)),
    "Japanese": Layout(plain, (JAPANESE,)),
    "Thai": Layout(plain, (THAI,)),
    "emoji and markup": Layout(plain, (EMOJI,)),
    "English and Chinese": Layout(plain, (ENGLISH, CHINESE)),
    "texts by frame": Layout(texts_by_frame, options=("--instruction", "language_instruction")),
    "segments": Layout(segments),
    "odd numbers": Layout(odd_numbers),
    "mostly pointers": Layout(mostly_pointers),
    "sometimes never closed": Layout(sometimes_never_closed),
    "no names": Layout(
        no_names,
        refused="its components have no names",
        options=("--gripper", "action[3]", "--place", "observation.state[0,1,2]"),
    ),
    "begins anywhere": Layout(
        begins_anywhere, refused="the closed end of .* cannot be determined", options=("--closed", "high")
    ),
}


def make(
    path: Path,
    name: str,
    planted: str,
    *,
    seed: int = 0,
    count: int = 160,
    noise: float = 0.0,
    change: Mapping[str, Any] | None = None,
) -> Path:
    """Write a dataset of a layout, and return its folder."""
    layout = LAYOUTS[name]
    episodes = happen(planted, seed, count, layout.words, layout.arms, noise=noise)
    made = Stranger(episodes, np.random.default_rng(seed + 1))
    layout.make(made)
    return write(path, replace(made, **(change or {})))


def main() -> None:
    """Write every layout with everything that can be planted."""
    for name in LAYOUTS:
        for planted in PLANTED:
            print(make(Path(sys.argv[1]) / f"{name} {planted}", name, planted))  # noqa: T201


if __name__ == "__main__":
    main()
