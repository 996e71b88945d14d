"""Draw the picture of the SO-101 for docs/so101.md: two views of the arm, and its camera images during a pick.

    PYTHONPATH=. python tools/so101_picture.py --out docs/pictures/so101.jpg

The scene is the one of the arm's tests (``tests/sim/robots/so101_table.py``).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import mujoco
import numpy as np
from PIL import Image
from tests.sim.robots.so101_table import places, table

from betterbench.interface.actions import SO101_DEGREES
from betterbench.policies.experts import make_expert
from betterbench.sim.robots import build_robot_spec
from betterbench.sim.robots.so101 import SO101
from betterbench.sim.scenes import Renderer, quality_preset
from betterbench.sim.scenes.stage import add_camera, stage_spec

SIZE = 420
SEED = 3
SHOWN_M = 0.09
"""Height at which the lifted lemon is shown [m]."""


def arm_alone() -> list[np.ndarray]:
    """Return two views of the arm on an empty table."""
    quality = quality_preset("high")
    stage = stage_spec(quality, front=SO101.front_camera)
    stage.worldbody.add_frame().attach_body(build_robot_spec("so101").worldbody.first_body(), "robot/", "")
    add_camera(stage.worldbody, "side", (0.16, -0.72, 0.22), (0.12, 0.0, 0.11), fovy_deg=30)
    add_camera(stage.worldbody, "oblique", (0.62, 0.42, 0.34), (0.11, 0.0, 0.10), fovy_deg=30)
    model = stage.compile()
    data = mujoco.MjData(model)
    posture = dict(zip(SO101.arm_joints, (0.0, -0.9, 0.9, 0.9, -1.5), strict=True))
    for joint, angle in (posture | {"gripper": SO101.jaw.joints_at(0.05)[0]}).items():
        data.joint(f"robot/{joint}").qpos[0] = angle
    mujoco.mj_forward(model, data)
    with Renderer(model, width=SIZE, height=SIZE, quality=quality) as renderer:
        return [np.asarray(renderer.render(data, camera).rgb) for camera in ("side", "oblique")]


def picking() -> list[np.ndarray]:
    """Return the front and the wrist image when the expert has lifted the lemon."""
    scene = table(SEED, SO101_DEGREES, fruit=places(SEED + 1)[SEED])
    state, expert = scene.state(), make_expert("expert", scene)
    while state.position("lemon")[2] < SHOWN_M:
        scene.step(expert.act_on_state(state))
        state = scene.state()
    with Renderer(scene.model, width=SIZE, height=SIZE, quality=quality_preset("high")) as renderer:
        return [np.asarray(renderer.render(scene.data, camera).rgb) for camera in ("front", "wrist")]


def main() -> None:
    """Write the picture."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("docs/pictures/so101.jpg"), help="file of the picture")
    wanted = parser.parse_args()
    Image.fromarray(np.hstack([*arm_alone(), *picking()])).save(wanted.out, quality=82)


if __name__ == "__main__":
    main()
