"""CALVIN's process with the real PyBullet and Hydra, in a checkout that is laid out as calvin_env and is none of it.

It needs ``better worlds install calvin``, or ``BETTER_CALVIN_PYTHON``, a Python with the same packages.
"""

import os
import shutil
import subprocess

import numpy as np
import pytest

from betterbench.evaluation.planning.world_plan import make_world_plan
from betterbench.interface.actions import CALVIN_RELATIVE
from betterbench.sim.worlds import WorldProcesses, world_named
from betterbench.sim.worlds.installation import start_code
from betterbench.sim.worlds.process import WorldError
from betterbench.tasks.worlds.calvin import calvin_chains, start_of

CAMERA = "calvin_env.envs.play_table_env.Camera"

CONF = {
    "config_data_collection.yaml": """
seed: 0
data_path: data
defaults:
  - cameras: no_cameras
  - env: play_table_env
  - scene: calvin_scene_D
  - robot: panda_longer_finger
  - override hydra/job_logging: colorlog
  - override hydra/hydra_logging: colorlog
""",
    "cameras/no_cameras.yaml": "{}\n",
    "cameras/static_and_gripper.yaml": "defaults:\n  - cameras@static: static\n  - cameras@gripper: gripper\n",
    "cameras/cameras/static.yaml": f"_target_: {CAMERA}\nname: static\nwidth: 200\nheight: 200\n",
    "cameras/cameras/gripper.yaml": f"_target_: {CAMERA}\nname: gripper\nwidth: 84\nheight: 84\n",
    "env/play_table_env.yaml": """
_target_: calvin_env.envs.play_table_env.PlayTableSimEnv
_recursive_: false
cameras: ${cameras}
scene_cfg: ${scene}
robot_cfg: ${robot}
use_vr: true
show_gui: true
use_scene_info: false
use_egl: true
""",
    "robot/panda_longer_finger.yaml": "euler_obs: true\n",
    "scene/calvin_scene_D.yaml": """
objects:
  movable_objects:
    block_red: {file: blocks/block_red_middle.urdf, initial_pos: any, initial_orn: any}
    block_blue: {file: blocks/block_blue_small.urdf, initial_pos: any, initial_orn: any}
    block_pink: {file: blocks/block_pink_big.urdf, initial_pos: any, initial_orn: any}
""",
}

