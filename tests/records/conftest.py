"""Episodes made of random numbers: what a record holds matters here, not whether it could happen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from betterbench.geometry import Pose
from betterbench.interface.state import Contact, ObjectInfo, Region, SceneInfo, SlotInfo, WorldState
from betterbench.records import Record, RecordBuilder, RecordMetadata

BODIES = ("left_finger", "right_finger", "hand", "table")


def scene(objects: int) -> SceneInfo:
    infos = tuple(
        ObjectInfo(
            name=f"thing_{i}",
            kind="mug",
            asset=f"mug#{i}",
            category="mug",
            color="red",
            shape="cylinder",
            role="item",
            fixed=False,
            mass_kg=0.1 + i / 3,
            size_m=(0.08, 0.1, 1 / 7),
            regions=(Region("inside", (0.0, 0.0, 0.1), (0.03, 0.03, 0.04)),),
            slot="near",
        )
        for i in range(objects)
    )
    return SceneInfo(infos, (SlotInfo("near", (0.4, -0.1, 0.0), 0.3, ("mug",), ("mug",)),), (0.3, 0.0, 0.4), 0.08)


def metadata(objects: int = 3) -> RecordMetadata:
    return RecordMetadata(
        task="fast_food",
        task_version=1,
        suite_version="1.0",
        package_version="0.1.0",
        condition="R1",
        variation="R1",
        axis="primitive_recomposition",
        base_condition="train1",
        interventions=("do(instruct fries, then drink)",),
        seed=7,
        policy="zoo:inertia",
        instruction="Pack the fries, then the drink — please",
        expected="succeed",
        action_space="ee_delta",
        action_components=("x", "y", "z", "rx", "ry", "rz", "gripper"),
        control_rate_hz=20.0,
        camera_preset=None,
        render_quality=None,
        engine={"mujoco": "3.17.0", "model": "0f" * 16},
        scene_hash="0f" * 16,
        scene=scene(objects),
        predicate_names=("inside(fries, box)", "inside(drink, box)"),
        subgoal_names=("pack_fries", "pack_drink"),
    )


def state(info: SceneInfo, step: int, rng: np.random.Generator) -> WorldState:
    n = len(info.objects)

    def vector(size: int) -> tuple[float, ...]:
        return tuple(rng.normal(size=size).tolist())

    names = BODIES + tuple(o.name for o in info.objects)
    contacts = tuple(
        Contact(*(names[i] for i in rng.integers(0, len(names), 2)), float(rng.exponential()))
        for _ in range(rng.integers(0, 6))
    )
    return WorldState(
        info=info,
        step=step,
        time_s=step * 0.05 + 1e-17,
        positions=tuple(vector(3) for _ in range(n)),
        quaternions=tuple(vector(4) for _ in range(n)),
        linear_speeds=vector(n),
        angular_speeds=vector(n),
        ee_pose=Pose(vector(3), vector(4)),
        commanded_pose=Pose(vector(3), vector(4)),
        finger_width_m=float(rng.uniform()),
        gripper_command=-1.0,
        joint_positions=vector(7),
        joint_velocities=(-0.0, 5e-324, *vector(5)),
        contacts=contacts,
        held=f"thing_{rng.integers(n)}" if n and rng.uniform() < 0.5 else None,
    )


def build(meta: RecordMetadata, rows: int, seed: int = 0, **outcome: object) -> tuple[Record, list[WorldState]]:
    rng = np.random.default_rng(seed)
    builder, states = RecordBuilder(meta), []
    for step in range(rows):
        states.append(state(meta.scene, step, rng))
        action = rng.normal(size=len(meta.action_components))
        builder.append(
            states[-1],
            qpos=rng.normal(size=50),
            qvel=rng.normal(size=47),
            ctrl=rng.normal(size=8),
            act=rng.normal(size=7),
            action=action if step else None,
            applied=action.clip(-1, 1) if step else None,
            predicates=tuple((rng.uniform(size=len(meta.predicate_names)) < 0.5).tolist()),
            subgoals=tuple((rng.uniform(size=len(meta.subgoal_names)) < 0.5).tolist()),
            goal=bool(rng.uniform() < 0.1),
            forbidden=bool(rng.uniform() < 0.1),
        )
    return builder.finish(**{"termination": "step_limit", "success": False, **outcome}), states


@pytest.fixture
def make_metadata() -> Callable[..., RecordMetadata]:
    def make(objects: int = 3, **changes: object) -> RecordMetadata:
        return replace(metadata(objects), **changes)

    return make


@pytest.fixture
def make_state() -> Callable[..., WorldState]:
    return state


@pytest.fixture
def make_record() -> Callable[..., tuple[Record, list[WorldState]]]:
    def make(rows: int = 40, objects: int = 3, seed: int = 0, meta: RecordMetadata | None = None, **outcome: object):
        return build(meta or metadata(objects), rows, seed, **outcome)

    return make
