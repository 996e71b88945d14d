"""Task folders in the format of the BeTTER release, written for tests; all content is our own."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import yaml

BOX, APPLE, ORANGE, LEMON, BLOCK, CAN = "box_1", "apple_1", "orange_1", "lemon_1", "block_1", "can_1"


def pose(x: float, y: float, turn: tuple[float, float] = (1.0, 0.0), **more: Any) -> dict[str, Any]:
    """Returns a start pose; ``turn`` are the first and the last number of its quaternion."""
    return {"position": [x, y, 0.02], "rotation": [turn[0], 0.0, 0.0, turn[1]], "scale": [1.0, 1.0, 1.0], **more}


def thing(name: str, noun: str, query: str, description: str = "", **more: Any) -> dict[str, Any]:
    described = description or f"One {query} for the picnic."
    return {"instance_id": name, "semantic_name": noun, "description": described, "retrieval_query": query, **more}


LAYOUT = {
    BOX: pose(0.55, 0.0),
    APPLE: pose(0.40, -0.24),
    ORANGE: pose(0.40, 0.24),
    LEMON: pose(0.66, -0.22),
    CAN: pose(0.66, 0.22),
}


def lunch() -> dict[str, Any]:
    """Returns a task without any fault, by file: two training variations, and one test variation that exchanges two."""
    ours = {
        "task.yaml": {
            "task_id": "Picnic",
            "template_type": "loose_packing",
            "description": "A box is packed for a picnic.",
            "instruction": "Put the apple and the orange into the box.",
            "defaults": {
                "container_instance_id": BOX,
                "primary_goal_relation": "in",
                "allowed_goal_relations": ["in"],
                "fail_policy": {"distractor_relation_to_container_is_fail": True, "fail_on_relations": ["in", "on"]},
            },
            "variation_registry": {"train": ["TV-01", "TV-02"], "eval": ["EV-01"]},
        },
        "object_universe.yaml": {
            "container": [thing(BOX, "takeaway_box", "takeaway box", role="container")],
            "goal_objects": [
                thing(APPLE, "apple", "red apple"),
                thing(ORANGE, "orange", "orange"),
                thing(LEMON, "lemon", "lemon"),
            ],
            "fail_objects": [thing(CAN, "can", "can"), thing(BLOCK, "block", "red block")],
            "decor_objects": [],
        },
        "asset_bindings.yaml": {
            "task_id": "Picnic",
            "bindings": {
                name: {
                    "semantic_name": name,
                    "candidates": [{"source_uid": f"{name}-a", "registry_usd": f"loose_packing/{name}.usd"}],
                }
                for name in (BOX, APPLE, ORANGE, LEMON, BLOCK, CAN)
            },
        },
        "base_variation.yaml": {
            "variation_id": "BASE",
            "goal_relation": "in",
            "container_instance_id": BOX,
            "set_goal_objects": [APPLE, ORANGE],
            "set_fail_objects": [CAN, LEMON],
            "set_decor_objects": [],
            "pose_overrides": LAYOUT,
        },
        "variations/TV-01.yaml": {"variation_id": "TV-01", "extends": "BASE", "enabled": True},
        "variations/TV-02.yaml": {
            "variation_id": "TV-02",
            "extends": "BASE",
            "instruction": "Put the apple and the lemon into the box.",
            "add_goal_objects": [LEMON],
            "remove_goal_objects": [ORANGE],
            "add_fail_objects": [ORANGE],
            "remove_fail_objects": [LEMON],
        },
        "variations/EV-01.yaml": {
            "variation_id": "EV-01",
            "extends": "BASE",
            "pose_overrides": {APPLE: LAYOUT[ORANGE], ORANGE: LAYOUT[APPLE]},
        },
    }
    return copy.deepcopy(ours)


def write_task(folder: Path, files: dict[str, Any]) -> Path:
    """Writes files; a text is written as it is."""
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        text = content if isinstance(content, str) else yaml.dump(content, Dumper=yaml.CSafeDumper, sort_keys=False)
        (folder / name).write_text(text)
    return folder


def clone(folder: Path, files: dict[str, Any], template: dict[str, Any] | None = None) -> Path:
    """Writes a clone of the release with one task."""
    write_task(folder / "assets" / "tasks" / "loose_packing" / "Picnic", files)
    if template is not None:
        write_task(folder / "assets" / "task_templates", {"loose_packing.yaml": template})
    return folder