ENVIRONMENT = """
import numpy as np
import hydra
import pybullet
import pybullet_utils.bullet_client as bc
from pathlib import Path
from types import SimpleNamespace

SIZES = {"small": (0.05, 0.05, 0.05), "middle": (0.07, 0.05, 0.05), "big": (0.1, 0.05, 0.05)}

class Camera:
    def __init__(self, name, width, height):
        self.name, self.width, self.height = name, width, height

class Thing:
    def __init__(self, p, name, uid):
        self.p, self.name, self.uid = p, name, uid

class PlayTableSimEnv:
    def __init__(self, cameras, scene_cfg, robot_cfg, use_vr, show_gui, use_scene_info, use_egl):
        assert not use_vr and not show_gui and use_scene_info
        self.p, self.cid = bc.BulletClient(connection_mode=pybullet.DIRECT), 0
        p = self.p
        p.setGravity(0, 0, -9.8)
        shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.4, 0.3, 0.218])
        table = Thing(p, "table", p.createMultiBody(0, shape, basePosition=[0, 0, 0.218]))
        blocks = []
        for name, cfg in scene_cfg.objects.movable_objects.items():
            size = [0.4 * s for s in SIZES[Path(cfg.file).stem.rpartition("_")[2]]]
            shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=size)
            blocks.append(Thing(p, name, p.createMultiBody(1.0, shape, basePosition=[0, 0, 1 + len(blocks)])))
        self.cameras = [hydra.utils.instantiate(cameras[name]) for name in cameras]
        self.scene = SimpleNamespace(movable_objects=blocks, buttons=[], get_objects=lambda: [table, *blocks])
        self.table = table
        self.robot = SimpleNamespace(gripper_joint_ids=[9, 10], end_effector_link_id=7, gripper_action=1,
                                     target_pos=np.zeros(3), target_orn=np.zeros(3))

    def reset(self, robot_obs, scene_obs):
        self.head, self.obs = scene_obs[:6], robot_obs
        self.robot.target_pos = robot_obs[:3].copy()
        for i, block in enumerate(self.scene.movable_objects):
            pose = scene_obs[6 + 6 * i : 12 + 6 * i]
            turn = self.p.getQuaternionFromEuler(pose[3:])
            self.p.resetBasePositionAndOrientation(block.uid, pose[:3], turn)
        self.p.stepSimulation()
        return self.get_obs()

    def get_obs(self):
        poses = [self.p.getBasePositionAndOrientation(b.uid) for b in self.scene.movable_objects]
        scene = np.concatenate([self.head, *[[*at, *self.p.getEulerFromQuaternion(turn)] for at, turn in poses]])
        rgb = {}
        for camera in self.cameras:
            image = self.p.getCameraImage(camera.width, camera.height, renderer=self.p.ER_TINY_RENDERER)
            rgb["rgb_" + camera.name] = np.reshape(image[2], (camera.height, camera.width, 4))[:, :, :3]
        return {"rgb_obs": rgb, "robot_obs": np.array([*self.obs[:14], self.robot.gripper_action]), "scene_obs": scene}

    def get_info(self):
        blocks = {}
        for b in self.scene.movable_objects:
            at, turn = self.p.getBasePositionAndOrientation(b.uid)
            linear, angular = self.p.getBaseVelocity(b.uid)
            blocks[b.name] = {"uid": b.uid, "current_pos": at, "current_orn": turn, "current_lin_vel": linear,
                              "current_ang_vel": angular, "contacts": self.p.getContactPoints(bodyA=b.uid)}
        fixed = {"table": {"uid": self.table.uid, "links": {"base_link": -1, "drawer_link": 0, "plank_link": 2}}}
        doors = {"base__slide": {"current_state": self.head[0]}, "base__drawer": {"current_state": self.head[1]}}
        lights = {"lightbulb": {"logical_state": self.head[4]}, "led": {"logical_state": self.head[5]}}
        scene = {"movable_objects": blocks, "fixed_objects": fixed, "doors": doors, "lights": lights}
        return {"robot_info": {"uid": 99, "contacts": ()}, "scene_info": scene}

    def step(self, action):
        assert action[6] in (-1, 1)
        self.robot.gripper_action = action[6]
        red = next(b for b in self.scene.movable_objects if b.name == "block_red")
        for _ in range(8):
            self.p.applyExternalForce(red.uid, -1, [6 * action[0], 0, 0], [0, 0, 0], self.p.LINK_FRAME)
            self.p.stepSimulation()
        return self.get_obs(), 0, False, self.get_info()
"""


def _python() -> str:
    named = os.environ.get("BETTER_CALVIN_PYTHON")
    world = world_named("calvin").installation
    if named is None and not world.is_installed:
        pytest.skip("`better worlds install calvin` or BETTER_CALVIN_PYTHON")
    return named or str(world.folder / "bin" / "python")


SCENE_A = """
objects:
  movable_objects:
    block_pink: {file: blocks/block_pink_small.urdf, initial_pos: any, initial_orn: any}
    block_blue: {file: blocks/block_blue_big.urdf, initial_pos: any, initial_orn: any}
    block_red: {file: blocks/block_red_middle.urdf, initial_pos: any, initial_orn: any}
"""


@pytest.fixture(scope="module")
def command(tmp_path_factory):
    return _command(_checkout(tmp_path_factory.mktemp("calvin_env")))


def _command(checkout):
    return (_python(), "-c", start_code("betterbench.sim.worlds.calvin.simulator"), str(checkout), "", "")


def _checkout(checkout):
    git = shutil.which("git")
    for name, text in CONF.items():
        (checkout / "conf" / name).parent.mkdir(parents=True, exist_ok=True)
        (checkout / "conf" / name).write_text(text)
    (checkout / "calvin_env" / "envs").mkdir(parents=True)
    for folder in ("calvin_env", "calvin_env/envs"):
        (checkout / folder / "__init__.py").touch()
    (checkout / "calvin_env" / "envs" / "play_table_env.py").write_text(ENVIRONMENT)
    who = ["-c", "user.name=nobody", "-c", "user.email=nobody@localhost"]
    for words in (["init", "-q"], ["add", "-A"], [*who, "commit", "-qm", "first"]):
        subprocess.run([git, "-C", checkout, *words], check=True)
    return checkout


def _plan(checkout):
    return make_world_plan("python:none.py:None", suite="calvin", command=_command(checkout))


def _scene(command, processes, number):
    plan = make_world_plan("python:none.py:None", suite="calvin", command=command, trials=2)
    return plan.world.open_scene(
        processes, task="calvin", condition="base", seed=number, action_space=CALVIN_RELATIVE, images=True
    )


@pytest.mark.slow
def test_the_process_composes_the_configuration_and_plays_chains_that_leave_nothing(command):
    processes = WorldProcesses(command)
    played = {}
    for number in (0, 1, 0):
        scene = _scene(command, processes, number)
        state = scene.reset()
        start = start_of(calvin_chains()[number].start).scene
        for i, block in enumerate(("block_red", "block_blue", "block_pink")):
            assert np.allclose(state.positions[state.info.index(block)][:2], start[6 + 6 * i : 8 + 6 * i], atol=1e-3)
        sizes = {o.name: o.size_m for o in state.info.objects}
        assert sizes["block_pink"][0] == pytest.approx(0.08, abs=0.003)
        assert sizes["block_blue"][0] == pytest.approx(0.04, abs=0.003)
        assert scene.images()["front"].shape == (200, 200, 3)
        assert scene.images()["wrist"].shape == (84, 84, 3)
        rows = [scene.simulator_state()["qpos"]]
        for _ in range(5):
            scene.step(np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0]))
            rows.append(scene.simulator_state()["qpos"])
        assert {c.a for c in scene.state().contacts} | {c.b for c in scene.state().contacts} >= {"block_blue", "table"}
        assert rows[0][14] == 1.0
        assert rows[1][14] == -1.0
        here = np.array(rows)
        assert np.abs(here[-1, 15:] - here[0, 15:]).max() > 0.001
        if number in played:
            assert here.tobytes() == played[number].tobytes()
        played[number] = here
        scene.close(well=True)
    versions = scene.engine
    assert versions["pybullet"] == "3.2.7"
    assert versions["renderer"] == "TinyRenderer"
    assert len(versions["calvin_env"]) == 40
    processes.close()


@pytest.mark.slow
def test_a_checkout_that_cannot_play_scene_d_is_refused_with_the_reason(tmp_path):
    """Hydra's own message names neither the module nor the cause."""
    checkout = _checkout(tmp_path / "calvin_env")
    scene = checkout / "conf" / "scene" / "calvin_scene_D.yaml"
    right = scene.read_text()
    scene.write_text(SCENE_A)  # as before calvin_env@93aeae6, where A and D had each other's names
    with pytest.raises(WorldError, match=r"the blocks of scene A \(pink small, blue big, red middle\)"):
        _plan(checkout)
    scene.write_text(right)
    module = checkout / "calvin_env" / "envs" / "play_table_env.py"
    text = module.read_text()
    module.write_text("import a_module_of_nobody\n" + text)
    with pytest.raises(WorldError, match=r"No module named 'a_module_of_nobody'.*uv pip install --python"):
        _plan(checkout)
    module.write_text(text)
    shutil.rmtree(checkout / ".git")
    with pytest.raises(WorldError, match=r"is not in a git repository.*Clone calvin_env with git"):
        _plan(checkout)
